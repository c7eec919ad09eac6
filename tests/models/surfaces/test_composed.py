"""Composed surfaces, and what holds for every surface: its derivatives, gap and curvature."""

import math

import numpy as np
import pytest

from chamfer.models.surfaces.composed import Extruded, Intersection, Placed, Union
from chamfer.models.surfaces.graphs import Parabola, Paraboloid, Wave
from chamfer.models.surfaces.planes import RippledPlane
from chamfer.models.surfaces.rounds import Circle, Crucible, Sphere
from chamfer.models.surfaces.surface import Surface, curvature, locate, normal
from chamfer.models.validation import ParameterError

# Turned by 90 degrees about z and then about x: the old x, y, z are y, z, x in the world.
_CYCLE = ((0.0, 0.0, 1.0), (1.0, 0.0, 0.0), (0.0, 1.0, 0.0))
PLACED = Placed(surface=Paraboloid(coefficients=(0.3, -0.2)), point=(1.0, 2.0, 3.0), axes=_CYCLE)
SURFACES: list[Surface] = [
    Crucible(),
    RippledPlane(point=(0.1, -0.2, 0.3), tilt=0.2, ripple=1e-3, wavelength=0.05),
    Extruded(curve=Wave(amplitude=0.03, wavelength=0.9)),
    PLACED,
    Placed(surface=Extruded(curve=Circle()), point=(0.3, 0.2, 0.1), axes=_CYCLE),
    Union(parts=(Sphere(), Crucible(), PLACED)),
    Intersection(parts=(Sphere(), Crucible(), PLACED)),
]


@pytest.mark.parametrize("surface", SURFACES, ids=lambda one: type(one).__name__)
@pytest.mark.parametrize("seed", range(3))
def test_derivatives(surface: Surface, seed: int) -> None:
    p = np.random.default_rng(seed).uniform(-0.5, 0.5, 3)
    for function, derivative in (
        (surface.level, surface.gradient),
        (surface.gradient, surface.hessian),
    ):
        differences = [
            (np.asarray(function(p + 1e-6 * e)) - np.asarray(function(p - 1e-6 * e))) / 2e-6
            for e in np.eye(3)
        ]
        np.testing.assert_allclose(derivative(p), differences, atol=1e-6)


def test_places_are_where_they_are_put() -> None:
    # The paraboloid's top is at the placed origin, and its old z is the world's x.
    np.testing.assert_allclose(normal(PLACED, np.array([1.0, 2.0, 3.0])), [1, 0, 0], atol=1e-15)
    assert PLACED.level(np.array([1.25, 2.0, 3.0])) == pytest.approx(0.25)
    assert PLACED.level(np.array([1.0 + 0.3 * 0.5**2, 2.5, 3.0])) == pytest.approx(0, abs=1e-15)
    wall = Extruded(curve=Parabola(coefficient=0.5))
    assert locate(wall, np.array([1.0, 0.5, 7.0])).gap == pytest.approx(0, abs=1e-15)
    np.testing.assert_allclose(
        locate(wall, np.array([1.0, 0.5, 7.0])).normal, [-math.sqrt(0.5), math.sqrt(0.5), 0]
    )


def test_union_is_in_the_material_of_any_part() -> None:
    floor = Extruded(curve=Parabola(coefficient=0.0))
    both = Union(parts=(floor, Sphere(centre=(0.0, 0.0, 0.0), radius=0.5)))
    for point, gap in (((0.0, 0.3, 0.0), -0.2), ((2.0, -0.1, 0.0), -0.1), ((0.0, 0.8, 0.0), 0.3)):
        assert locate(both, np.array(point)).gap == pytest.approx(gap)


@pytest.mark.parametrize(
    ("surface", "point", "expected"),
    [
        (Sphere(radius=0.5), (0.0, 0.0, -0.5), 2.0),
        (Crucible(), (1.0, -1.5, 0.2), 1 / 0.75),
        (Parabola(coefficient=0.05), (0.0, 0.0), 0.1),
        (Paraboloid(coefficients=(0.3, -0.4)), (0.0, 0.0, 0.0), 0.8),
        (RippledPlane(point=(0.0, 0.0, 0.0), tilt=0.3), (0.0, 0.0, 0.0), 0.0),
    ],
)
def test_curvature(surface: Surface, point: tuple[float, ...], expected: float) -> None:
    assert curvature(surface, np.array(point)) == pytest.approx(expected, abs=1e-12)


def test_refusals() -> None:
    with pytest.raises(ParameterError, match=r"^curve is .*a surface in the plane$"):
        Extruded(curve=Sphere())
    with pytest.raises(ParameterError, match=r"^surface is .*a surface in space$"):
        Placed(surface=Circle(), point=(0.0, 0.0, 0.0), axes=_CYCLE)
    with pytest.raises(ParameterError, match=r"^axes is .*orthonormal$"):
        Placed(surface=Sphere(), point=(0.0, 0.0, 0.0), axes=((1.0, 0.0, 0.0),) * 3)
    with pytest.raises(ParameterError, match=r"^parts is"):
        Union(parts=(Sphere(), Circle()))


def test_intersection_is_in_the_material_of_all_parts() -> None:
    top = RippledPlane(point=(0.0, 0.0, 0.5))
    wall = Intersection(parts=(Crucible(centre=(0.0, 0.0), radius=0.2), top))
    for x, z, gap in ((0.3, 0.4, -0.1), (0.3, 0.55, 0.05), (0.15, 0.4, 0.05)):
        assert locate(wall, np.array([x, 0.0, z])).gap == pytest.approx(gap)
