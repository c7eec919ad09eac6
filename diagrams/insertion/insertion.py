"""Aligns the parts by vision and inserts the peg with a state chart (section 5)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, fields, replace
from functools import lru_cache, partial
from typing import Any, ClassVar, Final, Self, TypeVar, get_args

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, OutputPort, System
from pydrake.systems.primitives import Adder

from chamfer.diagrams.cell.alignment import (
    SEEN_IN,
    SHARES,
    DesiredMotion,
    add_command,
    add_sight,
    export_alignment,
    export_cell,
    make_controller,
    make_divergence_watch,
    start_poses,
)
from chamfer.diagrams.cell.alignment import resolve_as as resolve_alignment_as
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario, ResolvedAlignmentScenario
from chamfer.diagrams.cell.cell_vision import CameraSettings
from chamfer.diagrams.cell.work_cell import (
    ARMS,
    PEG_ARM,
    ArmName,
    ArmPorts,
    WorkCell,
    add_part_shapes,
    require_strong,
    support_at,
)
from chamfer.diagrams.insertion.cell_contact import add_cell_in_contact, export_contact
from chamfer.diagrams.insertion.cells import CELLS, Cells, single
from chamfer.diagrams.insertion.contact_loop import contact_loop, require_stable
from chamfer.diagrams.insertion.position_cell import (
    Sensed,
    WristSensorParams,
    add_position_cell,
)
from chamfer.models.arms.position_arm import (
    ArmInterface,
    ComplianceParams,
    ServoParams,
    require_within_deflection,
)
from chamfer.models.arms.wrist import WristParams
from chamfer.models.peg.bore_contact import (
    ContactMaterial,
    require_resolved_clearance,
    resolved_speed,
)
from chamfer.models.peg.peg_and_hole import SEATED, ColouredParts, Peg
from chamfer.models.peg.support import OpenSupport, Support, stacked
from chamfer.models.validation import (
    ParameterError,
    require_one_of,
    require_positive,
    require_same,
)
from chamfer.systems.cameras.camera_image import FrameGrabberParams
from chamfer.systems.contact.contact_approximation import Approximation, Convex
from chamfer.systems.contact.peg_hole_contact_monitor import PegHoleContactMonitor
from chamfer.systems.force.contact_admittance import ContactAdmittanceParams
from chamfer.systems.force.desired_pose import FeedOffset
from chamfer.systems.force.impedance_controller import SpringForce
from chamfer.systems.force.tool_pose import StraightMotion
from chamfer.systems.pose import pose_vector
from chamfer.systems.servo.divergence_watch import DivergenceWatch
from chamfer.systems.servo.measurement_selector import MeasurementSelector
from chamfer.systems.strategies.insertion_controller import (
    TASK,
    InsertionController,
    InsertionControllerParams,
)
from chamfer.systems.strategies.insertion_decision import SURE, DecisionParams, InsertionRegion
from chamfer.systems.strategies.insertion_law import (
    InsertionTaskParams,
    InsertParams,
    ResolvedInsertParams,
)
from chamfer.systems.strategies.insertion_search import SearchParams, TouchSearch
from chamfer.systems.strategies.insertion_task import InsertionTask
from chamfer.systems.vision.cell_error import AXES

INSERTION: Final = "Visual insertion"  # the diagram's name
FEED_SPEED: Final = 0.02  # m/s, of the feed; assumed
_JOINTS: Final = 1.0  # N, of the joints' dry friction at the tip; see InsertParams
_FACE: Final = 0.0005  # m, along the axis, by which the cameras are off at most; assumed
_IN: Final = 0.9  # of the peg's length, that goes in at most


@dataclass(frozen=True, kw_only=True)
class _WrongParts(ColouredParts):
    """Parts whose peg is thicker than anybody knows."""

    excess: float = 0.0  # m

    @property
    def peg(self) -> Peg:
        """The true peg."""
        peg = super().peg
        return peg._replace(radius=peg.radius + self.excess)


@dataclass(frozen=True, kw_only=True)
class InsertionScenario(AlignmentScenario):
    """The cameras align the parts, and the peg is inserted, with retries."""

    decide: DecisionParams = field(default_factory=DecisionParams)
    insert: InsertParams = field(default_factory=InsertParams)
    search: SearchParams = field(default_factory=SearchParams)
    contact: ContactMaterial = field(default_factory=ContactMaterial)
    approximation: Approximation = "lagged"  # of contact, by Drake; tamsi: only with such an arm
    support: OpenSupport = field(default_factory=OpenSupport)
    # of the decision and the theory; open fields: derived from the arms, at the depth in question
    arm: ArmInterface = field(default_factory=ArmInterface)
    # the peg's arm: its commands and servos
    admittance: ContactAdmittanceParams = field(default_factory=ContactAdmittanceParams)
    # of an arm that takes positions
    compliance: ComplianceParams = field(default_factory=ComplianceParams)
    # also of an arm that takes positions
    sensor: WristSensorParams = field(default_factory=WristSensorParams)  # at its wrist
    peg_excess: float = 0.0
    # m, excess of the peg's radius over that of parts: a wrong part; from 5 % on it is not
    # recognised
    duration: float = 60.0  # s, longest run

    UNUSED_OF_PARTS: ClassVar[tuple[str, ...]] = ()
    WHOLE: ClassVar[Mapping[str, Cells]] = {"cell": single(CELLS)}

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "duration")
        known = Convex if self.servo is None else Approximation
        require_one_of(self, "approximation", get_args(known))
        depth = self.insert.depth
        if depth is not None and not depth < self.parts.peg_length:
            allowed = f"less than the peg's length, {self.parts.peg_length:g} m"
            raise ParameterError("insert.depth", depth, allowed)
        if self.insert.speed is not None:
            require_resolved_clearance(self.parts, self.insert.speed, self.step)
        radius = self.parts.peg_radius + self.peg_excess
        if not self.parts.peg_chamfer.width < radius < self.parts.hole.mouth_radius:
            allowed = "such that the peg's tip still finds the mouth"
            raise ParameterError("peg_excess", self.peg_excess, allowed)

    @property
    def servo(self) -> ServoParams | None:
        """Of an arm that takes positions; None: the arms are under impedance control."""
        return self.arm.servo if self.arm.control == "position" else None

    @property
    def tool_mass(self) -> float:
        """Believed mass below the springs of an arm that takes positions, kg."""
        return self.peg.tool.mass + (self.compliance.mass or 0.0)

    @property
    def wrist(self) -> WristParams:
        """The springs between the flange of such an arm and the tip, and their load."""
        tool, more = self.peg.tool, self.peg.payload_error
        x, of_more = tool.centre_of_mass[0], self.peg.payload_position[0]
        mass = tool.mass + more
        return self.compliance.resolved().wrist(
            mass=mass,
            centre_of_mass=-(tool.mass * x + more * of_more) / mass,
            inertia=max(tool.inertia[1:]) + tool.mass * x**2 + more * of_more**2,
            axial_inertia=tool.inertia[0],
        )

    @property
    def stiffness(self) -> tuple[float, ...]:
        """Stiffness of the support at the tip, N/m and N m/rad along and about the axes, (6,).

        Of an arm that takes positions the springs of its admittance and those below its flange,
        as if both had their centres at the tip.
        """
        if self.servo is None:
            return (*self.impedance.stiffness, *self.impedance.rotational_stiffness)
        own = self.compliance.resolved()
        springs = own.axial, own.lateral, own.lateral, own.torsional, own.angular, own.angular
        arm = np.roll(self.admittance.stiffness, 3).tolist()
        return tuple(1 / (1 / one + 1 / other) for one, other in zip(arm, springs, strict=True))

    def support_at(self, depth: float) -> Support:
        """Return the believed support of the peg at a depth of its tip, m."""
        if self.servo is None:
            return self.support.over(support_at(self, depth))
        device, behind = self.compliance.resolved().support, self.admittance.support
        return self.support.over(stacked(device, behind) if behind else device)

    @property
    def wedging_support(self) -> Support:
        """The support at the depth where two points decide whether the peg can wedge."""
        return self.support_at(self.parts.chamfer_height + self.parts.wedging_depth)

    @property
    def unsure(self) -> float:
        """Largest error of the hole's believed position, across its axis, m.

        What the cameras leave is as much as the chamfers guide: by that the decision goes.
        Without cameras it is as far as the fixture and the arm may be off.
        """
        if self.cameras.kind != "none":
            return self.parts.chamfer_limit
        return math.sqrt(2) * (self.hole.position_error + self.repeatability)

    @property
    def unsure_along(self) -> float:
        """Largest error of the mouth's believed position, along its axis, m."""
        return _FACE if self.cameras.kind != "none" else max(_FACE, self.hole.position_error)

    @property
    def there(self) -> Self:
        """The scenario with the true parts, for contact and cameras only."""
        if not self.peg_excess:
            return self
        return replace(self, parts=_WrongParts(**vars(self.parts), excess=self.peg_excess))

    @property
    def peg_motion_ends(self) -> float:
        """When the peg is at the gap by its desired motion, s."""
        return max(self.begin, self.motion_time) if self.moves else self.begin


