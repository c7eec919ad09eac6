"""How far along a path one is at a time: finite acceleration, continuous velocity."""

import math
from dataclasses import dataclass

from chamfer.models.validation import ParameterError


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
