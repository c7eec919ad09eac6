"""An arm with a tool as a MultibodyPlant: the simulated arm, and a controller's model of it."""

from dataclasses import dataclass, field
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialForce
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import ExternallyAppliedSpatialForce, MultibodyPlant
from pydrake.multibody.tree import (
    BodyIndex,
    JacobianWrtVariable,
    ModelInstanceIndex,
    RotationalInertia,
    SpatialInertia,
)
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.arms.serial_arm import SerialArm, searched_posture
from chamfer.models.arms.wam import WAM
from chamfer.models.validation import ParameterError, require_numbers, require_positive
from chamfer.systems.ports import finite_input
from chamfer.systems.pose import POSE_SIZE, pose_vector

Array = NDArray[np.float64]
Vector3 = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Placement:
    """Where a frame is in another one."""

    position: Vector3 = (0.0, 0.0, 0.0)  # m
    rpy: Vector3 = (0.0, 0.0, 0.0)  # rad, about the fixed axes x, y, z in this order

    def __post_init__(self) -> None:
        require_numbers(self, 3, "position", "rpy")

    @property
    def transform(self) -> RigidTransform:
        """The same for Drake."""
        return RigidTransform(RollPitchYaw(self.rpy), np.array(self.position))


@dataclass(frozen=True, kw_only=True)
class ToolParams:
    """The body on the flange, and its frame T that the arm has to place.

    The tool frame's x axis is the direction of insertion: out of the peg at its tip, into the
    hole at its mouth.
    """

    mass: float  # kg, with its load
    centre_of_mass: Vector3  # m, in the frame T
    inertia: Vector3  # kg m^2, about the centre of mass and T's axes
    frame: Placement = field(default_factory=Placement)  # X_FT, in the flange's frame

    def __post_init__(self) -> None:
        require_positive(self, "mass")
        require_numbers(self, 3, "centre_of_mass", "inertia")
        x, y, z = self.inertia
        if not (min(x, y, z) > 0 and 2 * max(x, y, z) <= x + y + z):
            raise ParameterError(
                "inertia", self.inertia, "three numbers > 0, none more than the others' sum"
            )


def add_arm(
    plant: MultibodyPlant,
    X_WB: RigidTransform,
    tool: ToolParams,
    *,
    arm: SerialArm = WAM,
    name: str = "arm",
    mass_scale: float = 1.0,
) -> ModelInstanceIndex:
    """Add an arm with its base welded to the world and a body "tool" welded to its flange.

    The tool body's frame is T; it has no geometry. The plant is not yet finalized. The model
    instance is called ``<name>::`` and as the URDF calls the arm. ``mass_scale`` multiplies mass
    and inertia of the arm's links, not of the tool.
    """
    parser = Parser(plant, name)
    (instance,) = parser.AddModelsFromString(arm.urdf_text(mass_scale), "urdf")
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName(arm.base, instance), X_WB)
    for joint, rotor in zip(arm.joint_names, arm.rotor_inertia, strict=True):
        motor = plant.GetJointActuatorByName(f"{joint}_motor", instance)
        motor.set_default_rotor_inertia(rotor)
        motor.set_default_gear_ratio(1.0)
    inertia = SpatialInertia.MakeFromCentralInertia(
        tool.mass, np.array(tool.centre_of_mass), RotationalInertia(*tool.inertia)
    )
    body = plant.AddRigidBody("tool", instance, inertia)
    plant.WeldFrames(
        plant.GetFrameByName(arm.flange, instance), body.body_frame(), tool.frame.transform
    )
    return instance


class ToolState(NamedTuple):
    """The quantities that a controller needs at joint positions q; of n joints."""

    X_WT: RigidTransform  # the tool frame
    J_V_WT: Array  # (6, n), rad/s above m/s, of T's origin, in the world's axes
    mass: Array  # (n, n), kg m^2, reflected inertias included
    gravity: Array  # (n,), N m, the torque that holds the arm at rest


