"""The interface of surfaces: the zero of a smooth level function.

A surface is geometry; stiffness and friction belong to the contact. The level is 0 on the surface
and positive outside of the material. It need not be a distance. Its first two derivatives give the
normal, and how the normal turns along the surface.
"""

import math
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


class Surface(Protocol):
    """A surface in the plane or in space; points p in the world frame, shape (d,), m."""

    @property
    def dimension(self) -> int:
        """Return d: 2 for a curve in the plane, 3 for a surface in space."""

    def level(self, p: Vector) -> float:
        """Return the level, m: 0 on the surface, positive outside of the material."""

    def gradient(self, p: Vector) -> Vector:
        """Return the level's gradient, shape (d,)."""

    def hessian(self, p: Vector) -> Matrix:
        """Return the level's second derivatives, shape (d, d), 1/m."""


class Proximity(NamedTuple):
    """Place of a point relative to a surface."""

    gap: float  # m, distance along the normal, to first order; negative inside the material
    normal: Vector  # shape (d,), unit, world frame, away from the material


def locate(surface: Surface, p: Vector) -> Proximity:
    """Return the gap, ``level / |gradient|``, and the normal at a point, shape (d,), m.

    The gap is exact on planes and round surfaces. Where the gradient is 0, as in a circle's
    centre, the gap is the level and the normal the first axis.
    """
    return proximity(surface.level(p), surface.gradient(p))


def proximity(level: float, gradient: Vector) -> Proximity:
    """Return gap and normal, as :func:`locate` does, from a level in m and its gradient."""
    length = math.hypot(*gradient.tolist())
    if length == 0:
        return Proximity(level, np.eye(len(gradient))[0])
    return Proximity(level / length, gradient / length)


def normal(surface: Surface, p: Vector) -> Vector:
    """Return the unit normal out of the material, shape (d,).

    Raises:
        ParameterError: if the level's gradient is 0 at p.
    """
    gradient = surface.gradient(p)
    length = float(np.linalg.norm(gradient))
    if not length > 0:
        raise ParameterError("p", p.tolist(), "a point where the surface has a normal")
    return gradient / length


def curvature(surface: Surface, p: Vector) -> float:
    """Return the largest absolute normal curvature at a point of the surface, 1/m.

    Raises:
        ParameterError: if the level's gradient is 0 at p.
    """
    n = normal(surface, p)
    flat = np.eye(len(n)) - np.outer(n, n)
    size = float(np.linalg.norm(surface.gradient(p)))
    bend = flat @ surface.hessian(p) @ flat / size
    return float(np.max(np.abs(np.linalg.eigvalsh(bend))))
