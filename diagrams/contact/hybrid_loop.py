"""The hybrid position/force loop of Fig. 2-4, with the controllers of Figs. 2-1 and 2-2."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomDistribution
from pydrake.systems.framework import Diagram, DiagramBuilder, InputPort, LeafSystem, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, MatrixGain, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from chamfer.diagrams.contact.hybrid_scenario import HybridScenario
from chamfer.diagrams.contact.sensing import (
    add_delay,
    add_encoders,
    add_force_in_world,
    add_noise,
    add_sensor,
)
from chamfer.systems.contact.arm_in_contact import ArmInContact
from chamfer.systems.force.contact_detection import ContactDetection
from chamfer.systems.force.friction_compensation import FrictionCompensation
from chamfer.systems.force.hybrid_controller import HybridController, require_hybrid_ports
from chamfer.systems.force.selection import Selection
from chamfer.systems.force.surface_motion import GuardedMotion
from chamfer.systems.sensing.force_sensor import LoadCellParams, gauges

Array = NDArray[np.float64]


class Manipulator(NamedTuple):
    """Ports of an arm with n joints and m endpoint coordinates.

    A controller may be connected to ``torque`` and what is measured; ``arm`` is what is true.
    """

    torque: InputPort  # (n,), N m or N, that the controller asks for
    encoders: OutputPort  # (2n,), joint positions and velocities
    measured_force: OutputPort  # (m,), N, of the arm on the surface
    base_torque: OutputPort  # (n,), N m or N, of the sensor under the base
    arm: ArmInContact


def add_manipulator(builder: DiagramBuilder, scenario: HybridScenario) -> Manipulator:
    """Add the arm of a resolved scenario on its surface, its sensors, and the computer's delay."""
    control, plant = scenario.controller, scenario.plant
    start = scenario.joint_positions(np.array(scenario.task.start))
    arm = builder.AddNamedSystem(
        "manipulator and contact",
        ArmInContact(scenario.ARM, scenario.make_surface(), plant, start),
    )
    if scenario.surface.friction_noise:
        port = arm.GetInputPort("friction_noise")
        add_noise(builder, "friction noise", port, plant.period, RandomDistribution.kGaussian)
    motion = arm.GetOutputPort("encoders")
    encoders = add_encoders(builder, scenario.encoders, motion, start, period=control.period)
    return Manipulator(
        torque=add_delay(builder, control, arm.GetInputPort("torque"), step=plant.period),
        encoders=encoders,
        measured_force=_add_measured_force(builder, scenario, arm, encoders),
        base_torque=arm.GetOutputPort("base_torque"),
        arm=arm,
    )


def _add_measured_force(
    builder: DiagramBuilder, scenario: HybridScenario, arm: ArmInContact, encoders: OutputPort
) -> OutputPort:
    given = scenario.sensor
    reading = add_sensor(
        builder,
        "",
        given,
        gauges(given, scenario.arm.contact_offset),
        arm.GetOutputPort("tool_force"),
        step=scenario.plant.period,
        period=scenario.controller.period,
    )
    if isinstance(given, LoadCellParams):
        push = builder.AddNamedSystem("push", MatrixGain(scenario.direction[:, np.newaxis]))
        builder.Connect(reading, push.get_input_port())
        return push.get_output_port()
    m = scenario.ARM.num_coordinates
    dynamics = scenario.dynamics()
    return add_force_in_world(builder, given, dynamics, reading, encoders, coordinates=m)


