"""Round surfaces: circle, sphere, ellipsoid, and the upright cylinder of a crucible."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from chamfer.models.surfaces.composed import Upright
from chamfer.models.surfaces.surface_code import (
    ELLIPSOID,
    ROUND,
    Coded,
    Nodes,
    Place,
    leaf,
)
from chamfer.models.validation import ParameterError, require_numbers, require_positive

Vector = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class _Round(Coded):
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

    def nodes(self, place: Place | None) -> Nodes:
        """Return the circle's or sphere's node."""
        d, (x, y, *up) = self.dimension, self.centre
        numbers = (d, x, y, up[0] if up else 0.0, self.radius, -1.0 if self.inside else 1.0)
        return leaf(ROUND, numbers, place)


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
class Ellipsoid(Coded):
    """An ellipsoid about the origin, its axes along those of its frame.

    The level is ``s (|A^-1 p| - 1)`` with the semi-axes A and the smallest of them, s; its
    derivatives are 0 in the middle.
    """

    dimension: ClassVar[int] = 3

    semi_axes: tuple[float, float, float] = (1.0, 1.0, 1.0)  # m

    def __post_init__(self) -> None:
        require_numbers(self, 3, "semi_axes")
        if not min(self.semi_axes) > 0:
            raise ParameterError("semi_axes", self.semi_axes, "3 finite numbers > 0")

    def nodes(self, place: Place | None) -> Nodes:
        """Return the ellipsoid's node."""
        return leaf(ELLIPSOID, self.semi_axes, place)


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
