"""The hybrid position/force loop of Fig. 2-4, with the controllers of Figs. 2-1 and 2-2."""

from typing import Final

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantVectorSource

from chamfer.diagrams.contact.hybrid_resolve import resolve
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario
from chamfer.diagrams.contact.manipulator import Manipulator, add_manipulator
from chamfer.systems.contact.arm_in_contact import ArmInContact
from chamfer.systems.contact.impulse import Impulse
from chamfer.systems.force.contact_detection import ContactDetection
from chamfer.systems.force.friction_compensation import FrictionCompensation
from chamfer.systems.force.hybrid_controller import HybridController
from chamfer.systems.force.selection import Selection
from chamfer.systems.force.surface_motion import GuardedMotion

SIGNALS: Final = (
    "encoders",
    "measured_encoders",
    "contact_force",
    "contact",
    "torque",
    "position_error",
    "force_error",
    "mode",
)


def make_hybrid_diagram(scenario: HybridScenario) -> Diagram:
    """Build the loop; it exports :data:`SIGNALS`.

    The controller knows the arm by its encoders and its force sensor alone (with friction
    compensation also by the torque sensor under its base).

    Raises:
        ParameterError: As :func:`chamfer.diagrams.contact.hybrid_scenario.resolve`.
    """
    scenario = resolve(scenario)
    arm, task, control = scenario.ARM, scenario.task, scenario.controller
    builder = DiagramBuilder()
    manipulator = add_manipulator(builder, scenario)
    detection = builder.AddNamedSystem(
        "contact detection",
        ContactDetection(scenario.detection, scenario.direction, period=control.period),
    )
    selection = builder.AddNamedSystem("selection", Selection(scenario.direction))
    desired = builder.AddNamedSystem("desired trajectory", GuardedMotion(task))
    force = builder.AddNamedSystem(
        "desired force", ConstantVectorSource(task.force * scenario.direction)
    )
    controller = builder.AddNamedSystem(
        "hybrid control",
        HybridController(
            arm, control, dynamics=scenario.dynamics() if control.full_dynamics else None
        ),
    )
    connect = builder.Connect
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
    controller: HybridController,
) -> OutputPort:
    """Add what the scenario asks for between a controller and its arm; return the torque."""
    torque = controller.GetOutputPort("torque")
    if scenario.friction_compensation is None:
        return torque
    compensation = builder.AddNamedSystem(
        "friction compensation",
        FrictionCompensation(
            scenario.friction_compensation,
            joints=scenario.ARM.num_joints,
            period=scenario.controller.period,
        ),
    )
    builder.Connect(torque, compensation.GetInputPort("command"))
    builder.Connect(manipulator.base_torque, compensation.GetInputPort("base_torque"))
    return compensation.GetOutputPort("torque")


def add_kick(builder: DiagramBuilder, scenario: HybridScenario, arm: ArmInContact) -> None:
    """Add a blow that gives the tip a speed away from the surface."""
    task = scenario.task
    if task.kick_time is None:
        return
    q = scenario.joint_positions(scenario.touching)
    state = scenario.dynamics().evaluate(q, np.zeros(len(q)))
    away = -np.array([*scenario.direction, 0.0, 0.0][:3])
    row = away @ state.J_v_WC
    mass = 1 / float(row @ np.linalg.solve(state.mass, row))
    kick = builder.AddNamedSystem(
        "kick",
        Impulse(
            away * mass * task.kick_speed, begin=task.kick_time, duration=scenario.plant.period
        ),
    )
    builder.Connect(kick.get_output_port(), arm.GetInputPort("disturbance"))
