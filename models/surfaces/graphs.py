"""Graphs over the first coordinate or two: parabolas, waves, and their sums in space."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import ClassVar, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_numbers,
    require_positive,
)

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]


class _Rise(NamedTuple):
    """What a coordinate adds to the height."""

    height: float  # m
    slope: float
    bend: float  # 1/m


class _Graph:
    """The material below a height that is a sum over all coordinates but the last."""

    def level(self, p: Vector) -> float:
        """Return the height above the graph, m."""
        *across, up = p.tolist()
        for rise in self._rises(across):
            up -= rise.height
        return float(up)

    def gradient(self, p: Vector) -> Vector:
        """Return the height's gradient."""
        return np.array([*(-rise.slope for rise in self._rises(p.tolist()[:-1])), 1.0])

    def hessian(self, p: Vector) -> Matrix:
        """Return the height's second derivatives."""
        return np.diag([*(-rise.bend for rise in self._rises(p.tolist()[:-1])), 0.0])

    def _rises(self, across: Sequence[float]) -> list[_Rise]:
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class Parabola(_Graph):
    """The material below ``y = a x^2`` (eq. (5-1), Fig. 5-2); a = 0 makes it flat."""

    dimension: ClassVar[int] = 2

    coefficient: float = 0.05  # 1/m, a

    def __post_init__(self) -> None:
        require_finite(self, "coefficient")

    def _rises(self, across: Sequence[float]) -> list[_Rise]:
        return [_bowl(self.coefficient, across[0])]


@dataclass(frozen=True, kw_only=True)
class Wave(_Graph):
    """The material below ``y = A sin(2 pi x / L)``."""

    dimension: ClassVar[int] = 2

    amplitude: float = 0.05  # m, A
    wavelength: float = 1.0  # m, L

    def __post_init__(self) -> None:
        require_finite(self, "amplitude")
        require_positive(self, "wavelength")

    def _rises(self, across: Sequence[float]) -> list[_Rise]:
        return [_sine(self.amplitude, self.wavelength, across[0])]


@dataclass(frozen=True, kw_only=True)
class Paraboloid(_Graph):
    """The material below ``z = a x^2 + b y^2``."""

    dimension: ClassVar[int] = 3

    coefficients: tuple[float, float] = (0.05, 0.05)  # 1/m, a and b

    def __post_init__(self) -> None:
        require_numbers(self, 2, "coefficients")

    def _rises(self, across: Sequence[float]) -> list[_Rise]:
        return [_bowl(a, s) for a, s in zip(self.coefficients, across, strict=True)]


@dataclass(frozen=True, kw_only=True)
class WavySheet(_Graph):
    """The material below ``z = A sin(2 pi x / L) + B sin(2 pi y / M)``."""

    dimension: ClassVar[int] = 3

    amplitudes: tuple[float, float] = (0.05, 0.05)  # m, A and B
    wavelengths: tuple[float, float] = (1.0, 1.0)  # m, L and M

    def __post_init__(self) -> None:
        require_numbers(self, 2, "amplitudes")
        lengths = self.wavelengths
        if len(lengths) != 2 or not all(0 < length < math.inf for length in lengths):
            raise ParameterError("wavelengths", lengths, "2 finite numbers > 0")

    def _rises(self, across: Sequence[float]) -> list[_Rise]:
        return list(map(_sine, self.amplitudes, self.wavelengths, across))


def _bowl(coefficient: float, s: float) -> _Rise:
    return _Rise(coefficient * s * s, 2 * coefficient * s, 2 * coefficient)


def _sine(amplitude: float, wavelength: float, s: float) -> _Rise:
    wave = 2 * math.pi / wavelength
    sine = amplitude * math.sin(wave * s)
    return _Rise(sine, amplitude * wave * math.cos(wave * s), -wave * wave * sine)
