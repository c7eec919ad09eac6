"""The section of a D: a trapezoid with rounded corners.

Edges and corners are counted to the left, from the wide edge: 0 wide, 1 left, 2 narrow, 3 right;
corner ``i`` is where edge ``i`` begins. x is along the D, y towards its wide edge.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError, require_positive

Array = NDArray[np.float64]

EDGES = range(4)


@dataclass(frozen=True, kw_only=True)
class DSection:
    """A D, measured over all."""

    width: float  # m, between the outermost points of the wide corners
    height: float  # m, between the wide and the narrow edge
    corner_radius: float  # m
    side_angle: float  # rad, of each side from y

    def __post_init__(self) -> None:
        require_positive(self, "width", "height", "corner_radius")
        if not 0 <= self.side_angle < math.pi / 4:
            raise ParameterError("side_angle", self.side_angle, "0 <= angle < pi/4 rad")
        if not 2 * self.corner_radius < self.height:
            allowed = f"less than half the height, {self.height / 2:.3g} m"
            raise ParameterError("corner_radius", self.corner_radius, allowed)
        if not self.centres[3, 0] > 0:
            raise ParameterError("width", self.width, "enough for a narrow edge")

    def grown(self, by: float) -> "DSection":
        """Return the section whose outline is further out by ``by``, m, everywhere."""
        return replace(
            self,
            width=self.width + 2 * by,
            height=self.height + 2 * by,
            corner_radius=self.corner_radius + by,
        )

    @property
    def centres(self) -> Array:
        """Centres of the corners' arcs, m, shape (4, 2)."""
        x = self.width / 2 - self.corner_radius
        y = self.height / 2 - self.corner_radius
        narrow = x - 2 * y * math.tan(self.side_angle)
        return np.array([[x, y], [-x, y], [-narrow, -y], [narrow, -y]])

    @property
    def directions(self) -> Array:
        """Directions of the edges' outward normals, rad from x to y, shape (4,)."""
        quarters = np.array([1.0, 2.0, 3.0, 4.0]) * math.pi / 2
        lean = np.array([0.0, self.side_angle, 0.0, -self.side_angle])
        directions: Array = quarters + lean
        return directions

    @property
    def edges(self) -> Array:
        """First and last point of the straight part of each edge, m, shape (4, 2, 2)."""
        ends = np.stack([self.centres, np.roll(self.centres, -1, axis=0)], axis=1)
        edges: Array = ends + self.corner_radius * _unit(self.directions)[:, None, :]
        return edges

    def arc(self, corner: int, chords: int) -> Array:
        """Return points along a corner's arc, to the left, m, shape (chords + 1, 2)."""
        last = self.directions[corner]
        first = self.directions[corner - 1] - (2 * math.pi if corner == 0 else 0)
        directions = np.linspace(first, last, chords + 1)
        points: Array = self.centres[corner] + self.corner_radius * _unit(directions)
        return points


def _unit(direction: Array) -> Array:
    """Return unit vectors, shape (n, 2)."""
    unit: Array = np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    return unit
