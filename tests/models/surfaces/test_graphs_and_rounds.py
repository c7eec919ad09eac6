"""Smooth surfaces against differences, closed forms and a search for the nearest point."""

import math
import re
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from chamfer.models.surfaces.graphs import Parabola, Paraboloid, Wave, WavySheet
from chamfer.models.surfaces.nearest import nearest
from chamfer.models.surfaces.rounds import Circle, Sphere
from chamfer.models.surfaces.surface import Surface, normal
from chamfer.models.validation import ParameterError

SURFACES: list[Surface] = [
    Parabola(),
    Parabola(coefficient=-0.4),
    Wave(amplitude=0.03, wavelength=0.9),
    Circle(centre=(0.2, -1.3), radius=1.5),
    Circle(centre=(0.2, 1.3), radius=1.5, inside=True),
    Paraboloid(coefficients=(0.3, -0.2)),
    WavySheet(amplitudes=(0.03, 0.02), wavelengths=(0.9, 0.7)),
    Sphere(centre=(0.2, 0.1, -1.3), radius=1.5),
    Sphere(centre=(0.2, 0.1, 1.3), radius=1.5, inside=True),
]
NAMES = [f"{type(s).__name__}{i}" for i, s in enumerate(SURFACES)]
each = pytest.mark.parametrize("surface", SURFACES, ids=NAMES)
seeds = st.integers(0, 2**32 - 1)


def height(surface: Surface, x: float, y: float) -> float:
    """Return the last coordinate of the surface's point, from the docstrings' formulas."""
    match surface:
        case Parabola(coefficient=a):
            return a * x**2
        case Wave(amplitude=a, wavelength=length):
            return a * math.sin(2 * math.pi * x / length)
        case Paraboloid(coefficients=(a, b)):
            return a * x**2 + b * y**2
        case WavySheet(amplitudes=(a, b), wavelengths=(k, m)):
            return a * math.sin(2 * math.pi * x / k) + b * math.sin(2 * math.pi * y / m)
        case Circle(centre=(cx, cy), radius=radius, inside=inside):
            return cy + math.sqrt(radius**2 - (x - cx) ** 2) * (-1 if inside else 1)
        case Sphere(centre=(cx, cy, cz), radius=radius, inside=inside):
            rise = math.sqrt(radius**2 - (x - cx) ** 2 - (y - cy) ** 2)
            return cz + rise * (-1 if inside else 1)
    raise AssertionError(surface)


def on(surface: Surface, x: float, y: float = 0.0) -> np.ndarray:
    z = height(surface, x, y)
    return np.array([x, z] if surface.dimension == 2 else [x, y, z])


def difference(function: Callable[[np.ndarray], object], p: np.ndarray) -> np.ndarray:
    """Return central differences; the axis of p comes first."""
    rows = [
        (np.asarray(function(p + 1e-6 * e)) - np.asarray(function(p - 1e-6 * e))) / 2e-6
        for e in np.eye(len(p))
    ]
    return np.array(rows)


def random_metric(seed: int, d: int) -> np.ndarray:
    """Return a metric with eigenvalues from 1 to 3."""
    rng = np.random.default_rng(seed)
    q, _ = np.linalg.qr(rng.normal(size=(d, d)))
    matrix: np.ndarray = q @ np.diag(rng.uniform(1, 3, d)) @ q.T
    return 0.5 * (matrix + matrix.T)


@each
@given(x=st.floats(-0.8, 0.8), y=st.floats(-0.8, 0.8), off=st.floats(1e-6, 0.1))
def test_level_is_zero_on_the_surface_and_positive_above(
    surface: Surface, x: float, y: float, off: float
) -> None:
    p = on(surface, x, y)
    up = off * np.eye(surface.dimension)[-1]
    assert surface.level(p) == pytest.approx(0, abs=1e-15)
    assert surface.level(p + up) > 0 > surface.level(p - up)
    assert normal(surface, p)[-1] > 0
    assert np.linalg.norm(normal(surface, p)) == pytest.approx(1, abs=1e-15)


@each
@given(x=st.floats(-0.8, 0.8), y=st.floats(-0.8, 0.8), off=st.floats(-0.1, 0.1))
def test_derivatives(surface: Surface, x: float, y: float, off: float) -> None:
    p = on(surface, x, y)
    p[-1] += off
    np.testing.assert_allclose(surface.gradient(p), difference(surface.level, p), atol=1e-8)
    hessian = surface.hessian(p)
    np.testing.assert_allclose(hessian, difference(surface.gradient, p), atol=1e-6)
    np.testing.assert_array_equal(hessian, hessian.T)


