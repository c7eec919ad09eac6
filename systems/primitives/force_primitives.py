"""Force-driven primitives: guarded move, stick, hold, level, and the test for obstructed motion.

Source: Morrow, Nelson and Khosla, section 3.2. They command velocities that accommodation
perturbs: a maintained velocity v in contact is the force ``D |v|``.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, ClassVar, Final, Literal, NamedTuple

from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_one_of,
    require_positive,
    require_whole,
)
from chamfer.systems.primitives.correlation import Correlation, Phasors
from chamfer.systems.primitives.primitive import (
    FASTEST,
    STILL,
    Event,
    Observation,
    Primitive,
    Stepped,
    Vector,
)
from chamfer.systems.statechart.chart import TIME_TOLERANCE

_Pair = tuple[float, float]
Direction = Literal["-x", "+x", "-y", "+y", "-z", "+z", "-rx", "+rx", "-ry", "+ry", "-rz", "+rz"]
AxisName = Literal["x", "y", "z", "rx", "ry", "rz"]

AXIS_NAMES: Final[tuple[AxisName, ...]] = ("rx", "ry", "rz", "x", "y", "z")  # as in a velocity
# Ticks until what accommodation last perturbed is a primitive's own command: one until it is
# perturbed, and one until that is sensed. Where ticks are missing, more time passes.
_LAG: Final = 2
DIRECTIONS: Final = tuple(sign + name for name in AXIS_NAMES for sign in "-+")


class PrimitiveLoad(NamedTuple):
    """The largest speed and force of a primitive."""

    direction: Direction
    speed: float  # m/s or rad/s, commanded at most; at rest the force is D times it
    force: float = math.inf  # N or N m, against it, at which it ends; infinity: at none


def along(direction: Direction, values: Vector) -> float:
    """Return the part of six elements, angular above linear, along or about a direction."""
    value = values[index_of(direction)]
    return -value if direction[0] == "-" else value


def out_of_line(start: Vector, now: Vector, most: tuple[float, float]) -> bool:
    """Return whether two displacements differ by more than these turns, rad about x and y."""
    return any(abs(now[i] - start[i]) > most[i] for i in range(2))


def velocity(direction: Direction, speed: float) -> Vector:
    """Return the velocity, six elements, of a speed in a direction, m/s or rad/s."""
    index, way = index_of(direction), -speed if direction[0] == "-" else speed
    return tuple(way if i == index else 0.0 for i in range(len(AXIS_NAMES)))


def index_of(direction: Direction) -> int:
    """Return the place of a direction's axis in a velocity."""
    return DIRECTIONS.index(direction) // 2


def noise_of(sensed: Observation, index: int) -> float:
    """Return the standard deviation of an element of a wrench, as measured during the tare."""
    return 0.0 if sensed.spread is None else sensed.spread[index]


@dataclass(frozen=True, kw_only=True)
class Directed(Primitive):
    """A primitive along or about an axis."""

    direction: Direction = "-z"

    def __post_init__(self) -> None:
        require_one_of(self, "direction", DIRECTIONS)

    def begin(self, sensed: Observation) -> Any:
        """Remember the place of the start."""
        return along(self.direction, sensed.carriage)


