"""Sensors and computer of an arm: ideal as in the paper's figure, or realistic.

An ideal part adds no block.
"""

import math
from dataclasses import dataclass, fields, replace
from typing import Final, Literal, TypeVar

import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomDistribution
from pydrake.systems.framework import DiagramBuilder, InputPort, OutputPort
from pydrake.systems.primitives import RandomSource

from chamfer.models.validation import known, within
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.force.hybrid_law import HybridControllerParams
from chamfer.systems.sensing.computation_delay import ComputationDelay, require_within_period
from chamfer.systems.sensing.encoders import EncoderParams, Encoders
from chamfer.systems.sensing.force_sensor import (
    ChannelParams,
    ForceInWorld,
    ForceSensor,
    ForceSensorParams,
    Gauges,
    LoadCellParams,
)

Array = NDArray[np.float64]
Sensing = Literal["ideal", "realistic"]
SensorParams = ForceSensorParams | LoadCellParams
Params = TypeVar("Params", bound=ChannelParams)

# Relative, of friction on a table: of table_a, table_b and table_press (models/recordings) nine of
# ten means of 50 ms are within 14, 15 and 13 % of the median.
ROUGH: Final = 0.085
_TRACKED: Final = 20.0  # Hz, of a tracking filter that is asked for alone
EXACT: Final = EncoderParams(counts=0.0, velocity="exact", bandwidth=0.0)


@dataclass(frozen=True, kw_only=True)
class SensingValues:
    """Values for the fields that a scenario leaves open."""

    sensor: SensorParams
    encoders: EncoderParams = EXACT
    computation_delay: float = 0.0  # s
    computation_jitter: float = 0.0  # s
    friction_noise: float = 0.0  # relative, of the surface


@dataclass(frozen=True, kw_only=True)
class ControllerSettings(HybridControllerParams):
    """The hybrid controller, and whether it may run where it is unstable."""

    computation_delay: float | None = None
    # s, from the sensors to the torque, 0 to a period; None: derived from ``sensing``
    computation_jitter: float | None = None
    # s, half-width of the delay's variation; None: derived from ``sensing``
    allow_unstable: bool = False  # True: run a loop that is unstable


def ideal(sensor: Params) -> Params:
    """Return the sensor with its open fields set to no imperfection."""
    nothing = dict.fromkeys(missing(sensor, sensor), 0.0)
    at_tip = dict.fromkeys({"position", "origin"} & nothing.keys(), (0.0, 0.0, 0.0))
    return replace(sensor, **{**nothing, **at_tip})  # type: ignore[arg-type]


def sensor_of(given: Params, values: SensingValues) -> Params:
    """Return the sensor with its open fields filled in; its place only if it reads moments."""
    left_open = missing(given, values.sensor)
    if isinstance(given, ForceSensorParams) and isinstance(given.cross_talk, float):
        left_open["position"] = (0.0, 0.0, 0.0)
    return replace(given, **left_open)  # type: ignore[arg-type]


def encoders_of(given: EncoderParams, values: SensingValues) -> EncoderParams:
    """Return the encoders with open fields filled in; the bandwidth suits the velocity."""
    left_open = missing(given, values.encoders)
    if given.velocity is not None and given.bandwidth is None:
        left_open["bandwidth"] = _TRACKED if given.velocity == "tracked" else 0.0
    return replace(given, **left_open)  # type: ignore[arg-type]


def computer_of(control: ControllerSettings, values: SensingValues) -> ControllerSettings:
    """Return the controller with its computer's open fields filled in."""
    delay, jitter = control.computation_delay, control.computation_jitter
    if delay is None:
        delay = values.computation_delay
    if jitter is None:  # no more than what an own delay leaves room for
        jitter = min(values.computation_jitter, delay, control.period - delay)
    with within("controller"):
        require_within_period(delay, jitter, control.period)
    return replace(control, computation_delay=delay, computation_jitter=jitter)


def push_errors(sensor: SensorParams, direction: Array, R_WE: Array) -> tuple[float, float]:
    """Return the errors of a push measured without contact, N: by noise, by bias.

    ``direction``, shape (m,), is that of the push in endpoint coordinates, R_WE the endpoint's
    orientation where it should touch; the sensor is resolved.
    """
    share = 1.0  # of a channel's error in the push, at worst
    if isinstance(sensor, ForceSensorParams):
        channels = sensor.coupling.shape[0]
        scale = np.array([1.0, 1.0, 1.0, *3 * [sensor.radius]])[:channels]
        ahead = np.array([*direction, 0.0, 0.0])[:3]
        share = float(np.abs(ahead @ R_WE @ sensor.undoing) @ scale)
    return share * sensor.rest_noise, share * sensor.rest_bias


