"""The paths of segments, and the place on them at a time: from rest to rest."""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError
from chamfer.systems.trajectory.segment import CIRCLE, HOLD, LINE, SLEW, Segment

Array = NDArray[np.float64]
# A time, s, to how far, 0 to 1, and how fast, 1/s.
Profile = Callable[[float], tuple[float, float]]
Motion = tuple[Array, Array]  # position, m and rad, and velocity, m/s and rad/s, shape (7,) each

# A slew's parts of its time. The nugget goes up first, across in the middle, then down; the parts
# overlap where it is high enough to.
_LIFT: Final = 0.4
_ACROSS: Final = (0.2, 0.8)
_NEEDED: Final[dict[float, tuple[str, ...]]] = {  # by kind: what has to be > 0
    HOLD: ("acceleration",),
    LINE: ("acceleration", "speed", "turn_speed"),
    CIRCLE: ("acceleration", "speed", "turn_speed"),
    SLEW: ("acceleration", "duration"),
}


def trapezoid(speed: float, acceleration: float) -> tuple[float, Profile]:
    """Return duration, s, and profile from rest to rest: speeds up, goes on, slows down.

    A path too short to come up to speed is half speeding up and half slowing down.

    Args:
        speed: 1/s, at most, > 0; of the whole path.
        acceleration: 1/s^2, up and down, > 0.
    """
    top = min(speed, math.sqrt(acceleration))
    ramp, duration = top / acceleration, top / acceleration + 1 / top

    def at(time: float) -> tuple[float, float]:
        left = duration - time
        if left <= 0:
            return 1.0, 0.0
        if time < ramp:
            return acceleration * time * time / 2, acceleration * time
        if left < ramp:
            return 1 - acceleration * left * left / 2, acceleration * left
        return top * (time - ramp / 2), top

    return duration, at


def quintic(part: float) -> tuple[float, float]:
    """Return the place, 0 to 1, and its derivative, at a part of the time, 0 to 1.

    At rest and without acceleration at both ends; beyond them it stays there.
    """
    u = min(max(part, 0.0), 1.0)
    return u**3 * (10 + u * (6 * u - 15)), 30 * (u * (1 - u)) ** 2


@dataclass(frozen=True)
class Path:
    """A motion from rest to rest."""

    duration: float  # s
    at: Callable[[float], Motion]  # a time, s; after the duration: the end


def _slew(start: Array, way: Array, via: float, duration: float) -> Path:
    """Go up to a height, across, and down, quintic each and overlapping.

    The acceleration is continuous, and 0 at the ends.
    """
    begin, end = _ACROSS
    rise, fall = via - start[2], start[2] + way[2] - via

    def at(time: float) -> Motion:
        part = time / duration
        far, fast = quintic((part - begin) / (end - begin))
        position = start + far * way
        velocity = fast / (end - begin) / duration * way
        up, up_fast = quintic(part / _LIFT)
        down, down_fast = quintic((part - 1 + _LIFT) / _LIFT)
        position[2] = start[2] + up * rise + down * fall
        velocity[2] = (up_fast * rise + down_fast * fall) / _LIFT / duration
        return position, velocity

    return Path(duration, at)


def path_of(segment: Segment, *, turn_acceleration: float) -> Path:
    """Return the path of a segment; all coordinates move in proportion, but on a circle.

    Args:
        segment: Reference segment, with its reference acceleration and turn_speed.
        turn_acceleration: rad/s^2, of each angle along a line or a circle, at most.

    Raises:
        ParameterError: If there is no such kind; or if the acceleration is not > 0, nor the speed
            of a line or circle, or the duration of a slew.
    """
    if segment.kind not in _NEEDED:
        allowed = f"{HOLD} (hold), {LINE} (line), {CIRCLE} (circle) or {SLEW} (slew)"
        raise ParameterError("kind", segment.kind, allowed)
    for name in _NEEDED[segment.kind]:
        if not getattr(segment, name) > 0:
            raise ParameterError(name, getattr(segment, name), "a finite number > 0")
    start, goal = np.array(segment.start), np.array(segment.goal)
    way = goal - start
    stay = Path(0.0, lambda _: (goal, np.zeros_like(goal)))
    if segment.kind == HOLD:
        return stay
    if segment.kind == SLEW:
        return _slew(start, way, segment.via_height, segment.duration)
    flat = float(np.linalg.norm(way[:2]))
    if segment.kind == CIRCLE:
        flat = float(np.linalg.norm(start[:2] - segment.centre[:2])) * abs(segment.turn)
    length, turn = float(np.hypot(flat, way[2])), float(np.max(np.abs(way[3:])))
    if length == turn == 0:
        return stay
    # Each limit over what it limits; what does not move limits nothing.
    limits = [
        (v / size, a / size)
        for size, v, a in (
            (length, segment.speed, segment.acceleration),
            (turn, segment.turn_speed, turn_acceleration),
        )
        if size > 0
    ]
    duration, profile = trapezoid(min(v for v, _ in limits), min(a for _, a in limits))
    centre, angle = segment.centre[:2], segment.turn

    def at(time: float) -> Motion:
        far, fast = profile(time)
        position, velocity = start + far * way, fast * way
        if segment.kind == CIRCLE:  # x and y turn about a vertical axis
            c, s = np.cos(far * angle), np.sin(far * angle)
            across, along = start[:2] - centre
            x, y = c * across - s * along, s * across + c * along
            position[:2] = centre[0] + x, centre[1] + y
            velocity[:2] = -fast * angle * y, fast * angle * x
        return position, velocity

    return Path(duration, at)
