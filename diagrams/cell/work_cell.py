"""The work cell of Fig. 10: two WAMs that face each other, one with the peg, one with the hole.

The hole may also be fixed in the world, where one arm inserts. An arm may be another one, out of
a URDF.

Source: Ruybal, Lumia and Wood, section 4. World frame: X from the peg's arm to the hole's arm,
the direction of insertion; Z up. Its origin is below the mouth of the hole at the height of the
arms' base frames (their shoulders). The paper prints neither the bases' poses nor the joints'
positions: here the bases are 1.6 m apart, and the arms stand in the X-Z plane with their elbows
up and bent by about 100 degrees.

Insertion may also be downwards. Errors and cameras go by the axes H of the hole, x into it: the
world's own, or, downwards, x down and z ahead of the peg's arm.

Support of the peg: under impedance control an arm is a spring across the peg and one that turns
it, both about the tool's own point: the tip of the peg, or the mouth of the hole. Two arms are in
series, so that the support depends on how deep the tip is; against a fixture it is that of the
peg's arm alone. The joints' dry friction is not part of it, it is no spring: per arm nothing moves
below 0.03 N m, 0.1 N across and 0.4 N along the peg, and two-point forces are 2 to 4 times larger.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final, Literal, NamedTuple, Self, TypeVar, get_args

import numpy as np
from numpy.typing import NDArray
from pydrake.geometry import Cylinder, Meshcat, MeshcatVisualizer, MeshcatVisualizerParams
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import (
    AddMultibodyPlantSceneGraph,
    DiscreteContactApproximation,
    MultibodyPlant,
)
from pydrake.multibody.tree import (
    ModelInstanceIndex,
    PdControllerGains,
    RevoluteSpring,
    RigidBody,
    SpatialInertia,
    UnitInertia,
)
from pydrake.systems.framework import Diagram, DiagramBuilder, InputPort, OutputPort, System
from pydrake.systems.primitives import ConstantVectorSource, MatrixGain

from chamfer.models.arms.position_arm import ServoParams
from chamfer.models.arms.serial_arm import SerialArm
from chamfer.models.arms.urdf_arm import chosen_arm
from chamfer.models.cameras.camera import View
from chamfer.models.peg.part_surfaces import part_shape
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.peg.support import Support, in_series
from chamfer.models.recordings.recordings import panda_friction
from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_not_negative,
    require_numbers,
    require_one_of,
    require_positive,
    require_same,
    within,
)
from chamfer.systems.force.arm_model import (
    ArmModel,
    Placement,
    ToolParams,
    TruePose,
    Vector3,
    add_arm,
)
from chamfer.systems.force.impedance_controller import ImpedanceController
from chamfer.systems.force.impedance_law import ImpedanceControllerParams
from chamfer.systems.ports import add_fixed, require_ports
from chamfer.systems.pose import POSE_SIZE, pose_vector

Array = NDArray[np.float64]
ArmName = Literal["peg", "hole"]
HoleKind = Literal["arm", "fixture"]
InsertionAxis = Literal["horizontal", "downwards"]
AddParts = Callable[[MultibodyPlant, dict[ArmName, RigidBody]], None]

ARMS: Final[tuple[ArmName, ...]] = ("peg", "hole")

# N m s/rad, damping with which a joint sticks, up to its dry friction: at 0.1 N m it creeps by
# 1e-5 rad/s.
STICKING: Final = 1e4
_FAR: Final = 1e6  # rad, from which a spring pulls with a constant torque, to 1e-6 of it
_MOST_STEPS: Final = 100  # of the plant in a period of the controllers
# m, of the mouth: at the height of section 5; or where the peg's arm is well bent, assumed.
_MEETING_POINTS: Final[dict[InsertionAxis, Vector3]] = {
    "horizontal": (0.0, 0.0, 0.158),
    "downwards": (-0.3, 0.0, -0.3),
}


@dataclass(frozen=True, kw_only=True)
class CellArmSettings:
    """An arm, its tool, and the errors of its controller's model."""

    model: str = "wam"
    # wam, ur5e, scara, or path of a URDF with six or more revolute joints
    tool_frame: str | None = None  # its link that carries the tool; None: the arm's end
    base: Placement  # X_WB, the controller's believed pose of the base; assumed
    posture: tuple[float, ...] | None = None
    # rad, start of the search for the rest posture; None: the WAM's, assumed, or searched
    tool: ToolParams
    payload_error: float  # kg, unknown to the controller
    payload_position: Vector3  # m, of it in the tool's frame
    mass_scale: float = 1.0  # the links' masses over those in the controller's model
    base_error: Placement = field(default_factory=Placement)
    # pose of the true base in the believed one
    joint_friction: tuple[float, ...] | Literal["panda"] | None = None
    # N m, Coulomb, of each joint, mean of both directions, unknown to the controller; 0: none;
    # None: the model's; panda: measured on a Panda, with asymmetry and damping
    friction_asymmetry: tuple[float, ...] | None = None
    # forward less backward friction over their sum, from -1 to 1; None: equal
    joint_damping: tuple[float, ...] | None = None
    # N m s/rad, viscous, of each joint; None: the model's
    rotor_inertia: tuple[float, ...] | None = None
    # kg m^2, of each motor as seen at its joint; None: the model's

    def __post_init__(self) -> None:
        require_not_negative(self, "payload_error")
        require_positive(self, "mass_scale")
        n = chosen_arm(self.model, self.tool_frame).num_joints
        measured = self.joint_friction == "panda"
        if measured and n != len(panda_friction().mean):
            raise ParameterError("joint_friction", "panda", f"{n} numbers, of as many joints")
        if measured and self.friction_asymmetry is not None:
            allowed = "null: joint_friction is panda, which says it"
            raise ParameterError("friction_asymmetry", self.friction_asymmetry, allowed)
        least = {"joint_friction": 0, "joint_damping": 0, "rotor_inertia": 0}
        for name, low in {"posture": -math.inf, "friction_asymmetry": -1, **least}.items():
            values = getattr(self, name)
            if values is None or values == "panda":
                continue
            require_numbers(self, n, name)
            if min(values) < low:
                raise ParameterError(name, values, f"numbers >= {low}")
        if max(self.friction_asymmetry or (0.0,)) > 1:
            raise ParameterError("friction_asymmetry", self.friction_asymmetry, "numbers <= 1")
        require_numbers(self, 3, "payload_position")

    @property
    def arm(self) -> SerialArm:
        """The arm, with this cell's friction and rotors."""
        of_settings = "friction_asymmetry", "joint_damping", "rotor_inertia"
        own = {name: getattr(self, name) for name in of_settings}
        own["dry_friction"] = self.joint_friction
        if self.joint_friction == "panda":
            found = panda_friction()
            own["dry_friction"] = tuple(found.mean.tolist())
            own["friction_asymmetry"] = tuple(found.asymmetry.tolist())
            own["joint_damping"] = self.joint_damping or tuple(found.damping.tolist())
        said: dict[str, Any] = {name: of for name, of in own.items() if of is not None}
        return replace(chosen_arm(self.model, self.tool_frame), **said)

    def with_friction(self, factor: float) -> Self:
        """Return the arm with its dry friction scaled, in numbers."""
        own = self.arm
        return replace(
            self,
            joint_friction=tuple(factor * one for one in own.dry_friction),
            friction_asymmetry=own.friction_asymmetry,
            joint_damping=own.joint_damping,
        )

    @property
    def near(self) -> Array | None:
        """Start of the search for the rest posture, rad, shape (n,); None: no start."""
        near = self.arm.posture if self.posture is None else self.posture
        return None if near is None else np.array(near)

    def known_arm(self) -> ArmModel:
        """Return the controller's model of the arm."""
        return ArmModel(self.base.transform, self.tool, self.arm)


