"""A skill inserts a connector: primitives, accommodation, carriage, gripper and contact (Fig. 4).

Source: Morrow, Nelson and Khosla, section 4. The strategy commands ``V_cmd``; accommodation
perturbs it, ``V_ref``; the carriage follows it. World frame: origin in the middle of the socket's
face, Z up, against the direction of insertion. The paper prints no parameters: all are assumed.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import ClassVar, Final, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    Adder,
    LogVectorOutput,
    MatrixGain,
    PassThrough,
)

from chamfer.diagrams.cell.work_cell import CellArmSettings
from chamfer.diagrams.contact.sensing import Sensing
from chamfer.diagrams.skills.connector_plant import (
    STEP,
    ConnectorPlant,
    add_connector_plant,
    add_weight,
)
from chamfer.diagrams.skills.connector_sensing import add_wrench_sensor, sensor_of
from chamfer.diagrams.skills.connector_sight import SightSettings, add_sight
from chamfer.diagrams.skills.robots import ARM, RobotName, add_carriage, add_wam
from chamfer.models.arms.wrist import SIZE, WristParams, tip_pose
from chamfer.models.connectors.connector import Connector
from chamfer.models.validation import (
    ParameterError,
    require_one_of,
    require_positive,
)
from chamfer.systems.force.accommodation import AccommodationController, AccommodationParams
from chamfer.systems.force.impedance_controller import ImpedanceControllerParams
from chamfer.systems.primitives.divergence import DivergenceGuard
from chamfer.systems.primitives.gripper_block import Gripper, GripperParams, add_gripper
from chamfer.systems.primitives.skill import Skill, SkillState
from chamfer.systems.primitives.skill_check import check_forces
from chamfer.systems.primitives.skill_machine import SkillMachine
from chamfer.systems.sensing.tare import Tare
from chamfer.systems.sensing.wrench_sensor import WrenchSensorParams
from chamfer.systems.strategies.grasp_and_transport import PARTS, make_grasp_and_transport

Array = NDArray[np.float64]

LOADS: Final = "loads"  # the block that logs the true wrench at every step of the plant
# Sizes and largest elements, N and N m, or rad, m, rad/s and m/s, of what is no divergence.
_PHYSICAL: Final = {"wrench": (SIZE, 1e4), "displacement": (2 * SIZE, 1e3)}


@dataclass(frozen=True, kw_only=True)
class ConnectorScenario:
    """What all insertions have in common."""

    robot: RobotName = "carriage"  # what moves the gripper: a carriage with six axes, or a WAM
    arm: CellArmSettings = ARM  # of the WAM
    impedance: ImpedanceControllerParams = field(
        default_factory=lambda: ImpedanceControllerParams(
            stiffness=(4000.0, 4000.0, 4000.0), rotational_stiffness=(20.0, 20.0, 20.0)
        )
    )  # of the WAM; assumed
    wrist: WristParams = field(default_factory=WristParams)
    accommodation: AccommodationParams = field(default_factory=AccommodationParams)
    believed_wrist: WristParams | None = None
    # as the skill and accommodation take it to be; None: as it truly is
    sensing: Sensing = "ideal"  # what the sensor leaves open: ideal, or realistic
    sensor: WrenchSensorParams = field(default_factory=lambda: WrenchSensorParams(noise=0.17))
    # at the wrist; where its fields are None, ``sensing`` says them
    gripper: GripperParams = field(default_factory=GripperParams)
    initial_error: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    # rad above m, pose of the plug in the gripper over the one it is taken to have
    sight: SightSettings | None = field(default_factory=SightSettings)
    # None: the plug is in the gripper above the socket from the begin
    height: float = 0.008  # m, of the plug above the socket after the transport
    obstacle: float | None = None  # m, depth in the socket at which something is in the way
    step: float = STEP  # s, of the plant
    duration: float = 120.0  # s, after which a run ends at the latest

    RENAMED: ClassVar[Mapping[str, str]] = {
        "longest": "duration",
        "sensor.force_noise": "sensor.noise",
        "sensor.torque_noise": "sensor.noise",
        "sensor.force_bias": "sensor.bias",
        "sensor.torque_bias": "sensor.bias",
    }

    def __post_init__(self) -> None:
        require_one_of(self, "robot", ("carriage", "wam"))
        require_positive(self, "height", "step", "duration")
        if self.obstacle is not None and not 0 < self.obstacle < math.inf:
            raise ParameterError("obstacle", self.obstacle, "a finite number > 0, or none")
        require_one_of(self, "sensing", get_args(Sensing))
        stated, believed = self.accommodation.stiffness, self.believed.stiffness
        pairs = zip(believed, stated, strict=True)
        if not self.accommodation.allow_unstable and any(k > most for k, most in pairs):
            raise ParameterError(
                "wrist.stiffness" if self.believed_wrist is None else "believed_wrist.stiffness",
                believed,
                f"at most what accommodation.stiffness says, {stated}",
            )
        if len(self.initial_error) != SIZE or not all(map(math.isfinite, self.initial_error)):
            raise ParameterError("initial_error", self.initial_error, "six finite numbers")

    @property
    def believed(self) -> WristParams:
        """The wrist as it is believed to be."""
        return self.believed_wrist or self.wrist

    @property
    def above(self) -> tuple[float, float, float]:
        """Where the plug's tip is over the socket's face after the transport, m."""
        x, y, z = self.initial_error[3:]
        return x, y, self.height + z

    @property
    def plug_in_tool(self) -> RigidTransform:
        """X_TP, how the plug sits in the tool's frame: what the grasp is wrong by."""
        return tip_pose(np.array([*self.initial_error[:3], 0.0, 0.0, 0.0]))

    def make_grasp(self) -> tuple[SkillState, ...]:
        """Return the states that grasp and transport the plug by sight; none without sight."""
        if self.sight is None:
            return ()
        return make_grasp_and_transport(
            self.sight.motion,
            self.sight.believed,
            self.sight.servoing.with_frames(self.sight.frames.period),
            above=self.above,
            then="tare",
        )

    @property
    def start(self) -> Array:
        """Displacement of the carriage at first, rad above m, shape (6,)."""
        return self.sight.start if self.sight else np.array([0.0, 0.0, 0.0, *self.above])

    @property
    def resting(self) -> Array:
        """Displacement of the plug at first, likewise."""
        return self.sight.resting if self.sight else self.start


