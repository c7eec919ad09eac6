"""Round surfaces: circle, sphere, ellipsoid, and the upright cylinder of a crucible."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from chamfer.models.surfaces.composed import Upright
from chamfer.models.validation import ParameterError, require_numbers, require_positive

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class _Round:
    """Material within a distance of a centre, or beyond it.

    The level is the distance from the surface, m, negative in the material. Its gradient is a
    unit vector; in the centre it is 0, and so are the second derivatives.
    """

    dimension: ClassVar[int]

    centre: tuple[float, ...]  # m
    radius: float = 1.0  # m
    inside: bool = False  # True: the contact point is inside

    def __post_init__(self) -> None:
        require_numbers(self, self.dimension, "centre")
        require_positive(self, "radius")

    def level(self, p: Vector) -> float:
        """Return the distance from the surface, m."""
        distance = math.dist(p.tolist(), self.centre)
        return self.radius - distance if self.inside else distance - self.radius

    def gradient(self, p: Vector) -> Vector:
        """Return the distance's gradient."""
        distance, unit = self._direction(p)
        return np.array([-x if self.inside and distance else x for x in unit])

    def hessian(self, p: Vector) -> Matrix:
        """Return the distance's second derivatives."""
        distance, unit = self._direction(p)
        scale = -distance if self.inside else distance
        return np.array(
            [
                [((i == j) - x * y) / scale if scale else 0.0 for j, y in enumerate(unit)]
                for i, x in enumerate(unit)
            ]
        )

    def _direction(self, p: Vector) -> tuple[float, list[float]]:
        """Return how far a point is from the centre, m, and in which direction; in it, nowhere."""
        offset = [x - c for x, c in zip(p.tolist(), self.centre, strict=True)]
        distance = math.hypot(*offset)
        return distance, [x / distance if distance else 0.0 for x in offset]


@dataclass(frozen=True, kw_only=True)
class Circle(_Round):
    """A disc, or with ``inside`` the material around a round hole."""

    dimension: ClassVar[int] = 2

    centre: tuple[float, ...] = (0.0, -1.0)  # m


@dataclass(frozen=True, kw_only=True)
class Sphere(_Round):
    """A ball, or with ``inside`` the material around a round hollow."""

    dimension: ClassVar[int] = 3

    centre: tuple[float, ...] = (0.0, 0.0, -1.0)  # m


@dataclass(frozen=True, kw_only=True)
class Ellipsoid:
    """An ellipsoid about the origin, its axes along those of its frame.

    The level is ``s (|A^-1 p| - 1)`` with the semi-axes A and the smallest of them, s.
    """

    dimension: ClassVar[int] = 3

    semi_axes: tuple[float, float, float] = (1.0, 1.0, 1.0)  # m

    def __post_init__(self) -> None:
        require_numbers(self, 3, "semi_axes")
        if not min(self.semi_axes) > 0:
            raise ParameterError("semi_axes", self.semi_axes, "3 finite numbers > 0")

    def level(self, p: Vector) -> float:
        """Return the level, m."""
        return min(self.semi_axes) * (self._scaled(p)[0] - 1)

    def gradient(self, p: Vector) -> Vector:
        """Return the level's gradient; 0 in the middle."""
        length, slope = self._scaled(p)
        gradient: Vector = min(self.semi_axes) * slope / (length or 1.0)
        return gradient

    def hessian(self, p: Vector) -> Matrix:
        """Return the level's second derivatives; 0 in the middle."""
        length, slope = self._scaled(p)
        if not length:
            return np.zeros((3, 3))
        bent = np.diag(np.power(self.semi_axes, -2.0)) - np.outer(slope, slope) / length**2
        hessian: Matrix = min(self.semi_axes) / length * bent
        return hessian

    def _scaled(self, p: Vector) -> tuple[float, Vector]:
        """Return |A^-1 p| and A^-2 p."""
        scaled = p / self.semi_axes
        return math.hypot(*scaled.tolist()), scaled / self.semi_axes


@dataclass(frozen=True, kw_only=True)
class Crucible(Upright):
    """The inside of an upright cylinder; a stiff circle in the x-y plane (section 2.2)."""

    centre: tuple[float, float] = (1.0, -0.75)  # m
    radius: float = 0.75  # m

    def __post_init__(self) -> None:
        self.curve  # noqa: B018 - checks

    @cached_property
    def curve(self) -> Circle:  # type: ignore[override]
        """The outline."""
        return Circle(centre=self.centre, radius=self.radius, inside=True)

    def ahead(self, p: Vector, direction: Vector) -> float:
        """Return how far the wall is from a point inside, m, along a unit vector; shape (2,) each.

        Raises:
            ParameterError: If the point is not inside, or at the wall that lies ahead.
        """
        offset = p - self.centre
        along = float(offset @ direction)
        inside = self.radius**2 - float(offset @ offset)
        if inside >= 0 and (distance := math.sqrt(along**2 + inside) - along) > 0:
            return distance
        allowed = f"inside of the circle of {self.radius:g} m about {self.centre}"
        raise ParameterError("point", p.tolist(), allowed)
