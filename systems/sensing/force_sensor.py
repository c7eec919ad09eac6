"""Force sensors: gauges, filter, converter, decoupled readings, and tare."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from chamfer.models.validation import (
    ParameterError,
    finite,
    known,
    require_finite,
    require_not_negative,
    require_positive,
)
from chamfer.systems.compiled import add_product, compiled
from chamfer.systems.contact.arm_dynamics import ArmDynamics, Chain, pose
from chamfer.systems.force.projection import unit
from chamfer.systems.law_block import LawBlock
from chamfer.systems.sensing.tare_law import TareLaw

Array = NDArray[np.float64]
Matrix6 = tuple[tuple[float, ...], ...]

_FARTHEST = 1.0  # m, of a sensor's origin: beyond it the unit is wrong
_MOST_HELD = 1000  # steps of the plant for which a reading may be late


@dataclass(frozen=True, kw_only=True)
class ChannelParams:
    """Imperfections between a force and the number that the computer reads; 0: none.

    None: derived from ``sensing``.
    """

    noise: float | None = None  # N, half-width of a uniform noise, new each period
    bias: float | tuple[float, ...] | None = None
    # N, at the start, one for every channel; or one for each, N and N m
    drift: float | None = None  # N/s^0.5, of the bias, a random walk
    bandwidth: float | None = None  # Hz, of the first-order filter before the converter
    delay: float | None = None  # s, of the reading behind the filter
    resolution: float | None = None  # N, of the converter
    full_scale: float | None = None  # N, larger readings saturate
    tare: float | None = None
    # s, at the start, in which it reads 0; their mean is subtracted later

    def __post_init__(self) -> None:
        given = [name for name in ChannelParams.__dataclass_fields__ if name != "bias"]
        require_not_negative(self, *given)
        if isinstance(self.bias, tuple):
            if not all(map(math.isfinite, self.bias)):
                raise ParameterError("bias", self.bias, "finite numbers")
        elif self.bias is not None:
            require_finite(self, "bias")

    @property
    def rest_noise(self) -> float:
        """Half-width of a channel's reading without a force, N."""
        return known("noise", self.noise) + known("resolution", self.resolution) / 2

    @property
    def rest_bias(self) -> float:
        """Largest mean reading of a channel without a force, before it drifts, N."""
        return 0.0 if known("tare", self.tare) else float(np.abs(self.channel_bias(1)).max())

    def channel_bias(self, scale: Array | float) -> Array:
        """Return the bias of channels with a scale, shape (k,)."""
        if self.bias is None or isinstance(self.bias, float | int):
            return np.asarray(known("bias", self.bias) * scale)
        return np.array(self.bias)


@dataclass(frozen=True, kw_only=True)
class ForceSensorParams(ChannelParams):
    """Parameters of a wrist sensor.

    With a number for the cross-talk it has three channels, with a matrix six: forces, then
    moments about its origin, in the axes of the endpoint.
    """

    cross_talk: float | Matrix6 | None = None
    # of each force into each other one; or the 6 x 6 matrix of it all, in N and N m, ones on the
    # diagonal; None: derived from ``sensing``
    decoupling: bool = False  # True: the reading is multiplied by the inverse of the cross-talk
    position: tuple[float, float, float] | None = None
    # m, in the endpoint's frame; None: derived from ``sensing``
    radius: float = 0.05  # m, a moment's noise, bias, ... are the forces' times this; assumed

    def __post_init__(self) -> None:
        super().__post_init__()
        given = self.cross_talk
        require_positive(self, "radius")
        _require_place(self.position)
        if isinstance(given, tuple):
            _require_regular(given, "a number, or a regular 6 x 6 matrix")
        elif given is not None and not -0.5 < given < 1:
            # The eigenvalues of the matrix are 1 - c, 1 - c and 1 + 2c.
            raise ParameterError("cross_talk", given, "more than -0.5 and less than 1")
        elif given is not None and any(self.position or ()):
            allowed = "0 unless cross_talk is a 6 x 6 matrix: moments don't matter"
            raise ParameterError("position", self.position, allowed)
        six = given is None or isinstance(given, tuple)
        if not (six and self.decoupling) and self.radius != ForceSensorParams.radius:
            allowed = f"{ForceSensorParams.radius:g} unless a 6 x 6 cross-talk is undone"
            raise ParameterError("radius", self.radius, allowed)

    @property
    def coupling(self) -> Array:
        """Matrix from force and moment to the channels' readings, shape (3, 3) or (6, 6)."""
        if isinstance(self.cross_talk, tuple):
            return np.array(self.cross_talk, dtype=np.float64)
        given = known("cross_talk", self.cross_talk)
        coupling: Array = given * np.ones((3, 3)) + (1 - given) * np.eye(3)
        return coupling

    @property
    def undoing(self) -> Array:
        """Matrix from the reading to the force, shape (3, 3) or (3, 6)."""
        coupling = self.coupling
        if not self.decoupling:
            return np.eye(3, len(coupling))
        undone: Array = np.asarray(np.linalg.inv(coupling), dtype=np.float64)
        return undone[:3]


