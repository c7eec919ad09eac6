"""The two arms align the parts by sight: cameras, compensator, impedance control (section 5)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, Final, Literal, NamedTuple

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import Diagram, DiagramBuilder, InputPort, LeafSystem, OutputPort
from pydrake.systems.primitives import ConstantVectorSource

from diagrams.cell.cell_vision import CameraSettings, add_cell_vision, camera_placement
from diagrams.cell.part_shapes import add_part_shapes
from diagrams.cell.work_cell import (
    ARMS,
    HOLE_ARM,
    ArmName,
    ArmSettings,
    WorkCell,
    WorkCellScenario,
    add_work_cell,
)
from models.camera import CameraPlacement, View
from models.validation import ParameterError, require_one_of, require_positive
from systems.force.arm_model import Vector3
from systems.force.compensated_pose import CompensatedPose
from systems.force.impedance_controller import ImpedanceControllerParams
from systems.force.stoppable_motion import StoppableMotion
from systems.pose import pose_vector
from systems.servo.compensator import AxisParams, CompensatorParams, TrajectoryCompensator
from systems.servo.sampled_pid import PidGains, SampledPid, SampledPidParams

Compensated = Literal["peg", "hole", "both", "none"]
ControllerKind = Literal["fsm", "pid"]

_SHARES: Final[dict[Compensated, dict[ArmName, float]]] = {
    "peg": {"peg": 1.0, "hole": 0.0},
    "hole": {"peg": 0.0, "hole": -1.0},
    "both": {"peg": 0.5, "hole": -0.5},
    "none": {"peg": 0.0, "hole": 0.0},
}


@dataclass(frozen=True, kw_only=True)
class SixAxisSettings:
    """The compensator's elements: errors in pixels or rad, increments in m or rad.

    They follow from the settling theorem and the measured response of the arms, see
    :mod:`analysis.cell.arm_response`.
    """

    lateral: AxisParams = field(
        default_factory=lambda: AxisParams(
            dead_zone=0.4, large_error=4.5, increment=1e-4, limit=0.03
        )
    )
    rotational: AxisParams = field(
        default_factory=lambda: AxisParams(
            dead_zone=0.008, large_error=0.13, increment=4e-3, limit=0.3
        )
    )

    @property
    def axes(self) -> tuple[AxisParams, ...]:
        """The six elements in the order of :data:`systems.vision.image_plane_error.AXES`."""
        return (self.lateral,) * 3 + (self.rotational,) * 3


@dataclass(frozen=True, kw_only=True)
class SixAxisPid:
    """The baseline's gains: m per pixel and rad per rad, per s for the integral part.

    By SIMC for a closed loop of 0.05 s, about the dead time:
    :mod:`analysis.cell.arm_response`.
    """

    lateral: PidGains = PidGains(proportional=3.96e-4, integral=4.7e-3, limit=0.03)
    rotational: PidGains = PidGains(proportional=1.36, integral=10.9, limit=0.3)

    @property
    def axes(self) -> tuple[PidGains, ...]:
        """The six laws, in the order of the compensator's elements."""
        return (self.lateral,) * 3 + (self.rotational,) * 3


@dataclass(frozen=True, kw_only=True)
class ControllerChoice:
    """What makes compensation of the cameras' errors."""

    kind: ControllerKind = "fsm"  # its parameters: the scenario's compensator; of a PID its pid

    def __post_init__(self) -> None:
        require_one_of(self, "kind", ("fsm", "pid"))


