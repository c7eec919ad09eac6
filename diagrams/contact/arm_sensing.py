"""Between an arm and its computer: encoders, a force sensor, and a torque that is late.

What is ideal is not there.
"""

import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomDistribution
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import RandomSource

from chamfer.diagrams.contact.hybrid_scenario import ControllerSettings
from chamfer.models.validation import known
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.sensing.computation_delay import ComputationDelay
from chamfer.systems.sensing.encoders import EncoderParams, Encoders
from chamfer.systems.sensing.force_sensor import (
    BaseSensorParams,
    ChannelParams,
    ForceInWorld,
    ForceSensor,
    ForceSensorParams,
    Gauges,
    LoadCellParams,
    base_gauges,
    gauges,
)

Array = NDArray[np.float64]


def add_encoders(
    builder: DiagramBuilder,
    params: EncoderParams,
    motion: OutputPort,
    start: Array,
    *,
    period: float,
) -> OutputPort:
    """Add the joints' encoders; return what they show, (2n,).

    Args:
        builder: Of the loop.
        params: Resolved.
        motion: (2n,), joint positions and velocities.
        start: Joint positions at the start, shape (n,).
        period: s, of the computer.
    """
    if params.exact:
        return motion
    encoders = builder.AddNamedSystem("encoders", Encoders(params, start, period=period))
    builder.Connect(motion, encoders.GetInputPort("motion"))
    return encoders.GetOutputPort("encoders")


def add_delay(
    builder: DiagramBuilder, control: ControllerSettings, torque: InputPort, *, step: float
) -> InputPort:
    """Add the computer's delay before an arm's torque; return the port to connect to.

    Args:
        builder: Of the loop.
        control: Resolved.
        torque: (n,), of the arm.
        step: s, at which the arm takes a torque.
    """
    delay = known("computation_delay", control.computation_delay)
    jitter = known("computation_jitter", control.computation_jitter)
    if not delay:
        return torque
    block = builder.AddNamedSystem(
        "computation delay",
        ComputationDelay(
            torque.size(), delay=delay, jitter=jitter, period=control.period, step=step
        ),
    )
    builder.Connect(block.GetOutputPort("torque"), torque)
    if jitter:
        _add_noise(builder, "jitter", block.GetInputPort("jitter"), control.period)
    return block.GetInputPort("command")


def add_force_sensor(
    builder: DiagramBuilder,
    params: ForceSensorParams | LoadCellParams,
    tool_force: OutputPort,
    contact_point: tuple[float, float, float],
    *,
    step: float,
    period: float,
) -> OutputPort:
    """Add a force sensor with its noise; return its reading, (k,).

    Args:
        builder: Of the loop.
        params: Resolved.
        tool_force: (3,), N, in the endpoint's frame.
        contact_point: m, at which the force acts, in the endpoint's frame.
        step: s, at which the force changes.
        period: s, of the computer.
    """
    given = gauges(params, contact_point)
    return add_sensor(builder, "", params, given, tool_force, step=step, period=period)


def add_base_sensor(
    builder: DiagramBuilder,
    params: BaseSensorParams,
    base_wrench: OutputPort,
    *,
    step: float,
    period: float,
) -> OutputPort:
    """Add a sensor under the base with its noise; return its reading, (6,), of base on arm.

    Args:
        builder: Of the loop.
        params: Resolved.
        base_wrench: (6,), moment and force of the base on the arm.
        step: s, at which it changes.
        period: s, of the computer.
    """
    given = base_gauges(params)
    return add_sensor(builder, "base ", params, given, base_wrench, step=step, period=period)


def add_force_in_world(
    builder: DiagramBuilder,
    params: ForceSensorParams,
    dynamics: ArmDynamics,
    reading: OutputPort,
    encoders: OutputPort,
    *,
    coordinates: int,
) -> OutputPort:
    """Turn a wrist sensor's reading into the world; return it, N, of the arm on the surface.

    Args:
        builder: Of the loop.
        params: Resolved.
        dynamics: Of the arm.
        reading: (k,), of the sensor.
        encoders: (2n,).
        coordinates: Size of what is returned: x, y, z, then zeros.
    """
    turned = builder.AddNamedSystem(
        "force in the world",
        ForceInWorld(dynamics, params.undoing, coordinates=coordinates),
    )
    builder.Connect(reading, turned.GetInputPort("reading"))
    builder.Connect(encoders, turned.GetInputPort("encoders"))
    return turned.GetOutputPort("measured_force")


def add_sensor(
    builder: DiagramBuilder,
    where: str,
    params: ChannelParams,
    given: Gauges,
    felt: OutputPort,
    *,
    step: float,
    period: float,
) -> OutputPort:
    """Add a sensor with its noise; return its reading, (k,).

    Args:
        builder: Of the loop.
        where: In front of the blocks' names.
        params: Resolved.
        given: How its k channels feel.
        felt: What they feel.
        step: s, at which that changes.
        period: s, of the computer.
    """
    sensor = builder.AddNamedSystem(
        f"{where}force sensor", ForceSensor(params, given, step=step, period=period)
    )
    builder.Connect(felt, sensor.GetInputPort("tool_force"))
    if params.noise:
        _add_noise(builder, f"{where}sensor noise", sensor.GetInputPort("noise"), period)
    if params.drift:
        drift = sensor.GetInputPort("drift")
        _add_noise(builder, f"{where}sensor drift", drift, period, RandomDistribution.kGaussian)
    return sensor.GetOutputPort("reading")


def _add_noise(
    builder: DiagramBuilder,
    name: str,
    port: InputPort,
    period: float,
    distribution: RandomDistribution = RandomDistribution.kUniform,
) -> None:
    noise = builder.AddNamedSystem(name, RandomSource(distribution, port.size(), period))
    builder.Connect(noise.get_output_port(), port)