@dataclass(frozen=True, kw_only=True)
class ResolvedInsertionScenario(ResolvedAlignmentScenario, InsertionScenario):
    """The scenario with the contact's facets and the feed filled in, for diagrams."""

    insert: ResolvedInsertParams


INSERTION_BY_SIGHT: Final = InsertionScenario()
ResolvedT = TypeVar("ResolvedT", bound=ResolvedInsertionScenario)


def resolve(scenario: InsertionScenario) -> ResolvedInsertionScenario:
    """Fill in the contact's facets and the feed, once the parts are in view."""
    return resolve_as(ResolvedInsertionScenario, scenario)


def resolve_as(kind: type[ResolvedT], scenario: InsertionScenario) -> ResolvedT:
    """Return a scenario resolved, as the resolved class of its own kind."""
    if scenario.cameras.kind == "none":
        _require_unseen(scenario)
    scenario = _resolve_arm(scenario)
    insert, parts = scenario.insert, scenario.parts
    depth, speed, feed = insert.depth, insert.speed, insert.feed
    if depth is None:
        depth = min(parts.bore_length, _IN * parts.peg_length)
    if speed is None:
        speed = min(FEED_SPEED, resolved_speed(parts, scenario.step))
    if feed is None:
        # Stopped at the mouth the arms' springs take the rest of the way to reach the push.
        stiffness = scenario.stiffness[0] / len(scenario.arms)
        feed = scenario.gap + depth + insert.push / stiffness
        feed += scenario.unsure_along if scenario.search.kind != "none" else 0.0
    search = scenario.search.over(
        parts,
        error=scenario.unsure,
        push=insert.push,
        reach=scenario.unsure_along,
        attempts=insert.attempts,
    )
    found = replace(
        scenario,
        search=search,
        contact=scenario.contact.over(parts),
        insert=ResolvedInsertParams(
            **vars(insert) | {"depth": depth, "speed": speed, "feed": feed}
        ),
    )
    resolved = resolve_alignment_as(kind, found)
    require_strong(resolved, insert.push)
    return resolved


