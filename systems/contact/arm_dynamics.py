"""An arm's equations of motion: its links from a URDF by Drake, the rest in machine code.

Drake's MultibodyPlant takes about 40 us a state from Python, this takes about one, so that the arm
in contact can afford the whole dynamics in each of its steps. The recursions are those of
Featherstone (2008), chapters 5 and 6: composite rigid bodies for the mass matrix and
Newton-Euler for the bias, with all spatial vectors in the world's axes about its origin.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, RevoluteJoint

from chamfer.models.arms.arm import Arm
from chamfer.models.validation import ParameterError
from chamfer.systems.compiled import add_product, compiled

Array = NDArray[np.float64]


class Chain(NamedTuple):
    """An arm of n joints as it is at q = 0, in the world's axes; each joint carries one link."""

    axis: Array  # (n, 3), unit
    prismatic: NDArray[np.bool_]  # (n,), whether the joint slides along its axis
    offset: Array  # (n, 3), m, from the joint before, or the world's origin, to each joint
    mass: Array  # (n,), kg, of the links
    centre: Array  # (n, 3), m, from the joint to the link's centre of mass
    inertia: Array  # (n, 3, 3), kg m^2, about the centre of mass
    rotor: Array  # (n,), kg m^2 or kg, of the drives, as seen at the joints
    endpoint: Array  # (3,), m, from the last joint to the endpoint
    R_WE: Array  # (3, 3), rotation of the endpoint's frame
    gravity: Array  # (3,), m/s^2


class Pose(NamedTuple):
    """Where the links are."""

    twist: Array  # (n, 6), angular and linear velocity that each joint gives the links after it
    mass: Array  # (n,), kg
    moment: Array  # (n, 3), kg m, mass times centre of mass
    inertia: Array  # (n, 3, 3), kg m^2, about the world's origin
    R_WE: Array  # (3, 3)
    p_WE: Array  # (3,), m


@compiled
def add_cross(a: Array, b: Array, total: Array) -> None:
    """Add the cross product of a and b to a total."""
    total[0] += a[1] * b[2] - a[2] * b[1]
    total[1] += a[2] * b[0] - a[0] * b[2]
    total[2] += a[0] * b[1] - a[1] * b[0]


@compiled
def product(left: Array, right: Array, result: Array) -> None:
    """Fill in the product of two matrices of 3 rows and columns."""
    for i in range(3):
        for j in range(3):
            total = 0.0
            for k in range(3):
                total += left[i, k] * right[k, j]
            result[i, j] = total


@compiled
def _rotation(axis: Array, angle: float, result: Array) -> None:
    """Fill in the rotation about a unit axis (Rodrigues)."""
    x, y, z = axis[0], axis[1], axis[2]
    c, s = math.cos(angle), math.sin(angle)
    u = 1.0 - c
    result[0, 0], result[0, 1], result[0, 2] = c + u * x * x, u * x * y - s * z, u * x * z + s * y
    result[1, 0], result[1, 1], result[1, 2] = u * x * y + s * z, c + u * y * y, u * y * z - s * x
    result[2, 0], result[2, 1], result[2, 2] = u * x * z - s * y, u * y * z + s * x, c + u * z * z


@compiled
def pose(chain: Chain, q: Array) -> Pose:
    """Return where the links are at joint positions q, shape (n,)."""
    n = len(q)
    twist, moment = np.zeros((n, 6)), np.zeros((n, 3))
    inertia = np.empty((n, 3, 3))
    rotations, turn, half = np.empty((n + 2, 3, 3)), np.empty((3, 3)), np.empty((3, 3))
    rotations[0] = np.eye(3)
    place, centre = np.zeros(3), np.empty(3)
    for j in range(n):
        before, after = rotations[j], rotations[j + 1]
        add_product(before, chain.offset[j], place)
        angular, linear = twist[j, :3], twist[j, 3:]
        if chain.prismatic[j]:
            add_product(before, chain.axis[j], linear)
            for i in range(3):
                place[i] += q[j] * linear[i]
            after[:] = before
        else:
            add_product(before, chain.axis[j], angular)
            add_cross(place, angular, linear)
            _rotation(chain.axis[j], q[j], turn)
            product(before, turn, after)
        centre[:] = place
        add_product(after, chain.centre[j], centre)
        size = 0.0
        for i in range(3):
            moment[j, i] = chain.mass[j] * centre[i]
            size += moment[j, i] * centre[i]
        product(after, chain.inertia[j], half)
        product(half, after.T, inertia[j])
        for i in range(3):
            for k in range(3):
                inertia[j, i, k] -= moment[j, i] * centre[k]
            inertia[j, i, i] += size
    add_product(rotations[n], chain.endpoint, place)
    product(rotations[n], chain.R_WE, rotations[n + 1])
    return Pose(twist, chain.mass, moment, inertia, rotations[n + 1], place)


