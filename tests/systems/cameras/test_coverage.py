"""Areas of polygons in pixels against polygons clipped to the pixels."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from chamfer.systems.cameras.coverage import coverage, intersection, paint

seeds = st.integers(0, 2**32 - 1)


def convex(generator: np.random.Generator, low: float, high: float) -> np.ndarray:
    points = generator.uniform(low, high, (10, 2))
    polygon = points[ConvexHull(points).vertices]
    return polygon[::-1].copy() if generator.random() < 0.5 else polygon


def area(polygon: np.ndarray) -> float:
    u, v = polygon[:, 0], polygon[:, 1]
    return abs(float(np.sum(u * np.roll(v, -1) - v * np.roll(u, -1)))) / 2


def pixel(u: int, v: int) -> np.ndarray:
    return np.array([[-0.5, -0.5], [0.5, -0.5], [0.5, 0.5], [-0.5, 0.5]]) + np.array([u, v])


@settings(deadline=None)
@given(seed=seeds)
def test_each_pixel_is_covered_by_the_polygon_clipped_to_it(seed: int) -> None:
    generator = np.random.default_rng(seed)
    # Corners also on pixel boundaries, edges along them, and most of it out of sight.
    polygon = convex(generator, -8.0, 18.0)
    if generator.random() < 0.3:
        left, top, right, bottom = np.sort(generator.integers(-6, 28, (2, 2)) / 2, axis=0).ravel()
        right, bottom = right + 0.5, bottom + 0.5
        polygon = np.array([[left, top], [right, top], [right, bottom], [left, bottom]])
    result = coverage(polygon, 2, -1, 7, 9)
    assert result.shape == (9, 7)
    for row, column in np.ndindex(9, 7):
        clipped = intersection(pixel(column + 2, row - 1), polygon)
        expected = area(clipped) if len(clipped) else 0.0
        assert result[row, column] == pytest.approx(expected, abs=1e-9)


def test_intersection_by_hand_in_all_directions() -> None:
    square = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])
    for one in (square, square[::-1].copy()):
        for other in (square + 1.0, square[::-1] + 1.0):
            corners = intersection(one, other)
            assert sorted(map(tuple, corners.tolist())) == [(1, 1), (1, 2), (2, 1), (2, 2)]
    assert len(intersection(square, square + 3.0)) == 0
    np.testing.assert_array_equal(intersection(square, 10 * square - 5.0), square)


def test_paint_covers_or_adds() -> None:
    window = np.full((4, 6, 3), 100.0, np.float32)
    square = np.array([[0.5, 0.5], [3.5, 0.5], [3.5, 2.0], [0.5, 2.0]])
    paint(window, square, np.array([20.0, 0.0, 200.0]), True)
    np.testing.assert_allclose(window[1, 1:4], [[20, 0, 200]] * 3)
    np.testing.assert_allclose(window[2, 1:4], [[60, 50, 150]] * 3)
    paint(window, square, np.array([-20.0, 10.0, 0.0]), False)
    np.testing.assert_allclose(window[1, 1:4], [[0, 10, 200]] * 3)
    np.testing.assert_allclose(window[2, 1:4], [[50, 55, 150]] * 3)
    window[1:3, 1:4] = 100
    np.testing.assert_array_equal(window, 100)


def test_edge_that_is_nearly_along_the_rows_is_exact() -> None:
    slope = 1e-3
    polygon = np.array([[-0.5, 2.0], [19.5, 2.0 + 20 * slope], [19.5, 9.5], [-0.5, 9.5]])
    column = coverage(polygon, 0, 0, 20, 10).sum(axis=0)
    np.testing.assert_allclose(column, 7.5 - slope * (np.arange(20) + 0.5), atol=1e-12)
    assert math.isclose(column.sum(), area(polygon), rel_tol=1e-12)


@pytest.mark.parametrize("shift", [(-50.0, 0.0), (50.0, 0.0), (0.0, -50.0), (0.0, 50.0)])
def test_paint_out_of_the_window_does_nothing(shift: tuple[float, float]) -> None:
    window = np.zeros((4, 6, 3), np.float32)
    polygon = np.array([[0.5, 0.5], [3.5, 0.5], [3.5, 2.0]]) + shift
    paint(window, polygon, np.ones(3), True)
    assert not window.any()
