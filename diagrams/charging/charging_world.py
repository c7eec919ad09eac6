"""What answers the cycle: the gripper, the layer below, and what goes wrong."""

import math
from typing import Final

import numpy as np
from pydrake.systems.framework import DiagramBuilder, OutputPort
from pydrake.systems.primitives import MatrixGain

from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario
from chamfer.systems.charging.charging_machine import ChargingMachine
from chamfer.systems.charging.faults import CutOff, FaultTrigger, FaultTriggerParams
from chamfer.systems.charging.grasp import Grasp
from chamfer.systems.charging.layer_motion import LayerMotion, LayerMotionParams
from chamfer.systems.contact.arm_in_contact import ArmInContact

LAYER: Final = 1  # index of the contact point that meets the layer below
_TIMED: Final = ("part_dropped", "sensor_dead", "contact_lost", "halt")  # begin in a state


def add_world(
    builder: DiagramBuilder,
    scenario: CrucibleChargingScenario,
    arm: ArmInContact,
    machine: ChargingMachine,
) -> OutputPort | None:
    """Add gripper, layer and faults about the arm; return the port that cuts the sensor's line.

    Args:
        builder: Of the loop.
        scenario: Resolved.
        arm: With the scenario's scenes.
        machine: The chart that commands the gripper.
    """
    fault, connect = scenario.fault, builder.Connect
    missing = fault.item if fault.kind == "part_missing" else None
    contact = arm.GetOutputPort("contact")
    grasp = builder.AddNamedSystem(
        "grasp",
        Grasp(
            scenario.grasp,
            tuple(index != missing for index in range(len(scenario.plan))),
            contacts=contact.size(),
        ),
    )
    connect(contact, grasp.GetInputPort("contact"))
    for name in ("grip", "item"):
        connect(machine.GetOutputPort(name), grasp.GetInputPort(name))
    connect(grasp.GetOutputPort("scene"), arm.GetInputPort("scene"))
    connect(grasp.GetOutputPort("held"), machine.GetInputPort("held"))
    for name in ("scene", "held"):
        builder.ExportOutput(grasp.GetOutputPort(name), name)
    _add_layer(builder, scenario, arm, machine)
    if fault.kind not in _TIMED:
        return None
    active = _add_trigger(builder, scenario, machine)
    if fault.kind == "part_dropped":
        connect(active, grasp.GetInputPort("drop"))
    elif fault.kind == "halt":
        connect(active, machine.GetInputPort("halt"))
    elif fault.kind == "contact_lost":
        azimuth = scenario.plan[fault.item].azimuth
        away = -fault.force * np.array([math.cos(azimuth), math.sin(azimuth), 0.0])
        blow = builder.AddNamedSystem("blow", MatrixGain(away[:, np.newaxis]))
        connect(active, blow.get_input_port())
        connect(blow.get_output_port(), arm.GetInputPort("disturbance"))
    return active if fault.kind == "sensor_dead" else None


def add_line(
    builder: DiagramBuilder, reading: OutputPort, machine: ChargingMachine, cut: OutputPort | None
) -> OutputPort:
    """Put a line that can be cut behind a sensor, if any; return what the computer reads."""
    if cut is None:
        return reading
    line = builder.AddNamedSystem("sensor's line", CutOff(reading.size()))
    builder.Connect(reading, line.GetInputPort("signal"))
    builder.Connect(cut, line.GetInputPort("cut"))
    builder.Connect(line.GetOutputPort("alive"), machine.GetInputPort("alive"))
    return line.GetOutputPort("reading")


def _add_layer(
    builder: DiagramBuilder,
    scenario: CrucibleChargingScenario,
    arm: ArmInContact,
    machine: ChargingMachine,
) -> None:
    given = scenario.layer
    forces = arm.GetOutputPort("contact_force")
    pick = np.zeros((3, forces.size()))
    pick[:, 3 * LAYER : 3 * LAYER + 3] = np.eye(3)
    force = builder.AddNamedSystem("force on the layer", MatrixGain(pick))
    layer = builder.AddNamedSystem(
        "layer below",
        LayerMotion(
            LayerMotionParams(
                stiffness=given.stiffness,
                mass=given.mass,
                friction=given.slip_friction,
                period=scenario.plant.period,
            )
        ),
    )
    builder.Connect(forces, force.get_input_port())
    builder.Connect(force.get_output_port(), layer.GetInputPort("force"))
    builder.Connect(machine.GetOutputPort("item"), layer.GetInputPort("item"))
    builder.ExportOutput(layer.GetOutputPort("shift"), "layer_shift")


def _add_trigger(
    builder: DiagramBuilder, scenario: CrucibleChargingScenario, machine: ChargingMachine
) -> OutputPort:
    fault, states = scenario.fault, machine.chart.state_names
    trigger = builder.AddNamedSystem(
        "fault",
        FaultTrigger(
            FaultTriggerParams(
                state=states.index(fault.state),
                item=fault.item,
                delay=fault.delay,
                duration=fault.lasting,
                period=scenario.controller.period,
            )
        ),
    )
    for name in ("state", "item"):
        builder.Connect(machine.GetOutputPort(name), trigger.GetInputPort(name))
    return trigger.GetOutputPort("active")
