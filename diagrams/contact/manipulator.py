"""An arm in contact as its controller meets it: a torque goes in, what sensors read comes out."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomDistribution
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import MatrixGain, RandomSource

from diagrams.contact.hybrid_scenario import HybridScenario
from models.validation import known
from systems.contact.arm_in_contact import ArmInContact
from systems.sensing.computation_delay import ComputationDelay
from systems.sensing.encoders import Encoders
from systems.sensing.force_in_world import ForceInWorld
from systems.sensing.force_sensor import ForceSensor, LoadCellParams, gauges

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
    """Add an arm on its surface, its sensors with their noise, and the computer's delay.

    What is ideal is not there.

    Args:
        builder: Of the loop.
        scenario: Resolved.
    """
    start = scenario.joint_positions(np.array(scenario.task.start))
    arm = builder.AddNamedSystem(
        "manipulator and contact",
        ArmInContact(scenario.ARM, scenario.make_surface(), scenario.plant, start),
    )
    encoders = _add_encoders(builder, scenario, arm.GetOutputPort("encoders"), start)
    return Manipulator(
        torque=_add_delay(builder, scenario, arm.GetInputPort("torque")),
        encoders=encoders,
        measured_force=_add_force_sensor(builder, scenario, arm, encoders),
        base_torque=arm.GetOutputPort("base_torque"),
        arm=arm,
    )


def _add_encoders(
    builder: DiagramBuilder, scenario: HybridScenario, motion: OutputPort, start: Array
) -> OutputPort:
    if scenario.encoders.exact:
        return motion
    encoders = builder.AddNamedSystem(
        "encoders", Encoders(scenario.encoders, start, period=scenario.controller.period)
    )
    builder.Connect(motion, encoders.GetInputPort("motion"))
    return encoders.GetOutputPort("encoders")


def _add_delay(builder: DiagramBuilder, scenario: HybridScenario, torque: InputPort) -> InputPort:
    control = scenario.controller
    delay = known("computation_delay", control.computation_delay)
    jitter = known("computation_jitter", control.computation_jitter)
    if not delay:
        return torque
    block = builder.AddNamedSystem(
        "computation delay",
        ComputationDelay(
            torque.size(),
            delay=delay,
            jitter=jitter,
            period=control.period,
            step=scenario.plant.period,
        ),
    )
    builder.Connect(block.GetOutputPort("torque"), torque)
    if jitter:
        _add_noise(builder, "jitter", block.GetInputPort("jitter"), control.period)
    return block.GetInputPort("command")


def _add_force_sensor(
    builder: DiagramBuilder, scenario: HybridScenario, arm: ArmInContact, encoders: OutputPort
) -> OutputPort:
    given, period = scenario.sensor, scenario.controller.period
    sensor = builder.AddNamedSystem(
        "force sensor",
        ForceSensor(
            given,
            gauges(given, scenario.arm.contact_offset),
            step=scenario.plant.period,
            period=period,
        ),
    )
    builder.Connect(arm.GetOutputPort("tool_force"), sensor.GetInputPort("tool_force"))
    if given.noise:
        _add_noise(builder, "sensor noise", sensor.GetInputPort("noise"), period)
    if given.drift:
        drift = sensor.GetInputPort("drift")
        _add_noise(builder, "sensor drift", drift, period, RandomDistribution.kGaussian)
    reading = sensor.GetOutputPort("reading")
    if isinstance(given, LoadCellParams):
        push = builder.AddNamedSystem("push", MatrixGain(scenario.direction[:, np.newaxis]))
        builder.Connect(reading, push.get_input_port())
        return push.get_output_port()
    turned = builder.AddNamedSystem(
        "force in the world",
        ForceInWorld(scenario.dynamics(), given.undoing, coordinates=scenario.ARM.num_coordinates),
    )
    builder.Connect(reading, turned.GetInputPort("reading"))
    builder.Connect(encoders, turned.GetInputPort("encoders"))
    return turned.GetOutputPort("measured_force")


def _add_noise(
    builder: DiagramBuilder,
    name: str,
    port: InputPort,
    period: float,
    distribution: RandomDistribution = RandomDistribution.kUniform,
) -> None:
    noise = builder.AddNamedSystem(name, RandomSource(distribution, port.size(), period))
    builder.Connect(noise.get_output_port(), port)