@dataclass(frozen=True, kw_only=True)
class GuardedMove(Directed):
    """Moves straight, or turns, until it meets resistance.

    Events: ``contact`` when the force or torque against the motion reaches the threshold, ``lost``
    at the limit. A threshold that the sensor's noise would reach is raised beyond it.
    """

    speed: float = 0.01  # m/s or rad/s; assumed
    threshold: float = 4.0  # N or N m, against the motion; assumed
    limit: float = 0.03  # m or rad, at which the move has failed; assumed
    sure: float = 5.0
    # standard deviations of the tared sensor's noise, below which the threshold is raised

    WORD: ClassVar[str] = "gmove"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "threshold", "limit")
        require_positive(self, "speed", most=FASTEST, unit="m/s or rad/s")
        require_not_negative(self, "sure")

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, each with the earliest time, s."""
        return {"contact": 0.0, "lost": self.limit / self.speed}

    @property
    def load(self) -> PrimitiveLoad:
        """The largest speed and force."""
        return PrimitiveLoad(self.direction, self.speed, self.threshold)

    def step(self, sensed: Observation, memory: float, time: float) -> Stepped:
        """Move on, until contact or the limit."""
        noise = self.sure * noise_of(sensed, index_of(self.direction))
        if -along(self.direction, sensed.wrench) >= max(self.threshold, noise):
            return Stepped(memory, STILL, "contact")
        if along(self.direction, sensed.carriage) - memory >= self.limit:
            return Stepped(memory, STILL, "lost")
        return Stepped(memory, velocity(self.direction, self.speed))


@dataclass(frozen=True, kw_only=True)
class Stick(Directed):
    """Keeps contact by a maintained velocity, whose force is D times it, and monitors the contact.

    Event: ``lost`` when the tip has gone further than the threshold in the velocity's direction.
    """

    speed: float = 0.005  # m/s or rad/s, maintained; assumed
    threshold: float = 0.001
    # m or rad, of the tip's motion, beyond which contact is lost; assumed

    WORD: ClassVar[str] = "stick"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "speed")
        if not self.threshold > 0:
            raise ParameterError("threshold", self.threshold, "a number > 0, infinity for none")

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, each with the earliest time, s."""
        return {"lost": 0.0} if self.threshold < math.inf else {}

    @property
    def load(self) -> PrimitiveLoad:
        """The largest speed and force."""
        return PrimitiveLoad(self.direction, self.speed)

    def step(self, sensed: Observation, memory: float, time: float) -> Stepped:
        """Maintain the velocity while there is contact."""
        if along(self.direction, sensed.carriage) - memory > self.threshold:
            return Stepped(memory, STILL, "lost")
        return Stepped(memory, velocity(self.direction, self.speed))


class _Window(NamedTuple):
    """The samples of one axis in a window."""

    begin: float = 0.0  # s
    sums: Phasors = Phasors()
    below: int = 0  # windows in a row before that were below


class _Watched(NamedTuple):
    """The windows of all axes."""

    windows: tuple[_Window, ...]
    last: float = 0.0  # s, of the tick before
    skipped: int = 0  # ticks


