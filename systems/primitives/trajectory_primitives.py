"""Trajectory primitives: movedx, ldither and rdither, pairs of dithers (section 2), and a spiral.

Source: Morrow, Nelson and Khosla. A primitive gives a Cartesian velocity, shape (6,), rad/s above
m/s as Drake orders them, over the time since it began. The paper prints no amplitudes and no
frequencies.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Final, Literal

from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_numbers,
    require_one_of,
    require_positive,
)
from chamfer.systems.primitives.force_primitives import AXIS_NAMES
from chamfer.systems.primitives.primitive import (
    FASTEST,
    FASTEST_TURN,
    STILL,
    Event,
    Observation,
    Primitive,
    Stepped,
    Vector,
)
from chamfer.systems.statechart.chart import TIME_TOLERANCE

Axis = Literal["x", "y", "z"]

AXES: Final[tuple[Axis, ...]] = ("x", "y", "z")


class _Timed(Primitive):
    """A velocity over the time since it began. Event: ``done`` when the time is over."""

    @property
    def duration(self) -> float:
        """Duration, s."""
        raise NotImplementedError

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, each with the earliest time, s."""
        return {"done": self.duration}

    def done(self, time: float) -> bool:
        """Return whether it has ended."""
        return time >= self.duration - TIME_TOLERANCE

    def step(self, sensed: Observation, memory: object, time: float) -> Stepped:
        """Return the velocity, and the event at the end."""
        if self.done(time):
            return Stepped(None, STILL, "done")
        return Stepped(None, self.velocity(time))

    def velocity(self, time: float) -> Vector:
        """Return the velocity while it runs."""
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class MoveDx(_Timed):
    """Applies a constant velocity for a time, to move by a given displacement."""

    displacement: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # rad above m
    duration: float = 1.0  # s

    def __post_init__(self) -> None:
        require_positive(self, "duration")
        require_numbers(self, 6, "displacement")
        speeds = [abs(rate) for rate in self.velocity(0.0)]
        if max(speeds[:3]) > FASTEST_TURN or max(speeds[3:]) > FASTEST:
            allowed = f"at most {FASTEST_TURN:g} rad/s and {FASTEST:g} m/s, in {self.duration:g} s"
            raise ParameterError("displacement", self.displacement, allowed)

    @property
    def label(self) -> str:
        """The name in a chart."""
        signs = [
            ("-" if way < 0 else "+") + name
            for name, way in zip(AXIS_NAMES, self.displacement, strict=True)
            if way
        ]
        return " ".join(["movedx", *signs]) if signs else f"wait {self.duration:g} s"

    def velocity(self, time: float) -> Vector:
        """Return the velocity, a constant."""
        return tuple(way / self.duration for way in self.displacement)


@dataclass(frozen=True, kw_only=True)
class Dither(_Timed):
    """A sinusoidal velocity along an axis (ldither) or about it (rdither).

    The displacement is ``amplitude sin(w t)``: the velocity is a cosine. A velocity that begins as
    a sine, as in the paper's text, moves the pattern by the amplitude. This one begins a quarter
    of a cycle later, so that the pattern is centred at the place of the start.
    """

    kind: Literal["linear", "rotary"] = "linear"  # along the axis or about it
    axis: Axis = "x"  # of the tool
    amplitude: float = 0.001  # m or rad, of the displacement
    frequency: float = 1.0  # Hz, of the displacement
    cycles: float = 10.0  # duration

    def __post_init__(self) -> None:
        require_one_of(self, "kind", ("linear", "rotary"))
        require_one_of(self, "axis", AXES)
        require_finite(self, "amplitude")
        require_positive(self, "frequency", "cycles")
        w = 2 * math.pi * self.frequency
        most, unit = (FASTEST, "m") if self.kind == "linear" else (FASTEST_TURN, "rad")
        if w * abs(self.amplitude) > most:
            allowed = f"at most {most / w:.3g} {unit}, {most:g} {unit}/s at {self.frequency:g} Hz"
            raise ParameterError("amplitude", self.amplitude, allowed)

    @property
    def duration(self) -> float:
        """Duration, s."""
        return self.cycles / self.frequency

    @property
    def index(self) -> int:
        """Index of its element in a velocity."""
        return AXES.index(self.axis) + (3 if self.kind == "linear" else 0)

    def displacement(self, time: float) -> float:
        """Return the displacement at a time since the start, while it runs, m or rad."""
        return self.amplitude * math.sin(2 * math.pi * self.frequency * time)

    @property
    def label(self) -> str:
        """The name in a chart."""
        return f"{'ldither' if self.kind == 'linear' else 'rdither'} {self.axis}"

    def velocity(self, time: float) -> Vector:
        """Return the velocity, a cosine."""
        w = 2 * math.pi * self.frequency
        velocity = [0.0] * len(STILL)
        velocity[self.index] = self.amplitude * w * math.cos(w * time)
        return tuple(velocity)


