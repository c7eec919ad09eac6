"""From pixels to a seated peg: the alignment by sight, and a chart that inserts (section 5)."""

import math
from functools import partial

from pydrake.math import RigidTransform
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import Adder

from chamfer.diagrams.cell.alignment import (
    Motion,
    add_command,
    add_controller,
    add_divergence_watch,
    add_motion,
    export_arm,
    start_pose,
)
from chamfer.diagrams.cell.cell_vision import add_cell_vision
from chamfer.diagrams.cell.part_shapes import add_part_shapes
from chamfer.diagrams.cell.work_cell import ARMS, ArmName, WorkCell
from chamfer.diagrams.insertion.cell_contact import add_cell_in_contact, export_contact
from chamfer.diagrams.insertion.insertion_scenario import InsertionScenario, resolve
from chamfer.systems.contact.peg_hole_contact_monitor import SEATED
from chamfer.systems.force.desired_pose import FeedOffset
from chamfer.systems.force.impedance_controller import SpringForce
from chamfer.systems.servo.measurement_selector import MeasurementSelector
from chamfer.systems.strategies.insertion_decision import InsertionRegion
from chamfer.systems.strategies.insertion_memory import InsertionTaskParams
from chamfer.systems.strategies.insertion_task import InsertionTask
from chamfer.systems.vision.image_plane_error import AXES

TASK = "insertion task"


def task_params(scenario: InsertionScenario) -> InsertionTaskParams:
    """Return the parameters of the task's chart, of a resolved scenario."""
    parts = scenario.parts
    axes = (scenario.compensator if scenario.controller.kind == "fsm" else scenario.pid).axes
    return InsertionTaskParams(
        decide=scenario.decide,
        insert=scenario.insert,
        region=InsertionRegion(parts, scenario.wedging_support),
        chamfer_height=parts.chamfer_height,
        bottom=math.inf if parts.bore_depth is None else parts.bore_depth,
        gap=scenario.gap,
        pixel_size=scenario.cameras.pixel_size,
        begin=scenario.peg_motion_ends,
        wait=scenario.compensation_time,
        limits=tuple(axis.limit for axis in axes),
        period=scenario.cameras.frames.period,
    )