@dataclass(frozen=True, kw_only=True)
class HoleSettings(CellArmSettings):
    """The holder of the hole: an arm like the other one, or a fixture without an arm's fields."""

    kind: HoleKind = "arm"  # fixture: the hole is fixed in the world
    position_error: float = 0.0  # m, half-width of the believed error of a fixture across its axis
    angle_error: float = 0.0  # rad, half-width of the believed tilt of its axis

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "kind", get_args(HoleKind))
        require_not_negative(self, "position_error", "angle_error")
        if self.kind == "arm":
            for name in ("position_error", "angle_error"):
                if value := getattr(self, name):
                    raise ParameterError(name, value, "0, an arm's hole is no fixture")


# kg; calibrated: with the dry friction the peg stays 1.5 mm low at 700 N/m (Fig. 11).
_PAYLOAD_ERROR: Final = 0.0865

PEG_ARM: Final = CellArmSettings(
    base=Placement(position=(-0.8, 0.0, 0.0)),
    tool=ToolParams(
        mass=0.25,
        centre_of_mass=(-0.07, 0.0, 0.0),
        inertia=(1e-4, 3e-4, 3e-4),
        frame=Placement(position=(0.0, 0.0, 0.1), rpy=(0.0, -math.pi / 2, 0.0)),
    ),
    payload_error=_PAYLOAD_ERROR,
    payload_position=(-0.07, 0.0, 0.0),
)