def _require_place(place: tuple[float, ...] | None, name: str = "position") -> None:
    if not all(abs(one) <= _FARTHEST for one in place or ()):
        raise ParameterError(name, place, f"three finite numbers, {_FARTHEST:g} m at most")


def _require_regular(cross_talk: Matrix6, allowed: str) -> None:
    square = len(cross_talk) == 6 and all(len(row) == 6 for row in cross_talk)
    if not (square and np.all(np.isfinite(cross_talk)) and np.linalg.cond(cross_talk) < 1e6):
        raise ParameterError("cross_talk", cross_talk, allowed)


@dataclass(frozen=True, kw_only=True)
class LoadCellParams(ChannelParams):
    """Parameters of a uniaxial load cell."""

    axis: tuple[float, float, float]  # in the endpoint's frame, pointing out of the arm

    def __post_init__(self) -> None:
        super().__post_init__()
        unit(np.array(self.axis), "axis")


@dataclass(frozen=True, kw_only=True)
class BaseSensorParams(ChannelParams):
    """Parameters of a six-axis sensor under an arm's base, in the world's axes."""

    radius: float = 0.2  # m, a moment's noise, bias, ... are the forces' times this; assumed

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "radius")
        if self.tare:
            raise ParameterError("tare", self.tare, "0: at rest it reads the arm's weight")


class Gauges(NamedTuple):
    """Response of k channels to a force on the tip, or to another load of s entries."""

    pick_up: Array  # (k, s), from the arm's force on the surface in the endpoint's frame, N
    scale: Array  # (k,), of a channel's noise, bias, ...: 1 of a force, m of a moment


def gauges(
    params: ForceSensorParams | LoadCellParams, contact_point: tuple[float, float, float]
) -> Gauges:
    """Return a sensor's gauges for a force at a contact point, m, in the endpoint's frame.

    What a gripper gives by is left out of the moments.
    """
    if isinstance(params, LoadCellParams):
        return Gauges(unit(np.array(params.axis), "axis")[np.newaxis], np.ones(1))
    coupling = params.coupling
    lever = np.subtract(contact_point, known("position", params.position))
    felt = np.vstack([np.eye(3), _cross(lever)])[: len(coupling)]
    return Gauges(coupling @ felt, _scale(params.radius)[: len(coupling)])


def _cross(lever: Array) -> Array:
    """Return the matrix from a force to its moment for a lever, m, shape (3, 3)."""
    x, y, z = lever.tolist()
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def _scale(radius: float) -> Array:
    """Return the scale of three forces and three moments, shape (6,)."""
    return np.array([1.0, 1.0, 1.0, *3 * [radius]])


def base_gauges(params: BaseSensorParams) -> Gauges:
    """Return the gauges of a sensor under the base; their load is the base's wrench."""
    return Gauges(-np.eye(6), _scale(params.radius)[::-1])


class SensorCode(NamedTuple):
    """A force sensor of k channels for machine code."""

    pick_up: Array  # (k, s), N (N m) of a channel of what the gauges feel
    keep: float  # of what left the filter a step ago
    late: int  # steps by which a reading is late,
    part: float  # and the part of one more
    bias: Array  # (k,)
    noise: Array  # (k,), half-width of the noise
    walk: Array  # (k,), of the bias in a period
    limit: Array  # (k,), 0 for none
    quantum: Array  # (k,), 0 for none
    tares: int  # readings of which the zero is made
    rows: int  # of what left the filter, that are kept


