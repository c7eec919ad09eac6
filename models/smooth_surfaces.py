"""Rigid surfaces that a contact point slides on, each the zero of a smooth level function.

The level is 0 on the surface and positive outside of the material. It need not be a distance. Its
first two derivatives give the normal, and how the normal turns along the surface.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Protocol

import numpy as np
from numpy.typing import NDArray

from models.validation import ParameterError, require_finite, require_positive

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

_ITERATIONS = 50
_CONVERGED = 1e-14  # m, relative to the point's distance from the origin where that is above 1 m


class SmoothSurface(Protocol):
    """A surface in the plane or in space; points p in the world frame, shape (d,), m."""

    @property
    def dimension(self) -> int:
        """Return d: 2 for a curve in the plane, 3 for a surface in space."""

    def level(self, p: Vector) -> float:
        """Return the level, m: 0 on the surface, positive outside of the material."""

    def gradient(self, p: Vector) -> Vector:
        """Return the level's gradient, shape (d,)."""

    def hessian(self, p: Vector) -> Matrix:
        """Return the level's second derivatives, shape (d, d), 1/m."""


@dataclass(frozen=True, kw_only=True)
class Parabola:
    """The material below ``y = a x^2`` (eq. 5-1); a = 0 makes it flat."""

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
class Circle:
    """A disc, or with ``inside`` the material around a round hole."""

    dimension: ClassVar[int] = 2

    centre: tuple[float, float] = (0.0, -1.0)  # m
    radius: float = 1.0  # m
    inside: bool = False  # True: the contact point is inside of the circle

    def __post_init__(self) -> None:
        _check_round(self.centre, self.radius, 2)

    def level(self, p: Vector) -> float:
        """Return the distance from the circle, m, negative in the material."""
        return _round_level(p, self.centre, self.radius, self.inside)

    def gradient(self, p: Vector) -> Vector:
        """Return the distance's gradient, a unit vector; 0 in the centre."""
        return _round_gradient(p, self.centre, self.inside)

    def hessian(self, p: Vector) -> Matrix:
        """Return the distance's second derivatives; 0 in the centre."""
        return _round_hessian(p, self.centre, self.inside)


@dataclass(frozen=True, kw_only=True)
class Paraboloid:
    """The material below ``z = a x^2 + b y^2``."""

    dimension: ClassVar[int] = 3

    coefficients: tuple[float, float] = (0.05, 0.05)  # 1/m, a and b

    def __post_init__(self) -> None:
        _check_finite("coefficients", self.coefficients, 2)

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
        _check_finite("amplitudes", self.amplitudes, 2)
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


@dataclass(frozen=True, kw_only=True)
class Sphere:
    """A ball, or with ``inside`` the material around a round hollow."""

    dimension: ClassVar[int] = 3

    centre: tuple[float, float, float] = (0.0, 0.0, -1.0)  # m
    radius: float = 1.0  # m
    inside: bool = False  # True: the contact point is inside of the sphere

    def __post_init__(self) -> None:
        _check_round(self.centre, self.radius, 3)

    def level(self, p: Vector) -> float:
        """Return the distance from the sphere, m, negative in the material."""
        return _round_level(p, self.centre, self.radius, self.inside)

    def gradient(self, p: Vector) -> Vector:
        """Return the distance's gradient, a unit vector; 0 in the centre."""
        return _round_gradient(p, self.centre, self.inside)

    def hessian(self, p: Vector) -> Matrix:
        """Return the distance's second derivatives; 0 in the centre."""
        return _round_hessian(p, self.centre, self.inside)


def normal(surface: SmoothSurface, p: Vector) -> Vector:
    """Return the unit normal out of the material, shape (d,).

    Raises:
        ParameterError: if the level's gradient is 0 at p.
    """
    gradient = surface.gradient(p)
    length = float(np.linalg.norm(gradient))
    if not length > 0:
        raise ParameterError("p", p.tolist(), "a point where the surface has a normal")
    return gradient / length