@dataclass(frozen=True, kw_only=True)
class AlignmentScenario(WorkCellScenario):
    """The arms hold the parts at a distance, and the cameras align them (Figs. 12 to 14)."""

    compensated: Compensated = "both"  # which arm takes the compensation, section 5
    controller: ControllerChoice = ControllerChoice()
    cameras: CameraSettings = field(default_factory=CameraSettings)
    compensator: SixAxisSettings = field(default_factory=SixAxisSettings)
    pid: SixAxisPid = field(default_factory=SixAxisPid)
    initial_error: tuple[float, ...] = (0.0, 0.006, -0.008, 0.0, 0.05, -0.06)
    # m and rad, of the peg's commanded pose, as errors of the kinematic model make it; assumed
    start_offset: Vector3 = (0.0, 0.0, 0.0)  # m, from the peg's goal to where it starts
    motion_time: float = 2.0  # s, from there to the goal
    begin: float = 1.5  # s, of the compensation; until then impedance control alone
    compensation_time: float = 2.5  # s, section 5

    RENAMED: ClassVar[Mapping[str, str]] = {"controller": "controller.kind"}

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "compensated", tuple(_SHARES))
        require_positive(self, "begin", "compensation_time", "motion_time")
        for name, size in (("initial_error", 6), ("start_offset", 3)):
            value = getattr(self, name)
            if len(value) != size or not all(map(math.isfinite, value)):
                raise ParameterError(name, value, f"{size} finite numbers")

    @property
    def duration(self) -> float:
        """When the run ends, s."""
        return self.begin + self.compensation_time

    @property
    def moves(self) -> bool:
        """Whether the peg has a way to go."""
        return any(self.start_offset)

    def placement(self, view: View) -> CameraPlacement:
        """Return where a camera stands: it looks at the middle of the gap."""
        return camera_placement(self.cameras, self, view)


class _Motion(NamedTuple):
    """A desired motion before the compensation."""

    pose: OutputPort
    velocity: OutputPort | None  # None: at rest
    stop: InputPort | None  # None: has nothing to stop


def make_alignment_diagram(scenario: AlignmentScenario) -> Diagram:
    """Return the work cell with the vision loop closed (Fig. 10).

    The tools carry the shapes of the parts, for whoever adds a visualizer.

    Outputs: ``<arm>.true_pose``, ``<arm>.tool_pose``, ``<arm>.desired_pose`` (before error and
    compensation), ``<arm>.command``, ``<arm>.encoders``, ``<arm>.saturated``; of the vision
    ``error`` (pixels and rad), ``valid``, ``age`` and ``blind``; ``compensation`` (m and rad,
    world axes, of the peg relative to the hole).
    """
    builder = DiagramBuilder()
    connect = builder.Connect
    start: dict[ArmName, RigidTransform] = {"peg": _start(scenario)} if scenario.moves else {}
    cell = add_work_cell(
        builder, scenario, start=start, add_parts=partial(add_part_shapes, scenario)
    )
    motions = {arm: _add_motion(builder, scenario, arm) for arm in ARMS}
    error = add_cell_vision(
        builder,
        scenario,
        scenario.cameras,
        poses={arm: cell.arms[arm].true_pose for arm in ARMS},
        begin=scenario.begin,
        desired={arm: motions[arm].pose for arm in ARMS} if scenario.moves else None,
    )
    controller = _add_controller(builder, scenario)
    connect(error.GetOutputPort("error"), controller.GetInputPort("error"))
    connect(error.GetOutputPort("valid"), controller.GetInputPort("valid"))
    compensation = controller.GetOutputPort("compensation")
    for arm in ARMS:
        _command(builder, scenario, cell, arm, motions[arm], compensation)
        if (stop := motions[arm].stop) is not None:
            connect(error.GetOutputPort("blind"), stop)
    for name in ("error", "valid", "age", "blind"):
        builder.ExportOutput(error.GetOutputPort(name), name)
    builder.ExportOutput(compensation, "compensation")
    diagram = builder.Build()
    diagram.set_name("Alignment by sight")
    return diagram


def _start(scenario: AlignmentScenario) -> RigidTransform:
    goal = scenario.nominal_pose("peg")
    return RigidTransform(goal.rotation(), goal.translation() + np.array(scenario.start_offset))