ScenarioT = TypeVar("ScenarioT", bound=InsertionScenario)

_POSITION_ONLY: Final = ("admittance", "compliance", "sensor")


def _resolve_arm(scenario: ScenarioT) -> ScenarioT:
    """Fill in what an arm that takes positions has, and refuse what one of torques has not."""
    if scenario.servo is None:
        groups = {name: getattr(scenario, name) for name in _POSITION_ONLY}
        _require_unused({"arm.servo": scenario.arm.servo, **groups}, "arm.control is impedance")
        return scenario
    _require_unused({"impedance": scenario.impedance}, "arm.control is position")
    require_same(scenario.peg, PEG_ARM, "peg", "mass_scale", why="arm.control is position")
    names = "joint_friction", "friction_asymmetry", "joint_damping", "rotor_inertia"
    of_torques: dict[str, Any] = dict.fromkeys(names)
    usual = replace(scenario.peg, **of_torques).arm
    of_torques |= {"joint_friction": usual.dry_friction, "rotor_inertia": usual.rotor_inertia}
    for name, values in of_torques.items():
        if (given := getattr(scenario.peg, name)) not in (None, values):
            raise ParameterError(f"peg.{name}", given, "null: arm.control is position")
    places = {"tool.centre_of_mass": scenario.peg.tool.centre_of_mass}
    if scenario.peg.payload_error:
        places["payload_position"] = scenario.peg.payload_position
    for name, place in places.items():
        if any(place[1:]) or place[0] > 0:
            allowed = "on the peg's axis, not ahead of its tip: arm.control is position"
            raise ParameterError(f"peg.{name}", place, allowed)
    if scenario.hole.kind != "fixture":
        raise ParameterError("hole.kind", scenario.hole.kind, "fixture: arm.control is position")
    period = scenario.servo.period
    if scenario.sensor.rate * period < 1 - 1e-9:
        allowed = f"at least arm.servo.rate, {1 / period:g} Hz"
        raise ParameterError("sensor.rate", scenario.sensor.rate, allowed)
    needed = scenario.insert.force_limit + 9.81 * scenario.wrist.mass
    if 0 < scenario.sensor.full_scale < needed:
        allowed = f"at least insert.force_limit and the tool's weight, {needed:.3g} N"
        raise ParameterError("sensor.full_scale", scenario.sensor.full_scale, allowed)
    admittance, compliance = scenario.admittance, scenario.compliance.resolved()
    if admittance.kind == "wrist":
        require_stable(loop := contact_loop(scenario))
        admittance = replace(admittance, damping=loop.damping)
    hole = scenario.hole
    # Further off it lies beside the mouth.
    lateral = min(hole.position_error, scenario.parts.chamfer_limit)
    require_within_deflection(compliance, lateral, hole.angle_error, admittance.support)
    return replace(scenario, compliance=compliance, admittance=admittance)


