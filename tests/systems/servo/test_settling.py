import math
from collections.abc import Iterator
from dataclasses import replace

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray
from pydrake.systems.primitives import LinearSystem

from chamfer.models.validation import ParameterError
from chamfer.systems.servo.compensator_law import AxisParams, OpenAxisParams
from chamfer.systems.servo.settling import (
    SettlingPlant,
    allowed_axis,
    allowed_increment,
    approach_time,
    designed_axis,
    guarantee,
    sample_plant,
)

PERIOD = 1 / 80


def second_order(frequency: float, damping_ratio: float, gain: float) -> LinearSystem:
    return LinearSystem(
        A=np.array([[0.0, 1.0], [-(frequency**2), -2 * damping_ratio * frequency]]),
        B=np.array([[0.0], [gain * frequency**2]]),
        C=np.array([[1.0, 0.0]]),
        D=np.zeros((1, 1)),
    )


def first_order(pole: float, gain: float = 1.0) -> LinearSystem:
    """A plant whose discrete pole at PERIOD is ``pole``."""
    rate = -math.log(pole) / PERIOD
    return LinearSystem(
        A=np.array([[-rate]]), B=np.array([[gain * rate]]), C=np.ones((1, 1)), D=np.zeros((1, 1))
    )


def actions_and_errors(
    plant: SettlingPlant,
    axis: AxisParams,
    initial: float,
    measure: Iterator[float],
    ticks: int,
    *,
    play: float = 0.0,
    engaged: float = 0.0,
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """The closed loop by convolution with the step response, the law written out again.

    A play of this half width is before the plant, entered at ``engaged`` of it.
    """
    response = plant.gain * (1.0 - plant.undelivered)
    actions, errors = np.zeros(ticks), np.zeros(ticks)
    output = np.zeros(ticks + 1)
    total, driven = 0.0, engaged * play
    for k in range(ticks):
        errors[k] = initial - output[k]
        seen = errors[k] + next(measure)
        size = abs(seen)
        step = 0.0
        if size >= axis.large_error:
            step = axis.increment
        elif size >= axis.dead_zone:
            step = axis.increment / axis.divider
        actions[k] = math.copysign(step, seen) if step else 0.0
        if step:
            arrived = min(len(response), ticks - k)
            total += actions[k]
            before, driven = driven, min(max(driven, total - play), total + play)
            output[k + 1 : k + 1 + arrived] += (driven - before) * response[:arrived]
            output[k + 1 + arrived :] += (driven - before) * plant.gain
    return actions, errors


@settings(max_examples=25, deadline=None)
@given(
    frequency=st.floats(5.0, 100.0),
    damping_ratio=st.floats(0.1, 2.0),
    gain=st.floats(0.01, 50.0),
    delay=st.integers(0, 4),
    noise=st.floats(0.0, 0.6),
    divider=st.floats(1.0, 12.0),
    initial=st.floats(-10.0, 10.0),
    width=st.just(0.0) | st.floats(0.0, 5.0),
    engaged=st.floats(-1.0, 1.0),
    seed=st.integers(0, 2**32 - 1),
)
def test_inside_the_bound_no_action_reverses_and_the_error_rests_in_the_dead_zone(
    frequency: float,
    damping_ratio: float,
    gain: float,
    delay: int,
    noise: float,
    divider: float,
    initial: float,
    width: float,
    engaged: float,
    seed: int,
) -> None:
    """A play before the plant takes time only."""
    plant = sample_plant(second_order(frequency, damping_ratio, gain), PERIOD, delay_samples=delay)
    error = 0.01 * noise
    axis = allowed_axis(plant, dead_zone=0.01, measurement_error=error, divider=divider)
    said = guarantee(axis, plant, error)
    assert said.small_band
    assert said.everywhere
    start, play = initial * axis.large_error, width * axis.large_error / gain
    generator = np.random.default_rng(seed)
    # The measurement error is anything within its bound: here the two extremes, at random.
    measure = iter(lambda: error * generator.choice([-1.0, 1.0]), None)
    ticks = 60 + 3 * len(plant.undelivered)
    ticks += 2 * math.ceil((abs(start) + 2 * gain * play) / (gain * axis.small_increment))
    actions, errors = actions_and_errors(
        plant, axis, start, measure, ticks, play=play, engaged=engaged
    )
    assert np.all(actions * math.copysign(1.0, start) >= 0)
    rest = errors[-len(plant.undelivered) // 2 :]
    assert not np.any(actions[-len(rest) :])
    assert np.all(np.abs(rest) < axis.dead_zone + error)
    if not play:
        beyond = np.max(np.copysign(1.0, start) * (errors[-1] - errors))
        assert beyond <= 0.25 * axis.dead_zone * (1 + 1e-9)


@pytest.mark.parametrize("pole", [0.5, 0.8, 0.9, 0.95])
@pytest.mark.parametrize("delay", [0, 2])
def test_first_order_bound_is_the_closed_form(pole: float, delay: int) -> None:
    # theory: g n_s (d + 1/(1-a)) <= 2 eps, where s_1 = 1 - a already at the first sample
    plant = sample_plant(first_order(pole), PERIOD, delay_samples=delay)
    assert 1 + plant.total == pytest.approx(delay + 1 / (1 - pole), rel=1e-9)


@pytest.mark.parametrize("pole", [0.5, 0.8, 0.9, 0.95])
def test_a_first_order_plant_reverses_just_beyond_the_bound(pole: float) -> None:
    plant = sample_plant(first_order(pole), PERIOD)
    bound = 2 * 0.01 / (1 + plant.total)

    def reverses(share: float) -> bool:
        axis = AxisParams(dead_zone=0.01, large_error=1e3, increment=share * bound, divider=1.0)
        starts = np.random.default_rng(1).uniform(0.5, 1.0, 40)
        quiet = iter(lambda: 0.0, None)
        return any(
            bool(np.any(actions_and_errors(plant, axis, start, quiet, 1500)[0] < 0))
            for start in starts.tolist()
        )

    assert not reverses(1.0)
    first = next(share for share in np.arange(1.02, 2.0, 0.02).tolist() if reverses(share))
    assert first <= 1.15


def test_more_delay_than_is_said_breaks_the_condition_on_small_errors() -> None:
    plant = second_order(18.0, 0.7, 1.0)
    prompt = sample_plant(plant, PERIOD)
    bound = 2 * (0.01 - 0.0025) / (1 + prompt.total)
    for share, more in ((0.5, int(1 + prompt.total)), (0.999, 0), (1.001, -1)):
        axis = AxisParams(dead_zone=0.01, large_error=1.0, increment=share * bound, divider=1.0)
        assert guarantee(axis, prompt, 0.0025).small_share == pytest.approx(share)
        said = guarantee(axis, prompt, 0.0025).more_delay
        assert said == more
        for delay, holds in ((said, more >= 0), (said + 1, False)):
            late = sample_plant(plant, PERIOD, delay_samples=max(delay, 0))
            assert guarantee(axis, late, 0.0025).small_band is holds


def test_a_large_error_that_is_too_small_is_not_guaranteed() -> None:
    plant = sample_plant(second_order(18.0, 0.7, 1.0), PERIOD)
    axis = allowed_axis(plant, dead_zone=0.01, measurement_error=0.0025)
    assert guarantee(axis, plant, 0.0025).everywhere
    smaller = replace(axis, large_error=0.5 * axis.large_error)
    assert not guarantee(smaller, plant, 0.0025).everywhere


def test_approach_time_is_close_to_the_simulated_one() -> None:
    plant = sample_plant(second_order(18.0, 0.7, 1.0), PERIOD)
    axis = allowed_axis(plant, dead_zone=0.01, measurement_error=0.0)
    actions, _ = actions_and_errors(plant, axis, 2.0, iter(lambda: 0.0, None), 1000)
    last = float(np.flatnonzero(actions)[-1]) * PERIOD
    assert last <= approach_time(axis, plant, 2.0, PERIOD) <= 1.15 * last


@pytest.mark.parametrize(
    ("plant", "message"),
    [
        (second_order(10.0, -0.1, 1.0), "slowest pole is 1.0"),
        (
            LinearSystem(
                A=np.array([[0.0, 1.0], [-100.0, -10.0]]),
                B=np.array([[0.0], [1.0]]),
                C=np.array([[0.0, 1.0]]),
                D=np.zeros((1, 1)),
            ),
            "DC gain is 0.0, allowed: a finite number > 0",
        ),
        (
            LinearSystem(A=-np.eye(1), B=np.eye(1), C=np.eye(1), D=np.eye(1)),
            r"feed-through is \[\[1\.0\]\], allowed: zero",
        ),
        (second_order(1e-7, 0.7, 1.0), "period is 0.0125, allowed: at least"),
    ],
)
def test_plants_that_the_theorem_does_not_cover(plant: LinearSystem, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        sample_plant(plant, PERIOD)


plants = st.lists(
    st.builds(
        lambda frequency, damping, gain: sample_plant(
            second_order(frequency, damping, gain), PERIOD, delay_samples=2
        ),
        st.floats(5.0, 60.0),
        st.floats(0.1, 2.0),
        st.floats(0.01, 100.0),
    ),
    min_size=1,
    max_size=3,
)


@settings(max_examples=40, deadline=None)
@given(
    plants=plants,
    increment=st.floats(1e-4, 1e-2),
    nu=st.just(0.0) | st.floats(0.0, 0.5),
    divider=st.sampled_from([1.0, 5.0]),
)
def test_what_is_designed_settles_on_every_plant_and_is_no_larger_than_it_needs(
    plants: list[SettlingPlant], increment: float, nu: float, divider: float
) -> None:
    open_ = OpenAxisParams(divider=divider)
    axis = designed_axis(open_, plants, increment=increment, measurement_error=nu, limit=3.0)
    assert (axis.increment, axis.divider, axis.limit) == (increment, divider, 3.0)
    for plant in plants:
        assert guarantee(axis, plant, nu).everywhere
    allowed = min(
        allowed_increment(plant, dead_zone=axis.dead_zone, measurement_error=nu, divider=divider)
        for plant in plants
    )
    assert allowed >= increment * (1 - 1e-9)
    if nu == 0:
        assert allowed == pytest.approx(increment, rel=0.011)  # three digits, rounded up
    # With its dead zone alone the same follows again.
    again = designed_axis(
        OpenAxisParams(dead_zone=axis.dead_zone, divider=divider),
        plants,
        increment=increment,
        measurement_error=nu,
        limit=3.0,
    )
    assert again == axis


def test_what_is_designed_has_three_digits_rounded_to_the_careful_side() -> None:
    plant = SettlingPlant(1.0, np.array([1.0, 1.0, 1 / 3, 1 / 7]))
    axis = designed_axis(
        OpenAxisParams(), [plant], increment=0.1, measurement_error=0.01, limit=1.0
    )
    exact = 0.01 + 0.02 * (1 + plant.total) / (2 * 0.9)
    assert axis.dead_zone == float(f"{axis.dead_zone:.3g}")
    assert exact < axis.dead_zone < 1.01 * exact
    tight = designed_axis(
        OpenAxisParams(dead_zone=0.0333),
        [plant],
        increment=0.1,
        measurement_error=0.01,
        limit=1.0,
    )
    bound = 5 * 0.9 * 2 * 0.0233 / (1 + plant.total)
    assert tight.increment == float(f"{tight.increment:.3g}")
    assert 0.99 * bound < tight.increment < bound


def test_what_is_left_open_is_refused_where_it_is_used() -> None:
    with pytest.raises(ParameterError, match="dead_zone is None"):
        OpenAxisParams(large_error=1.0, increment=0.1, limit=1.0).closed  # noqa: B018


@pytest.mark.parametrize("dead_time", [0.0, 0.4 * PERIOD, PERIOD, 2.7 * PERIOD])
def test_a_dead_time_moves_the_step_response(dead_time: float) -> None:
    found = sample_plant(
        second_order(20.0, 0.6, 2.0), PERIOD, dead_time=dead_time, delay_samples=1
    )
    times = PERIOD * np.arange(0, 40)
    shifted = times - PERIOD - dead_time
    fine = np.linspace(0.0, float(times[-1]), 20_001)
    answer = control.step_response(control.tf([400.0], [1, 24.0, 400.0]), fine).outputs
    expected = np.interp(shifted, fine, answer, left=0.0)
    assert found.gain == pytest.approx(2.0)
    assert 1 - found.undelivered[:39] == pytest.approx(expected[1:], abs=1e-5)