def make_insertion_diagram(scenario: InsertionScenario) -> Diagram:
    """Return the work cell with the vision loop closed, the parts in contact, and the task.

    Outputs: those of :func:`chamfer.diagrams.cell.alignment.make_alignment_diagram`,
    ``<arm>.command`` before the feed; ``feed``, ``attempts``, ``measured`` (errors of the
    decision), ``sensed_force``, ``sensed_depth``, ``trouble`` and ``state`` of the task; and
    ``contact.*``, the truth of the contact.
    """
    scenario = resolve(scenario)
    params = task_params(scenario)
    there = scenario.there
    builder = DiagramBuilder()
    connect = builder.Connect
    start: dict[ArmName, RigidTransform] = {"peg": start_pose(scenario)} if scenario.moves else {}
    cell, contact = add_cell_in_contact(
        builder,
        scenario,
        there.parts,
        seated_depth=SEATED * params.target,
        material=scenario.contact,
        start=start,
        add_parts=partial(add_part_shapes, there),
    )
    motions = {arm: add_motion(builder, scenario, arm) for arm in ARMS}
    error = add_cell_vision(
        builder,
        scenario,
        scenario.cameras,
        poses=cell.true_poses,
        begin=scenario.begin,
        desired={arm: motions[arm].pose for arm in ARMS} if scenario.moves else None,
        parts_there=there.parts,
    )
    gate = builder.AddNamedSystem("error gate", MeasurementSelector(len(AXES)))
    watch = add_divergence_watch(builder, scenario)
    controller = add_controller(builder, scenario)
    peg_joints, hole_joints = (getattr(scenario, arm).arm.num_joints for arm in ARMS)
    task = builder.AddNamedSystem(
        TASK, InsertionTask(params, peg_joints=peg_joints, hole_joints=hole_joints)
    )
    for name in ("error", "valid"):
        connect(error.GetOutputPort(name), gate.GetInputPort(name))
        connect(error.GetOutputPort(name), task.GetInputPort(name))
        connect(gate.GetOutputPort(name), watch.GetInputPort(name))
    connect(gate.GetOutputPort("error"), controller.GetInputPort("error"))
    connect(watch.GetOutputPort("valid"), controller.GetInputPort("valid"))
    connect(error.GetOutputPort("blind"), task.GetInputPort("blind"))
    connect(error.GetOutputPort("blind"), watch.GetInputPort("blind"))
    connect(watch.GetOutputPort("diverged"), task.GetInputPort("diverged"))
    connect(task.GetOutputPort("compensates"), gate.GetInputPort("open"))
    compensation = controller.GetOutputPort("compensation")
    connect(compensation, task.GetInputPort("compensation"))
    commands = {
        arm: add_command(builder, scenario, arm, motions[arm], compensation) for arm in ARMS
    }
    if "hole" in cell.arms:
        connect(commands["hole"], cell.arms["hole"].desired_pose)
    _add_advance(builder, scenario, cell, commands, motions["peg"], task)
    for arm in ARMS:
        if arm in cell.arms:
            connect(cell.arms[arm].saturated, task.GetInputPort(f"{arm}_saturated"))
        export_arm(builder, cell, arm)
        if (stop := motions[arm].stop) is not None:
            connect(watch.GetOutputPort("stop"), stop)
    for name in ("error", "valid", "age", "blind"):
        builder.ExportOutput(error.GetOutputPort(name), name)
    builder.ExportOutput(watch.GetOutputPort("diverged"), "diverged")
    builder.ExportOutput(compensation, "compensation")
    for name, of in (
        ("feed", "feed"),
        ("attempts", "attempts"),
        ("errors", "measured"),
        ("sensed_force", "sensed_force"),
        ("sensed_depth", "sensed_depth"),
        ("trouble", "trouble"),
        ("state", "state"),
    ):
        builder.ExportOutput(task.GetOutputPort(name), of)
    export_contact(builder, contact)
    diagram = builder.Build()
    diagram.set_name("Insertion by sight")
    return diagram


def _add_advance(
    builder: DiagramBuilder,
    scenario: InsertionScenario,
    cell: WorkCell,
    commands: dict[ArmName, OutputPort],
    motion: Motion,
    task: InsertionTask,
) -> None:
    """Add the feed along the hole's commanded axis, and what the arm knows of its way and load."""
    connect, peg = builder.Connect, cell.arms["peg"]
    advance = builder.AddNamedSystem("advance", FeedOffset())
    connect(commands["peg"], advance.GetInputPort("pose"))
    connect(commands["hole"], advance.GetInputPort("along"))
    connect(task.GetOutputPort("feed"), advance.GetInputPort("feed"))
    command = advance.GetOutputPort("advanced_pose")
    connect(command, peg.desired_pose)
    velocity = advance.GetOutputPort("velocity")
    if motion.velocity is not None:
        both = builder.AddNamedSystem("peg desired velocity", Adder(2, 6))
        connect(motion.velocity, both.get_input_port(0))
        connect(velocity, both.get_input_port(1))
        velocity = both.get_output_port()
    connect(velocity, peg.desired_velocity)
    sensed = builder.AddNamedSystem("spring force", SpringForce(scenario.impedance.stiffness))
    connect(command, sensed.GetInputPort("command"))
    connect(peg.tool_pose, sensed.GetInputPort("tool_pose"))
    connect(cell.tool_poses["hole"], sensed.GetInputPort("hole_pose"))
    for name in ("force", "advance"):
        connect(sensed.GetOutputPort(name), task.GetInputPort(name))