def _require_unseen(scenario: InsertionScenario) -> None:
    """Refuse what nothing reads without cameras."""
    why = "cameras.kind is none"
    names = "compensator", "pid", "controller"
    _require_unused({name: getattr(scenario, name) for name in names}, why)
    require_same(scenario.insert, InsertParams, "insert", "compensation", "freeze_depth", why=why)
    if scenario.compensated not in (None, "none"):
        raise ParameterError("compensated", scenario.compensated, f"none, {why}")
    cameras, frames = scenario.cameras, scenario.cameras.frames
    usual = CameraSettings(kind="none", frames=FrameGrabberParams(period=frames.period))
    of_frames = [one.name for one in fields(frames)]
    require_same(frames, usual.frames, "cameras.frames", *of_frames, why=why)
    require_same(cameras, usual, "cameras", *[one.name for one in fields(cameras)], why=why)


def _require_unused(groups: Mapping[str, Any], why: str) -> None:
    for path, group in groups.items():
        names = [one.name for one in fields(group)]
        require_same(group, type(group)(), path, *names, why=why)


def region_of(scenario: ResolvedInsertionScenario) -> InsertionRegion:
    """Return the believed errors with which the peg finds its hole and does not wedge."""
    return _region(scenario.parts, scenario.wedging_support)


@lru_cache(maxsize=64)
def _region(parts: ColouredParts, support: Support) -> InsertionRegion:
    return InsertionRegion(parts, support)


def _search(scenario: ResolvedInsertionScenario) -> TouchSearch | None:
    if scenario.search.kind == "none":
        return None
    search, admittance = scenario.search, scenario.admittance
    joints, lag, damping = _JOINTS, None, 0.0
    if scenario.servo is not None:
        joints = 0.0
        if admittance.kind == "wrist" and admittance.damping is not None:
            damping = max(admittance.damping[3:])
            lag = max(admittance.damping[4:]) / min(admittance.spring[4:])
    return TouchSearch(
        search,
        axial=scenario.stiffness[0] / len(scenario.arms),
        stiffness=scenario.support_at(0.0).lateral_stiffness,
        drag=scenario.parts.friction * search.press + joints,
        lag=lag,
        damping=damping,
        tip=scenario.parts.leading(search.angle),
        turn=math.sqrt(2) * scenario.hole.angle_error,
    )


