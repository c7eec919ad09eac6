"""An arm in contact as its controller meets it: a torque goes in, what sensors read comes out."""

from typing import NamedTuple

import numpy as np
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import MatrixGain

from chamfer.diagrams.contact.arm_sensing import (
    add_delay,
    add_encoders,
    add_force_in_world,
    add_force_sensor,
)
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario
from chamfer.systems.contact.arm_in_contact import ArmInContact
from chamfer.systems.sensing.force_sensor import LoadCellParams


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
    """Add an arm on its surface, its sensors with their noise, and the computer's delay.

    Args:
        builder: Of the loop.
        scenario: Resolved.
    """
    control, plant = scenario.controller, scenario.plant
    start = scenario.joint_positions(np.array(scenario.task.start))
    arm = builder.AddNamedSystem(
        "manipulator and contact",
        ArmInContact(scenario.ARM, scenario.make_surface(), plant, start),
    )
    encoders = add_encoders(
        builder,
        scenario.encoders,
        arm.GetOutputPort("encoders"),
        start,
        period=control.period,
    )
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
    reading = add_force_sensor(
        builder,
        given,
        arm.GetOutputPort("tool_force"),
        scenario.arm.contact_offset,
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