def force_noise(sensor: ForceSensorParams) -> float:
    """Return the rms length of a force's error by a resolved sensor's noise and converter, N."""
    undoing = sensor.undoing
    scale = np.array([1.0, 1.0, 1.0, *3 * [sensor.radius]])[: undoing.shape[1]]
    noise, step = known("noise", sensor.noise), known("resolution", sensor.resolution)
    return math.sqrt(noise**2 / 3 + step**2 / 12) * float(np.linalg.norm(undoing * scale))


def missing(given: object, values: object) -> dict[str, object]:
    """Return the fields that are None, with their values of another dataclass."""
    return {
        one.name: getattr(values, one.name)
        for one in fields(given)  # type: ignore[arg-type]
        if getattr(given, one.name) is None
    }


def add_encoders(
    builder: DiagramBuilder,
    params: EncoderParams,
    motion: OutputPort,
    start: Array,
    *,
    period: float,
) -> OutputPort:
    """Add encoders to a motion, (2n,), that starts at rest, (n,); return their output, (2n,)."""
    if params.exact:
        return motion
    encoders = builder.AddNamedSystem("encoders", Encoders(params, start, period=period))
    builder.Connect(motion, encoders.GetInputPort("motion"))
    return encoders.GetOutputPort("encoders")


def add_delay(
    builder: DiagramBuilder, control: ControllerSettings, torque: InputPort, *, step: float
) -> InputPort:
    """Add the computer's delay before an arm's torque, (n,); return the port to connect to.

    The arm takes a torque every ``step``, s.
    """
    delay = known("computation_delay", control.computation_delay)
    jitter = known("computation_jitter", control.computation_jitter)
    if not delay:
        return torque
    size, period = torque.size(), control.period
    late = ComputationDelay(size, delay=delay, jitter=jitter, period=period, step=step)
    block = builder.AddNamedSystem("computation delay", late)
    builder.Connect(block.GetOutputPort("torque"), torque)
    if jitter:
        add_noise(builder, "jitter", block.GetInputPort("jitter"), period)
    return block.GetInputPort("command")


def add_force_in_world(
    builder: DiagramBuilder,
    params: ForceSensorParams,
    dynamics: ArmDynamics,
    reading: OutputPort,
    encoders: OutputPort,
    *,
    coordinates: int,
) -> OutputPort:
    """Express a wrist sensor's reading, (k,), in the world; return the arm's force, N.

    It has as many ``coordinates`` as the endpoint vector: x, y, z, then zeros.
    """
    block = ForceInWorld(dynamics, params.undoing, coordinates=coordinates)
    turned = builder.AddNamedSystem("force in the world", block)
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
    ahead: bool = False,
) -> OutputPort:
    """Add a sensor with its noise; return its reading, (k,).

    ``where`` is in front of the blocks' names; ``felt``, which changes every ``step``, s, is what
    the given gauges feel; ``period``, s, is the computer's; ``ahead`` as of :class:`ForceSensor`.
    """
    block = ForceSensor(params, given, step=step, period=period, ahead=ahead)
    sensor = builder.AddNamedSystem(f"{where}force sensor", block)
    builder.Connect(felt, sensor.GetInputPort("tool_force"))
    if params.noise:
        add_noise(builder, f"{where}sensor noise", sensor.GetInputPort("noise"), period)
    if params.drift:
        drift = sensor.GetInputPort("drift")
        add_noise(builder, f"{where}sensor drift", drift, period, RandomDistribution.kGaussian)
    return sensor.GetOutputPort("reading")


def add_noise(
    builder: DiagramBuilder,
    name: str,
    port: InputPort,
    period: float,
    distribution: RandomDistribution = RandomDistribution.kUniform,
) -> None:
    """Connect a source of noise to a port; it draws once a ``period``, s."""
    noise = builder.AddNamedSystem(name, RandomSource(distribution, port.size(), period))
    builder.Connect(noise.get_output_port(), port)