def task_params(scenario: ResolvedInsertionScenario) -> InsertionTaskParams:
    """Return the parameters of the task's chart, of a resolved scenario."""
    parts, across, turned = scenario.parts, 0.0, 0.0
    if scenario.cameras.kind == "hand":
        across, turned = scenario.cameras.hand.deviations
    limits = InsertionTaskParams.limits
    if scenario.cameras.kind != "none":
        own = scenario.compensator if scenario.controller.kind == "fsm" else scenario.pid
        limits = tuple(axis.limit for axis in own.axes)
    return InsertionTaskParams(
        decide=scenario.decide,
        insert=scenario.insert,
        region=region_of(scenario),
        chamfer_height=parts.chamfer_height,
        bottom=math.inf if parts.bore_depth is None else parts.bore_depth,
        gap=scenario.gap,
        pixel_size=scenario.cameras.pixel_size,
        sight=(SURE * across, SURE * turned),
        begin=scenario.peg_motion_ends,
        wait=scenario.compensation_time,
        limits=limits,
        period=scenario.cameras.frames.period,
        search=_search(scenario),
    )


def make_insertion_diagram(
    scenario: ResolvedInsertionScenario,
    *,
    controller: System | None = None,
    arm_controllers: Mapping[ArmName, System] | None = None,
) -> Diagram:
    """Return the work cell with the vision loop closed, the parts in contact, and the task.

    Outputs:

    - those of :func:`chamfer.diagrams.cell.alignment.make_alignment_diagram`, with
      ``<arm>.command`` before the feed;
    - of the task ``feed``, ``attempts``, ``measured`` (errors of the decision), ``sensed_force``,
      ``sensed_depth``, ``trouble`` and ``state``;
    - ``contact.*``, the true quantities of the contact.

    Args:
        scenario: Resolved.
        controller: Your own controller instead of the state machine or the PID laws, with the
            ports of :func:`chamfer.diagrams.cell.alignment.make_alignment_diagram`.
        arm_controllers: Your own controllers of the arms instead of the impedance law.
    """
    builder = DiagramBuilder()
    connect = builder.Connect
    cell, contact, sensed = _add_cell(builder, scenario, arm_controllers)
    motions, error = add_sight(builder, scenario, cell, scenario.there.parts)
    watch, compensation, task = _add_deciding(builder, scenario, error, controller)
    for name in ("error", "valid", "blind"):
        connect(error.GetOutputPort(name), task.GetInputPort(name))
    connect(watch.GetOutputPort("diverged"), task.GetInputPort("diverged"))
    connect(compensation, task.GetInputPort("compensation"))
    commands = {
        arm: add_command(builder, scenario, arm, motions[arm], compensation) for arm in ARMS
    }
    if "hole" in cell.arms:
        connect(commands["hole"], cell.arms["hole"].desired_pose)
    _add_advance(builder, scenario, cell, commands, motions["peg"], task, sensed)
    for arm, ports in cell.arms.items():
        connect(ports.saturated, task.GetInputPort(f"{arm}_saturated"))
    export_alignment(builder, cell, motions, error, watch, compensation)
    return _built(builder, task, contact, INSERTION)


