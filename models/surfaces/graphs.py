"""Graphs over the first coordinate or two: parabolas and waves, summed up in space."""

import math
from dataclasses import dataclass

from chamfer.models.surfaces.surface_code import PARABOLA, WAVE, Coded, Nodes, Place, leaf
from chamfer.models.validation import ParameterError, require_numbers


@dataclass(frozen=True, kw_only=True)
class Parabola(Coded):
    """The material below ``y = a x^2`` (eq. (5-1), Fig. 5-2), in space ``z = a x^2 + b y^2``.

    The level is the height above it, m.
    """

    coefficients: tuple[float, ...] = (0.05,)  # 1/m, a, or a and b; 0 makes it flat

    def __post_init__(self) -> None:
        require_numbers(self, self.dimension - 1, "coefficients")

    @property
    def dimension(self) -> int:
        """2 with one coefficient, else 3."""
        return 2 if len(self.coefficients) == 1 else 3

    def nodes(self, place: Place | None) -> Nodes:
        """Return the parabola's node."""
        terms = [number for a in self.coefficients for number in (a, 0.0)]
        return leaf(PARABOLA, (len(self.coefficients), *terms), place)


@dataclass(frozen=True, kw_only=True)
class Wave(Coded):
    """The material below ``y = A sin(2 pi x / L)``, in space ``z``, plus the same along y.

    The level is the height above it, m.
    """

    amplitudes: tuple[float, ...] = (0.05,)  # m, A, in space for x and y
    wavelengths: tuple[float, ...] = (1.0,)  # m, L, in space for x and y

    def __post_init__(self) -> None:
        count = self.dimension - 1
        require_numbers(self, count, "amplitudes")
        lengths = self.wavelengths
        if len(lengths) != count or not all(0 < length < math.inf for length in lengths):
            raise ParameterError("wavelengths", lengths, f"{count} finite numbers > 0")

    @property
    def dimension(self) -> int:
        """2 with one amplitude, else 3."""
        return 2 if len(self.amplitudes) == 1 else 3

    def nodes(self, place: Place | None) -> Nodes:
        """Return the wave's node."""
        waves = (2 * math.pi / length for length in self.wavelengths)
        terms = [number for term in zip(self.amplitudes, waves, strict=True) for number in term]
        return leaf(WAVE, (len(self.amplitudes), *terms), place)
