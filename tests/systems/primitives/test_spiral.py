"""The search along a spiral."""

import math

import numpy as np
import pytest

from chamfer.models.validation import ParameterError
from chamfer.systems.primitives.primitive import STILL, Observation
from chamfer.systems.primitives.trajectory_primitives import Spiral

SENSED = Observation(carriage=STILL, motion=STILL, wrench=STILL)
PERIOD = 0.001  # s


def path_of(spiral: Spiral) -> np.ndarray:
    """Return the positions of whoever follows its velocity, m, shape (n, 2)."""
    steps = math.floor(spiral.duration / PERIOD)
    velocities = [spiral.step(SENSED, None, (i + 0.5) * PERIOD).velocity for i in range(steps)]
    assert all(velocity[:3] + velocity[5:] == (0.0,) * 4 for velocity in velocities)
    return np.cumsum(np.array(velocities)[:, 3:5], axis=0) * PERIOD


def test_it_goes_along_an_archimedean_spiral_at_its_speed() -> None:
    spiral = Spiral(speed=0.004, pitch=0.0006, radius=0.003)
    path = path_of(spiral)
    angle = np.unwrap(np.arctan2(path[:, 1], path[:, 0]))
    radius = np.hypot(*path.T)
    later = slice(200, None)
    expected = spiral.pitch * angle[later] / (2 * math.pi)
    np.testing.assert_allclose(radius[later], expected, atol=0.01 * spiral.pitch)
    speed = np.hypot(*np.diff(path, axis=0).T) / PERIOD
    np.testing.assert_allclose(speed, spiral.speed, rtol=0.01)


def test_it_ends_at_its_radius_and_says_so() -> None:
    spiral = Spiral(speed=0.01, pitch=0.001, radius=0.003)
    assert math.hypot(*path_of(spiral)[-1]) == pytest.approx(0.003, rel=0.01)
    # A disc is covered by its area over the pitch.
    assert spiral.duration * spiral.speed == pytest.approx(math.pi * 0.003**2 / 0.001, rel=0.02)
    assert spiral.step(SENSED, None, spiral.duration - 0.01).event is None
    done = spiral.step(SENSED, None, spiral.duration)
    assert (done.event, done.velocity) == ("done", STILL)
    assert spiral.events == {"done": spiral.duration}


def test_no_place_within_its_radius_is_further_off_than_half_its_pitch() -> None:
    spiral = Spiral(speed=0.01, pitch=0.0008, radius=0.003)
    path = path_of(spiral)
    for angle in np.linspace(0, 2 * math.pi, 17):
        for radius in np.linspace(0, spiral.radius - spiral.pitch, 9):
            place = radius * np.array([math.cos(angle), math.sin(angle)])
            nearest = np.hypot(*(path - place).T).min()
            assert nearest <= 0.51 * spiral.pitch


@pytest.mark.parametrize("name", ["speed", "pitch", "radius"])
def test_it_refuses(name: str) -> None:
    with pytest.raises(ParameterError, match=name):
        Spiral(**{name: 0.0})
