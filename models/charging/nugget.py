"""A lump of polycrystalline silicon, as an ellipsoid that hangs from the gripper."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError, require_numbers, require_positive

Array = NDArray[np.float64]

SILICON: Final = 2330.0  # kg/m^3, appendix B.1
ASPECT: Final = (1.0, 0.9, 0.8)  # of a nugget: towards the wall, along it, up; assumed


@dataclass(frozen=True, kw_only=True)
class Nugget:
    """An ellipsoid whose axes are those of the endpoint's frame while it is held.

    The gripper holds it by the middle of its top, the origin of the endpoint's frame.
    """

    mass: float  # kg
    semi_axes: tuple[float, float, float]  # m, towards the wall, along it, up

    def __post_init__(self) -> None:
        require_positive(self, "mass")
        require_numbers(self, 3, "semi_axes")
        if not min(self.semi_axes) > 0:
            raise ParameterError("semi_axes", self.semi_axes, "3 finite numbers > 0")

    @property
    def reach(self) -> float:
        """From the grip point to the side that meets the wall, m."""
        return self.semi_axes[0]

    @property
    def height(self) -> float:
        """From the grip point down to what meets the layer below, m."""
        return 2 * self.semi_axes[2]

    @property
    def centre(self) -> tuple[float, float, float]:
        """Centre of mass in the endpoint's frame, m."""
        return 0.0, 0.0, -self.semi_axes[2]

    @property
    def wall_point(self) -> tuple[float, float, float]:
        """The point that meets the wall in the endpoint's frame, m."""
        return self.semi_axes[0], 0.0, -self.semi_axes[2]

    @property
    def layer_point(self) -> tuple[float, float, float]:
        """The point that meets what lies below in the endpoint's frame, m."""
        return 0.0, 0.0, -2 * self.semi_axes[2]

    @property
    def inertia(self) -> Array:
        """Rotational inertia about the centre, endpoint's axes, kg m^2, shape (3, 3)."""
        a, b, c = (one**2 for one in self.semi_axes)
        return self.mass / 5 * np.diag([b + c, a + c, a + b])


def nugget_of(mass: float, *, size: float = 1.0) -> Nugget:
    """Return the nugget of a mass, kg, of solid silicon with the usual proportions.

    Args:
        mass: kg.
        size: By which its lengths, not its mass, are larger than those of an ellipsoid: a nugget
            is irregular, and what matters is where it touches.

    Raises:
        ParameterError: If a number is not finite and > 0.
    """
    for name, value in (("mass", mass), ("size", size)):
        if not 0 < value < math.inf:
            raise ParameterError(name, value, "a finite number > 0")
    unit = (3 * mass / (4 * math.pi * SILICON * math.prod(ASPECT))) ** (1 / 3)
    a, b, c = (size * unit * one for one in ASPECT)
    return Nugget(mass=mass, semi_axes=(a, b, c))
