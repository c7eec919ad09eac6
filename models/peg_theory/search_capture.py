"""Probability that a spiral brings a peg over its hole: theory, and exact geometry.

The peg is captured where its axis passes the hole's nearer than the clearance and the chamfers
reach. Of an Archimedean spiral each pass covers a band of twice that width; its last turn ends at
a radius that, seen in the hole's direction, is anywhere between those of two turns.

Friction that drags the peg behind its command by a way L lets it run on a pursuit curve: on a
circle of radius r it stays on one of ``sqrt(r^2 - L^2)``.
"""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial import cKDTree
from scipy.special import ndtr

from chamfer.models.validation import require_not_negative, require_positive

Array = NDArray[np.float64]

_POINTS: Final = 2001  # of a mean
_FINE: Final = 60.0  # points of a track in a pitch


@dataclass(frozen=True, kw_only=True)
class SpiralCoverage:
    """A spiral, and the capture of the peg."""

    pitch: float  # m
    radius: float  # m, where it ends
    capture: float  # m, half-width: clearance and chamfers
    noise: float = 0.0  # m, standard deviation of where a pass is, across it
    drag: float = 0.0  # m, by which the peg is behind its command

    def __post_init__(self) -> None:
        require_positive(self, "pitch", "radius", "capture")
        require_not_negative(self, "noise", "drag")

    def between_turns(self) -> float:
        """Return the chance that a hole amid the turns is passed: min(1, 2 c / p) without noise.

        The two turns beside it pass independently of each other.
        """
        c, p, d = self.capture, self.pitch, np.linspace(0.0, self.pitch, _POINTS)
        missed = np.ones_like(d)
        for way in (d, p - d):
            if self.noise:
                missed *= 1 - ndtr((c - way) / self.noise) + ndtr((-c - way) / self.noise)
            else:
                missed *= way > c
        return float(np.mean(1 - missed))

    def probability(self, size: float) -> float:
        """Return the chance to find a hole that is off by an error over a disc of a radius, m.

        It is that of being in reach, a mean over the last turn, times that of being passed. What
        it does not have is the gap that drag leaves in the middle.
        """
        last = np.linspace(max(self.radius - self.pitch, 0.0), self.radius, _POINTS)
        reach = np.sqrt(np.maximum(last**2 - self.drag**2, 0.0)) + self.capture
        return float(np.mean(np.minimum(1.0, (reach / size) ** 2))) * self.between_turns()

    def track(self, generator: np.random.Generator | None = None) -> Array:
        """Return where the peg passes, m, shape (n, 2), with new noise each quarter of a turn."""
        last = 2 * math.pi * self.radius / self.pitch
        ways = np.linspace(0.0, 1.0, max(100, int(_FINE * last * self.radius / self.pitch)))
        angle = last * np.sqrt(ways)  # evenly along it, but for the middle
        radius = self.pitch / (2 * math.pi) * angle
        if generator is not None and self.noise:
            quarter = (2 * angle / math.pi).astype(int)
            radius = radius + generator.normal(0.0, self.noise, quarter[-1] + 1)[quarter]
        told = np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
        if not self.drag:
            return told
        at, passed = np.zeros(2), []
        for command in told:
            if (pull := math.hypot(*(command - at))) > self.drag:
                at = command + self.drag / pull * (at - command)
            passed.append(at)
        return np.array(passed)

    def finds(self, holes: Array, generator: np.random.Generator) -> NDArray[np.bool_]:
        """Return which holes, m, shape (n, 2), are passed, by the track itself; shape (n,)."""
        away = np.asarray(cKDTree(self.track(generator)).query(holes)[0])
        found: NDArray[np.bool_] = away <= self.capture
        return found


def draw_errors(size: float, n: int, generator: np.random.Generator) -> Array:
    """Return errors across the axis, m, shape (n, 2), evenly over a disc of a radius, m."""
    radius, angle = size * np.sqrt(generator.random(n)), 2 * math.pi * generator.random(n)
    return np.column_stack([radius * np.cos(angle), radius * np.sin(angle)])