@pytest.mark.parametrize("x", [-3.0, 0.0, 1.0, 2.378])
def test_thesis_surface(x: float) -> None:
    surface, p = Parabola(), np.array([x, 0.05 * x**2])
    n = normal(surface, p)
    angle = math.atan2(n[1], n[0])
    assert angle == pytest.approx(math.pi / 2 + math.atan(x / 10), abs=1e-15)  # (5-2)
    radius = 10 * (1 + 0.01 * x**2) ** 1.5  # (5-3)
    t = np.array([n[1], -n[0]])
    curvature = t @ surface.hessian(p) @ t / np.linalg.norm(surface.gradient(p))
    assert curvature == pytest.approx(-1 / radius)


@each
@given(seed=seeds, weighted=st.booleans())
@settings(max_examples=25)
def test_nearest_point(surface: Surface, seed: int, weighted: bool) -> None:
    rng, d = np.random.default_rng(seed), surface.dimension
    metric = random_metric(seed, d) if weighted else np.eye(d)
    p = on(surface, *rng.uniform(-0.4, 0.4, 2))
    p[-1] += rng.uniform(-0.08, 0.08)
    found = nearest(surface, p, metric if weighted else None)
    assert surface.level(found) == pytest.approx(0, abs=1e-13)
    # The spring that the metric stands for pulls along the normal.
    pull, n = metric @ (found - p), normal(surface, found)
    np.testing.assert_allclose(pull - (pull @ n) * n, 0, atol=1e-12)

    def squared(uv: np.ndarray) -> float:
        r = on(surface, uv[0], uv[-1]) - p
        return float(r @ metric @ r)

    searched = minimize(squared, p[: d - 1], tol=1e-14, options={"gtol": 1e-9})
    r = found - p
    assert r @ metric @ r == pytest.approx(searched.fun, abs=1e-9)
    np.testing.assert_allclose(found[: d - 1], searched.x, atol=1e-5)


@each
def test_a_point_of_the_surface_is_its_own_nearest(surface: Surface) -> None:
    p = on(surface, 0.3, -0.2)
    np.testing.assert_allclose(nearest(surface, p), p, atol=1e-15)


def test_nearest_point_from_below_a_bump() -> None:
    # The curve's point straight above is 5 cm away, its nearest ones are on both flanks.
    surface = Parabola(coefficient=-1.0)
    assert nearest(surface, np.array([0.0, -0.4]))[0] == pytest.approx(0, abs=1e-12)
    found = nearest(surface, np.array([0.01, -0.6]))
    assert math.dist(found, (0.01, -0.6)) < 0.6 - 1e-2
    assert found[0] > 0.3


@pytest.mark.parametrize(
    ("point", "allowed"),
    [
        ((0.0, -1.0), "a point nearer to the surface than its radius of curvature"),
        ((0.0, math.nan), "finite numbers"),
        ((math.inf, 0.0), "finite numbers"),
    ],
)
def test_nearest_point_that_is_not_found(point: tuple[float, float], allowed: str) -> None:
    message = re.escape(f"p is {list(point)!r}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        nearest(Circle(), np.array(point))


def test_no_normal_in_the_centre() -> None:
    message = re.escape("p is [0.0, -1.0], allowed: a point where the surface has a normal")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        normal(Circle(), np.array([0.0, -1.0]))
    np.testing.assert_array_equal(Circle().hessian(np.array([0.0, -1.0])), np.zeros((2, 2)))


@pytest.mark.parametrize(
    ("kind", "changes", "allowed"),
    [
        (Parabola, {"coefficient": math.nan}, "a finite number"),
        (Wave, {"amplitude": math.inf}, "a finite number"),
        (Wave, {"wavelength": 0.0}, "a finite number > 0"),
        (Circle, {"centre": (0.0, math.nan)}, "2 finite numbers"),
        (Circle, {"centre": (0.0, 0.0, 0.0)}, "2 finite numbers"),
        (Circle, {"radius": -1.0}, "a finite number > 0"),
        (Paraboloid, {"coefficients": (math.inf, 0.0)}, "2 finite numbers"),
        (Paraboloid, {"coefficients": (0.0,)}, "2 finite numbers"),
        (WavySheet, {"amplitudes": (0.0, math.nan)}, "2 finite numbers"),
        (WavySheet, {"wavelengths": (0.0, 1.0)}, "2 finite numbers > 0"),
        (WavySheet, {"wavelengths": (1.0, 1.0, 1.0)}, "2 finite numbers > 0"),
        (Sphere, {"centre": (0.0, 0.0)}, "3 finite numbers"),
        (Sphere, {"radius": math.inf}, "a finite number > 0"),
    ],
)
def test_errors(kind: Callable[..., Surface], changes: dict[str, object], allowed: str) -> None:
    ((name, value),) = changes.items()
    message = re.escape(f"{name} is {value!r}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        kind(**changes)
