"""An arm's equations of motion: its links from a URDF by Drake, the rest in machine code.

Drake's MultibodyPlant takes about 40 us a state from Python, this takes about one, so that the arm
in contact can afford the whole dynamics in each of its steps. The recursions are those of
Featherstone (2008), chapters 5 and 6: composite rigid bodies for the mass matrix and
Newton-Euler for the bias, with all spatial vectors in the world's axes about its origin.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, RevoluteJoint

from chamfer.models.arms.arm import Arm
from chamfer.models.validation import ParameterError
from chamfer.systems.compiled import compiled, in_place

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


Three = tuple[float, float, float]
Nine = tuple[float, float, float, float, float, float, float, float, float]  # 3 rows of 3

ZERO: Final = (0.0, 0.0, 0.0)
_UNTURNED: Final = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)
_NOTHING: Final = (0.0,) * 9


@in_place
def row(matrix: Array, i: int, first: int) -> Three:
    """Return three numbers of a row."""
    return matrix[i, first], matrix[i, first + 1], matrix[i, first + 2]


@in_place
def vector(values: Array) -> Three:
    """Return the first three numbers."""
    return values[0], values[1], values[2]


@in_place
def nine(values: Array) -> Nine:
    """Return a matrix of 3 rows and columns."""
    return (
        *(values[0, 0], values[0, 1], values[0, 2]),
        *(values[1, 0], values[1, 1], values[1, 2]),
        *(values[2, 0], values[2, 1], values[2, 2]),
    )


@in_place
def nine_of(values: Array, j: int) -> Nine:
    """Return one of several matrices of 3 rows and columns."""
    return (
        *(values[j, 0, 0], values[j, 0, 1], values[j, 0, 2]),
        *(values[j, 1, 0], values[j, 1, 1], values[j, 1, 2]),
        *(values[j, 2, 0], values[j, 2, 1], values[j, 2, 2]),
    )


@in_place
def scaled(v: Three, factor: float) -> Three:
    """Return a multiple of a vector."""
    return factor * v[0], factor * v[1], factor * v[2]


@in_place
def shared(v: Three, parts: float) -> Three:
    """Return a part of a vector."""
    return v[0] / parts, v[1] / parts, v[2] / parts


@in_place
def dot(a: Three, b: Three) -> float:
    """Return the scalar product."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


@in_place
def add(a: Three, b: Three) -> Three:
    """Return the sum of two vectors."""
    return a[0] + b[0], a[1] + b[1], a[2] + b[2]


@in_place
def add_cross(a: Three, b: Three, total: Three) -> Three:
    """Add the cross product of a and b to a total."""
    return (
        total[0] + (a[1] * b[2] - a[2] * b[1]),
        total[1] + (a[2] * b[0] - a[0] * b[2]),
        total[2] + (a[0] * b[1] - a[1] * b[0]),
    )


@in_place
def add_turned(m: Nine, v: Three, total: Three) -> Three:
    """Add the product of a matrix and a vector to a total."""
    return (
        total[0] + m[0] * v[0] + m[1] * v[1] + m[2] * v[2],
        total[1] + m[3] * v[0] + m[4] * v[1] + m[5] * v[2],
        total[2] + m[6] * v[0] + m[7] * v[1] + m[8] * v[2],
    )


@in_place
def transposed(m: Nine) -> Nine:
    """Return a matrix with rows for columns."""
    return m[0], m[3], m[6], m[1], m[4], m[7], m[2], m[5], m[8]


@in_place
def product(left: Nine, right: Nine) -> Nine:
    """Return the product of two matrices."""
    a = add_turned(left, (right[0], right[3], right[6]), ZERO)
    b = add_turned(left, (right[1], right[4], right[7]), ZERO)
    c = add_turned(left, (right[2], right[5], right[8]), ZERO)
    return a[0], b[0], c[0], a[1], b[1], c[1], a[2], b[2], c[2]


@in_place
def _rotation(axis: Three, angle: float) -> Nine:
    """Return the rotation about a unit axis (Rodrigues)."""
    x, y, z = axis
    c, s = math.cos(angle), math.sin(angle)
    u = 1.0 - c
    a, b = u * x * y, u * x * z
    d = u * y * z
    return (
        *(c + u * x * x, a - s * z, b + s * y),
        *(a + s * z, c + u * y * y, d - s * x),
        *(b - s * y, d + s * x, c + u * z * z),
    )