def make_hybrid_diagram(
    scenario: HybridScenario, *, controller: LeafSystem | None = None
) -> Diagram:
    """Build the loop of a resolved scenario.

    It exports ``encoders``, ``measured_encoders``, ``contact_force``, ``contact``, ``torque``,
    ``position_error``, ``force_error`` and ``mode``.

    The controller knows the arm only by its encoders and its force sensor (with friction
    compensation also by the torque sensor under its base). Your own controller needs the ports
    that :func:`chamfer.systems.force.hybrid_controller.require_hybrid_ports` lists.

    Raises:
        ParameterError: If a field of the scenario is open, or the controller lacks a port.
    """
    arm, task, control = scenario.ARM, scenario.task, scenario.controller
    if controller is None:
        model = scenario.dynamics() if control.full_dynamics else None
        controller = HybridController(arm, control, dynamics=model)
    require_hybrid_ports(controller, arm)
    builder = DiagramBuilder()
    add, connect = builder.AddNamedSystem, builder.Connect
    manipulator = add_manipulator(builder, scenario)
    detects = ContactDetection(scenario.detection, scenario.direction, period=control.period)
    detection = add("contact detection", detects)
    selection = add("selection", Selection(scenario.direction))
    desired = add("desired trajectory", GuardedMotion(task))
    force = add("desired force", ConstantVectorSource(task.force * scenario.direction))
    add("hybrid control", controller)
    measured = manipulator.measured_force
    mode = detection.GetOutputPort("state")
    connect(measured, detection.GetInputPort("measured_force"))
    connect(mode, selection.GetInputPort("mode"))
    connect(detection.GetOutputPort("contact_time"), desired.GetInputPort("contact_time"))
    connect(manipulator.encoders, controller.GetInputPort("encoders"))
    connect(desired.get_output_port(), controller.GetInputPort("desired_position"))
    connect(force.get_output_port(), controller.GetInputPort("desired_force"))
    connect(measured, controller.GetInputPort("measured_force"))
    connect(selection.get_output_port(), controller.GetInputPort("selection"))
    connect(mode, controller.GetInputPort("mode"))
    torque = add_friction_compensation(builder, scenario, manipulator, controller)
    connect(torque, manipulator.torque)
    add_kick(builder, scenario, manipulator.arm)
    builder.ExportOutput(manipulator.arm.GetOutputPort("encoders"), "encoders")
    builder.ExportOutput(manipulator.encoders, "measured_encoders")
    for name in ("contact_force", "contact"):
        builder.ExportOutput(manipulator.arm.GetOutputPort(name), name)
    for name in ("torque", "position_error", "force_error"):
        builder.ExportOutput(controller.GetOutputPort(name), name)
    builder.ExportOutput(mode, "mode")
    diagram = builder.Build()
    diagram.set_name(f"Hybrid position/force control, {arm.name}")
    return diagram


def add_friction_compensation(
    builder: DiagramBuilder,
    scenario: HybridScenario,
    manipulator: Manipulator,
    controller: LeafSystem,
) -> OutputPort:
    """Add the scenario's compensation between a controller and its arm; return the torque."""
    torque = controller.GetOutputPort("torque")
    if scenario.friction_compensation is None:
        return torque
    n, period = scenario.ARM.num_joints, scenario.controller.period
    block = FrictionCompensation(scenario.friction_compensation, joints=n, period=period)
    compensation = builder.AddNamedSystem("friction compensation", block)
    builder.Connect(torque, compensation.GetInputPort("command"))
    builder.Connect(manipulator.base_torque, compensation.GetInputPort("base_torque"))
    return compensation.GetOutputPort("torque")


def add_kick(builder: DiagramBuilder, scenario: HybridScenario, arm: ArmInContact) -> None:
    """Add a blow that gives the tip a speed away from the surface."""
    blow = kick_of(scenario)
    if blow is None:
        return
    step, (first, force) = scenario.plant.period, blow
    times = [first - step, first, first + step, first + 2 * step]
    forces = np.column_stack([0 * force, force, 0 * force, 0 * force])
    kick = builder.AddNamedSystem(
        "kick", TrajectorySource(PiecewisePolynomial.ZeroOrderHold(times, forces))
    )
    builder.Connect(kick.get_output_port(), arm.GetInputPort("disturbance"))


def kick_of(scenario: HybridScenario) -> tuple[float, Array] | None:
    """Return the blow's start, s, and its force on the tip, N, shape (3,), for a step of the arm.

    It begins half a step early, so that rounding decides neither its first sample nor its last.
    """
    task, step = scenario.task, scenario.plant.period
    if task.kick_time is None:
        return None
    q = scenario.joint_positions(scenario.touching)
    state = scenario.dynamics().evaluate(q, np.zeros(len(q)))
    away = -np.array([*scenario.direction, 0.0, 0.0][:3])
    row = away @ state.J_v_WC
    mass = 1 / float(row @ np.linalg.solve(state.mass, row))
    return task.kick_time - step / 2, away * mass * task.kick_speed / step