class ArmModel:
    """Evaluates pose, Jacobian, mass matrix and gravity torque of an arm with a tool."""

    def __init__(self, X_WB: RigidTransform, tool: ToolParams, arm: SerialArm = WAM) -> None:
        plant = MultibodyPlant(0.0)
        add_arm(plant, X_WB, tool, arm=arm)
        plant.Finalize()
        self.arm = arm
        self._X_BW = X_WB.inverse()
        self._X_TF = tool.frame.transform.inverse()
        self._plant = plant
        self._context = plant.CreateDefaultContext()
        self._world = plant.world_frame()
        self._tool = plant.GetFrameByName("tool")
        self._origin = np.zeros(3)

    def kinematics(self, q: Array) -> tuple[RigidTransform, Array]:
        """Return pose and Jacobian of the tool frame alone, as :class:`ToolState` has them."""
        plant, context, world = self._plant, self._context, self._world
        plant.SetPositions(context, q)
        return (
            self._tool.CalcPoseInWorld(context),
            plant.CalcJacobianSpatialVelocity(
                context, JacobianWrtVariable.kV, self._tool, self._origin, world, world
            ),
        )

    def evaluate(self, q: Array) -> ToolState:
        """Return the state at joint positions q, rad, shape (n,)."""
        pose, plant, context = self.kinematics(q), self._plant, self._context
        return ToolState(
            *pose, plant.CalcMassMatrix(context), -plant.CalcGravityGeneralizedForces(context)
        )

    def joint_positions(self, X_WT: RigidTransform, near: Array | None) -> Array:
        """Return joint positions, rad, shape (n,), that put the tool frame at a pose.

        As :meth:`SerialArm.joint_positions`, or, for None, :func:`searched_posture` does.
        """
        X_BF = self._X_BW @ X_WT @ self._X_TF
        R, p = X_BF.rotation().matrix(), X_BF.translation()
        if near is None:
            return searched_posture(self.arm, R, p, self._X_BW.rotation().matrix()[:, 2])
        return self.arm.joint_positions(R, p, near)


class TruePose(LeafSystem):
    """Selects the true pose of one body of a plant; for logs, not for controllers.

    .. pydrake_system::

        name: TruePose
        input_ports:
        - body_poses
        output_ports:
        - pose

    ``body_poses`` is the plant's port of that name, ``pose`` the body's quaternion (w, x, y, z)
    with w >= 0 and its position in the world, m, shape (7,).
    """

    def __init__(self, body: BodyIndex) -> None:
        super().__init__()
        poses = self.DeclareAbstractInputPort("body_poses", Value[list[RigidTransform]]())

        def calc(context: Context, output: BasicVector) -> None:
            output.SetFromVector(pose_vector(poses.Eval(context)[int(body)]))

        self.DeclareVectorOutputPort("pose", POSE_SIZE, calc, {poses.ticket()})


class ToolForce(LeafSystem):
    """Applies a wrench to a body at its origin.

    .. pydrake_system::

        name: ToolForce
        input_ports:
        - wrench
        output_ports:
        - spatial_forces

    ``wrench``, shape (6,), N m above N, world axes. ``spatial_forces`` goes to the plant's
    ``applied_spatial_force``.

    Raises:
        ParameterError: In a run if the wrench is not finite.
    """

    def __init__(self, body: BodyIndex) -> None:
        super().__init__()
        wrench = self.DeclareVectorInputPort("wrench", 6)

        def calc(context: Context, output: Any) -> None:
            value = finite_input(wrench, context)
            force = ExternallyAppliedSpatialForce()
            force.body_index = body
            force.F_Bq_W = SpatialForce(tau=value[:3], f=value[3:])
            output.set_value([force])

        def make() -> Any:
            return Value[list[ExternallyAppliedSpatialForce]]()

        self.DeclareAbstractOutputPort("spatial_forces", make, calc, {wrench.ticket()})


def tool_friction(J_V_WT: Array, dry_friction: Array) -> tuple[Array, Array]:
    """Return friction's largest wrench at rest, and in motion, N m above N, (6,) each.

    Up to ``min_i tau_i / |J_i e|`` no joint moves if the tool is pushed so and not otherwise. A
    motion takes the power that the joints lose over the speed, ``sum_i tau_i |(J^+ e)_i|``, with
    the joints' speeds of least norm: by so much springs are wound up once all joints slide. In
    between joint after joint gives way. The Jacobian, rad/s above m/s, shape (6, n), is in the
    axes that are asked for; Coulomb's friction is in N m.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        alone = dry_friction / np.abs(J_V_WT)
    # A joint that the push does not turn holds it whatever its friction is.
    turned = np.abs(J_V_WT) > 1e-6 * np.abs(J_V_WT).max()
    held: Array = np.min(np.where(turned, alone, np.inf), axis=1)
    return held, np.asarray(dry_friction @ np.abs(np.linalg.pinv(J_V_WT)), np.float64)
