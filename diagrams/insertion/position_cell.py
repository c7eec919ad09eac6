"""One arm that takes positions, a force sensor at its wrist, and a fixture with the hole."""

from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import numpy as np
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.multibody.tree import FixedOffsetFrame, RigidBody, SpatialInertia
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, MatrixGain

from chamfer.diagrams.cell.alignment_scenario import offset_pose, true_pose, wrong_pose
from chamfer.diagrams.cell.sprung_tool import Springs, add_springs
from chamfer.diagrams.cell.work_cell import AddParts, ArmName, ArmPorts, WorkCell, add_fixture
from chamfer.diagrams.contact.sensing import add_sensor
from chamfer.diagrams.insertion.cell_contact import TouchingParts
from chamfer.models.arms.wrist import SIZE, add_wrist, in_joint_order, moved, tip_displacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import (
    require_between,
    require_not_negative,
    require_positive,
    within,
)
from chamfer.systems.contact.peg_hole_contact_monitor import PegHoleContactMonitor
from chamfer.systems.force.arm_model import TruePose
from chamfer.systems.force.contact_admittance import ContactAdmittanceLaw, WristSetting
from chamfer.systems.force.wrist_wrench import WRIST_AXES, ContactAdmittance, TurnedToSensor
from chamfer.systems.pose import pose_vector
from chamfer.systems.sensing.force_sensor import Matrix6, WrenchSensorParams
from chamfer.systems.servo.joint_servo import JointServo

if TYPE_CHECKING:
    from chamfer.diagrams.insertion.insertion import ResolvedInsertionScenario

_LATEST: Final = 0.1  # s, of a reading: beyond it the unit is wrong
_NO_CROSS_TALK: Final[Matrix6] = tuple(map(tuple, np.eye(SIZE).tolist()))


@dataclass(frozen=True, kw_only=True)
class WristSensorParams(WrenchSensorParams):
    """The six-axis sensor between flange and tool; its axes go with the arm. All is assumed."""

    rate: float = 500.0  # Hz, of its readings
    noise: float = 0.5  # N, half-width of a uniform noise, new each reading
    bias: float | tuple[float, ...] = 1.0  # N, of every channel; or of each one, N and N m
    drift: float = 0.02  # N/s^0.5, of the bias, a random walk
    bandwidth: float = 100.0  # Hz, of the first-order filter before the converter
    delay: float = 0.001  # s, of the reading behind the filter
    resolution: float = 0.05  # N, of the converter
    full_scale: float = 200.0  # N, larger readings saturate
    tare: float = 0.0
    cross_talk: Matrix6 = _NO_CROSS_TALK
    origin: tuple[float, float, float] = (0.0, 0.0, 0.1)
    # m, where moments are taken, from the peg's tip, z away from the hole
    tool_mass: float | None = None  # kg, believed; None: the mass of tool and device

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "rate")
        require_between(self, 0.0, _LATEST, "delay", unit="s")
        require_not_negative(self, "tool_mass")


class Sensed(NamedTuple):
    """The arm's knowledge of its load and its path."""

    force: OutputPort  # N, of the tool on what it touches, along the hole's axes, shape (3,)
    advance: OutputPort  # m, beyond the mouth along its axis, size 1
    tares: InputPort | None = None  # 1 while a sensor's zero is taken, size 1; None: no sensor