@compiled
def _momentum(mass: float, moment: Array, inertia: Array, twist: Array, total: Array) -> None:
    """Add a body's spatial momentum, or its force for an acceleration, to a total."""
    add_product(inertia, twist[:3], total[:3])
    add_cross(moment, twist[3:], total[:3])
    for i in range(3):
        total[3 + i] += mass * twist[3 + i]
    add_cross(twist[:3], moment, total[3:])


@compiled
def mass_matrix(chain: Chain, at: Pose) -> Array:
    """Return the mass matrix, shape (n, n), with the drives' rotors."""
    n = len(chain.mass)
    matrix = np.empty((n, n))
    mass, moment, inertia, force = 0.0, np.zeros(3), np.zeros((3, 3)), np.empty(6)
    for j in range(n - 1, -1, -1):
        mass += at.mass[j]
        moment += at.moment[j]
        inertia += at.inertia[j]
        force[:] = 0.0
        _momentum(mass, moment, inertia, at.twist[j], force)
        for i in range(j + 1):
            total = 0.0
            for k in range(6):
                total += at.twist[i, k] * force[k]
            matrix[i, j] = matrix[j, i] = total
        matrix[j, j] += chain.rotor[j]
    return matrix


@compiled
def link_forces(chain: Chain, at: Pose, v: Array) -> Array:
    """Return what each link takes at joint velocities v, shape (n,), that do not change.

    Moment about the world's origin, N m, and force, N, of its centripetal and Coriolis
    acceleration less its weight; shape (n, 6), world axes.
    """
    n = len(chain.mass)
    forces = np.zeros((n, 6))
    speed, rate, joint, momentum = np.zeros(6), np.zeros(6), np.empty(6), np.empty(6)
    rate[3:] = -chain.gravity
    for j in range(n):
        joint[:] = at.twist[j] * v[j]
        momentum[:] = 0.0
        speed += joint
        add_cross(speed[:3], joint[:3], rate[:3])
        add_cross(speed[:3], joint[3:], rate[3:])
        add_cross(speed[3:], joint[:3], rate[3:])
        _momentum(at.mass[j], at.moment[j], at.inertia[j], speed, momentum)
        _momentum(at.mass[j], at.moment[j], at.inertia[j], rate, forces[j])
        add_cross(speed[:3], momentum[:3], forces[j, :3])
        add_cross(speed[3:], momentum[3:], forces[j, :3])
        add_cross(speed[:3], momentum[3:], forces[j, 3:])
    return forces


@compiled
def bias(chain: Chain, at: Pose, v: Array) -> Array:
    """Return Coriolis and centripetal less gravity torque at joint velocities v, shape (n,)."""
    forces = link_forces(chain, at, v)
    n = len(forces)
    total = np.zeros(6)
    torque = np.zeros(n)
    for j in range(n - 1, -1, -1):
        for i in range(6):
            total[i] += forces[j, i]
            torque[j] += at.twist[j, i] * total[i]
    return torque


@compiled
def base_wrench(chain: Chain, at: Pose, v: Array, acceleration: Array) -> Array:
    """Return what the base gives an arm that touches nothing; rotors are no part of the links.

    For joint velocities v and accelerations, shape (n,). Moment about the world's origin, N m, and
    force, N, shape (6,), world axes.
    """
    n = len(chain.mass)
    forces = link_forces(chain, at, v)
    total, force = np.zeros(6), np.empty(6)
    mass, moment, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    for j in range(n - 1, -1, -1):
        mass += at.mass[j]
        moment += at.moment[j]
        inertia += at.inertia[j]
        force[:] = 0.0
        _momentum(mass, moment, inertia, at.twist[j], force)
        total += forces[j] + acceleration[j] * force
    return total


@compiled
def point_jacobian(at: Pose, point: Array) -> Array:
    """Return the translational Jacobian, (3, n), of a point, m, of the last link, world frame."""
    n = len(at.twist)
    jacobian = np.empty((3, n))
    for j in range(n):
        jacobian[:, j] = at.twist[j, 3:]
        add_cross(at.twist[j, :3], point, jacobian[:, j])
    return jacobian


@compiled
def potential(chain: Chain, at: Pose) -> float:
    """Return the potential energy in the field of gravity, J, zero at the world's origin."""
    total = 0.0
    for j in range(len(chain.mass)):
        for i in range(3):
            total -= at.moment[j, i] * chain.gravity[i]
    return total