def lissajous(*, first: Dither, axis: Axis, repeats: int) -> tuple[Dither, Dither]:
    """Return two dithers that together cover an area, frequencies (N + 1) / N apart (section 2).

    The first one is the slower; it runs N cycles, ``repeats``, until the pattern repeats.
    """
    if axis == first.axis:
        raise ParameterError("axis", axis, f"an axis other than {first.axis}")
    if not repeats >= 1:
        raise ParameterError("repeats", repeats, "a whole number >= 1")
    ratio = (repeats + 1) / repeats
    slow = replace(first, cycles=float(repeats))
    fast = replace(first, axis=axis, frequency=ratio * first.frequency, cycles=float(repeats + 1))
    return slow, fast


@dataclass(frozen=True, kw_only=True)
class Spiral(_Timed):
    """Moves along a spiral in x and y at a constant speed: an alternative to the paper's dithers.

    Two dithers cover a rectangle evenly in time and come back to the middle. An Archimedean
    spiral, ``r = pitch angle / (2 pi)``, begins in the middle, where the error is least likely to
    be large, and covers a disc. Its length up to the radius R is about ``pi R^2 / pitch``.
    """

    speed: float = 0.01  # m/s, along the spiral; assumed
    pitch: float = 0.0008  # m, between two turns; assumed
    radius: float = 0.003  # m, where it ends; assumed

    WORD: ClassVar[str] = "spiral"

    def __post_init__(self) -> None:
        require_positive(self, "pitch", "radius")
        require_positive(self, "speed", most=FASTEST, unit="m/s")

    @property
    def duration(self) -> float:
        """Duration, s."""
        return self._way(self._last) / self.speed

    def angle(self, time: float) -> float:
        """Return the angle at a time since the start, rad."""
        way = self.speed * time
        # From the way of many turns, b angle^2 / 2, by Newton's method.
        angle = min(math.sqrt(2 * way / self._growth), self._last)
        for _ in range(3):
            angle -= (self._way(angle) - way) / (self._growth * math.hypot(1.0, angle))
        return max(angle, 0.0)

    def place(self, time: float) -> tuple[float, float]:
        """Return the place at a time since the start, x and y, m; the last place after that."""
        angle = self.angle(min(time, self.duration))
        radius = self._growth * angle
        return radius * math.cos(angle), radius * math.sin(angle)

    def velocity(self, time: float) -> Vector:
        """Return the velocity along the spiral."""
        angle = self.angle(time)
        rate = self.speed / math.hypot(1.0, angle)  # of the radius, and of the turn around
        x = rate * (math.cos(angle) - angle * math.sin(angle))
        y = rate * (math.sin(angle) + angle * math.cos(angle))
        return 0.0, 0.0, 0.0, x, y, 0.0

    @property
    def _growth(self) -> float:
        """Growth of the radius, m/rad."""
        return self.pitch / (2 * math.pi)

    @property
    def _last(self) -> float:
        """Angle of the end, rad."""
        return self.radius / self._growth

    def _way(self, angle: float) -> float:
        """Return the length of the spiral from the middle, m."""
        root = math.hypot(1.0, angle)
        return self._growth / 2 * (angle * root + math.asinh(angle))
