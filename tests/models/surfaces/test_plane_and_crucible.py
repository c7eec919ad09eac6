"""Surfaces against distances and gradients computed another way."""

import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.optimize import minimize_scalar

from chamfer.models.surfaces.planes import RippledPlane
from chamfer.models.surfaces.rounds import Crucible
from chamfer.models.surfaces.surface import Surface, locate
from chamfer.models.validation import ParameterError

coordinates = st.floats(-2.0, 2.0)
points = st.tuples(coordinates, coordinates, coordinates).map(np.array)
seeds = st.integers(0, 2**32 - 1)

CRUCIBLE = Crucible()
WAVY = RippledPlane(point=(0.1, -0.2, 0.3), tilt=0.2, ripple=1e-3, wavelength=0.05)


def gradient(surface: Surface, p_W: np.ndarray, step: float = 1e-6) -> np.ndarray:
    return np.array(
        [
            (locate(surface, p_W + step * axis).gap - locate(surface, p_W - step * axis).gap)
            / (2 * step)
            for axis in np.eye(3)
        ]
    )


def turned(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors at right angles."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q[:, 0], q[:, 1]


def wavy(seed: int, tilt: float = 0.2, ripple: float = 1e-3) -> RippledPlane:
    normal, along = turned(seed)
    return dataclasses.replace(
        WAVY, normal=tuple(normal), along=tuple(along), tilt=tilt, ripple=ripple
    )


def on(surface: RippledPlane, s: float, across: float = 0.0) -> np.ndarray:
    """Return the point of the surface's graph above ``s``, from the docstring's formula."""
    normal, along = np.array(surface.normal), np.array(surface.along)
    height = math.tan(surface.tilt) * s + surface.ripple * math.sin(
        2 * math.pi * s / surface.wavelength
    )
    sideways = np.cross(normal, along)
    return np.array(surface.point) + s * along + height * normal + across * sideways


@pytest.mark.parametrize(
    ("point", "gap", "normal"),
    [
        ((1.5, -0.75, 0.0), 0.25, (-1, 0, 0)),
        ((1.0, -1.5, 7.0), 0.0, (0, 1, 0)),  # the nominal contact point of section 2.2
        ((1.0, -1.6, 0.0), -0.1, (0, 1, 0)),
        ((0.1, -0.75, -3.0), -0.15, (1, 0, 0)),
        ((1.0, 0.0, 0.0), 0.0, (0, -1, 0)),
    ],
)
def test_crucible_inside_and_outside(
    point: tuple[float, ...], gap: float, normal: tuple[float, ...]
) -> None:
    found = locate(CRUCIBLE, np.array(point))
    assert found.gap == pytest.approx(gap, abs=1e-15)
    np.testing.assert_allclose(found.normal, normal, atol=1e-15)


def test_crucible_on_its_axis() -> None:
    found = locate(CRUCIBLE, np.array([1.0, -0.75, 0.4]))
    assert found.gap == 0.75
    np.testing.assert_array_equal(found.normal, [1, 0, 0])


@given(p_W=points)
def test_crucible_normal_is_the_gradient_of_the_gap(p_W: np.ndarray) -> None:
    found = locate(CRUCIBLE, p_W)
    assert np.linalg.norm(found.normal) == pytest.approx(1, abs=1e-14)
    assume(0.75 - found.gap > 1e-2)
    np.testing.assert_allclose(found.normal, gradient(CRUCIBLE, p_W), atol=1e-7)
    # From the point, the gap against the normal leads to the wall.
    wall = p_W - found.gap * found.normal
    assert math.hypot(wall[0] - 1.0, wall[1] + 0.75) == pytest.approx(0.75, abs=1e-14)
    assert wall[2] == p_W[2]


@given(p_W=points, seed=seeds)
def test_flat_plane(p_W: np.ndarray, seed: int) -> None:
    surface = wavy(seed, tilt=0.0, ripple=0.0)
    found = locate(surface, p_W)
    expected = np.dot(surface.normal, p_W - surface.point)
    assert found.gap == pytest.approx(expected, abs=1e-14)
    np.testing.assert_allclose(found.normal, surface.normal, atol=1e-15)


@given(p_W=points, seed=seeds, tilt=st.floats(-1.4, 1.4))
def test_tilted_plane_is_exact(p_W: np.ndarray, seed: int, tilt: float) -> None:
    surface = wavy(seed, tilt=tilt, ripple=0.0)
    # Turned about the axis that is at right angles to both, normal towards -along.
    normal = math.cos(tilt) * np.array(surface.normal) - math.sin(tilt) * np.array(surface.along)
    found = locate(surface, p_W)
    assert found.gap == pytest.approx(np.dot(normal, p_W - surface.point), abs=1e-13)
    np.testing.assert_allclose(found.normal, normal, atol=1e-13)


def test_tilt_rises_along() -> None:
    surface = RippledPlane(point=(0.0, 0.0, 0.0), tilt=math.atan(0.5))
    assert locate(surface, np.array([2.0, 5.0, 1.0])).gap == pytest.approx(0, abs=1e-15)
    assert (
        locate(surface, np.array([2.0, 0.0, 0.9])).gap < 0 < locate(surface, np.zeros(3) + 1).gap
    )


@given(seed=seeds, s=st.floats(-0.2, 0.2), across=st.floats(-1, 1))
def test_ripple_is_where_its_formula_puts_it(seed: int, s: float, across: float) -> None:
    surface = wavy(seed)
    p_W = on(surface, s, across)
    found = locate(surface, p_W)
    assert found.gap == pytest.approx(0, abs=1e-14)
    assert np.linalg.norm(found.normal) == pytest.approx(1, abs=1e-14)
    # The normal is at right angles to the graph, and on the graph the gradient of the gap.
    chord = (on(surface, s + 1e-7) - on(surface, s - 1e-7)) / 2e-7
    assert found.normal @ chord == pytest.approx(0, abs=1e-6)
    assert found.normal @ np.cross(surface.normal, surface.along) == pytest.approx(0, abs=1e-14)
    assert found.normal @ surface.normal > 0
    np.testing.assert_allclose(found.normal, gradient(surface, p_W), atol=1e-7)


@given(seed=seeds, s=st.floats(-0.02, 0.02), gap=st.floats(-1e-3, 1e-3))
def test_gap_is_the_distance_to_first_order(seed: int, s: float, gap: float) -> None:
    # Of a size as in the experiments: slopes up to 0.03, radii of curvature down to 0.2 m.
    surface = dataclasses.replace(wavy(seed, tilt=0.0125, ripple=5e-5), wavelength=0.02)
    p_W = on(surface, s) + gap * np.array(surface.normal)
    distance = math.sqrt(
        minimize_scalar(
            lambda other: float(np.sum((on(surface, other) - p_W) ** 2)),
            bounds=(s - 2e-3, s + 2e-3),
            method="bounded",
            options={"xatol": 1e-12},
        ).fun
    )
    found = locate(surface, p_W).gap
    assert abs(found - math.copysign(distance, gap)) < 1e-5 * abs(gap) + 1e-9


def test_error_of_the_distance_shrinks_with_the_square_of_the_slope() -> None:
    def error(tilt: float) -> float:
        surface = dataclasses.replace(WAVY, tilt=tilt, ripple=5e-5, wavelength=0.02)
        p_W = on(surface, 0.003) + np.array([0.0, 0.0, 1e-3])
        found = minimize_scalar(
            lambda other: float(np.linalg.norm(on(surface, other) - p_W)),
            bounds=(0.001, 0.005),
            method="bounded",
            options={"xatol": 1e-13},
        )
        return abs(locate(surface, p_W).gap - found.fun)

    # The ripple's own slope at this point is 0.0157 cos(0.94) = 0.0092.
    assert error(0.0908) == pytest.approx(4 * error(0.0408), rel=0.1)


def test_period_of_the_ripple() -> None:
    surface = RippledPlane(point=(0.0, 0.0, 0.0), ripple=1e-4, wavelength=0.02)
    gaps = [locate(surface, np.array([s, 0.0, 0.0])).gap for s in (0.005, 0.015, 0.025, 0.01)]
    np.testing.assert_allclose(gaps, [-1e-4, 1e-4, -1e-4, 0], atol=1e-15)


@pytest.mark.parametrize(
    ("changes", "allowed"),
    [
        ({"tilt": math.nan}, "a finite number"),
        ({"tilt": math.pi / 2}, "less than a right angle, rad"),
        ({"tilt": -2.0}, "less than a right angle, rad"),
        ({"ripple": -1e-3}, "a finite number >= 0"),
        ({"ripple": math.inf}, "a finite number >= 0"),
        ({"wavelength": 0.0}, "a finite number > 0"),
        ({"wavelength": math.nan}, "a finite number > 0"),
        ({"wavelength": math.inf}, "a finite number > 0"),
        ({"normal": (0.0, 0.0, 2.0)}, "a vector of length 1"),
        ({"normal": (0.0, 0.0, math.nan)}, "a vector of length 1"),
        ({"along": (0.0, 0.0, 0.0)}, "a vector of length 1"),
        ({"along": (0.0, 0.6, 0.8)}, "at right angles to (0.0, 0.0, 1.0)"),
        ({"point": (0.0, math.nan, 0.0)}, "3 finite numbers"),
        ({"point": (0.0, 0.0)}, "3 finite numbers"),
    ],
)
def test_plane_errors(changes: dict[str, object], allowed: str) -> None:
    ((name, value),) = changes.items()
    message = re.escape(f"{name} is {value!r}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        dataclasses.replace(WAVY, **changes)


@pytest.mark.parametrize(
    ("changes", "allowed"),
    [
        ({"centre": (math.nan, 0.0)}, "2 finite numbers"),
        ({"centre": (0.0, math.inf)}, "2 finite numbers"),
        ({"radius": 0.0}, "a finite number > 0"),
        ({"radius": math.nan}, "a finite number > 0"),
        ({"radius": math.inf}, "a finite number > 0"),
    ],
)
def test_crucible_errors(changes: dict[str, object], allowed: str) -> None:
    ((name, value),) = changes.items()
    message = re.escape(f"{name} is {value!r}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        Crucible(**changes)  # type: ignore[arg-type]