HOLE_ARM: Final = HoleSettings(
    base=Placement(position=(0.8, 0.0, 0.0), rpy=(0.0, 0.0, math.pi)),
    tool=ToolParams(
        mass=0.25,
        centre_of_mass=(0.055, 0.0, 0.0),
        inertia=(1e-4, 2e-4, 2e-4),
        frame=Placement(position=(0.0, 0.0, 0.08), rpy=(math.pi, math.pi / 2, 0.0)),
    ),
    payload_error=_PAYLOAD_ERROR,
    payload_position=(0.055, 0.0, 0.0),
)


@dataclass(frozen=True, kw_only=True)
class WorkCellScenario:
    """The arms, their controllers, the parts, and where these are to meet.

    The rest posture of each arm, at which it also starts, puts its tool at its nominal pose.
    """

    peg: CellArmSettings = PEG_ARM
    hole: HoleSettings = HOLE_ARM
    parts: ColouredParts = field(default_factory=ColouredParts)
    impedance: ImpedanceControllerParams = field(default_factory=ImpedanceControllerParams)
    axis: InsertionAxis = "horizontal"  # of insertion, gravity stays where it is; or downwards
    meeting_point: Vector3 | None = None  # m, the hole's mouth; None: derived from the axis
    gap: float = 0.03  # m, from the peg's tip to the hole's mouth, section 5, alignment
    step: float = 0.002  # s, of the plant; half of it moves the parts by 1 um and 0.07 mrad

    def __post_init__(self) -> None:
        require_positive(self, "step")
        require_one_of(self, "axis", get_args(InsertionAxis))
        if self.meeting_point is not None:
            require_numbers(self, 3, "meeting_point")
        require_finite(self, "gap")
        if self.hole.kind == "fixture":
            names = [one.name for one in fields(CellArmSettings)]
            if not self.hole.payload_error:
                names.remove("payload_error")  # nothing to know of
            require_same(self.hole, type(self).hole, "hole", *names, why="a fixture is no arm")
        period = self.control_period
        steps = round(period / self.step)
        if not (1 <= steps <= _MOST_STEPS and abs(steps * self.step / period - 1) < 1e-9):
            allowed = f"a whole part of the controllers' period, {period:g} s"
            raise ParameterError("step", self.step, allowed)

    @property
    def control_period(self) -> float:
        """Period of the arms' controllers, s."""
        return self.impedance.period if self.servo is None else self.servo.period

    @property
    def servo(self) -> ServoParams | None:
        """Of an arm that takes positions; None: the arms are under impedance control."""
        return None

    @property
    def arms(self) -> tuple[ArmName, ...]:
        """The arms of the cell."""
        return ARMS if self.hole.kind == "arm" else ("peg",)

    @property
    def mouth(self) -> Vector3:
        """Position of the hole's mouth, m."""
        return _MEETING_POINTS[self.axis] if self.meeting_point is None else self.meeting_point

    @property
    def hole_axes(self) -> RotationMatrix:
        """R_WH, x into the hole; horizontal they are the world's."""
        if self.axis == "horizontal":
            return RotationMatrix()
        return RotationMatrix(np.array([[0.0, 0.0, 1.0], [0.0, 1.0, 0.0], [-1.0, 0.0, 0.0]]))

    def nominal_pose(self, arm: ArmName) -> RigidTransform:
        """Return X_WT of the aligned peg or hole, with the hole's axes."""
        p = np.array(self.mouth)
        if arm == "peg":
            p -= self.gap * self.hole_axes.matrix()[:, 0]
        return RigidTransform(self.hole_axes, p)

    def rest_posture(self, arm: ArmName) -> Array:
        """Return the joint positions, rad, shape (n,), that put an arm's tool at its place."""
        settings: CellArmSettings = getattr(self, arm)
        try:
            return settings.known_arm().joint_positions(self.nominal_pose(arm), settings.near)
        except ParameterError as error:
            reached = f"one that the {arm}'s arm reaches with an axis that is {self.axis}"
            raise ParameterError("meeting_point", self.mouth, f"{reached}; its {error}") from error