def add_position_cell(
    builder: DiagramBuilder,
    scenario: "ResolvedInsertionScenario",
    parts: ColouredParts,
    *,
    seated_depth: float,
    add_parts: AddParts,
) -> tuple[WorkCell, PegHoleContactMonitor, Sensed]:
    """Add the arm, its sensor and its admittance, the fixture, and the parts that touch.

    The peg starts at the scenario's begin, at rest; ``parts`` are those that are there. Exported
    is ``wrist_wrench``, the true one of the tool on its springs about the tip, N m above N, (6,).
    """
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, scenario.step)
    plant.set_name("arms")
    scene_graph.set_name("geometry")
    X_TS = WRIST_AXES
    rest = scenario.nominal_pose("peg") @ X_TS
    carrier = FixedOffsetFrame("flange at rest", plant.world_frame(), rest)
    held = add_wrist(plant, plant.AddFrame(carrier), scenario.wrist)
    plant.set_gravity_enabled(held.instance, True)
    peg = plant.AddRigidBody("peg", held.instance, SpatialInertia.Zero())
    plant.WeldFrames(held.body.body_frame(), peg.body_frame(), X_TS.inverse())
    tools: dict[ArmName, RigidBody] = {"peg": peg, "hole": add_fixture(plant, scenario, "hole")}
    add_parts(plant, tools)
    touching = TouchingParts(parts, scenario.contact, scenario.approximation)
    touching.add(plant, tools["peg"], tools["hole"])
    plant.Finalize()

    model, start = scenario.peg.known_arm(), offset_pose(scenario, 1.0)
    posture = model.joint_positions(start, scenario.rest_posture("peg"))
    # What the arm does not know of: where its base is, and the hole.
    off = wrong_pose(scenario, at_gap := scenario.nominal_pose("peg")) @ at_gap.inverse()
    X_WT = true_pose(scenario, "peg", off @ start)
    servo = JointServo(
        scenario.arm.servo,
        model,
        posture,
        step=scenario.step,
        rest=rest,
        X_TS=X_TS,
        true=X_WT @ start.inverse(),
    )
    at_start = in_joint_order() @ moved(
        tip_displacement(rest.inverse() @ X_WT @ X_TS), scenario.wrist.centre
    )
    plant.SetDefaultPositions(held.instance, at_start)
    builder.AddNamedSystem("joint servos", servo)
    springs = add_springs(builder, plant, held, scenario.wrist)
    connect, hole_pose = builder.Connect, pose_vector(scenario.nominal_pose("hole"))
    connect(servo.GetOutputPort("motion"), springs.desired)
    place = ConstantVectorSource(hole_pose)
    fixture = builder.AddNamedSystem("hole fixture", place).get_output_port()
    tool = scenario.peg.tool
    believed = scenario.sensor.tool_mass
    setting = WristSetting(
        R_WH=scenario.hole_axes.matrix(),
        R_TS=WRIST_AXES.rotation().matrix(),
        tool_mass=scenario.tool_mass if believed is None else believed,
        p_TC=np.array(tool.centre_of_mass),
        hole_pose=hole_pose,
        period=scenario.arm.servo.period,
    )
    law = ContactAdmittanceLaw(scenario.admittance, setting)
    admittance = builder.AddNamedSystem("admittance", ContactAdmittance(law))
    true = builder.AddNamedSystem("peg true pose", TruePose(peg.index()))
    tool_pose = servo.GetOutputPort("tool_pose")
    reading = _add_wrist_sensor(builder, scenario, servo, springs)
    connect(reading, admittance.GetInputPort("reading"))
    connect(tool_pose, admittance.GetInputPort("tool_pose"))
    connect(admittance.GetOutputPort("reference_pose"), servo.GetInputPort("reference_pose"))
    connect(plant.get_body_poses_output_port(), true.get_input_port())
    arm = ArmPorts(
        desired_pose=admittance.GetInputPort("desired_pose"),
        desired_velocity=None,
        encoders=servo.GetOutputPort("encoders"),
        tool_pose=tool_pose,
        saturated=servo.GetOutputPort("saturated"),
        true_pose=true.GetOutputPort("pose"),
        instance=held.instance,
    )
    cell = WorkCell(
        plant,
        {"peg": arm},
        tools,
        true_poses={"peg": arm.true_pose, "hole": fixture},
        tool_poses={"peg": tool_pose, "hole": fixture},
    )
    builder.ExportOutput(springs.wrench, "wrist_wrench")
    contact = touching.monitor(builder, plant, seated_depth)
    sensed = Sensed(*map(admittance.GetOutputPort, ("force", "advance")))
    return cell, contact, sensed._replace(tares=admittance.GetInputPort("tares"))


def _add_wrist_sensor(
    builder: DiagramBuilder,
    scenario: "ResolvedInsertionScenario",
    servo: JointServo,
    springs: Springs,
) -> OutputPort:
    """Add the sensor; return the wrench on the tool about its tip, in its axes."""
    sensor, connect = scenario.sensor, builder.Connect
    turned = builder.AddNamedSystem("in the sensor's axes", TurnedToSensor())
    connect(springs.wrench, turned.GetInputPort("wrench"))
    connect(servo.GetOutputPort("motion"), turned.GetInputPort("motion"))
    felt = turned.get_output_port()
    rates = {"step": scenario.step, "period": 1 / sensor.rate}
    with within("sensor"):
        channels = add_sensor(builder, "wrist ", sensor, sensor.gauges, felt, **rates, ahead=True)
    reading = builder.AddNamedSystem("wrist sensor's reading", MatrixGain(sensor.undoing))
    connect(channels, reading.get_input_port())
    return reading.get_output_port()
