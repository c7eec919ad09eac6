"""Surfaces that a tip touches: how far away they are, and in which direction.

A surface is geometry; stiffness and friction belong to the contact.
"""

import math
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from models.validation import (
    ParameterError,
    require_finite,
    require_not_negative,
    require_positive,
)

Vector = NDArray[np.float64]


class Proximity(NamedTuple):
    """Where a point is, seen from a surface."""

    gap: float  # m, distance along the normal; negative inside the material
    normal: Vector  # shape (3,), unit, world frame, away from the material


class Surface(Protocol):
    """A surface in the world frame."""

    def locate(self, p_W: Vector) -> Proximity:
        """Return the gap and the normal at a point, shape (3,), m."""


@dataclass(frozen=True, kw_only=True)
class Crucible:
    """The inside of an upright cylinder; a stiff circle in the x-y plane (section 2.2)."""

    centre: tuple[float, float] = (1.0, -0.75)  # m
    radius: float = 0.75  # m

    def __post_init__(self) -> None:
        if not all(math.isfinite(value) for value in self.centre):
            raise ParameterError("centre", self.centre, "two finite numbers")
        if not 0 < self.radius < math.inf:
            raise ParameterError("radius", self.radius, "a finite number > 0")

    def locate(self, p_W: Vector) -> Proximity:
        """Return the gap and the normal, which points to the axis; along +x on the axis."""
        x, y = self.centre[0] - p_W[0], self.centre[1] - p_W[1]
        distance = math.hypot(x, y)
        if distance == 0.0:
            return Proximity(self.radius, np.array([1.0, 0.0, 0.0]))
        return Proximity(self.radius - distance, np.array([x / distance, y / distance, 0.0]))

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


@dataclass(frozen=True, kw_only=True)
class Unevenness:
    """How a plane differs from what it is taken to be.

    Along a direction s it rises by ``tan(tilt)`` per metre and ripples by
    ``ripple * sin(2 pi s / wavelength)``.
    """

    tilt: float = 0.0  # rad, rise along the motion
    ripple: float = 0.0  # m, amplitude
    wavelength: float = 0.02  # m, of the ripple

    def __post_init__(self) -> None:
        require_finite(self, "tilt")
        require_not_negative(self, "ripple")
        require_positive(self, "wavelength")
        if not abs(self.tilt) < math.pi / 2:
            raise ParameterError("tilt", self.tilt, "less than a right angle, rad")


@dataclass(frozen=True, kw_only=True)
class RippledPlane(Unevenness):
    """A plane that is tilted out of its nominal direction and has a sinusoidal ripple."""

    point: tuple[float, float, float]  # m, on the surface
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)  # nominal, away from the material
    along: tuple[float, float, float] = (1.0, 0.0, 0.0)  # direction of tilt and ripple

    def __post_init__(self) -> None:
        super().__post_init__()
        if len(self.point) != 3 or not all(math.isfinite(value) for value in self.point):
            raise ParameterError("point", self.point, "three finite numbers")
        for name in ("normal", "along"):
            vector = getattr(self, name)
            if not abs(math.hypot(*vector) - 1) < 1e-9:
                raise ParameterError(name, vector, "a vector of length 1")
        if not abs(float(np.dot(self.normal, self.along))) < 1e-9:
            raise ParameterError("along", self.along, f"at right angles to {self.normal}")

    def locate(self, p_W: Vector) -> Proximity:
        """Return the gap, to first order in the slope, and the normal."""
        x, y, z = p_W[0] - self.point[0], p_W[1] - self.point[1], p_W[2] - self.point[2]
        (nx, ny, nz), (ax, ay, az) = self.normal, self.along
        s = ax * x + ay * y + az * z
        height = nx * x + ny * y + nz * z
        wave = 2 * math.pi / self.wavelength
        slope = math.tan(self.tilt) + self.ripple * wave * math.cos(wave * s)
        surface = math.tan(self.tilt) * s + self.ripple * math.sin(wave * s)
        length = math.hypot(1.0, slope)
        normal = np.array([nx - slope * ax, ny - slope * ay, nz - slope * az]) / length
        return Proximity((height - surface) / length, normal)