def sensor_code(
    params: ChannelParams, gauges: Gauges, *, step: float, period: float
) -> SensorCode:
    """Return a sensor for :func:`converted`; see :class:`ForceSensor`."""
    bandwidth, delay = known("bandwidth", params.bandwidth), known("delay", params.delay)
    if delay > _MOST_HELD * step:
        raise ParameterError("delay", delay, f"at most {_MOST_HELD * step:g} s")
    late, part = divmod(delay / step, 1.0) if delay else (0.0, 0.0)
    if part > 1 - 1e-9:  # of a whole number of steps
        late, part = late + 1, 0.0
    bias = np.array(params.channel_bias(gauges.scale), np.float64)
    if len(bias) != len(gauges.scale):
        raise ParameterError("bias", params.bias, f"one number, or {len(gauges.scale)}")
    return SensorCode(
        -gauges.pick_up,
        math.exp(-2 * math.pi * bandwidth * step) if bandwidth else 0.0,
        int(late),
        part,
        bias,
        known("noise", params.noise) * gauges.scale,
        known("drift", params.drift) * math.sqrt(period) * gauges.scale,
        known("full_scale", params.full_scale) * gauges.scale,
        known("resolution", params.resolution) * gauges.scale,
        round(known("tare", params.tare) / period),
        max(int(late) + int(part > 0), int(bandwidth > 0)),
    )


@compiled
def filtered(code: SensorCode, force: Array, line: Array) -> Array:
    """Return the filter's outputs, the present and earlier ones, newest first, ((rows + 1) k,)."""
    k = len(code.bias)
    result = np.zeros(k + len(line))
    add_product(code.pick_up, force, result[:k])
    result[k:] = line
    if code.keep > 0.0:
        for i in range(k):
            result[i] += code.keep * (line[i] - result[i])
    return result


@compiled
def converted(code: SensorCode, force: Array, line: Array, walk: Array, noise: Array) -> Array:
    """Return the converter's output before the tare, shape (k,); raw where not finite."""
    k = len(code.bias)
    passed, reading, sound = filtered(code, force, line), np.empty(k), True
    for i in range(k):
        at = code.late * k + i
        reading[i] = passed[at]
        if code.part > 0.0:
            reading[i] += code.part * (passed[at + k] - passed[at])
        reading[i] += code.bias[i] + walk[i]
        if code.noise[i] > 0.0:
            reading[i] += code.noise[i] * (2.0 * noise[i] - 1.0)
        sound = sound and math.isfinite(reading[i])
    for i in range(k):
        if sound and code.limit[i] > 0.0:
            reading[i] = min(max(reading[i], -code.limit[i]), code.limit[i])
        if sound and code.quantum[i] > 0.0:
            reading[i] = code.quantum[i] * np.rint(reading[i] / code.quantum[i])
    return reading