@compiled
def no_pose(chain: Chain) -> Pose:
    """Return a pose to be filled in."""
    n = len(chain.mass)
    moment, inertia = np.empty((n, 3)), np.empty((n, 3, 3))
    return Pose(np.zeros((n, 6)), chain.mass, moment, inertia, np.empty((3, 3)), np.empty(3))


@compiled
def pose(chain: Chain, q: Array) -> Pose:
    """Return where the links are at joint positions q, shape (n,)."""
    at = no_pose(chain)
    place_links(chain, q, at)
    return at


@in_place
def place_links(chain: Chain, q: Array, at: Pose) -> None:
    """Fill in where the links are at joint positions q, shape (n,)."""
    turn, place = _UNTURNED, ZERO
    for j in range(len(q)):
        place = add_turned(turn, row(chain.offset, j, 0), place)
        own = row(chain.axis, j, 0)
        axis = add_turned(turn, own, ZERO)
        first = 3 if chain.prismatic[j] else 0
        for i in range(3):
            at.twist[j, first + i] = axis[i]
        if chain.prismatic[j]:
            place = add(place, scaled(axis, q[j]))
        else:
            linear = add_cross(place, axis, ZERO)
            for i in range(3):
                at.twist[j, 3 + i] = linear[i]
            turn = product(turn, _rotation(own, q[j]))
        centre = add_turned(turn, row(chain.centre, j, 0), place)
        moment = scaled(centre, chain.mass[j])
        inertia = product(product(turn, nine_of(chain.inertia, j)), transposed(turn))
        size = dot(moment, centre)
        for i in range(3):
            at.moment[j, i] = moment[i]
            for k in range(3):
                at.inertia[j, i, k] = inertia[3 * i + k] - moment[i] * centre[k]
            at.inertia[j, i, i] += size
    place = add_turned(turn, vector(chain.endpoint), place)
    turn = product(turn, nine(chain.R_WE))
    for i in range(3):
        at.p_WE[i] = place[i]
        for k in range(3):
            at.R_WE[i, k] = turn[3 * i + k]


@in_place
def _momentum(
    mass: float, moment: Three, inertia: Nine, angular: Three, linear: Three
) -> tuple[Three, Three]:
    """Return a body's spatial momentum, or its force for an acceleration."""
    turning = add_cross(moment, linear, add_turned(inertia, angular, ZERO))
    return turning, add_cross(angular, moment, scaled(linear, mass))


@in_place
def _with_link(
    at: Pose, j: int, mass: float, moment: Three, inertia: Nine
) -> tuple[float, Three, Nine]:
    """Return a body with a link more."""
    a, b = inertia, nine_of(at.inertia, j)
    both = (
        *(a[0] + b[0], a[1] + b[1], a[2] + b[2]),
        *(a[3] + b[3], a[4] + b[4], a[5] + b[5]),
        *(a[6] + b[6], a[7] + b[7], a[8] + b[8]),
    )
    return mass + at.mass[j], add(moment, row(at.moment, j, 0)), both


@compiled
def mass_matrix(chain: Chain, at: Pose) -> Array:
    """Return the mass matrix, shape (n, n), with the drives' rotors."""
    result = np.empty((len(chain.mass), len(chain.mass)))
    fill_mass_matrix(chain, at, result)
    return result


@in_place
def fill_mass_matrix(chain: Chain, at: Pose, result: Array) -> None:
    """Fill in the mass matrix."""
    mass, moment, inertia = 0.0, ZERO, _NOTHING
    for j in range(len(chain.mass) - 1, -1, -1):
        mass, moment, inertia = _with_link(at, j, mass, moment, inertia)
        a, b = _momentum(mass, moment, inertia, row(at.twist, j, 0), row(at.twist, j, 3))
        for i in range(j + 1):
            total = dot(row(at.twist, i, 0), a)
            for k in range(3):
                total += at.twist[i, 3 + k] * b[k]
            result[i, j] = result[j, i] = total
        result[j, j] += chain.rotor[j]


@compiled
def link_forces(chain: Chain, at: Pose, v: Array) -> Array:
    """Return what each link takes at joint velocities v, shape (n,), that do not change.

    Moment about the world's origin, N m, and force, N, of its centripetal and Coriolis
    acceleration less its weight; shape (n, 6), world axes.
    """
    forces = np.empty((len(v), 6))
    fill_link_forces(chain, at, v, forces)
    return forces


