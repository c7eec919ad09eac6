"""Surfaces made of surfaces: placed, extruded from a curve, or several in one."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from chamfer.models.surfaces.surface import Surface
from chamfer.models.surfaces.surface_code import LEAST, MOST, Nodes, Place, nodes_of
from chamfer.models.validation import ParameterError, require_numbers

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


class Upright:
    """A curve of the x-y plane extruded along z: a wall of that outline."""

    dimension: ClassVar[int] = 3

    curve: Surface

    def level(self, p: Vector) -> float:
        """Return the curve's level, m."""
        return self.curve.level(p[:2])

    def gradient(self, p: Vector) -> Vector:
        """Return the level's gradient, without z."""
        x, y = self.curve.gradient(p[:2]).tolist()
        return np.array([x, y, 0.0])

    def hessian(self, p: Vector) -> Matrix:
        """Return the level's second derivatives."""
        hessian = np.zeros((3, 3))
        hessian[:2, :2] = self.curve.hessian(p[:2])
        return hessian

    def nodes(self, place: Place | None) -> Nodes:
        """Return the curve's nodes, which have no z."""
        return nodes_of(self.curve, place)


@dataclass(frozen=True, kw_only=True)
class Extruded(Upright):
    """Any curve, extruded."""

    curve: Surface

    def __post_init__(self) -> None:
        if self.curve.dimension != 2:
            raise ParameterError("curve", self.curve, "a surface in the plane")


@dataclass(frozen=True, kw_only=True)
class Placed:
    """A surface S in space at another place: its frame's origin and axes in the world."""

    dimension: ClassVar[int] = 3

    surface: Surface
    point: tuple[float, float, float]  # m, p_WS
    axes: tuple[tuple[float, float, float], ...]  # R_WS by rows

    def __post_init__(self) -> None:
        if self.surface.dimension != 3:
            raise ParameterError("surface", self.surface, "a surface in space")
        require_numbers(self, 3, "point")
        axes = np.array(self.axes)
        if axes.shape != (3, 3) or not np.allclose(axes @ axes.T, np.eye(3), atol=1e-9):
            raise ParameterError("axes", self.axes, "3 rows of 3, orthonormal")

    def level(self, p: Vector) -> float:
        """Return the surface's level, m."""
        return self.surface.level(self._seen(p))

    def gradient(self, p: Vector) -> Vector:
        """Return the level's gradient."""
        gradient: Vector = self._rotation @ self.surface.gradient(self._seen(p))
        return gradient

    def hessian(self, p: Vector) -> Matrix:
        """Return the level's second derivatives."""
        hessian: Matrix = self._rotation @ self.surface.hessian(self._seen(p)) @ self._rotation.T
        return hessian

    def nodes(self, place: Place | None) -> Nodes:
        """Return the surface's nodes where it is placed."""
        rotation, point = self._rotation, self._origin
        if place is not None:
            rotation, point = place[0] @ rotation, place[0] @ point + place[1]
        return nodes_of(self.surface, (rotation, point))

    @cached_property
    def _origin(self) -> Vector:
        return np.array(self.point)

    @cached_property
    def _rotation(self) -> Matrix:
        return np.array(self.axes)

    def _seen(self, p: Vector) -> Vector:
        """Return a point in the surface's frame."""
        seen: Vector = (p - self._origin) @ self._rotation
        return seen


@dataclass(frozen=True, kw_only=True)
class _Several:
    """Surfaces of which one counts at each place.

    Where two of them meet the normal changes at once, and there is no curvature.
    """

    _pick: ClassVar[Callable[..., Surface]]

    parts: tuple[Surface, ...]

    def __post_init__(self) -> None:
        if not self.parts or len({one.dimension for one in self.parts}) > 1:
            raise ParameterError("parts", self.parts, "at least one surface, all in as many axes")

    @property
    def dimension(self) -> int:
        """Return d, that of the parts."""
        return self.parts[0].dimension

    def level(self, p: Vector) -> float:
        """Return the level of the one that counts, m."""
        return self._foremost(p).level(p)

    def gradient(self, p: Vector) -> Vector:
        """Return its gradient."""
        return self._foremost(p).gradient(p)

    def hessian(self, p: Vector) -> Matrix:
        """Return its second derivatives."""
        return self._foremost(p).hessian(p)

    def nodes(self, place: Place | None) -> Nodes:
        """Return the parts' nodes, and the node that selects one of them."""
        parts = [node for part in self.parts for node in nodes_of(part, place)]
        return [*parts, [3.0, LEAST if self._pick is min else MOST, float(len(self.parts))]]

    def _foremost(self, p: Vector) -> Surface:
        return self._pick(self.parts, key=lambda one: one.level(p))


@dataclass(frozen=True, kw_only=True)
class Union(_Several):
    """The material of any of several surfaces: that with the least level counts."""

    _pick = staticmethod(min)


@dataclass(frozen=True, kw_only=True)
class Intersection(_Several):
    """The material that several surfaces have in common: that with the largest level counts.

    Outside, near an edge, the gap is that to the one part, less than the way to the material.
    """

    _pick = staticmethod(max)