def nearest(surface: SmoothSurface, p: Vector, metric: Matrix | None = None) -> Vector:
    """Return the point of the surface that is nearest to p, shape (d,), m.

    Newton's method from p, so p has to be near the surface: nearer than its radius of curvature.

    Args:
        surface: the surface.
        p: m, shape (d,).
        metric: symmetric positive definite, shape (d, d); the distance is ``sqrt(r^T metric r)``.
            The Euclidean distance if None. With a stiffness, a spring from p to the point found
            pushes along the normal alone.

    Raises:
        ParameterError: if the search ends nowhere, or in a point that is not a local minimum.
    """
    if not all(map(math.isfinite, p.tolist())):
        raise ParameterError("p", p.tolist(), "finite numbers")
    d = surface.dimension
    weight = np.eye(d) if metric is None else metric
    point, multiplier = np.array(p, dtype=float), 0.0
    for _ in range(_ITERATIONS):
        gradient = surface.gradient(point)
        bent = weight - multiplier * surface.hessian(point)
        minimal = _convex_along(bent, gradient)
        # Stationarity of the Lagrangian and the constraint, both linearised. Where the Lagrangian
        # has no minimum along the surface the constraint's bend is left out, to descend anyway.
        system = np.zeros((d + 1, d + 1))
        system[:d, :d] = bent if minimal else weight
        system[:d, d] = -gradient
        system[d, :d] = -gradient
        right = np.append(-weight @ (point - p), surface.level(point))
        try:
            solution = np.linalg.solve(system, right)
        except np.linalg.LinAlgError:
            break
        point, multiplier = point + solution[:d], float(solution[d])
        size = float(np.max(np.abs(point)))
        if not size < math.inf:
            break
        if minimal and float(np.max(np.abs(solution[:d]))) <= _CONVERGED * max(1.0, size):
            return point
    allowed = "a point nearer to the surface than its radius of curvature"
    raise ParameterError("p", p.tolist(), allowed)


def _convex_along(matrix: Matrix, gradient: Vector) -> bool:
    """Return whether a quadratic form is positive in every direction across the gradient."""
    tangents = np.linalg.svd(gradient[np.newaxis])[2][1:]
    try:
        np.linalg.cholesky(tangents @ matrix @ tangents.T)
    except np.linalg.LinAlgError:
        return False
    return True


def _sine(amplitude: float, wavelength: float, s: float) -> tuple[float, float, float]:
    """Return a sine wave's value, slope and second derivative at s."""
    wave = 2 * math.pi / wavelength
    sine = amplitude * math.sin(wave * s)
    return sine, amplitude * wave * math.cos(wave * s), -wave * wave * sine


def _round_level(p: Vector, centre: tuple[float, ...], radius: float, inside: bool) -> float:
    distance = math.dist(p.tolist(), centre)
    return radius - distance if inside else distance - radius


def _round_gradient(p: Vector, centre: tuple[float, ...], inside: bool) -> Vector:
    offset = [x - c for x, c in zip(p.tolist(), centre, strict=True)]
    distance = math.hypot(*offset)
    if distance == 0:
        return np.zeros(len(offset))
    scale = -distance if inside else distance
    return np.array([x / scale for x in offset])


def _round_hessian(p: Vector, centre: tuple[float, ...], inside: bool) -> Matrix:
    offset = p - np.array(centre)
    distance = math.hypot(*offset.tolist())
    if distance == 0:
        return np.zeros((len(offset), len(offset)))
    unit = offset / distance
    flat = np.eye(len(offset)) - np.outer(unit, unit)
    return flat / (-distance if inside else distance)


def _check_finite(name: str, values: tuple[float, ...], count: int) -> None:
    if len(values) != count or not all(map(math.isfinite, values)):
        raise ParameterError(name, values, f"{count} finite numbers")


def _check_round(centre: tuple[float, ...], radius: float, dimension: int) -> None:
    _check_finite("centre", centre, dimension)
    if not 0 < radius < math.inf:
        raise ParameterError("radius", radius, "a finite number > 0")