class ArmPorts(NamedTuple):
    """Where one arm of the cell is connected; sizes as in :class:`ImpedanceController`."""

    desired_pose: InputPort
    desired_velocity: InputPort | None  # None: an arm that takes positions
    encoders: OutputPort
    tool_pose: OutputPort  # as the controller takes it to be
    saturated: OutputPort
    true_pose: OutputPort  # of the tool frame, shape (7,); for logs alone
    instance: ModelInstanceIndex


class WorkCell(NamedTuple):
    """The added blocks of a builder; poses are of the frames T and M, shape (7,)."""

    plant: MultibodyPlant
    arms: dict[ArmName, ArmPorts]  # those that there are
    tools: dict[ArmName, RigidBody]  # that the parts are on, in their frames
    true_poses: dict[ArmName, OutputPort]  # for cameras and logs alone
    tool_poses: dict[ArmName, OutputPort]  # as the controllers take them to be


def add_work_cell(
    builder: DiagramBuilder,
    scenario: WorkCellScenario,
    *,
    arms: tuple[ArmName, ...] = ARMS,
    start: dict[ArmName, RigidTransform] | None = None,
    add_parts: AddParts | None = None,
    controllers: Mapping[ArmName, System] | None = None,
) -> WorkCell:
    """Add arms, in one plant, and their controllers; desired poses are left to be connected.

    A fixture is a body that is welded to the world.

    Args:
        builder: Where to.
        scenario: Parameters.
        arms: Which arms, or the hole's fixture.
        start: X_WT of tools that do not start, at rest, at their nominal poses.
        add_parts: Adds the parts' geometry to the tools' bodies before the plant is finalized.
        controllers: A user's own, in the place of an arm's impedance law. With n joints it needs
            the inputs ``encoders`` (2n,), rad and rad/s, ``desired_pose`` (7,) and
            ``desired_velocity`` (6,), and the outputs ``torque`` (n,), N m, ``tool_pose`` (7,)
            and ``saturated`` (n,).
    """
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, scenario.step)
    plant.set_name("arms")
    scene_graph.set_name("geometry")
    plant.set_discrete_contact_approximation(DiscreteContactApproximation.kLagged)
    instances, tools = add_holders(plant, scenario, arms)
    if add_parts is not None:
        add_parts(plant, tools)
    plant.Finalize()
    ports = {}
    for arm, instance in instances.items():
        model = getattr(scenario, arm).known_arm()
        q = scenario.rest_posture(arm)
        own, n = (controllers or {}).get(arm), len(q)
        controller = own or ImpedanceController(model, q, scenario.impedance)
        require_ports(
            f"{arm} controller",
            controller,
            inputs={"encoders": 2 * n, "desired_pose": POSE_SIZE, "desired_velocity": 6},
            outputs={"torque": n, "tool_pose": POSE_SIZE, "saturated": n},
        )
        if start is not None and arm in start:
            q = model.joint_positions(start[arm], q)
        plant.SetDefaultPositions(instance, q)
        ports[arm] = connect_arm(builder, plant, arm, instance, controller)
    true = {arm: one.true_pose for arm, one in ports.items()}
    known = {arm: one.tool_pose for arm, one in ports.items()}
    for arm in tools.keys() - ports.keys():
        pose = pose_vector(scenario.nominal_pose(arm))
        true[arm] = known[arm] = add_fixed(builder, f"{arm} fixture", pose)
    return WorkCell(plant, ports, tools, true, known)


