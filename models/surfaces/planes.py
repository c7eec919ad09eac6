"""Planes, even or uneven."""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from chamfer.models.surfaces.surface_code import PLANE, Coded, Nodes, Place, leaf
from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_not_negative,
    require_numbers,
    require_positive,
)


@dataclass(frozen=True, kw_only=True)
class Unevenness:
    """Difference between a plane and its believed place and shape.

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
class RippledPlane(Coded, Unevenness):
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

    def nodes(self, place: Place | None) -> Nodes:
        """Return the plane's node; its level is the height along the nominal normal, m."""
        wave = 2 * math.pi / self.wavelength
        uneven = (math.tan(self.tilt), self.ripple, wave)
        return leaf(PLANE, (*self.point, *self.normal, *self.along, *uneven), place)
