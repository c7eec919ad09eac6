"""Coulomb friction of a surface, from place to place."""

import math
from dataclasses import dataclass, fields
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from chamfer.models.compiled import in_place
from chamfer.models.validation import (
    MOST_FRICTION,
    ParameterError,
    require_between,
    require_finite,
    require_not_negative,
    require_positive,
)

Vector = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class SurfaceFriction:
    """A coefficient of friction that depends on the first coordinate x alone.

    ``mu(x) = c + r sin(2 pi x / L) + (s / 2) (1 + tanh((x - x_s) / w))``; the thesis' surface has
    the same friction everywhere (section 5.2.1). It must nowhere be negative.
    """

    coefficient: float = 1.0  # c, without ripple and jump
    ripple: float = 0.0  # r, amplitude of a sine
    wavelength: float = 1.0  # m, L, of the ripple
    jump: float = 0.0  # change of the coefficient towards +x, s
    jump_at: float = 0.0  # m, x_s, where half of the jump is done
    jump_width: float = 0.01  # m, w; 96 % of the jump is done from x_s - 2 w to x_s + 2 w

    def __post_init__(self) -> None:
        require_finite(self, "jump", "jump_at")
        require_not_negative(self, "ripple")
        require_positive(self, "wavelength", "jump_width")
        least = self.ripple - min(self.jump, 0.0)
        if not least <= self.coefficient < math.inf:
            allowed = f"a finite number >= {least:g}, so that friction is nowhere negative"
            raise ParameterError("coefficient", self.coefficient, allowed)
        require_between(self, least, max(least, MOST_FRICTION), "coefficient")

    def at(self, p: Vector) -> float:
        """Return the coefficient at a point, shape (d,), m."""
        return friction_at(self.numbers, float(p[0]))[0]

    def gradient(self, p: Vector) -> Vector:
        """Return the coefficient's gradient at a point, shape (d,), 1/m."""
        gradient = np.zeros(len(p))
        gradient[0] = friction_at(self.numbers, float(p[0]))[1]
        return gradient

    @cached_property
    def numbers(self) -> Vector:
        """The six numbers, in the order above, as :func:`friction_at` takes them."""
        return np.array([getattr(self, field.name) for field in fields(self)], dtype=np.float64)


@in_place
def friction_at(numbers: Vector, x: float) -> tuple[float, float]:
    """Return the coefficient at a place, m, and its slope, 1/m."""
    value, slope = numbers[0], 0.0
    ripple, wavelength, jump = numbers[1], numbers[2], numbers[3]
    if ripple > 0.0:
        value += ripple * math.sin(2 * math.pi * x / wavelength)
        wave = 2 * math.pi / wavelength
        slope += ripple * wave * math.cos(wave * x)
    if jump != 0.0:
        done = math.tanh((x - numbers[4]) / numbers[5])
        value += 0.5 * jump * (1 + done)
        slope += 0.5 * jump / numbers[5] * (1 - done**2)
    return max(value, 0.0), slope  # rounding, where the ripple or the jump takes all of it