@in_place
def fill_link_forces(chain: Chain, at: Pose, v: Array, forces: Array) -> None:
    """Fill in what each link takes."""
    turning, moving, spinning = ZERO, ZERO, ZERO
    falling = scaled(vector(chain.gravity), -1.0)
    for j in range(len(v)):
        w, u = scaled(row(at.twist, j, 0), v[j]), scaled(row(at.twist, j, 3), v[j])
        turning, moving = add(turning, w), add(moving, u)
        spinning = add_cross(turning, w, spinning)
        falling = add_cross(moving, w, add_cross(turning, u, falling))
        mass, moment, inertia = at.mass[j], row(at.moment, j, 0), nine_of(at.inertia, j)
        a, b = _momentum(mass, moment, inertia, turning, moving)
        torque, force = _momentum(mass, moment, inertia, spinning, falling)
        torque = add_cross(moving, b, add_cross(turning, a, torque))
        force = add_cross(turning, b, force)
        for i in range(3):
            forces[j, i], forces[j, 3 + i] = torque[i], force[i]


@compiled
def bias(chain: Chain, at: Pose, v: Array) -> Array:
    """Return Coriolis and centripetal less gravity torque at joint velocities v, shape (n,)."""
    torque = np.empty(len(v))
    fill_bias(chain, at, v, np.empty((len(v), 6)), torque)
    return torque


@in_place
def fill_bias(chain: Chain, at: Pose, v: Array, forces: Array, torque: Array) -> None:
    """Fill in what each link takes, and the bias."""
    fill_link_forces(chain, at, v, forces)
    a, b = ZERO, ZERO
    for j in range(len(v) - 1, -1, -1):
        a, b = add(a, row(forces, j, 0)), add(b, row(forces, j, 3))
        torque[j] = dot(row(at.twist, j, 0), a)
        for i in range(3):
            torque[j] += at.twist[j, 3 + i] * b[i]


@compiled
def base_wrench(chain: Chain, at: Pose, v: Array, acceleration: Array) -> Array:
    """Return what the base gives an arm that touches nothing; rotors are no part of the links.

    For joint velocities v and accelerations, shape (n,). Moment about the world's origin, N m, and
    force, N, shape (6,), world axes.
    """
    torque, force = base_forces(at, link_forces(chain, at, v), acceleration)
    return np.array([*torque, *force])


@in_place
def base_forces(at: Pose, forces: Array, acceleration: Array) -> tuple[Three, Three]:
    """Return what the base gives, from what each link takes and joint accelerations."""
    mass, moment, inertia, torque, force = 0.0, ZERO, _NOTHING, ZERO, ZERO
    for j in range(len(acceleration) - 1, -1, -1):
        mass, moment, inertia = _with_link(at, j, mass, moment, inertia)
        a, b = _momentum(mass, moment, inertia, row(at.twist, j, 0), row(at.twist, j, 3))
        torque = add(torque, add(row(forces, j, 0), scaled(a, acceleration[j])))
        force = add(force, add(row(forces, j, 3), scaled(b, acceleration[j])))
    return torque, force


@compiled
def point_jacobian(at: Pose, point: Array) -> Array:
    """Return the translational Jacobian, (3, n), of a point, m, of the last link, world frame."""
    jacobian = np.empty((1, 3, len(at.twist)))
    fill_jacobian(at, vector(point), jacobian, 0)
    return np.ascontiguousarray(jacobian[0])


@in_place
def fill_jacobian(at: Pose, point: Three, jacobian: Array, which: int) -> None:
    """Fill in one of several Jacobians."""
    for j in range(len(at.twist)):
        column = add_cross(row(at.twist, j, 0), point, row(at.twist, j, 3))
        for i in range(3):
            jacobian[which, i, j] = column[i]


@in_place
def potential(chain: Chain, at: Pose) -> float:
    """Return the potential energy in the field of gravity, J, zero at the world's origin."""
    total = 0.0
    for j in range(len(chain.mass)):
        for i in range(3):
            total -= at.moment[j, i] * chain.gravity[i]
    return total


GRAVITY = 9.81  # m/s^2


class ArmState(NamedTuple):
    """The terms of the equations of motion at one state of n joints."""

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
