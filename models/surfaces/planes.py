"""Planes, even or not."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_not_negative,
    require_numbers,
    require_positive,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


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

    dimension: ClassVar[int] = 3

    point: tuple[float, float, float]  # m, on the surface
    normal: tuple[float, float, float] = (0.0, 0.0, 1.0)  # nominal, away from the material
    along: tuple[float, float, float] = (1.0, 0.0, 0.0)  # direction of tilt and ripple

    def __post_init__(self) -> None:
        super().__post_init__()
        require_numbers(self, 3, "point")
        for name in ("normal", "along"):
            vector = getattr(self, name)
            if not abs(math.hypot(*vector) - 1) < 1e-9:
                raise ParameterError(name, vector, "a vector of length 1")
        if not abs(float(np.dot(self.normal, self.along))) < 1e-9:
            raise ParameterError("along", self.along, f"at right angles to {self.normal}")

    def level(self, p: Vector) -> float:
        """Return the height above the tilted and rippled plane, m, along the nominal normal."""
        x, y, z = p.tolist()
        x, y, z = x - self.point[0], y - self.point[1], z - self.point[2]
        (nx, ny, nz), s = self.normal, self._along(p)
        wave = self.ripple * math.sin(2 * math.pi / self.wavelength * s)
        return float(nx * x + ny * y + nz * z - (math.tan(self.tilt) * s + wave))

    def gradient(self, p: Vector) -> Vector:
        """Return the height's gradient."""
        wave = 2 * math.pi / self.wavelength
        slope = math.tan(self.tilt) + self.ripple * wave * math.cos(wave * self._along(p))
        (nx, ny, nz), (ax, ay, az) = self.normal, self.along
        return np.array([nx - slope * ax, ny - slope * ay, nz - slope * az])

    def hessian(self, p: Vector) -> Matrix:
        """Return the height's second derivatives."""
        wave = 2 * math.pi / self.wavelength
        bend = self.ripple * wave**2 * math.sin(wave * self._along(p))
        return np.array([[bend * a * b for b in self.along] for a in self.along])

    def _along(self, p: Vector) -> float:
        (x, y, z), (ax, ay, az) = p.tolist(), self.along
        px, py, pz = self.point
        return float(ax * (x - px) + ay * (y - py) + az * (z - pz))
