"""The search along a spiral, beside the paper's dithers.

The paper searches by two dithers, which cover a rectangle evenly in time and come back to the
middle. An Archimedean spiral, ``r = pitch angle / (2 pi)``, begins in the middle, where the error
is least likely to be large, and covers a disc: its way up to the radius R is about
``pi R^2 / pitch``.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass

from chamfer.models.validation import require_positive
from chamfer.systems.primitives.primitive import STILL, Event, Observation, Stepped
from chamfer.systems.statechart.chart import TIME_TOLERANCE


@dataclass(frozen=True, kw_only=True)
class Spiral:
    """Moves along a spiral in x and y at a constant speed.

    Event: ``done`` when the radius is reached.
    """

    speed: float = 0.01  # m/s, along the spiral; assumed
    pitch: float = 0.0008  # m, between two turns; assumed
    radius: float = 0.003  # m, where it ends; assumed

    def __post_init__(self) -> None:
        require_positive(self, "speed", "pitch", "radius")

    @property
    def label(self) -> str:
        """What a chart shows of it."""
        return "spiral"

    @property
    def duration(self) -> float:
        """How long it takes, s."""
        return self._way(self._last) / self.speed

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, each with the earliest time, s."""
        return {"done": self.duration}

    def angle(self, time: float) -> float:
        """Return how far it has turned at a time since the begin, rad."""
        way = self.speed * time
        # From the way of many turns, b angle^2 / 2, by Newton's method.
        angle = min(math.sqrt(2 * way / self._growth), self._last)
        for _ in range(3):
            angle -= (self._way(angle) - way) / (self._growth * math.hypot(1.0, angle))
        return max(angle, 0.0)

    def begin(self, sensed: Observation) -> None:
        """Nothing is remembered: it follows the time."""

    def step(self, sensed: Observation, memory: object, time: float) -> Stepped:
        """Return the velocity; the event ``done`` at the end."""
        if time >= self.duration - TIME_TOLERANCE:
            return Stepped(None, STILL, "done")
        angle = self.angle(time)
        rate = self.speed / math.hypot(1.0, angle)  # of the radius, and of the turn around
        x = rate * (math.cos(angle) - angle * math.sin(angle))
        y = rate * (math.sin(angle) + angle * math.cos(angle))
        return Stepped(None, (0.0, 0.0, 0.0, x, y, 0.0))

    @property
    def _growth(self) -> float:
        """Of the radius, m/rad."""
        return self.pitch / (2 * math.pi)

    @property
    def _last(self) -> float:
        """Where it ends, rad."""
        return self.radius / self._growth

    def _way(self, angle: float) -> float:
        """Return the length of the spiral from the middle, m."""
        root = math.hypot(1.0, angle)
        return self._growth / 2 * (angle * root + math.asinh(angle))
