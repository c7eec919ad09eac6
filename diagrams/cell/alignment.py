"""Aligns the parts of two arms by vision: cameras, compensator, impedance control (section 5)."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Final, NamedTuple, TypeVar

import numpy as np
from pydrake.math import RigidTransform
from pydrake.systems.framework import (
    Diagram,
    DiagramBuilder,
    InputPort,
    LeafSystem,
    OutputPort,
    System,
)

from chamfer.diagrams.cell.alignment_scenario import (
    AlignmentScenario,
    Compensated,
    ResolvedAlignmentScenario,
    offset_pose,
    require_in_view,
    require_start_apart,
)
from chamfer.diagrams.cell.cell_vision import add_cell_vision, resolved_cameras
from chamfer.diagrams.cell.controller_design import resolve_controllers
from chamfer.diagrams.cell.work_cell import (
    ARMS,
    ArmName,
    WorkCell,
    add_part_shapes,
    add_work_cell,
    resolve_arms,
)
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError
from chamfer.systems.force.desired_pose import CompensatedPose, StoppableMotion
from chamfer.systems.ports import add_fixed, require_ports
from chamfer.systems.pose import pose_vector
from chamfer.systems.servo.compensator import TrajectoryCompensator
from chamfer.systems.servo.compensator_law import COMPENSATES, CompensatorParams
from chamfer.systems.servo.divergence_law import DivergenceParams, Watched
from chamfer.systems.servo.divergence_watch import DivergenceWatch
from chamfer.systems.servo.pid_law import SampledPidParams
from chamfer.systems.servo.sampled_pid import SampledPid
from chamfer.systems.vision.cell_error import AXES, NoSight

ResolvedT = TypeVar("ResolvedT", bound=ResolvedAlignmentScenario)

SHARES: Final[dict[Compensated, dict[ArmName, float]]] = {
    "peg": {"peg": 1.0, "hole": 0.0},
    "hole": {"peg": 0.0, "hole": -1.0},
    "both": {"peg": 0.5, "hole": -0.5},
    "none": {"peg": 0.0, "hole": 0.0},
}


# Dead zones, of the smallest error that may not grow by half: in ordinary runs others have become
# as large as 11 while the arms were on their way.
SEEN_IN: Final = ("pixel",) * 3 + ("rad",) * 3  # units of an error of AXES, as cameras see it
_GROWS_FROM: Final = 10.0
_WATCHED: Final = tuple(tuple(map(AXES.index, of)) for of in (("y", "z"), ("pitch", "yaw")))


class DesiredMotion(NamedTuple):
    """A desired motion before the compensation."""

    pose: OutputPort
    velocity: OutputPort | None = None  # None: at rest
    stop: InputPort | None = None  # None: has nothing to stop


def resolve(scenario: AlignmentScenario) -> ResolvedAlignmentScenario:
    """Fill in the cameras, the controllers, where and which arm is compensated."""
    return resolve_as(ResolvedAlignmentScenario, scenario)


def resolve_as(kind: type[ResolvedT], scenario: AlignmentScenario) -> ResolvedT:
    """Return a scenario resolved, as the resolved class of its own kind.

    Refused are cameras that can't be as asked, parts out of an image where the compensation begins
    or in each other before, arms out of reach, and controllers that can't be designed.
    """
    sees = scenario.cameras.kind != "none"
    if sees:
        scenario = replace(scenario, cameras=resolved_cameras(scenario.cameras, scenario))
        if scenario.cameras.kind == "hand":
            _require_in_reach(scenario)
        else:
            require_in_view(scenario)
    require_start_apart(scenario)
    usual: Compensated = "both" if scenario.hole.kind == "arm" else "peg"
    derived = {
        "compensated": scenario.compensated or (usual if sees else "none"),
        "meeting_point": scenario.mouth,
    }
    resolved = kind(**vars(resolve_arms(scenario)) | derived)
    return resolve_controllers(resolved) if sees else resolved


def _require_in_reach(scenario: AlignmentScenario) -> None:
    """Refuse a camera in the hand that looks for the mouth elsewhere than it will be."""
    if scenario.hole.kind != "fixture":
        raise ParameterError("hole.kind", scenario.hole.kind, "fixture: cameras.kind is hand")
    far, reach = math.hypot(*scenario.initial_error[1:3]), scenario.cameras.hand.reach
    if far > reach:
        allowed = f"at least {far:.3g} m, how far off initial_error puts the peg"
        raise ParameterError("cameras.hand.reach", reach, allowed)


def make_alignment_diagram(
    scenario: ResolvedAlignmentScenario,
    *,
    controller: System | None = None,
    arm_controllers: Mapping[ArmName, System] | None = None,
) -> Diagram:
    """Return the work cell with the vision loop closed (Fig. 10).

    A fixed hole has its fixed pose as command, and no encoders. The tools carry the shapes of the
    parts, for a visualizer.

    Outputs:

    - of each arm ``<arm>.true_pose``, ``<arm>.tool_pose``, ``<arm>.desired_pose`` (before error
      and compensation), ``<arm>.command``, ``<arm>.encoders``, ``<arm>.saturated``;
    - of the vision ``error`` (pixels and rad), ``valid``, ``age`` and ``blind``;
    - ``diverged``: whether the compensation has stopped because the error grew;
    - ``compensation``: m and rad, of the peg relative to the hole, in the hole's axes like the
      error.

    Args:
        scenario: Resolved.
        controller: Your own controller instead of the state machine or the PID laws. It needs the
            inputs ``error`` (6,), pixels and rad along and about the hole's axes, and ``valid``
            (1,), 1 where the error is measured, and the output ``compensation`` (6,), m and rad.
        arm_controllers: Your own controllers of the arms instead of the impedance law, see
            :func:`chamfer.diagrams.cell.work_cell.add_work_cell`.
    """
    builder = DiagramBuilder()
    connect = builder.Connect
    cell = add_work_cell(
        builder,
        scenario,
        start=start_poses(scenario),
        add_parts=partial(add_part_shapes, scenario),
        controllers=arm_controllers,
    )
    motions, error = add_sight(builder, scenario, cell)
    watch = builder.AddSystem(make_divergence_watch(scenario))
    controller = builder.AddSystem(make_controller(scenario, controller))
    for name in ("error", "valid", "blind"):
        connect(error.GetOutputPort(name), watch.GetInputPort(name))
    connect(error.GetOutputPort("error"), controller.GetInputPort("error"))
    connect(watch.GetOutputPort("valid"), controller.GetInputPort("valid"))
    compensation = controller.GetOutputPort("compensation")
    for arm in ARMS:
        command = add_command(builder, scenario, arm, motions[arm], compensation)
        if arm in cell.arms:
            connect(command, cell.arms[arm].desired_pose)
            if (velocity := motions[arm].velocity) is not None:
                connect(velocity, cell.arms[arm].desired_velocity)
    export_alignment(builder, cell, motions, error, watch, compensation)
    diagram = builder.Build()
    diagram.set_name("Visual alignment")
    return diagram


def start_poses(scenario: AlignmentScenario) -> dict[ArmName, RigidTransform]:
    """Return where tools start that do not start at their nominal poses."""
    return {"peg": offset_pose(scenario, 1.0)} if scenario.moves else {}


def add_sight(
    builder: DiagramBuilder,
    scenario: AlignmentScenario,
    cell: WorkCell,
    parts_there: ColouredParts | None = None,
) -> tuple[dict[ArmName, DesiredMotion], LeafSystem]:
    """Add the arms' desired motions, and the measurement of the peg's error.

    It has the outputs of :class:`CellError`; without cameras it is :class:`NoSight`.
    """
    motions = {arm: _add_motion(builder, scenario, arm) for arm in ARMS}
    if scenario.cameras.kind == "none":
        return motions, builder.AddNamedSystem("no sight", NoSight())
    error = add_cell_vision(
        builder,
        scenario,
        scenario.cameras,
        poses=cell.true_poses,
        begin=scenario.begin,
        tool_pose=cell.tool_poses["peg"],
        desired={arm: motions[arm].pose for arm in ARMS} if scenario.moves else None,
        parts_there=parts_there,
    )
    return motions, error


def export_alignment(
    builder: DiagramBuilder,
    cell: WorkCell,
    motions: dict[ArmName, DesiredMotion],
    error: LeafSystem,
    watch: LeafSystem,
    compensation: OutputPort,
) -> None:
    """Export the outputs of an alignment, and let the watch stop the motions."""
    for motion in motions.values():
        if motion.stop is not None:
            builder.Connect(watch.GetOutputPort("stop"), motion.stop)
    export_cell(builder, cell, motions, error)
    builder.ExportOutput(watch.GetOutputPort("diverged"), "diverged")
    builder.ExportOutput(compensation, "compensation")


def export_cell(
    builder: DiagramBuilder,
    cell: WorkCell,
    motions: dict[ArmName, DesiredMotion],
    error: LeafSystem,
) -> None:
    """Export commands, motions and measurements of arms and cameras."""
    for arm in ARMS:
        builder.ExportOutput(motions[arm].pose, f"{arm}.desired_pose")
        builder.ExportOutput(cell.true_poses[arm], f"{arm}.true_pose")
        builder.ExportOutput(cell.tool_poses[arm], f"{arm}.tool_pose")
        for name in ("encoders", "saturated") if arm in cell.arms else ():
            builder.ExportOutput(getattr(cell.arms[arm], name), f"{arm}.{name}")
    for name in ("error", "valid", "age", "blind"):
        builder.ExportOutput(error.GetOutputPort(name), name)


def _add_motion(
    builder: DiagramBuilder, scenario: AlignmentScenario, arm: ArmName
) -> DesiredMotion:
    """Add where an arm should be, over time."""
    goal = scenario.nominal_pose(arm)
    if arm == "hole" or not scenario.moves:
        return DesiredMotion(add_fixed(builder, f"{arm} desired pose", pose_vector(goal)))
    start, period = start_poses(scenario)["peg"].translation(), scenario.cameras.frames.period
    motion = StoppableMotion(start, goal, scenario.motion_time, period)
    builder.AddNamedSystem("peg desired motion", motion)
    pose, velocity = map(motion.GetOutputPort, ("desired_pose", "desired_velocity"))
    return DesiredMotion(pose, velocity, motion.GetInputPort("stop"))


def divergence_params(scenario: AlignmentScenario) -> DivergenceParams:
    """Return the watch's parameters for a growing error; without a compensation it can't act.

    Along the hole's axis the error is no error of alignment, and a feed changes it.
    """
    zones = [axis.dead_zone for axis in scenario.compensator.axes]
    return DivergenceParams(
        watched=tuple(Watched(axes, _GROWS_FROM * zones[axes[0]]) for axes in _WATCHED),
        size=len(AXES),
        factor=math.inf if scenario.compensated == "none" else DivergenceParams.factor,
        period=scenario.cameras.frames.period,
    )


def make_divergence_watch(scenario: AlignmentScenario) -> DivergenceWatch:
    """Return the watch of :func:`divergence_params`, named."""
    watch = DivergenceWatch(divergence_params(scenario))
    watch.set_name("divergence watch")
    watch.law.in_units(error=SEEN_IN)
    return watch


def make_controller(scenario: AlignmentScenario, own: System | None = None) -> System:
    """Return the named controller of the error: your own, or the scenario's."""
    if own is not None:
        sizes = {"error": len(AXES), "valid": 1}
        require_ports("controller", own, inputs=sizes, outputs={"compensation": len(AXES)})
        own.set_name("own controller")
        return own
    period = scenario.cameras.frames.period
    block: TrajectoryCompensator | SampledPid
    if scenario.controller.kind == "fsm":
        fsm = CompensatorParams(axes=scenario.compensator.axes, period=period)
        block = TrajectoryCompensator(fsm)
        block.set_name("trajectory compensator")
    else:
        block = SampledPid(SampledPidParams(axes=scenario.pid.axes, period=period))
        block.set_name("PID")
    block.law.in_units(error=SEEN_IN, **dict.fromkeys(COMPENSATES, ("m",) * 3 + ("rad",) * 3))
    return block


def add_command(
    builder: DiagramBuilder,
    scenario: ResolvedAlignmentScenario,
    arm: ArmName,
    motion: DesiredMotion,
    compensation: OutputPort,
) -> OutputPort:
    """Add an arm's command: where it should be, its error, and its share of the compensation.

    That of a fixture is its place.
    """
    desired = motion.pose

    def add(name: str, share: float, compensation: OutputPort) -> OutputPort:
        pose = builder.AddNamedSystem(name, CompensatedPose(share, scenario.hole_axes))
        builder.Connect(desired, pose.GetInputPort("desired_pose"))
        builder.Connect(compensation, pose.GetInputPort("compensation"))
        return pose.get_output_port()

    if arm == "peg" and any(scenario.initial_error) and scenario.servo is None:
        # The wrong pose that a wrong kinematic model makes of the right one.
        error = add_fixed(builder, "initial error", np.array(scenario.initial_error))
        desired = add("peg kinematic error", 1.0, error)
    if arm in scenario.arms:
        desired = add(f"{arm} command", SHARES[scenario.compensated][arm], compensation)
    builder.ExportOutput(desired, f"{arm}.command")
    return desired