def _add_deciding(
    builder: DiagramBuilder,
    scenario: ResolvedInsertionScenario,
    error: LeafSystem,
    own: System | None,
) -> tuple[LeafSystem, OutputPort, InsertionTask]:
    """Add the task, and what makes compensation of the cameras' error; return the watch too."""
    if scenario.cameras.kind == "none":
        task = builder.AddSystem(_make_task(scenario))
        return error, error.GetOutputPort("compensation"), task
    connect = builder.Connect
    gate, watch, controller, task = map(builder.AddSystem, _deciding(scenario, own))
    for name in ("error", "valid"):
        connect(error.GetOutputPort(name), gate.GetInputPort(name))
        connect(gate.GetOutputPort(name), watch.GetInputPort(name))
    connect(gate.GetOutputPort("error"), controller.GetInputPort("error"))
    connect(watch.GetOutputPort("valid"), controller.GetInputPort("valid"))
    connect(error.GetOutputPort("blind"), watch.GetInputPort("blind"))
    connect(task.GetOutputPort("compensates"), gate.GetInputPort("open"))
    return watch, controller.GetOutputPort("compensation"), task


def _built(
    builder: DiagramBuilder, task: System, contact: PegHoleContactMonitor, name: str
) -> Diagram:
    """Export what the task says and what is true of the contact, and return the diagram."""
    builder.ExportOutput(task.GetOutputPort("errors"), "measured")
    for told in ("feed", "attempts", "sensed_force", "sensed_depth", "trouble", "state"):
        builder.ExportOutput(task.GetOutputPort(told), told)
    export_contact(builder, contact)
    diagram = builder.Build()
    diagram.set_name(name)
    return diagram


def _add_cell(
    builder: DiagramBuilder,
    scenario: ResolvedInsertionScenario,
    arm_controllers: Mapping[ArmName, System] | None = None,
) -> tuple[WorkCell, PegHoleContactMonitor, Sensed | None]:
    """Add the cell, and the sensor of an arm that takes positions."""
    there = scenario.there
    seated, shapes = SEATED * task_params(scenario).target, partial(add_part_shapes, there)
    if scenario.servo is not None:
        if arm_controllers:
            raise ParameterError("arm_controllers", sorted(arm_controllers), "none: positions")
        return add_position_cell(
            builder, scenario, there.parts, seated_depth=seated, add_parts=shapes
        )
    cell, contact = add_cell_in_contact(
        builder,
        scenario,
        there.parts,
        seated_depth=seated,
        material=scenario.contact,
        start=start_poses(scenario),
        add_parts=shapes,
        controllers=arm_controllers,
        approximation=scenario.approximation,
    )
    return cell, contact, None


def _deciding(
    scenario: ResolvedInsertionScenario, own: System | None = None
) -> tuple[MeasurementSelector, DivergenceWatch, Any, InsertionTask]:
    """Return the blocks that decide, named; the compensation may be a user's own."""
    gate = MeasurementSelector(len(AXES), period=scenario.cameras.frames.period)
    gate.set_name("measurement selector")
    gate.law.in_units(error=SEEN_IN)
    watch, controller = make_divergence_watch(scenario), make_controller(scenario, own)
    return gate, watch, controller, _make_task(scenario)


def _make_task(scenario: ResolvedInsertionScenario) -> InsertionTask:
    joints = {f"{arm}_joints": getattr(scenario, arm).arm.num_joints for arm in ARMS}
    task = InsertionTask(task_params(scenario), **joints)
    task.set_name(TASK)
    return task


def controller_of(scenario: ResolvedInsertionScenario) -> InsertionController:
    """Return all controllers except the arms' own as one law, equal to the bit.

    It needs no Drake, and runs beside a robot as well.
    """
    peg, hole = map(scenario.nominal_pose, ARMS)
    motion = None
    if scenario.moves:
        start = start_poses(scenario)["peg"].translation()
        motion = StraightMotion(start, peg.translation(), scenario.motion_time)
    if scenario.servo is not None or scenario.cameras.kind == "none":
        name, value = "arm.control", scenario.arm.control
        raise ParameterError(name, value, "impedance with a pair of cameras, of the one law")
    shares = SHARES[scenario.compensated]
    params = InsertionControllerParams(
        stiffness=np.array(scenario.impedance.stiffness),
        R_WH=scenario.hole_axes.matrix(),
        peg_pose=pose_vector(peg),
        hole_pose=pose_vector(hole),
        shares={arm: shares[arm] for arm in scenario.arms},
        motion=motion,
        initial_error=scenario.initial_error,
    )
    return InsertionController(
        params, {block.get_name(): block.law for block in _deciding(scenario)}
    )