@dataclass(frozen=True, kw_only=True)
class Obstructed(Primitive):
    """Detects obstructed dithers by correlation, and by the ratio of their amplitudes.

    Both are evaluated at the dither's frequency alone, so that bias and noise matter little. A
    window that misses half a cycle starts again. Event: ``hindered`` when C or the ratio of the
    amplitudes was below its threshold in the last windows of every axis. Only the ratio detects a
    stop on one side.
    """

    axes: tuple[AxisName, ...] = ("x", "y")
    cycle: tuple[float, ...] = (1.0, 1.0)  # s, of each axis' dither: the length of a window
    threshold: float = 0.8  # of C; free is pi^2/8; assumed
    amplitude_threshold: float = 0.4
    # of the ratio of the amplitudes; friction alone can leave 0.5; assumed
    windows: int = 2  # in a row below a threshold; assumed

    WORD: ClassVar[str] = "corr"

    def __post_init__(self) -> None:
        _require_axes(self.axes)
        if len(self.cycle) != len(self.axes) or not all(0 < t < math.inf for t in self.cycle):
            raise ParameterError("cycle", self.cycle, "a finite number > 0 for each axis")
        require_not_negative(self, "threshold", "amplitude_threshold")
        require_whole(self, "windows")

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, each with the earliest time, s."""
        return {"hindered": 0.0}

    def begin(self, sensed: Observation) -> _Watched:
        """Forget all windows before."""
        return _Watched((_Window(),) * len(self.axes))

    def step(self, sensed: Observation, memory: _Watched, time: float) -> Stepped:
        """Add a sample of every axis."""
        if memory.skipped < _LAG:
            begun = (_Window(time),) * len(self.axes)
            return Stepped(_Watched(begun, time, memory.skipped + 1))
        windows = []
        for axis, cycle, window in zip(self.axes, self.cycle, memory.windows, strict=True):
            i = AXIS_NAMES.index(axis)
            pair = sensed.perturbed[i], sensed.motion[i]
            windows.append(self._seen(window, cycle, pair, (memory.last, time)))
        watched = _Watched(tuple(windows), time, memory.skipped)
        hindered = min(window.below for window in windows) >= self.windows
        return Stepped(watched, STILL, "hindered" if hindered else None)

    def _seen(self, window: _Window, cycle: float, pair: _Pair, span: _Pair) -> _Window:
        """Return the window with a sample of f and g, which stands for a time from and to, s."""
        last, time = span
        if time - last >= cycle / 2:
            return _Window(time)
        before, now = (last - window.begin) / cycle, (time - window.begin) / cycle
        if time < window.begin + cycle - TIME_TOLERANCE:
            return window._replace(sums=window.sums.add(*pair, before, now))
        low = self._low(window.sums.add(*pair, before, 1.0).correlation())
        rest = Phasors().add(*pair, 0.0, now - 1.0)
        return _Window(window.begin + cycle, rest, window.below + 1 if low else 0)

    def _low(self, found: Correlation) -> bool:
        return found.value < self.threshold or found.amplitude_ratio < self.amplitude_threshold


@dataclass(frozen=True, kw_only=True)
class Hold(Primitive):
    """Holds axes softly where they were when it began; it has no event.

    Under damping control it is a spring: a force that pushes an axis away by q is D gain q.
    """

    axes: tuple[AxisName, ...] = ("rx", "ry", "rz")
    gain: float = 5.0  # 1/s; assumed

    WORD: ClassVar[str] = "hold"

    def __post_init__(self) -> None:
        _require_axes(self.axes)
        require_positive(self, "gain")

    def begin(self, sensed: Observation) -> Vector:
        """Remember the pose of the axes."""
        return sensed.carriage

    def step(self, sensed: Observation, memory: Vector, time: float) -> Stepped:
        """Go back to that pose."""
        velocity = [0.0] * len(AXIS_NAMES)
        for axis in self.axes:
            i = AXIS_NAMES.index(axis)
            velocity[i] = self.gain * (memory[i] - sensed.carriage[i])
        return Stepped(memory, tuple(velocity))


class _Levelled(NamedTuple):
    """The memory of levelling."""

    start: Vector  # rad above m
    since: float = 0.0  # s, when the window began
    sums: Vector = (0.0, 0.0)  # N m, of the window's torques about the axes
    samples: int = 0


@dataclass(frozen=True, kw_only=True)
class Level(Primitive):
    """Waits until accommodation has laid a face flat on another: no torque about x or y is left.

    The torque is a mean over windows; a mean within its noise counts as none. Events: ``done``;
    ``lost`` when the part has turned further than the grasp can be wrong. It then tips over an
    edge, beside the face that it should lie on.
    """

    axes: tuple[Literal["rx", "ry"], ...] = ("rx", "ry")  # that are levelled
    torque: float = 0.012  # N m, of a mean that counts as none; assumed
    sure: float = 3.0  # standard deviations of the mean, by the tared spread, that count as none
    time: float = 0.2  # s, of a window; assumed
    limit: float = 0.056  # rad, of the turn about each axis at which it is lost; assumed

    WORD: ClassVar[str] = "level"

    def __post_init__(self) -> None:
        if not self.axes or not set(self.axes) <= {"rx", "ry"}:
            raise ParameterError("axes", self.axes, "one or more of rx, ry")
        require_positive(self, "torque", "limit")
        require_not_negative(self, "time", "sure")

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, each with the earliest time, s."""
        return {"done": self.time, "lost": 0.0}

    def begin(self, sensed: Observation) -> _Levelled:
        """Remember the turn at the start."""
        return _Levelled(sensed.carriage)

    def step(self, sensed: Observation, memory: _Levelled, time: float) -> Stepped:
        """Compare torque and turn with their limits."""
        turning = [AXIS_NAMES.index(axis) for axis in self.axes]
        turned = max(abs(sensed.carriage[i] - memory.start[i]) for i in turning)
        if turned > self.limit:
            return Stepped(memory, STILL, "lost")
        sums = tuple(
            total + (sensed.wrench[i] if i in turning else 0.0)
            for i, total in enumerate(memory.sums)
        )
        samples = memory.samples + 1
        if time - memory.since < self.time - TIME_TOLERANCE:
            return Stepped(_Levelled(memory.start, memory.since, sums, samples))
        spread = max(noise_of(sensed, i) for i in turning) / math.sqrt(samples)
        none = max(self.torque, self.sure * spread)
        done = math.hypot(*sums) / samples <= none
        return Stepped(_Levelled(memory.start, time), STILL, "done" if done else None)


def _require_axes(axes: tuple[AxisName, ...]) -> None:
    if not axes or not set(axes) <= set(AXIS_NAMES):
        raise ParameterError("axes", axes, f"one or more of {', '.join(AXIS_NAMES)}")
