"""The paths of segments, and how far along one is at a time: from rest to rest."""

import math
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError
from chamfer.systems.trajectory.segment import CIRCLE, HOLD, LINE, SLEW, Segment


@dataclass(frozen=True, kw_only=True)
class Trapezoid:
    """From 0 to 1, from rest to rest: speeds up, goes on, slows down.

    A path too short to come up to speed is half speeding up and half slowing down.
    """

    speed: float  # 1/s, at most; of the whole path
    acceleration: float  # 1/s^2, up and down

    def __post_init__(self) -> None:
        for name in ("speed", "acceleration"):
            value = getattr(self, name)
            if not 0 < value < math.inf:
                raise ParameterError(name, value, "a finite number > 0")

    @property
    def top(self) -> float:
        """The speed that is come up to, 1/s."""
        return min(self.speed, math.sqrt(self.acceleration))

    @property
    def duration(self) -> float:
        """From rest to rest, s."""
        return self.top / self.acceleration + 1 / self.top

    def at(self, time: float) -> tuple[float, float]:
        """Return how far, 0 to 1, and how fast, 1/s, at a time, s."""
        top, acceleration, duration = self.top, self.acceleration, self.duration
        if time >= duration:
            return 1.0, 0.0
        ramp, left = top / acceleration, duration - time
        if time < ramp:
            return acceleration * time * time / 2, acceleration * time
        if left < ramp:
            return 1 - acceleration * left * left / 2, acceleration * left
        return top * (time - ramp / 2), top


def quintic(part: float) -> tuple[float, float]:
    """Return how far, 0 to 1, and its derivative, at a part of the time, 0 to 1.

    At rest and without acceleration at both ends; beyond them it stays where it is.
    """
    u = min(max(part, 0.0), 1.0)
    return u**3 * (10 + u * (6 * u - 15)), 30 * (u * (1 - u)) ** 2


Array = NDArray[np.float64]
Motion = tuple[Array, Array]  # position, m and rad, and velocity, m/s and rad/s, shape (7,) each

# A slew's parts of its time. The nugget goes up first, across in the middle, then down; the parts
# overlap where it is high enough to.
_LIFT: Final = 0.4
_ACROSS: Final = (0.2, 0.8)


class Path(Protocol):
    """A way from rest to rest."""

    @property
    def duration(self) -> float:
        """S."""
        ...

    def at(self, time: float) -> Motion:
        """Return position and velocity at a time, s; after the duration, those of the end."""
        ...


@dataclass(frozen=True)
class Stay:
    """No motion."""

    place: Array
    duration: float = 0.0  # s

    def at(self, time: float) -> Motion:
        """See :class:`Path`."""
        return self.place, np.zeros_like(self.place)


@dataclass(frozen=True)
class Line:
    """All coordinates in proportion."""

    start: Array
    way: Array
    profile: Trapezoid

    @property
    def duration(self) -> float:
        """See :class:`Path`."""
        return self.profile.duration

    def at(self, time: float) -> Motion:
        """See :class:`Path`."""
        far, fast = self.profile.at(time)
        return self.start + far * self.way, fast * self.way


@dataclass(frozen=True)
class Circle:
    """x and y about a vertical axis, the other coordinates in proportion."""

    start: Array
    way: Array
    centre: tuple[float, float]  # m
    angle: float  # rad
    profile: Trapezoid

    @property
    def duration(self) -> float:
        """See :class:`Path`."""
        return self.profile.duration

    def at(self, time: float) -> Motion:
        """See :class:`Path`."""
        far, fast = self.profile.at(time)
        position, velocity = self.start + far * self.way, fast * self.way
        c, s = np.cos(far * self.angle), np.sin(far * self.angle)
        across, along = self.start[:2] - self.centre
        x, y = c * across - s * along, s * across + c * along
        position[:2] = self.centre[0] + x, self.centre[1] + y
        velocity[:2] = -fast * self.angle * y, fast * self.angle * x
        return position, velocity


@dataclass(frozen=True)
class Slew:
    """Up to a height, across, and down, quintic each and overlapping.

    The acceleration is continuous, and 0 at the ends.
    """

    start: Array
    way: Array
    via: float  # m
    duration: float  # s

    def at(self, time: float) -> Motion:
        """See :class:`Path`."""
        part = time / self.duration
        begin, end = _ACROSS
        far, fast = quintic((part - begin) / (end - begin))
        position = self.start + far * self.way
        velocity = fast / (end - begin) / self.duration * self.way
        up, up_fast = quintic(part / _LIFT)
        down, down_fast = quintic((part - 1 + _LIFT) / _LIFT)
        rise = self.via - self.start[2]
        fall = self.start[2] + self.way[2] - self.via
        position[2] = self.start[2] + up * rise + down * fall
        velocity[2] = (up_fast * rise + down_fast * fall) / _LIFT / self.duration
        return position, velocity


def path_of(segment: Segment, *, turn_acceleration: float) -> Path:
    """Return the way of a segment.

    Args:
        segment: What is wanted; acceleration and turn_speed as wanted too.
        turn_acceleration: rad/s^2, of each angle along a line or a circle, at most.

    Raises:
        ParameterError: If there is no such kind; or if the acceleration is not > 0, nor the speed
            of a line or circle, or the duration of a slew.
    """
    if segment.kind not in (HOLD, LINE, CIRCLE, SLEW):
        allowed = f"{HOLD} (hold), {LINE} (line), {CIRCLE} (circle) or {SLEW} (slew)"
        raise ParameterError("kind", segment.kind, allowed)
    _require_positive(segment, "acceleration")
    start, goal = np.array(segment.start), np.array(segment.goal)
    way = goal - start
    if segment.kind == HOLD:
        return Stay(goal)
    if segment.kind == SLEW:
        _require_positive(segment, "duration")
        return Slew(start, way, segment.via_height, segment.duration)
    _require_positive(segment, "speed")
    _require_positive(segment, "turn_speed")
    flat = float(np.linalg.norm(way[:2]))
    if segment.kind == CIRCLE:
        flat = float(np.linalg.norm(start[:2] - segment.centre[:2])) * abs(segment.turn)
    length, turn = float(np.hypot(flat, way[2])), float(np.max(np.abs(way[3:])))
    if length == turn == 0:
        return Stay(goal)
    # Each limit over what it limits; what does not move limits nothing.
    limits = [
        (v / size, a / size)
        for size, v, a in (
            (length, segment.speed, segment.acceleration),
            (turn, segment.turn_speed, turn_acceleration),
        )
        if size > 0
    ]
    profile = Trapezoid(speed=min(v for v, _ in limits), acceleration=min(a for _, a in limits))
    if segment.kind == CIRCLE:
        return Circle(start, way, segment.centre[:2], segment.turn, profile)
    return Line(start, way, profile)


def _require_positive(segment: Segment, name: str) -> None:
    if not getattr(segment, name) > 0:
        raise ParameterError(name, getattr(segment, name), "a finite number > 0")
