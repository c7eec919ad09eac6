"""Trajectory primitives: what they cover, how fast, and when they end."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import cumulative_simpson

from chamfer.systems.primitives.dither_blocks import TrajectoryPrimitive
from chamfer.systems.primitives.primitive import STILL, Observation
from chamfer.systems.primitives.trajectory_primitives import (
    Axis,
    Dither,
    MoveDx,
    Spiral,
    lissajous,
)

SENSED = Observation(carriage=STILL, motion=STILL, wrench=STILL)


def velocity(primitive: Any, time: float) -> np.ndarray:
    return np.array(primitive.step(SENSED, None, time).velocity)


WAY = (0.1, -0.2, 0.3, 0.01, -0.02, 0.03)


@settings(deadline=None)
@given(
    rates=st.tuples(*[st.floats(-3, 3)] * 6),
    steps=st.integers(1, 400),
    period=st.sampled_from([0.001, 0.01, 1 / 80]),
)
def test_movedx_covers_its_way_when_it_is_sampled_and_held(
    rates: tuple[float, ...], steps: int, period: float
) -> None:
    displacement = tuple(0.99 * steps * period * rate for rate in rates)
    move = MoveDx(displacement=displacement, duration=steps * period)
    way = sum(velocity(move, i * period) for i in range(steps + 3)) * period
    np.testing.assert_allclose(way, displacement, atol=1e-12)
    assert move.step(SENSED, None, steps * period).event == "done"


def test_a_dither_is_centred_where_it_began() -> None:
    dither = Dither(amplitude=0.002, frequency=2.0, cycles=3.0)
    time = np.linspace(0.0, 1.5 - 1e-8, 6001)
    rates = [velocity(dither, t)[3] for t in time]
    displacement = cumulative_simpson(rates, x=time, initial=0)
    assert displacement.max() == pytest.approx(0.002, rel=1e-4)
    assert displacement.min() == pytest.approx(-0.002, rel=1e-4)
    assert displacement.mean() == pytest.approx(0.0, abs=1e-6)
    assert displacement[-1] == pytest.approx(0.0, abs=1e-8)


def test_a_dither_ends_after_its_cycles() -> None:
    dither = Dither(frequency=4.0, cycles=10.0)
    assert dither.duration == 2.5
    assert velocity(dither, 2.499)[3] != 0
    for time in (2.5, 2.5 - 1e-12, 100.0):
        assert dither.step(SENSED, None, time).event == "done"
        assert not velocity(dither, time).any()


FIRST = Dither(kind="linear", axis="x", amplitude=0.002, frequency=2.0, cycles=77.0)


@settings(deadline=None)
@given(repeats=st.integers(1, 64), axis=st.sampled_from(["y", "z"]))
def test_a_lissajous_pattern_closes_after_n_slow_cycles(repeats: int, axis: Axis) -> None:
    slow, fast = lissajous(first=FIRST, axis=axis, repeats=repeats)
    assert fast.frequency / slow.frequency == pytest.approx((repeats + 1) / repeats)
    assert (slow.cycles, fast.cycles) == (repeats, repeats + 1)
    assert slow.duration == pytest.approx(fast.duration)
    assert slow.duration == pytest.approx(repeats / 2.0)
    assert (slow.axis, fast.axis, fast.kind) == ("x", axis, "linear")
    assert (slow.amplitude, fast.amplitude) == (0.002, 0.002)


def test_the_block_gives_the_velocity_at_its_time() -> None:
    move, dither = MoveDx(displacement=WAY, duration=2.0), Dither(frequency=1.0)
    block = TrajectoryPrimitive(move, dither)
    assert block.num_input_ports() == 0
    context = block.CreateDefaultContext()
    for time in (0.0, 0.7, 3.0):  # the cache has to follow the time
        context.SetTime(time)
        np.testing.assert_array_equal(
            block.GetOutputPort("velocity").Eval(context),
            velocity(move, time) + velocity(dither, time),
        )


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
