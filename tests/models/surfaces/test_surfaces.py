"""Surfaces against their formulas, differences and a search; friction and damage on them."""

import dataclasses
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from chamfer.models.surfaces.composed import Extruded, Intersection, Placed, Union
from chamfer.models.surfaces.damage import impact_speed_limit
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.graphs import Parabola, Wave
from chamfer.models.surfaces.nearest import nearest
from chamfer.models.surfaces.planes import RippledPlane
from chamfer.models.surfaces.profile import Profile
from chamfer.models.surfaces.rounds import Circle, Crucible, Ellipsoid, Sphere
from chamfer.models.surfaces.surface import Surface, curvature, locate, normal
from chamfer.models.surfaces.surface_code import evaluate, surface_code
from chamfer.models.validation import ParameterError

SURFACES: list[Surface] = [
    Parabola(),
    Parabola(coefficients=(-0.4,)),
    Wave(amplitudes=(0.03,), wavelengths=(0.9,)),
    Circle(centre=(0.2, -1.3), radius=1.5),
    Circle(centre=(0.2, 1.3), radius=1.5, inside=True),
    Parabola(coefficients=(0.3, -0.2)),
    Wave(amplitudes=(0.03, 0.02), wavelengths=(0.9, 0.7)),
    Sphere(centre=(0.2, 0.1, -1.3), radius=1.5),
    Sphere(centre=(0.2, 0.1, 1.3), radius=1.5, inside=True),
]
# Turned by 90 degrees about z and then about x: the old x, y, z are y, z, x in the world.
_CYCLE = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
PLACED = Placed(surface=Parabola(coefficients=(0.3, -0.2)), point=(1.0, 2.0, 3.0), axes=_CYCLE)
WAVY = RippledPlane(point=(0.1, -0.2, 0.3), tilt=0.2, ripple=1e-3, wavelength=0.05)
COMPOSED: list[Surface] = [
    Crucible(),
    WAVY,
    Extruded(curve=Wave(amplitudes=(0.03,), wavelengths=(0.9,))),
    PLACED,
    Ellipsoid(semi_axes=(0.9, 0.7, 0.5)),
    Placed(surface=Extruded(curve=Circle()), point=(0.3, 0.2, 0.1), axes=_CYCLE),
    Union(parts=(Sphere(), Crucible(), PLACED)),
    Intersection(parts=(Sphere(), Crucible(), PLACED)),
    Profile(lengths=(0.1, 0.6, 0.3), curvatures=(0.0, 1.2, -0.9)),
]
NAMES = [f"{type(s).__name__}{i}" for i, s in enumerate(SURFACES)]
each = pytest.mark.parametrize("surface", SURFACES, ids=NAMES)
seeds = st.integers(0, 2**32 - 1)


def height(surface: Surface, x: float, y: float) -> float:
    """Return the last coordinate of the surface's point, from the docstrings' formulas."""
    match surface:
        case Parabola(coefficients=bends):
            return sum(a * s**2 for a, s in zip(bends, (x, y), strict=False))
        case Wave(amplitudes=rises, wavelengths=lengths):
            places = zip(rises, lengths, (x, y), strict=False)
            return sum(a * math.sin(2 * math.pi * s / length) for a, length, s in places)
        case Circle(centre=(cx, cy), radius=radius, inside=inside):
            return cy + math.sqrt(radius**2 - (x - cx) ** 2) * (-1 if inside else 1)
        case Sphere(centre=(cx, cy, cz), radius=radius, inside=inside):
            rise = math.sqrt(radius**2 - (x - cx) ** 2 - (y - cy) ** 2)
            return cz + rise * (-1 if inside else 1)
    raise AssertionError(surface)


def on(surface: Surface, x: float, y: float = 0.0) -> np.ndarray:
    z = height(surface, x, y)
    return np.array([x, z] if surface.dimension == 2 else [x, y, z])


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