class ForceSensor(LeafSystem):
    """Measures a force with k channels, up to the numbers that the computer reads.

    .. pydrake_system::

        name: ForceSensor
        input_ports:
        - tool_force
        - noise
        - drift
        output_ports:
        - reading

    In this order: gauges with their cross-talk, a first-order low-pass, a delay, bias with its
    drift and noise, saturation, quantisation and the tare.

    * ``tool_force``, shape (3,), N, is of the surface on the arm in the endpoint's frame, or
      another load of the gauges. With :func:`base_gauges` it is moment and force of the base on
      the arm, shape (6,).
    * ``noise``, shape (k,), has samples from 0 to 1; ``drift``, shape (k,), has standard normal
      samples. Both are new each period (Drake's ``RandomSource``), and read only if they matter.
    * ``reading``, shape (k,), N (N m), is of the arm on the surface: the opposite sign. With
      :func:`base_gauges` the sign is kept. Without filter and delay the output follows the inputs
      directly.

    Discrete states: the filter's outputs, newest first, the drift, and the tare with its count.
    The filter runs at ``step``, s, in which the force changes; the period, s, is the computer's.
    With ``ahead`` the filter steps before discrete updates of the same instant, because plants
    with sampled outputs show the force of the next instant after their update.

    Raises:
        ParameterError: If parameters are open, or the delay is more than 1000 steps; in a run, if
            a force or a reading is not finite.
    """

    def __init__(
        self,
        params: ChannelParams,
        gauges: Gauges,
        *,
        step: float,
        period: float,
        ahead: bool = False,
    ) -> None:
        super().__init__()
        k = len(gauges.scale)
        self._code = code = sensor_code(params, gauges, step=step, period=period)
        self._force = self.DeclareVectorInputPort("tool_force", gauges.pick_up.shape[1])
        self._noise = self.DeclareVectorInputPort("noise", k)
        self._drift = self.DeclareVectorInputPort("drift", k)
        self._line = self.DeclareDiscreteState(k * code.rows)
        self._walk = self.DeclareDiscreteState(k)
        self._tare = self.DeclareDiscreteState(k)
        self._count = self.DeclareDiscreteState(1)
        if code.rows and ahead:
            self.DeclarePeriodicUnrestrictedUpdateEvent(
                step,
                0.0,
                lambda context, state: self._step(context, state.get_mutable_discrete_state()),
            )
        elif code.rows:
            self.DeclarePeriodicDiscreteUpdateEvent(step, 0.0, self._step)
        if code.walk.any() or code.tares:
            self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, self._tick)
        depends = {self._force.ticket(), self._noise.ticket(), self.xd_ticket()}
        self.DeclareVectorOutputPort("reading", k, self._calc, depends)

    def _felt(self, context: Context) -> tuple[Array, Array]:
        """Return the gauges' signal, and the filter's earlier outputs."""
        # Copies, because compiled code tells views of a Context from arrays.
        line = context.get_discrete_state(self._line).value().copy()
        return self._force.Eval(context).copy(), line

    def _converted(self, context: Context) -> Array:
        """Return the converter's output before the tare."""
        walk = context.get_discrete_state(self._walk).value().copy()
        noise = self._noise.Eval(context).copy() if self._code.noise.any() else walk
        reading = converted(self._code, *self._felt(context), walk, noise)
        return finite("measured force", reading)

    def _calc(self, context: Context, vector: BasicVector) -> None:
        values = context.get_discrete_state
        if values(self._count).value()[0] < self._code.tares:
            vector.SetZero()
        else:
            vector.SetFromVector(self._converted(context) - values(self._tare).value())

    def _step(self, context: Context, values: DiscreteValues) -> None:
        passed = filtered(self._code, *self._felt(context))
        values.set_value(self._line, passed[: -len(self._code.bias)])

    def _tick(self, context: Context, values: DiscreteValues) -> None:
        state = context.get_discrete_state
        if self._code.walk.any():
            step = self._code.walk * self._drift.Eval(context)
            values.set_value(self._walk, state(self._walk).value() + step)
        count = float(state(self._count).value()[0])
        if count < self._code.tares:
            tare = state(self._tare).value()
            mean = tare + (self._converted(context) - tare) / (count + 1)
            values.set_value(self._tare, mean)
            values.set_value(self._count, [count + 1])


# Channels are forces, then moments; wrenches are moments above forces.
_SWAP = np.roll(np.eye(6), 3, axis=0)


