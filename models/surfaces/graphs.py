"""Graphs over the first coordinate or two: parabolas, waves, and their sums in space."""

import math
from dataclasses import dataclass
from typing import ClassVar

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


@dataclass(frozen=True, kw_only=True)
class Parabola:
    """The material below ``y = a x^2`` (eq. (5-1), Fig. 5-2); a = 0 makes it flat."""

    dimension: ClassVar[int] = 2

    coefficient: float = 0.05  # 1/m, a

    def __post_init__(self) -> None:
        require_finite(self, "coefficient")

    def level(self, p: Vector) -> float:
        """Return the height above the parabola, m."""
        x, y = p.tolist()
        return float(y - self.coefficient * x * x)

    def gradient(self, p: Vector) -> Vector:
        """Return the height's gradient."""
        return np.array([-2 * self.coefficient * float(p[0]), 1.0])

    def hessian(self, p: Vector) -> Matrix:
        """Return the height's second derivatives."""
        return np.array([[-2 * self.coefficient, 0.0], [0.0, 0.0]])


@dataclass(frozen=True, kw_only=True)
class Wave:
    """The material below ``y = A sin(2 pi x / L)``."""

    dimension: ClassVar[int] = 2

    amplitude: float = 0.05  # m, A
    wavelength: float = 1.0  # m, L

    def __post_init__(self) -> None:
        require_finite(self, "amplitude")
        require_positive(self, "wavelength")

    def level(self, p: Vector) -> float:
        """Return the height above the wave, m."""
        x, y = p.tolist()
        return float(y - _sine(self.amplitude, self.wavelength, x)[0])

    def gradient(self, p: Vector) -> Vector:
        """Return the height's gradient."""
        return np.array([-_sine(self.amplitude, self.wavelength, float(p[0]))[1], 1.0])

    def hessian(self, p: Vector) -> Matrix:
        """Return the height's second derivatives."""
        bend = _sine(self.amplitude, self.wavelength, float(p[0]))[2]
        return np.array([[-bend, 0.0], [0.0, 0.0]])


@dataclass(frozen=True, kw_only=True)
class Paraboloid:
    """The material below ``z = a x^2 + b y^2``."""

    dimension: ClassVar[int] = 3

    coefficients: tuple[float, float] = (0.05, 0.05)  # 1/m, a and b

    def __post_init__(self) -> None:
        require_numbers(self, 2, "coefficients")

    def level(self, p: Vector) -> float:
        """Return the height above the paraboloid, m."""
        (a, b), (x, y, z) = self.coefficients, p.tolist()
        return float(z - a * x * x - b * y * y)

    def gradient(self, p: Vector) -> Vector:
        """Return the height's gradient."""
        (a, b), (x, y, _) = self.coefficients, p.tolist()
        return np.array([-2 * a * x, -2 * b * y, 1.0])

    def hessian(self, p: Vector) -> Matrix:
        """Return the height's second derivatives."""
        a, b = self.coefficients
        return np.array([[-2 * a, 0.0, 0.0], [0.0, -2 * b, 0.0], [0.0, 0.0, 0.0]])


@dataclass(frozen=True, kw_only=True)
class WavySheet:
    """The material below ``z = A sin(2 pi x / L) + B sin(2 pi y / M)``."""

    dimension: ClassVar[int] = 3

    amplitudes: tuple[float, float] = (0.05, 0.05)  # m, A and B
    wavelengths: tuple[float, float] = (1.0, 1.0)  # m, L and M

    def __post_init__(self) -> None:
        require_numbers(self, 2, "amplitudes")
        lengths = self.wavelengths
        if len(lengths) != 2 or not all(0 < length < math.inf for length in lengths):
            raise ParameterError("wavelengths", lengths, "2 finite numbers > 0")

    def level(self, p: Vector) -> float:
        """Return the height above the sheet, m."""
        (a, b), (k, m), (x, y, z) = self.amplitudes, self.wavelengths, p.tolist()
        return float(z - _sine(a, k, x)[0] - _sine(b, m, y)[0])

    def gradient(self, p: Vector) -> Vector:
        """Return the height's gradient."""
        (a, b), (k, m), (x, y, _) = self.amplitudes, self.wavelengths, p.tolist()
        return np.array([-_sine(a, k, x)[1], -_sine(b, m, y)[1], 1.0])

    def hessian(self, p: Vector) -> Matrix:
        """Return the height's second derivatives."""
        (a, b), (k, m), (x, y, _) = self.amplitudes, self.wavelengths, p.tolist()
        u, v = -_sine(a, k, x)[2], -_sine(b, m, y)[2]
        return np.array([[u, 0.0, 0.0], [0.0, v, 0.0], [0.0, 0.0, 0.0]])


def _sine(amplitude: float, wavelength: float, s: float) -> tuple[float, float, float]:
    """Return a sine wave's value, slope and second derivative at s."""
    wave = 2 * math.pi / wavelength
    sine = amplitude * math.sin(wave * s)
    return sine, amplitude * wave * math.cos(wave * s), -wave * wave * sine