@pytest.mark.parametrize("surface", [*SURFACES, *COMPOSED], ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("seed", range(3))
def test_derivatives(surface: Surface, seed: int) -> None:
    d = surface.dimension
    p = np.random.default_rng(seed).uniform(-0.5, 0.5, d)
    for function, derivative in (
        (surface.level, surface.gradient),
        (surface.gradient, surface.hessian),
    ):
        differences = [
            (np.asarray(function(p + 1e-6 * e)) - np.asarray(function(p - 1e-6 * e))) / 2e-6
            for e in np.eye(d)
        ]
        np.testing.assert_allclose(derivative(p), differences, atol=1e-6)


def test_codes_say_what_the_surfaces_say() -> None:
    twice = Placed(surface=Union(parts=(PLACED, Sphere())), point=(0.0, 0.1, 0.0), axes=_CYCLE)
    surfaces = [one for one in [*SURFACES, *COMPOSED, twice] if one.dimension == 3]
    code, rng = surface_code(*surfaces), np.random.default_rng(1)
    assert code is not None
    gradient, hessian = np.empty(3), np.empty((3, 3))
    for which, surface in enumerate(surfaces):
        for p in rng.uniform(-1.5, 1.5, (20, 3)):
            level = evaluate(code, which, p, gradient, hessian)
            assert level == pytest.approx(surface.level(p), rel=1e-13, abs=1e-14)
            np.testing.assert_allclose(gradient, surface.gradient(p), atol=1e-13)
            np.testing.assert_allclose(hessian, surface.hessian(p), rtol=1e-12, atol=1e-12)


def test_what_a_class_of_ones_own_says_has_no_code() -> None:
    class Own(Sphere):
        def level(self, p: np.ndarray) -> float:
            return super().level(p) - 0.1

    assert surface_code(Sphere()) is not None
    assert surface_code(Union(parts=(Sphere(), Own()))) is None


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


@given(s=st.floats(0.0, 0.6), off=st.floats(-0.3, 0.3))
def test_an_arc_of_a_profile_is_a_circle(s: float, off: float) -> None:
    profile = Profile(lengths=(0.5, 0.6), curvatures=(0.0, 0.8), smooth=False)
    circle = Circle(centre=(0.5, 1.25), radius=1.25, inside=True)
    p = np.array(
        [0.5 + (1.25 - off) * math.sin(s / 1.25), 1.25 - (1.25 - off) * math.cos(s / 1.25)]
    )
    assert profile.level(p) == pytest.approx(off, abs=1e-10)
    np.testing.assert_allclose(profile.gradient(p), circle.gradient(p), atol=1e-9)


def test_a_bend_turns_by_half_its_length_times_its_curvature() -> None:
    bend = Profile(lengths=(1.0, 0.4), curvatures=(0.0, -1.5))
    for x, angle, curved in ((0.5, 0.0, 0.0), (1.2, -0.15, 1.5), (2.0, -0.3, 0.0)):
        p = np.array([x, 0.0])
        p = p - bend.level(p) * bend.gradient(p)
        np.testing.assert_allclose(normal(bend, p), [-math.sin(angle), math.cos(angle)], atol=2e-3)
        assert curvature(bend, p) == pytest.approx(curved, abs=2e-3)


def turned(seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Return two unit vectors at right angles."""
    q, _ = np.linalg.qr(np.random.default_rng(seed).normal(size=(3, 3)))
    return q[:, 0], q[:, 1]


def wavy(seed: int, tilt: float = 0.2, ripple: float = 1e-3) -> RippledPlane:
    normal, along = turned(seed)
    return dataclasses.replace(
        WAVY, normal=tuple(normal), along=tuple(along), tilt=tilt, ripple=ripple
    )


def on_plane(surface: RippledPlane, s: float, across: float = 0.0) -> np.ndarray:
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
    found = locate(Crucible(), np.array(point))
    assert found.gap == pytest.approx(gap, abs=1e-15)
    np.testing.assert_allclose(found.normal, normal, atol=1e-15)


@given(seed=seeds, tilt=st.floats(-1.4, 1.4))
def test_tilted_plane_is_exact(seed: int, tilt: float) -> None:
    p_W = np.random.default_rng(seed).uniform(-2.0, 2.0, 3)
    surface = wavy(seed, tilt=tilt, ripple=0.0)
    # Turned about the axis that is at right angles to both, normal towards -along.
    normal = math.cos(tilt) * np.array(surface.normal) - math.sin(tilt) * np.array(surface.along)
    found = locate(surface, p_W)
    assert found.gap == pytest.approx(np.dot(normal, p_W - surface.point), abs=1e-13)
    np.testing.assert_allclose(found.normal, normal, atol=1e-13)


@given(seed=seeds, s=st.floats(-0.2, 0.2), across=st.floats(-1, 1))
def test_ripple_is_where_its_formula_puts_it(seed: int, s: float, across: float) -> None:
    surface = wavy(seed)
    p_W = on_plane(surface, s, across)
    found = locate(surface, p_W)
    assert found.gap == pytest.approx(0, abs=1e-14)
    assert np.linalg.norm(found.normal) == pytest.approx(1, abs=1e-14)
    # The normal is at right angles to the graph, and on the graph the gradient of the gap.
    chord = (on_plane(surface, s + 1e-7) - on_plane(surface, s - 1e-7)) / 2e-7
    assert found.normal @ chord == pytest.approx(0, abs=1e-6)
    assert found.normal @ np.cross(surface.normal, surface.along) == pytest.approx(0, abs=1e-14)
    assert found.normal @ surface.normal > 0


def test_places_are_where_they_are_put() -> None:
    # The paraboloid's top is at the placed origin, and its old z is the world's x.
    np.testing.assert_allclose(normal(PLACED, np.array([1.0, 2.0, 3.0])), [1, 0, 0], atol=1e-15)
    assert PLACED.level(np.array([1.25, 2.0, 3.0])) == pytest.approx(0.25)
    assert PLACED.level(np.array([1.0 + 0.3 * 0.5**2, 2.5, 3.0])) == pytest.approx(0, abs=1e-15)
    wall = Extruded(curve=Parabola(coefficients=(0.5,)))
    assert locate(wall, np.array([1.0, 0.5, 7.0])).gap == pytest.approx(0, abs=1e-15)
    np.testing.assert_allclose(
        locate(wall, np.array([1.0, 0.5, 7.0])).normal, [-math.sqrt(0.5), math.sqrt(0.5), 0]
    )


def test_union_is_in_the_material_of_any_part() -> None:
    floor = Extruded(curve=Parabola(coefficients=(0.0,)))
    both = Union(parts=(floor, Sphere(centre=(0.0, 0.0, 0.0), radius=0.5)))
    for point, gap in (((0.0, 0.3, 0.0), -0.2), ((2.0, -0.1, 0.0), -0.1), ((0.0, 0.8, 0.0), 0.3)):
        assert locate(both, np.array(point)).gap == pytest.approx(gap)


@pytest.mark.parametrize(
    ("surface", "point", "expected"),
    [
        (Sphere(radius=0.5), (0.0, 0.0, -0.5), 2.0),
        (Crucible(), (1.0, -1.5, 0.2), 1 / 0.75),
        (Parabola(coefficients=(0.05,)), (0.0, 0.0), 0.1),
        (Parabola(coefficients=(0.3, -0.4)), (0.0, 0.0, 0.0), 0.8),
        (RippledPlane(point=(0.0, 0.0, 0.0), tilt=0.3), (0.0, 0.0, 0.0), 0.0),
    ],
)
def test_curvature(surface: Surface, point: tuple[float, ...], expected: float) -> None:
    assert curvature(surface, np.array(point)) == pytest.approx(expected, abs=1e-12)


def test_intersection_is_in_the_material_of_all_parts() -> None:
    top = RippledPlane(point=(0.0, 0.0, 0.5))
    wall = Intersection(parts=(Crucible(centre=(0.0, 0.0), radius=0.2), top))
    for x, z, gap in ((0.3, 0.4, -0.1), (0.3, 0.55, 0.05), (0.15, 0.4, 0.05)):
        assert locate(wall, np.array([x, 0.0, z])).gap == pytest.approx(gap)


VARIED = SurfaceFriction(
    coefficient=0.9, ripple=0.2, wavelength=0.7, jump=-0.5, jump_at=0.3, jump_width=0.05
)


@pytest.mark.parametrize(
    ("x", "value"), [(0.0, 0.8), (0.25, 1.1), (0.5, 0.8), (0.75, 0.5), (1.25, 0.5)]
)
def test_ripple(x: float, value: float) -> None:
    friction = SurfaceFriction(coefficient=0.8, ripple=0.3)
    if x == 1.25:
        friction = dataclasses.replace(friction, wavelength=5 / 3)
    assert friction.at(np.array([x, 9.0])) == pytest.approx(value, abs=1e-15)


def test_jump() -> None:
    friction = SurfaceFriction(coefficient=1.0, jump=-0.4, jump_at=2.0, jump_width=0.1)
    values = [friction.at(np.array([x, 0.0])) for x in (-5.0, 1.8, 2.0, 2.2, 9.0)]
    done = 0.5 * (1 - math.tanh(2))  # of the jump, two widths before its middle
    expected = [1.0, 1 - 0.4 * done, 0.8, 0.6 + 0.4 * done, 0.6]
    np.testing.assert_allclose(values, expected, atol=1e-15)
    assert values[1] - values[3] == pytest.approx(0.96 * 0.4, abs=2e-3)


@given(x=st.floats(-1, 1), d=st.sampled_from([2, 3]))
def test_gradient(x: float, d: int) -> None:
    p, across = np.full(d, x), np.eye(d)
    differences = [
        (VARIED.at(p + 1e-6 * axis) - VARIED.at(p - 1e-6 * axis)) / 2e-6 for axis in across
    ]
    np.testing.assert_allclose(VARIED.gradient(p), differences, atol=1e-7)


def test_the_wall_ahead_is_where_the_way_meets_the_circle() -> None:
    p, way = np.array([1.3, -0.6]), np.array([0.8, -0.6])
    distance = Crucible().ahead(p, way)
    assert distance > 0
    assert np.linalg.norm(p + distance * way - Crucible().centre) == pytest.approx(0.75)


def test_between_and_beyond_the_masses_tested() -> None:
    assert impact_speed_limit(0.085) == pytest.approx(0.63, rel=1e-12)
    assert impact_speed_limit(0.0565) == pytest.approx((0.99 + 0.63) / 2)
    assert impact_speed_limit(0.1125) == pytest.approx((0.63 + 0.44) / 2)
    assert impact_speed_limit(0.020) == pytest.approx(0.99)
    assert impact_speed_limit(1e-9) == 0.99
    assert impact_speed_limit(1e9) == 0.44


NOWHERE = ", so that friction is nowhere negative"


@pytest.mark.parametrize(
    ("make", "changes", "allowed"),
    [
        *(
            (lambda **changes: dataclasses.replace(WAVY, **changes), changes, allowed)
            for changes, allowed in (
                ({"normal": (0.0, 0.0, 2.0)}, "a vector of length 1"),
                ({"along": (0.0, 0.0, 0.0)}, "a vector of length 1"),
                ({"along": (0.0, 0.6, 0.8)}, "at right angles to (0.0, 0.0, 1.0)"),
            )
        ),
        (Extruded, {"curve": Sphere()}, "a surface in the plane"),
        (Union, {"parts": (Sphere(), Circle())}, "at least one surface, all in as many axes"),
        (
            lambda surface: Placed(surface=surface, point=(0.0, 0.0, 0.0), axes=_CYCLE),
            {"surface": Circle()},
            "a surface in space",
        ),
        (
            lambda axes: Placed(surface=Sphere(), point=(0.0, 0.0, 0.0), axes=axes),
            {"axes": ((1.0, 0.0, 0.0),) * 3},
            "3 rows of 3, orthonormal",
        ),
        (
            lambda p: nearest(Circle(), np.array(p)),
            {"p": [0.0, -1.0]},
            "a point nearer to the surface than its radius of curvature",
        ),
        (
            lambda point: Crucible().ahead(np.array(point), np.array([0.0, 1.0])),
            {"point": [0.0, 2.0]},
            "inside of the circle of 0.75 m about (1.0, -0.75)",
        ),
        (  # as near as can be along one direction only
            lambda p: nearest(Parabola(coefficients=(0.1, 1.0)), np.array(p)),
            {"p": [0.05, 0.0, 1.0]},
            "a point nearer to the surface than its radius of curvature",
        ),
        (lambda p: nearest(Circle(), np.array(p)), {"p": [0.0, math.nan]}, "finite numbers"),
        (
            lambda p: normal(Circle(), np.array(p)),
            {"p": [0.0, -1.0]},
            "a point where the surface has a normal",
        ),
        (impact_speed_limit, {"mass": 0.0}, "a finite number > 0"),
        *(
            (SurfaceFriction, changes, allowed)
            for changes, allowed in (
                (
                    {"coefficient": 0.15, "ripple": 0.2, "jump": 0.5},  # which takes nothing
                    f"a finite number >= 0.2{NOWHERE}",
                ),
                (
                    {"coefficient": 0.6, "ripple": 0.2, "jump": -0.5},
                    f"a finite number >= 0.7{NOWHERE}",
                ),
            )
        ),
    ],
)
def test_refusals(make: Callable[..., object], changes: dict[str, Any], allowed: str) -> None:
    name, value = next(iter(changes.items()))
    with pytest.raises(ParameterError) as caught:
        make(**changes)
    assert str(caught.value) == str(ParameterError(name, value, allowed))