def _add_motion(builder: DiagramBuilder, scenario: AlignmentScenario, arm: ArmName) -> _Motion:
    goal = scenario.nominal_pose(arm)
    if arm == "peg" and scenario.moves:
        motion = builder.AddNamedSystem(
            "peg desired motion",
            StoppableMotion(
                _start(scenario).translation(),
                goal,
                scenario.motion_time,
                scenario.cameras.frames.period,
            ),
        )
        return _Motion(
            motion.GetOutputPort("desired_pose"),
            motion.GetOutputPort("desired_velocity"),
            motion.GetInputPort("stop"),
        )
    pose = builder.AddNamedSystem(f"{arm} desired pose", ConstantVectorSource(pose_vector(goal)))
    return _Motion(pose.get_output_port(), None, None)


def _add_controller(builder: DiagramBuilder, scenario: AlignmentScenario) -> LeafSystem:
    period = scenario.cameras.frames.period
    if scenario.controller.kind == "fsm":
        fsm = CompensatorParams(axes=scenario.compensator.axes, period=period)
        return builder.AddNamedSystem("trajectory compensator", TrajectoryCompensator(fsm))
    pid = SampledPidParams(axes=scenario.pid.axes, period=period)
    return builder.AddNamedSystem("PID", SampledPid(pid))


def _command(
    builder: DiagramBuilder,
    scenario: AlignmentScenario,
    cell: WorkCell,
    arm: ArmName,
    motion: _Motion,
    compensation: OutputPort,
) -> None:
    """Command an arm: where it should be, its error, and its share of the compensation."""
    connect, ports = builder.Connect, cell.arms[arm]
    desired = motion.pose
    if arm == "peg" and any(scenario.initial_error):
        # The wrong pose that a wrong kinematic model makes of the right one.
        off = builder.AddNamedSystem("peg kinematic error", CompensatedPose(1.0))
        error = builder.AddNamedSystem(
            "initial error", ConstantVectorSource(np.array(scenario.initial_error))
        )
        connect(desired, off.GetInputPort("desired_pose"))
        connect(error.get_output_port(), off.GetInputPort("compensation"))
        desired = off.get_output_port()
    command = builder.AddNamedSystem(
        f"{arm} command", CompensatedPose(_SHARES[scenario.compensated][arm])
    )
    connect(desired, command.GetInputPort("desired_pose"))
    connect(compensation, command.GetInputPort("compensation"))
    connect(command.get_output_port(), ports.desired_pose)
    if motion.velocity is not None:
        connect(motion.velocity, ports.desired_velocity)
    builder.ExportOutput(motion.pose, f"{arm}.desired_pose")
    builder.ExportOutput(command.get_output_port(), f"{arm}.command")
    for name in ("true_pose", "tool_pose", "encoders", "saturated"):
        builder.ExportOutput(getattr(ports, name), f"{arm}.{name}")


@dataclass(frozen=True, kw_only=True)
class VerticalTrackingScenario(AlignmentScenario):
    """The peg's tip goes up to the hole's height, 10 cm away from it (Fig. 11).

    The way is not published: assumed.
    """

    compensated: Compensated = "peg"
    hole: ArmSettings = replace(HOLE_ARM, payload_error=0.0)  # exactly at the height, section 5
    impedance: ImpedanceControllerParams = field(
        default_factory=lambda: ImpedanceControllerParams(stiffness=(700.0, 700.0, 700.0))
    )  # about 700 N/m, section 5
    compensator: SixAxisSettings = field(
        default_factory=lambda: SixAxisSettings(
            rotational=AxisParams(dead_zone=0.009, large_error=0.14, increment=4e-3, limit=0.3)
        )
    )
    gap: float = 0.1  # m, section 5
    initial_error: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    start_offset: Vector3 = (0.0, 0.0, -0.03)
    begin: float = 0.1
    compensation_time: float = 3.9