class SkillLoop(NamedTuple):
    """What was added to a builder."""

    skill: SkillMachine
    plant: ConnectorPlant


def add_skill_loop(
    builder: DiagramBuilder,
    scenario: ConnectorScenario,
    connector: Connector,
    skill: Skill,
) -> SkillLoop:
    """Add the skill, all that it moves and what it senses.

    It exports ``V_cmd`` and ``V_ref``, rad/s above m/s, ``wrench`` as measured and tared, N m
    above N, and ``carriage``, rad above m, shape (6,) each; ``plug``, the true displacement of the
    tip, rad above m, and its rate, shape (12,), and ``true_wrench``, what the plug touches, shape
    (6,); ``holding``,
    ``retries`` and ``state``.

    Args:
        builder: Where to.
        scenario: Parameters.
        connector: What is inserted.
        skill: How.

    Raises:
        ChartError: If the skill can't be run.
    """
    check_forces(skill, scenario.accommodation.damping, connector)
    connect = builder.Connect
    period = scenario.accommodation.period
    start, resting = scenario.start, scenario.resting
    plant = add_connector_plant(
        builder,
        connector,
        scenario.wrist,
        X_WS=RigidTransform(),
        X_TP=scenario.plug_in_tool,
        start=resting,
        step=scenario.step,
        obstacle=scenario.obstacle,
    )
    guard = builder.AddNamedSystem(
        "divergence", DivergenceGuard("connectors", limits=_PHYSICAL, period=period)
    )
    connect(plant.wrench, guard.GetInputPort("wrench"))
    connect(plant.displacement, guard.GetInputPort("displacement"))
    machine = builder.AddNamedSystem("skill", SkillMachine(skill, parts=PARTS, period=period))
    accommodation = builder.AddNamedSystem(
        "accommodation", AccommodationController(scenario.accommodation)
    )
    if scenario.robot == "carriage":
        robot = add_carriage(builder, start, scenario.step)
    else:
        robot = add_wam(builder, scenario.arm, scenario.impedance, start, scenario.step)
    gripper = add_gripper(
        builder,
        Gripper(scenario.gripper, resting=resting, offset=resting - start if skill.held else None),
        carriage=robot.motion,
        closed=machine.GetOutputPort("closed"),
    )
    sensor = sensor_of(scenario.sensor, scenario.sensing)
    reading = add_wrench_sensor(builder, sensor, plant.wrench, step=scenario.step, period=period)
    tare = builder.AddNamedSystem("tare", Tare(period=period, size=SIZE))
    wrench = tare.GetOutputPort("tared_force")
    tip = builder.AddNamedSystem("tip by encoders and stiffness", Adder(2, SIZE))
    given_way = builder.AddNamedSystem(
        "deflection of the wrist", MatrixGain(np.diag(1 / np.array(scenario.believed.stiffness)))
    )
    connect(reading, tare.GetInputPort("force"))
    connect(machine.GetOutputPort("tares"), tare.GetInputPort("tare"))
    connect(tare.GetOutputPort("spread"), machine.GetInputPort("spread"))
    connect(machine.GetOutputPort("velocity"), accommodation.GetInputPort("command"))
    connect(machine.GetOutputPort("damping"), accommodation.GetInputPort("damping"))
    connect(wrench, accommodation.GetInputPort("wrench"))
    connect(accommodation.GetOutputPort("velocity"), robot.velocity)
    if robot.reaction is not None:
        connect(plant.wrench, robot.reaction)
    if scenario.gripper.senses:
        part_sensor = builder.AddNamedSystem("gripper's part sensor", PassThrough(1))
        connect(gripper.holding, part_sensor.get_input_port())
        connect(part_sensor.get_output_port(), machine.GetInputPort("holding"))
    touched = add_weight(builder, plant, connector.mass, gripper.holding)
    connect(gripper.part, plant.desired)
    connect(wrench, given_way.get_input_port())
    connect(robot.encoders, tip.get_input_port(0))
    connect(given_way.get_output_port(), tip.get_input_port(1))
    connect(tip.get_output_port(), machine.GetInputPort("carriage"))
    connect(wrench, machine.GetInputPort("wrench"))
    connect(accommodation.GetOutputPort("velocity"), machine.GetInputPort("motion"))
    connect(accommodation.GetOutputPort("perturbed"), machine.GetInputPort("perturbed"))
    if scenario.sight is not None:
        add_sight(
            builder,
            scenario.sight,
            connector,
            X_TP=scenario.plug_in_tool,
            motion=robot.motion,
            tool_pose=plant.plug_pose,
            trigger=machine.GetOutputPort("looks"),
            detections={
                "xz": machine.GetInputPort("xz_detections"),
                "yz": machine.GetInputPort("yz_detections"),
            },
        )
    for name, port in (
        ("V_cmd", machine.GetOutputPort("velocity")),
        ("V_ref", accommodation.GetOutputPort("velocity")),
        ("wrench", wrench),
        ("carriage", robot.encoders),
        ("plug", plant.displacement),
        ("true_wrench", touched),
        ("holding", gripper.holding),
        ("retries", machine.GetOutputPort("retries")),
        ("state", machine.GetOutputPort("state")),
    ):
        builder.ExportOutput(port, name)
    loads = LogVectorOutput(touched, builder, publish_period=scenario.step)
    loads.set_name(LOADS)
    return SkillLoop(machine, plant)
