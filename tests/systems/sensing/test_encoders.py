"""Encoders: counts, and velocities by difference and by a tracking filter."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from chamfer.models.validation import ParameterError
from chamfer.systems.sensing.encoders import EncoderParams, Encoders

PERIOD = 0.005


def read(params: EncoderParams, motion: Any, q: Any = (0.0, 0.0)) -> np.ndarray:
    block = Encoders(params, np.array(q), period=PERIOD)
    context = block.CreateDefaultContext()
    block.GetInputPort("motion").FixValue(context, motion)
    found: np.ndarray = block.GetOutputPort("encoders").Eval(context)
    return found


def follow(params: EncoderParams, speed: float, until: float) -> np.ndarray:
    """What is shown at each tick of a joint that moves at a constant speed from 0."""
    builder = DiagramBuilder()
    path = PiecewisePolynomial.FirstOrderHold(
        [0.0, until + 1], [[0.0, speed * (until + 1)], [speed, speed]]
    )
    motion = builder.AddSystem(TrajectorySource(path, 0, False))
    block = builder.AddSystem(Encoders(params, np.zeros(1), period=PERIOD))
    builder.Connect(motion.get_output_port(), block.GetInputPort("motion"))
    logger = LogVectorOutput(block.GetOutputPort("encoders"), builder, PERIOD)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(until)
    found: np.ndarray = logger.FindLog(simulator.get_context()).data().T.copy()
    return found


@given(q=st.lists(st.floats(-3, 3), min_size=2, max_size=2))
def test_positions_are_whole_counts(q: list[float]) -> None:
    found = read(EncoderParams(counts=(100.0, 0.0), velocity="exact", bandwidth=0.0), [*q, 5, -6])
    assert found[0] * 100 == pytest.approx(round(q[0] * 100), abs=1e-9)
    assert abs(found[0] - q[0]) <= 0.005 + 1e-12
    np.testing.assert_array_equal(found[1:], [q[1], 5, -6])


def test_a_differenced_velocity_is_the_mean_of_a_period() -> None:
    params = EncoderParams(counts=0.0, velocity="differenced", bandwidth=0.0)
    found = follow(params, 0.3, 0.1)
    # A row is of the tick at its time; the joint is taken to have been at rest before.
    np.testing.assert_allclose(found[:, 0], 0.3 * PERIOD * np.arange(len(found)), atol=1e-12)
    np.testing.assert_allclose(found[1:, 1], 0.3, atol=1e-9)


def test_differenced_counts_give_steps_of_a_count_by_the_period() -> None:
    params = EncoderParams(counts=7436.0, velocity="differenced", bandwidth=0.0)
    velocity = follow(params, 0.1, 1.0)[1:, 1]
    quantum = 1 / 7436 / PERIOD
    np.testing.assert_allclose(velocity / quantum, np.round(velocity / quantum), atol=1e-6)
    assert velocity.mean() == pytest.approx(0.1, rel=1e-2)
    assert np.ptp(velocity) == pytest.approx(quantum, rel=1e-6)


def test_the_low_pass_smooths_the_steps() -> None:
    rough, smooth = (
        follow(EncoderParams(counts=7436.0, velocity="differenced", bandwidth=one), 0.1, 1.0)
        for one in (0.0, 10.0)
    )
    assert smooth[100:, 1].std() < 0.5 * rough[100:, 1].std()
    assert smooth[100:, 1].mean() == pytest.approx(0.1, rel=1e-2)


def test_a_tracking_filter_has_its_poles_and_no_lag_in_velocity() -> None:
    params = EncoderParams(counts=0.0, velocity="tracked", bandwidth=20.0)
    error = 1 - follow(params, 1.0, 0.5)[:, 1]
    pole = math.exp(-2 * math.pi * 20 * PERIOD)
    # Both poles at p: (a + b k) p^k, from the second sample on.
    k = np.arange(1, 25)
    scaled = error[1:25] / pole**k
    np.testing.assert_allclose(np.diff(scaled, 2), 0.0, atol=1e-6)
    assert abs(error[-1]) < 1e-9


@pytest.mark.parametrize("velocity", ["differenced", "tracked"])
def test_it_starts_at_rest(velocity: Any) -> None:
    params = EncoderParams(counts=1000.0, velocity=velocity, bandwidth=20.0)
    found = read(params, [0.12345, -1.0, 0.0, 0.0], q=(0.12345, -1.0))
    np.testing.assert_allclose(found, [0.123, -1.0, 0.0, 0.0], atol=1e-12)


@pytest.mark.parametrize(
    ("given_", "message"),
    [
        ({"counts": -1.0}, "counts is -1.0, allowed: finite numbers >= 0"),
        ({"counts": (1.0, math.nan)}, "counts is (1.0, nan), allowed: finite numbers >= 0"),
        ({"velocity": "guessed"}, "velocity is 'guessed', allowed: exact, differenced, tracked"),
        ({"velocity": "exact", "bandwidth": 3.0}, "bandwidth is 3.0, allowed: 0 with an exact ve"),
        ({"velocity": "tracked", "bandwidth": 0.0}, "bandwidth is 0.0, allowed: more than 0 Hz"),
    ],
)
def test_parameters(given_: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        EncoderParams(**given_)
    assert str(caught.value).startswith(message)


def test_counts_are_for_each_joint() -> None:
    params = EncoderParams(counts=(1.0, 2.0, 3.0), velocity="exact", bandwidth=0.0)
    with pytest.raises(ParameterError, match=r"^counts is .*, allowed: 2 numbers, or one for all"):
        read(params, np.zeros(4))
    assert not params.exact
    assert EncoderParams(counts=0.0, velocity="exact", bandwidth=0.0).exact