GRAVITY = 9.81  # m/s^2


class ArmState(NamedTuple):
    """What the equations of motion need at one state of n joints."""

    mass: Array  # (n, n), reflected rotor inertias included
    bias: Array  # (n,), Coriolis and centripetal less gravity torque: M v' + bias = torque
    R_WE: Array  # (3, 3), rotation of the endpoint's frame
    p_WC: Array  # (3,), m, the contact point
    J_v_WC: Array  # (3, n), its translational Jacobian


class ArmDynamics:
    """Evaluates an arm's mass matrix, bias and contact point (2-1, without friction).

    The base is welded to the world; gravity is along -z; the contact point is ``contact_offset``,
    m, from the endpoint in its frame.
    """

    def __init__(
        self,
        arm: Arm,
        *,
        contact_offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        if not all(math.isfinite(value) for value in contact_offset):
            raise ParameterError("contact_offset", contact_offset, "three finite numbers")
        self.arm = arm
        self.chain = make_chain(arm)
        self.contact_offset = np.array(contact_offset)

    def evaluate(self, q: Array, v: Array) -> ArmState:
        """Return the equations of motion at joint positions q and velocities v, shape (n,)."""
        at = pose(self.chain, np.array(q, dtype=np.float64))
        point = at.p_WE + at.R_WE @ self.contact_offset
        return ArmState(
            mass_matrix(self.chain, at),
            bias(self.chain, at, np.array(v, dtype=np.float64)),
            at.R_WE,
            point,
            point_jacobian(at, point),
        )

    def orientation(self, q: Array) -> Array:
        """Return the rotation of the endpoint's frame at joint positions q, shape (3, 3)."""
        return pose(self.chain, np.array(q, dtype=np.float64)).R_WE

    def gravity_torque(self, q: Array) -> Array:
        """Return the torque that holds the arm at rest at q, shape (n,)."""
        return self.evaluate(q, np.zeros(len(q))).bias


def make_chain(arm: Arm) -> Chain:
    """Return an arm's links as its URDF has them, its base welded; gravity is along -z."""
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(arm.urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    context, world = plant.CreateDefaultContext(), plant.world_frame()
    plant.SetPositions(context, np.zeros(plant.num_positions()))
    joints = [plant.get_joint(index) for index in plant.GetJointIndices()]
    joints = [joint for joint in joints if joint.num_velocities()]
    parent, links = plant.world_body(), []
    axes, origins = [], [np.zeros(3)]
    for joint in joints:
        slides = isinstance(joint, PrismaticJoint)
        welded = {body.index() for body in plant.GetBodiesWeldedTo(parent)}
        moves = slides or isinstance(joint, RevoluteJoint)
        if not moves or joint.parent_body().index() not in welded:
            allowed = "a chain of revolute and prismatic joints"
            raise ParameterError("urdf", str(arm.urdf), allowed)
        place = joint.frame_on_parent().CalcPoseInWorld(context)
        axis = joint.translation_axis() if slides else joint.revolute_axis()
        axes.append(place.rotation() @ axis)
        origins.append(place.translation())
        parent = joint.child_body()
        welded_on = [body.index() for body in plant.GetBodiesWeldedTo(parent)]
        links.append(plant.CalcSpatialInertia(context, world, welded_on))
    rotors = np.zeros(len(joints))
    for index in plant.GetJointActuatorIndices():
        drive = plant.get_joint_actuator(index)
        reflected = drive.default_rotor_inertia() * drive.default_gear_ratio() ** 2
        rotors[drive.joint().velocity_start()] += reflected
    endpoint = plant.GetFrameByName("endpoint").CalcPoseInWorld(context)
    masses = np.array([link.get_mass() for link in links])
    centres = np.array([link.get_com() for link in links])
    about_origin = [link.CalcRotationalInertia().CopyToFullMatrix3() for link in links]
    central = [
        inertia - mass * (centre @ centre * np.eye(3) - np.outer(centre, centre))
        for inertia, mass, centre in zip(about_origin, masses, centres, strict=True)
    ]
    return Chain(
        axis=np.array(axes),
        prismatic=np.array([isinstance(joint, PrismaticJoint) for joint in joints]),
        offset=np.diff(origins, axis=0),
        mass=masses,
        centre=centres - origins[1:],
        inertia=np.array(central),
        rotor=rotors,
        endpoint=endpoint.translation() - origins[-1],
        R_WE=np.ascontiguousarray(endpoint.rotation().matrix()),
        gravity=np.array([0.0, 0.0, -GRAVITY]),
    )