@dataclass(frozen=True, kw_only=True)
class WrenchSensorParams(ChannelParams):
    """Parameters of a six-axis sensor; its channels are three forces, then three moments."""

    cross_talk: Matrix6 | None = None
    # 6 x 6, what each channel reads of all, in N and N m, ones on the diagonal; None: derived
    # from ``sensing``
    decoupling: bool = False  # True: the reading is multiplied by the inverse of the cross-talk
    origin: tuple[float, float, float] | None = None
    # m, where moments are taken, from the tool's tip in the world's axes; None: derived from
    # ``sensing``
    radius: float = 0.02  # m, a moment's noise, bias, ... are the forces' times this; assumed

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "radius")
        _require_place(self.origin, "origin")
        if self.cross_talk is not None:
            _require_regular(self.cross_talk, "a regular 6 x 6 matrix")
        if self.tare:
            raise ParameterError("tare", self.tare, "0: the skill takes the zero")

    @property
    def coupling(self) -> Array:
        """Matrix from forces and moments at the sensor's origin to the readings, shape (6, 6)."""
        return np.array(known("cross_talk", self.cross_talk), dtype=np.float64)

    @property
    def _moved(self) -> Array:
        """Matrix from the wrench at the tip to that at the sensor's origin, shape (6, 6)."""
        moved = np.eye(6)
        moved[3:, :3] = -_cross(np.array(known("origin", self.origin)))
        return moved

    @property
    def gauges(self) -> Gauges:
        """Response of the channels to the wrench on the tool at its tip, N m above N."""
        # The sensor block reads what the arm does to the surface, the opposite.
        return Gauges(-self.coupling @ self._moved @ _SWAP, _scale(self.radius))

    @property
    def undoing(self) -> Array:
        """Matrix from the reading to the wrench on the tool's tip, shape (6, 6)."""
        undone = np.linalg.inv(self.coupling) if self.decoupling else np.eye(6)
        matrix: Array = np.asarray(_SWAP.T @ np.linalg.inv(self._moved) @ undone, dtype=np.float64)
        return matrix


@compiled
def force_in_world(chain: Chain, undoing: Array, reading: Array, q: Array, size: int) -> Array:
    """Return a wrist sensor's reading, decoupled and rotated; see :class:`ForceInWorld`."""
    turn, undone, force = pose(chain, q).R_WE, np.zeros(3), np.zeros(size)
    add_product(undoing, reading, undone)
    add_product(turn[:size], undone, force[:3])
    return force


class ForceInWorld(LeafSystem):
    """Decouples a wrist sensor's reading and expresses it in the world's axes (section 3.3).

    .. pydrake_system::

        name: ForceInWorld
        input_ports:
        - reading
        - encoders
        output_ports:
        - measured_force

    ``measured = R(q) D reading``, with the decoupling matrix D, and the endpoint's orientation R
    at the encoders' joint positions.

    ``reading``, shape (k,), N (N m), is in the endpoint's axes; ``encoders``, shape (2n,), is q
    and velocity, of which only q is used. ``measured_force``, shape (m,), N, has as many
    ``coordinates`` as the endpoint vector; angular ones read 0. D is ``undoing``, shape (3, k).
    """

    def __init__(self, dynamics: ArmDynamics, undoing: Array, *, coordinates: int) -> None:
        super().__init__()
        n, chain = dynamics.arm.num_joints, dynamics.chain
        undoing = np.array(undoing, np.float64)
        reading = self.DeclareVectorInputPort("reading", undoing.shape[1])
        encoders = self.DeclareVectorInputPort("encoders", 2 * n)

        def calc(context: Context, vector: BasicVector) -> None:
            q, read = encoders.Eval(context)[:n].copy(), reading.Eval(context).copy()
            vector.SetFromVector(force_in_world(chain, undoing, read, q, coordinates))

        self.DeclareVectorOutputPort(
            "measured_force", coordinates, calc, {reading.ticket(), encoders.ticket()}
        )


class Tare(LawBlock[TareLaw]):
    """Subtracts the mean reading of the last tare.

    .. pydrake_system::

        name: Tare
        input_ports:
        - force
        - tare
        output_ports:
        - tared_force
        - spread

    This removes a bias, and the weight of a nugget in the gripper. It does not remove later drift,
    or effects that turn with the sensor.

    ``force``, shape (size,), N, or N m above N, has one reading each ``period``, s; ``tare``, size
    1, is 1 while the zero is taken. ``tared_force``, likewise, is zero meanwhile, else the reading
    minus the last mean. ``spread``, likewise, is the standard deviation of one reading in the last
    mean, 0 before there are two.

    Discrete states: the mean and the sum of squared deviations from it, shape (size,) each, and
    the numbers of readings, size 2. The numbers are of the present tare and of the last one.

    Raises:
        ParameterError: If the period is not positive; while running, if the force is not finite.
    """

    def __init__(self, *, period: float, size: int = 3) -> None:
        # As Drake samples a plant: the reading of before its step of the same instant.
        super().__init__(TareLaw(period=period, size=size), updates="discrete")