def make_insertion_robot(scenario: ResolvedInsertionScenario, controller: System) -> Diagram:
    """Return the diagram with one block that replaces :func:`controller_of`.

    Its outputs are those of :func:`make_insertion_diagram`.

    Args:
        scenario: Resolved.
        controller: A block with the ports of :class:`InsertionController`, such as the robot's end
            of a connection.
    """
    builder = DiagramBuilder()
    connect = builder.Connect
    # First, so that at each instant it hears of what was before any other block has drawn images.
    builder.AddNamedSystem("controller", controller)
    cell, contact, _ = _add_cell(builder, scenario)
    motions, error = add_sight(builder, scenario, cell, scenario.there.parts)
    for name in ("error", "valid", "blind"):
        connect(error.GetOutputPort(name), controller.GetInputPort(name))
    for arm, ports in cell.arms.items():
        connect(ports.tool_pose, controller.GetInputPort(f"{arm}_tool_pose"))
        connect(ports.saturated, controller.GetInputPort(f"{arm}_saturated"))
        connect(controller.GetOutputPort(f"{arm}_pose"), ports.desired_pose)
    connect(controller.GetOutputPort("peg_velocity"), cell.arms["peg"].desired_velocity)
    export_cell(builder, cell, motions, error)
    for name, exported in _TOLD.items():
        builder.ExportOutput(controller.GetOutputPort(name), exported)
    return _built(builder, controller, contact, "Visual insertion by a robot")


# What the controller says beside the task, and what the diagram calls it.
_TOLD: Final = {
    "peg_command": "peg.command",
    "hole_pose": "hole.command",
    "diverged": "diverged",
    "compensation": "compensation",
}


def _add_advance(
    builder: DiagramBuilder,
    scenario: InsertionScenario,
    cell: WorkCell,
    commands: dict[ArmName, OutputPort],
    motion: DesiredMotion,
    task: InsertionTask,
    sensed: Sensed | None,
) -> None:
    """Add the feed along the hole's commanded axis, and what the arm knows of its way and load."""
    connect, peg = builder.Connect, cell.arms["peg"]
    advance = builder.AddNamedSystem("feed offset", FeedOffset())
    connect(commands["peg"], advance.GetInputPort("pose"))
    connect(commands["hole"], advance.GetInputPort("along"))
    for name in ("feed", "offset"):
        connect(task.GetOutputPort(name), advance.GetInputPort(name))
    command = advance.GetOutputPort("advanced_pose")
    connect(command, peg.desired_pose)
    if sensed is None:
        _add_velocity(builder, advance.GetOutputPort("velocity"), motion, peg)
        spring = builder.AddNamedSystem("spring force", SpringForce(scenario.impedance.stiffness))
        connect(command, spring.GetInputPort("command"))
        connect(peg.tool_pose, spring.GetInputPort("tool_pose"))
        connect(cell.tool_poses["hole"], spring.GetInputPort("hole_pose"))
        sensed = Sensed(*map(spring.GetOutputPort, Sensed._fields[:2]))
    if sensed.tares is not None:
        connect(task.GetOutputPort("tares"), sensed.tares)
    connect(sensed.force, task.GetInputPort("force"))
    connect(sensed.advance, task.GetInputPort("advance"))


def _add_velocity(
    builder: DiagramBuilder, feed: OutputPort, motion: DesiredMotion, peg: ArmPorts
) -> None:
    """Add how fast the peg should go, by its feed and its desired motion."""
    velocity, connect = feed, builder.Connect
    if motion.velocity is not None:
        both = builder.AddNamedSystem("peg desired velocity", Adder(2, 6))
        connect(motion.velocity, both.get_input_port(0))
        connect(feed, both.get_input_port(1))
        velocity = both.get_output_port()
    connect(velocity, peg.desired_velocity)