def add_holders(
    plant: MultibodyPlant, scenario: WorkCellScenario, arms: tuple[ArmName, ...] = ARMS
) -> tuple[dict[ArmName, ModelInstanceIndex], dict[ArmName, RigidBody]]:
    """Add the arms, or the hole's fixture; return their instances and the tools' bodies."""
    instances, tools = {}, {}
    for arm in arms:
        if arm in scenario.arms:
            instances[arm] = add_simulated_arm(plant, arm, getattr(scenario, arm))
            tools[arm] = plant.GetBodyByName("tool", instances[arm])
        else:
            tools[arm] = add_fixture(plant, scenario, arm)
    return instances, tools


def add_fixture(plant: MultibodyPlant, scenario: WorkCellScenario, arm: ArmName) -> RigidBody:
    """Add a fixed part in the world in place of an arm's tool."""
    body = plant.AddRigidBody(
        "fixture", plant.AddModelInstance(f"{arm}_fixture"), SpatialInertia.Zero()
    )
    plant.WeldFrames(plant.world_frame(), body.body_frame(), scenario.nominal_pose(arm))
    return body


def add_simulated_arm(
    plant: MultibodyPlant, arm: str, settings: CellArmSettings
) -> ModelInstanceIndex:
    """Add an arm, at its true base, with the errors of its controller's model."""
    X_WB = settings.base.transform @ settings.base_error.transform
    instance = add_arm(
        plant,
        X_WB,
        settings.tool,
        arm=settings.arm,
        name=f"{arm}_arm",
        mass_scale=settings.mass_scale,
    )
    if settings.payload_error > 0:
        p_TP = np.array(settings.payload_position)
        inertia = SpatialInertia(settings.payload_error, p_TP, UnitInertia.PointMass(p_TP))
        payload = plant.AddRigidBody("payload", instance, inertia)
        tool = plant.GetFrameByName("tool", instance)
        plant.WeldFrames(tool, payload.body_frame(), RigidTransform())
    own = settings.arm
    rows = zip(
        own.joint_names, own.dry_friction, own.friction_bias, own.rotor_inertia, strict=True
    )
    for k, (name, torque, bias, rotor) in enumerate(rows):
        joint = plant.GetJointByName(name, instance)
        if own.joint_damping is not None:
            joint.set_default_damping(own.joint_damping[k])
        if bias:
            far = -math.copysign(_FAR, bias)
            plant.AddForceElement(RevoluteSpring(joint, far, abs(bias) / _FAR))
        if torque > 0:
            actuator = plant.AddJointActuator(f"{name}_friction", joint, torque)
            actuator.set_controller_gains(PdControllerGains(p=0.0, d=STICKING))
            # Of a joint's actuators Drake takes the last one's rotor, and no other's.
            actuator.set_default_rotor_inertia(rotor)
    return instance


