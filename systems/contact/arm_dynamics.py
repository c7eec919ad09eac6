"""An arm's equations of motion: its links from a URDF by Drake, the rest compiled."""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint, RevoluteJoint

from chamfer.models.arms.arm import Arm
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.serial_chain import Chain, bias, mass_matrix, point_jacobian, pose

Array = NDArray[np.float64]

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

    The contact point is fixed in the arm's endpoint frame.

    Args:
        arm: The arm; its base is welded to the world.
        gravity: Whether gravity acts, along -z.
        contact_offset: m, shape (3,), the contact point in the endpoint's frame.
    """

    def __init__(
        self,
        arm: Arm,
        *,
        gravity: bool = True,
        contact_offset: tuple[float, float, float] = (0.0, 0.0, 0.0),
    ) -> None:
        if not all(math.isfinite(value) for value in contact_offset):
            raise ParameterError("contact_offset", contact_offset, "three finite numbers")
        self.arm = arm
        self.chain = make_chain(arm, GRAVITY * gravity)
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


def make_chain(arm: Arm, gravity: float) -> Chain:
    """Return an arm's links as its URDF has them.

    Args:
        arm: The arm; its base is welded to the world.
        gravity: m/s^2, along -z.

    Raises:
        ParameterError: If the URDF's joints are not a chain of revolute and prismatic ones.
    """
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
        if not (slides or isinstance(joint, RevoluteJoint)) or (
            joint.parent_body().index() not in welded
        ):
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
        gravity=np.array([0.0, 0.0, -gravity]),
    )
