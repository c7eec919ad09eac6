"""An arm in contact as its controller meets it: a torque goes in, what sensors read comes out."""

from typing import NamedTuple

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.systems.framework import DiagramBuilder, InputPort, LeafSystem, OutputPort
from pydrake.systems.primitives import RandomSource

from diagrams.contact.hybrid_scenario import HybridScenario
from systems.contact.arm_in_contact import ArmInContact
from systems.sensing.force_sensor import ForceSensor, LoadCell, LoadCellParams


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
    """Add an arm on its surface, its sensors and their noise.

    Args:
        builder: Of the loop.
        scenario: Resolved.
    """
    arm = builder.AddNamedSystem(
        "manipulator and contact",
        ArmInContact(
            scenario.ARM,
            scenario.make_surface(),
            scenario.plant,
            scenario.joint_positions(np.array(scenario.task.start)),
        ),
    )
    return Manipulator(
        torque=arm.GetInputPort("torque"),
        encoders=arm.GetOutputPort("encoders"),
        measured_force=_add_force_sensor(builder, scenario, arm),
        base_torque=arm.GetOutputPort("base_torque"),
        arm=arm,
    )


def _add_force_sensor(
    builder: DiagramBuilder, scenario: HybridScenario, arm: ArmInContact
) -> OutputPort:
    given = scenario.sensor
    sensor: LeafSystem
    if isinstance(given, LoadCellParams):
        sensor, force = LoadCell(given, scenario.direction), "tool_force"
    else:
        sensor = ForceSensor(given, coordinates=scenario.ARM.num_coordinates)
        force = "contact_force"
    builder.AddNamedSystem("force sensor", sensor)
    builder.Connect(arm.GetOutputPort(force), sensor.GetInputPort(force))
    if given.noise:
        size = sensor.GetInputPort("noise").size()
        noise = builder.AddNamedSystem(
            "sensor noise",
            RandomSource(RandomDistribution.kUniform, size, scenario.controller.period),
        )
        builder.Connect(noise.get_output_port(), sensor.GetInputPort("noise"))
    return sensor.GetOutputPort("measured_force")