def connect_arm(
    builder: DiagramBuilder,
    plant: MultibodyPlant,
    arm: str,
    instance: ModelInstanceIndex,
    controller: System,
) -> ArmPorts:
    """Add an arm's controller and its drives; the plant is finalized."""
    builder.AddNamedSystem(f"{arm} impedance control", controller)
    # Behind the motors' torques come those of the friction, which is at rest by itself.
    actuators, motors = plant.num_actuators(instance), controller.GetOutputPort("torque").size()
    drive = builder.AddNamedSystem(f"{arm} drives", MatrixGain(np.eye(actuators, motors)))
    still = ConstantVectorSource(np.zeros(2 * actuators))
    rest = builder.AddNamedSystem(f"{arm} friction at rest", still)
    tool = plant.GetBodyByName("tool", instance)
    true_pose = builder.AddNamedSystem(f"{arm} true pose", TruePose(tool.index()))
    encoders = plant.get_state_output_port(instance)
    builder.Connect(encoders, controller.GetInputPort("encoders"))
    builder.Connect(controller.GetOutputPort("torque"), drive.get_input_port())
    builder.Connect(drive.get_output_port(), plant.get_actuation_input_port(instance))
    builder.Connect(rest.get_output_port(), plant.get_desired_state_input_port(instance))
    builder.Connect(plant.get_body_poses_output_port(), true_pose.get_input_port())
    return ArmPorts(
        **{name: controller.GetInputPort(name) for name in ("desired_pose", "desired_velocity")},
        **{name: controller.GetOutputPort(name) for name in ("tool_pose", "saturated")},
        encoders=encoders,
        true_pose=true_pose.GetOutputPort("pose"),
        instance=instance,
    )


ScenarioT = TypeVar("ScenarioT", bound=WorkCellScenario)

# Shares of the largest torques: what holds an arm up leaves the rest to move it.
_MOST_HELD: Final = 0.9


def resolve_arms(scenario: ScenarioT) -> ScenarioT:
    """Fill in posture, friction and rotors of the arms, which have to reach and hold there."""
    filled: dict[str, Any] = {}
    for arm in scenario.arms:
        settings: CellArmSettings = getattr(scenario, arm)
        with within("impedance"):
            scenario.impedance.limits(settings.arm.torque_limits)
        posture = scenario.rest_posture(arm) if settings.near is None else settings.near
        filled[arm] = replace(
            settings.with_friction(1.0),
            posture=tuple(posture.tolist()),
            rotor_inertia=settings.arm.rotor_inertia,
        )
    scenario = replace(scenario, **filled)
    require_strong(scenario, 0.0)
    return scenario


def require_strong(scenario: WorkCellScenario, push: float) -> None:
    """Refuse arms whose motors don't hold them and a push, N, at their poses.

    Torque limits of the scenario's own are not looked at.
    """
    if scenario.impedance.torque_limits is not None:
        return
    wrench = np.concatenate([np.zeros(3), push * scenario.hole_axes.matrix()[:, 0]])
    for name in scenario.arms:
        settings: CellArmSettings = getattr(scenario, name)
        arm = settings.arm
        state = settings.known_arm().evaluate(scenario.rest_posture(name))
        force = wrench if name == "peg" else -wrench
        torque = np.abs(state.gravity + state.J_V_WT.T @ force)
        limits = np.array(arm.torque_limits)
        worst = int(np.argmax(torque / limits))
        if torque[worst] > _MOST_HELD * limits[worst]:
            what = f"hold itself and push with {push:g} N" if push else "hold itself"
            raise ParameterError(
                f"{name}.model",
                settings.model,
                f"an arm strong enough to {what} at its place: {arm.joint_names[worst]} has "
                f"{limits[worst]:.3g} N m, and takes {torque[worst]:.3g} N m of it",
            )


_ACROSS = {"xy": (1, 2), "xz": (2, 1)}  # the lateral axis of a plane, and the one that it turns


def support_at(scenario: WorkCellScenario, depth: float, plane: View | None = None) -> Support:
    """Return the arms' support of a peg with its tip at a depth, m.

    By default it is of the plane of insertion in which a lateral error tilts the peg more.
    """
    if plane is None:
        both = (support_at(scenario, depth, "xy"), support_at(scenario, depth, "xz"))
        return max(both, key=lambda support: abs(support.tilt_per_error))
    lateral, turn = _ACROSS[plane]
    arm = Support(
        lateral_stiffness=scenario.impedance.stiffness[lateral],
        angular_stiffness=scenario.impedance.rotational_stiffness[turn],
        centre_distance=0.0,
    )
    return arm if scenario.hole.kind == "fixture" else in_series(arm, arm, depth)


