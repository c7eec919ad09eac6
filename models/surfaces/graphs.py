"""Graphs over the first coordinate or two: parabolas and waves, summed up in space."""

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError, require_numbers

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
        for i, s in enumerate(across):
            up -= self._rise(i, s).height
        return float(up)

    def gradient(self, p: Vector) -> Vector:
        """Return the height's gradient."""
        return np.array([*(-self._rise(i, s).slope for i, s in enumerate(p.tolist()[:-1])), 1.0])

    def hessian(self, p: Vector) -> Matrix:
        """Return the height's second derivatives."""
        return np.diag([*(-self._rise(i, s).bend for i, s in enumerate(p.tolist()[:-1])), 0.0])

    def _rise(self, i: int, s: float) -> _Rise:
        raise NotImplementedError


@dataclass(frozen=True, kw_only=True)
class Parabola(_Graph):
    """The material below ``y = a x^2`` (eq. (5-1), Fig. 5-2), in space ``z = a x^2 + b y^2``."""

    coefficients: tuple[float, ...] = (0.05,)  # 1/m, a, or a and b; 0 makes it flat

    def __post_init__(self) -> None:
        require_numbers(self, self.dimension - 1, "coefficients")

    @property
    def dimension(self) -> int:
        """2 with one coefficient, else 3."""
        return 2 if len(self.coefficients) == 1 else 3

    def _rise(self, i: int, s: float) -> _Rise:
        a = self.coefficients[i]
        return _Rise(a * s * s, 2 * a * s, 2 * a)


@dataclass(frozen=True, kw_only=True)
class Wave(_Graph):
    """The material below ``y = A sin(2 pi x / L)``, in space ``z``, plus the same along y."""

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

    def _rise(self, i: int, s: float) -> _Rise:
        wave = 2 * math.pi / self.wavelengths[i]
        sine = self.amplitudes[i] * math.sin(wave * s)
        return _Rise(sine, self.amplitudes[i] * wave * math.cos(wave * s), -wave * wave * sine)
