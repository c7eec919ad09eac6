"""The blow against its integral, and what a sampled plant sees of it."""

import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.models.validation import ParameterError
from chamfer.systems.contact.impulse import Impulse


def force_at(block: Impulse, time: float) -> np.ndarray:
    context = block.CreateDefaultContext()
    context.SetTime(time)
    return block.GetOutputPort("force").Eval(context).copy()


def test_acts_for_its_duration() -> None:
    block = Impulse(np.array([0.3, 0.0, -0.6]), begin=2.0, duration=0.1)
    for time in (0.0, 1.94, 2.06, 3.0):
        np.testing.assert_array_equal(force_at(block, time), np.zeros(3))
    for time in (1.96, 2.0, 2.04):
        np.testing.assert_allclose(force_at(block, time), [3.0, 0, -6.0], rtol=1e-12)


def test_integral_over_time_is_the_impulse() -> None:
    block = Impulse(np.array([0.3, -0.7]), begin=0.5, duration=0.2)
    times = np.linspace(0.0, 1.0, 2000, endpoint=False) + 2.5e-4
    total = np.mean([force_at(block, time) for time in times], axis=0)
    np.testing.assert_allclose(total, [0.3, -0.7], rtol=1e-9)


@given(
    period=st.sampled_from([0.005, 0.0025, 1e-4, 1 / 80, 1 / 3]),
    sample=st.integers(2, 100_000),
    error=st.floats(-1e-9, 1e-9),
)
def test_a_sampled_plant_sees_it_exactly_once(period: float, sample: int, error: float) -> None:
    block = Impulse(np.array([2.0]), begin=sample * period + error, duration=period)
    around = [force_at(block, k * period)[0] for k in range(sample - 2, sample + 3)]
    np.testing.assert_allclose(np.array(around) * period, [0, 0, 2.0, 0, 0], rtol=1e-12)


def test_at_the_very_start() -> None:
    block = Impulse(np.array([1.0]), begin=0.0, duration=0.01)
    assert force_at(block, 0.0)[0] == pytest.approx(100.0)
    assert force_at(block, 0.01)[0] == 0.0


def test_ports() -> None:
    block = Impulse(np.ones(4), begin=1.0, duration=1.0)
    assert (block.num_input_ports(), block.num_output_ports()) == (0, 1)
    assert block.GetOutputPort("force").size() == 4
    assert not block.HasAnyDirectFeedthrough()


def test_follows_the_time_of_one_context() -> None:
    block = Impulse(np.array([1.0]), begin=1.0, duration=0.5)
    context = block.CreateDefaultContext()
    found = []
    for time in (0.0, 1.0, 2.0):
        context.SetTime(time)
        found.append(block.GetOutputPort("force").Eval(context)[0])
    assert found == [0.0, 2.0, 0.0]


@pytest.mark.parametrize("duration", [0.0, -1.0, math.nan, math.inf])
def test_duration_has_to_be_positive(duration: float) -> None:
    message = re.escape(f"duration is {duration}, allowed: a finite number > 0")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        Impulse(np.ones(3), begin=0.0, duration=duration)