def wedging_support(scenario: WorkCellScenario) -> Support:
    """Return the support at the depth at which two points decide whether the peg can wedge."""
    parts = scenario.parts
    return support_at(scenario, parts.chamfer_height + parts.wedging_depth)


def axial_stiffness(scenario: WorkCellScenario) -> float:
    """Return the stiffness of the arms in series along the axis, N/m."""
    return scenario.impedance.stiffness[0] / len(scenario.arms)


_SIDES: Final = 96  # corners of a circle
_SEE_THROUGH: Final = 0.45  # opacity of the hole part, so that the peg is seen in the bore
_GRIP: Final = 1 / 6  # of a part's length, that its holder hides
_SHORTEST: Final = 1e-6  # m, of a holder
_WALL: Final = 0.003  # m, of a holder around its part
_HOLDER: Final = np.array([0.25, 0.27, 0.30, 1.0])  # red, green, blue, opacity


def add_part_shapes(
    scenario: WorkCellScenario, plant: MultibodyPlant, tools: dict[ArmName, RigidBody]
) -> None:
    """Add peg and hole part to their tools before Finalize; rods hold parts of arms."""
    peg, hole = scenario.parts.peg, scenario.parts.hole
    add_part_meshes(scenario.parts, plant, tools)
    ends = {"peg": (-peg.length, peg.radius), "hole": (hole.depth, hole.outer_radius)}
    for arm in scenario.arms:
        X_TF = getattr(scenario, arm).tool.frame.transform.inverse()
        _add_holder(plant, tools[arm], X_TF.translation(), *ends[arm])


def add_part_meshes(
    parts: ColouredParts, plant: MultibodyPlant, bodies: dict[ArmName, RigidBody]
) -> None:
    """Add the visible peg and a translucent hole part, in the frames of two bodies."""
    opacity: dict[ArmName, float] = {"peg": 1.0, "hole": _SEE_THROUGH}
    for part, share in opacity.items():
        profile = getattr(parts, part).closed_profile
        mesh = part_shape(profile, _SIDES, part, parts.section)
        rgba = np.array([*(np.array(getattr(parts, f"{part}_colour")) / 255), share])
        plant.RegisterVisualGeometry(bodies[part], RigidTransform(), mesh, part, rgba)


def _add_holder(
    plant: MultibodyPlant, tool: RigidBody, p_TF: Array, end: float, radius: float
) -> None:
    """Add a rod from the flange around the end of a part, so that the part is seen to be held.

    The part is as thick as its radius, m, and ends at that place along x_T, m.
    """
    p_TE = np.array([(1 - _GRIP) * end, 0.0, 0.0])
    rod = p_TE - p_TF
    length = float(np.linalg.norm(rod))
    if length < _SHORTEST:
        return
    R_TR = RotationMatrix.MakeFromOneVector(rod / length, 2)
    X_TR = RigidTransform(R_TR, (p_TE + p_TF) / 2)
    shape = Cylinder(radius + _WALL, length)
    plant.RegisterVisualGeometry(tool, X_TR, shape, "holder", _HOLDER)


def make_work_cell_view(
    scenario: WorkCellScenario, meshcat: Meshcat
) -> tuple[Diagram, MultibodyPlant]:
    """Return a diagram that shows the cell in Meshcat when it publishes, and its plant.

    The plant's positions are those of the arms, in their order.
    """
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, scenario.step)
    _, tools = add_holders(plant, scenario)
    add_part_shapes(scenario, plant, tools)
    plant.Finalize()
    params = MeshcatVisualizerParams(prefix="cell")
    MeshcatVisualizer.AddToBuilder(builder, scene_graph, meshcat, params)
    diagram = builder.Build()
    diagram.set_name("Work cell to look at")
    return diagram, plant
