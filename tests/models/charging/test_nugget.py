"""Nuggets as ellipsoids of silicon."""

import math

import numpy as np
import pytest

from chamfer.models.charging.nugget import SILICON, nugget_of
from chamfer.models.validation import ParameterError


def test_mass_is_that_of_solid_silicon() -> None:
    nugget = nugget_of(0.185)
    volume = 4 / 3 * math.pi * math.prod(nugget.semi_axes)
    assert volume * SILICON == pytest.approx(0.185, rel=1e-12)


def test_inertia_is_that_of_its_points() -> None:
    nugget = nugget_of(0.085)
    rng = np.random.default_rng(0)
    ball = rng.normal(size=(400_000, 3))
    ball *= (rng.random(400_000) ** (1 / 3) / np.linalg.norm(ball, axis=1))[:, np.newaxis]
    points = ball * nugget.semi_axes
    square = np.mean(points**2, axis=0)
    expected = nugget.mass * (square.sum() - square)
    assert np.diag(nugget.inertia) == pytest.approx(expected, rel=0.01)


def test_points_that_touch_lie_on_it() -> None:
    nugget = nugget_of(0.028, size=1.2)
    for point in (nugget.wall_point, nugget.layer_point, (0.0, 0.0, 0.0)):
        scaled = np.subtract(point, nugget.centre) / nugget.semi_axes
        assert np.linalg.norm(scaled) == pytest.approx(1.0, rel=1e-12)


def test_no_mass_is_refused() -> None:
    with pytest.raises(ParameterError, match="mass is 0"):
        nugget_of(0.0)
