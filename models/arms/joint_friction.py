"""Dry and viscous friction of an arm's joints."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError


@dataclass(frozen=True, kw_only=True)
class JointFrictionParams:
    """Friction of n joints; N m for revolute joints, N for prismatic ones.

    A joint at rest holds up to ``breakaway`` times its Coulomb friction. Once it moves at speed w
    the friction falls off, ``coulomb * (1 + (breakaway - 1) exp(-(w / stribeck)^2))``, and
    ``viscous * w`` is added.
    """

    coulomb: tuple[float, ...]  # N m or N, Coulomb's, of each joint
    breakaway: float = 1.5  # static over Coulomb friction
    stribeck: float = 0.02  # rad/s or m/s, speed over which the breakaway fades
    viscous: tuple[float, ...]  # N m s/rad or N s/m, of each joint

    def __post_init__(self) -> None:
        for name in ("coulomb", "viscous"):
            values = getattr(self, name)
            if not values or not all(0 <= value < np.inf for value in values):
                raise ParameterError(name, values, "finite numbers >= 0, one a joint")
        if len(self.coulomb) != len(self.viscous):
            raise ParameterError("viscous", self.viscous, f"{len(self.coulomb)} numbers")
        if not 1 <= self.breakaway < np.inf:
            raise ParameterError("breakaway", self.breakaway, "a finite number >= 1")
        if not 0 < self.stribeck < np.inf:
            raise ParameterError("stribeck", self.stribeck, "a finite number > 0")

    def dry(self, speed: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return the dry friction's magnitude of moving joints, shape (..., n)."""
        fading = np.exp(-np.square(np.asarray(speed) / self.stribeck))
        moving: NDArray[np.float64] = np.asarray(self.coulomb) * (
            1 + (self.breakaway - 1) * fading
        )
        return moving
