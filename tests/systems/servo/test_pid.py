import math
from collections.abc import Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import LinearSystem
from scipy.signal import lfilter

from chamfer.systems.servo.pid_law import OpenPidGains, PidGains, SampledPidParams
from chamfer.systems.servo.sampled_pid import SampledPid, designed_gains, tuned_gains
from chamfer.systems.servo.settling import SettlingPlant, sample_plant

PERIOD = 1 / 80
NAN = math.nan

numbers = st.floats(-5.0, 5.0)
gains = st.floats(0.0, 10.0)


def answer(
    axes: Sequence[PidGains],
    errors: Sequence[Sequence[float]],
    valid: Sequence[float] | None = None,
    period: float = PERIOD,
) -> np.ndarray:
    """What the block puts out after every one of its ticks, shape (ticks, axes)."""
    block = SampledPid(SampledPidParams(axes=tuple(axes), period=period))
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    found = []
    for k, error in enumerate(errors):
        block.GetInputPort("error").FixValue(context, error)
        if valid is not None:
            block.GetInputPort("valid").FixValue(context, [valid[k]])
        simulator.AdvanceTo((k + 0.5) * period)
        found.append(np.array(block.GetOutputPort("compensation").Eval(context)))
    return np.array(found)


def single(gain: PidGains, errors: Sequence[float], **more: Sequence[float]) -> np.ndarray:
    return answer([gain], [[error] for error in errors], **more)[:, 0]  # type: ignore[arg-type]


def difference_equation(gain: PidGains, errors: Sequence[float], period: float) -> np.ndarray:
    """C(z) = P + I T z/(z - 1) + D (z - 1)/(T z); there is no difference at the first sample."""
    integral, derivative = gain.integral * period, gain.derivative / period
    numerator = [gain.proportional + integral + derivative, -gain.proportional - 2 * derivative]
    filtered = lfilter([*numerator, derivative], [1.0, -1.0], errors)
    filtered[0] -= derivative * errors[0]
    return np.asarray(filtered)


@settings(max_examples=30, deadline=None)
@given(
    gain=st.builds(PidGains, proportional=gains, integral=gains, derivative=gains),
    errors=st.lists(numbers, min_size=1, max_size=20),
    period=st.sampled_from([PERIOD, 0.1, 1.0]),
)
def test_is_the_difference_equation(gain: PidGains, errors: list[float], period: float) -> None:
    found = answer([gain], [[error] for error in errors], period=period)[:, 0]
    expected = difference_equation(gain, errors, period)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-8)


def test_every_axis_has_gains_of_its_own() -> None:
    axes = [
        PidGains(proportional=1.0, integral=0.0),
        PidGains(proportional=0.0, integral=80.0),
        PidGains(proportional=0.0, integral=0.0, derivative=PERIOD),
    ]
    found = answer(axes, [[1.0, 2.0, 3.0], [4.0, 5.0, 7.0]])
    np.testing.assert_allclose(found, [[1.0, 2.0, 0.0], [4.0, 7.0, 4.0]], rtol=1e-12)


def test_acts_at_its_ticks_only_and_at_the_first_at_once() -> None:
    block = SampledPid(SampledPidParams(axes=(PidGains(proportional=1.0, integral=0.0),)))
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    output = block.GetOutputPort("compensation")
    block.GetInputPort("error").FixValue(context, [1.0])
    assert output.Eval(context)[0] == 0.0
    simulator.AdvanceTo(0.5 * PERIOD)
    assert output.Eval(context)[0] == 1.0
    block.GetInputPort("error").FixValue(context, [2.0])
    simulator.AdvanceTo(0.9 * PERIOD)
    assert output.Eval(context)[0] == 1.0
    simulator.AdvanceTo(1.1 * PERIOD)
    assert output.Eval(context)[0] == 2.0
    assert not block.HasAnyDirectFeedthrough()


ALL = PidGains(proportional=2.0, integral=8.0, derivative=0.25)


@settings(max_examples=30, deadline=None)
@given(
    before=st.lists(numbers, min_size=1, max_size=4),
    gap=st.lists(st.sampled_from([1e3, NAN, math.inf, -math.inf]), min_size=1, max_size=4),
    after=st.lists(numbers, min_size=1, max_size=4),
)
def test_holds_over_a_gap_and_goes_on_without_a_kick(
    before: list[float], gap: list[float], after: list[float]
) -> None:
    valid = [1.0] * len(before) + [0.0] * len(gap) + [1.0] * len(after)
    found = single(ALL, before + gap + after, valid=valid)
    n, m = len(before), len(before) + len(gap)
    assert (found[n:m] == found[n - 1]).all()
    # As if the law had started anew with the integral part that it had.
    earned = ALL.integral * PERIOD * sum(before)
    expected = earned + difference_equation(ALL, after, PERIOD)
    np.testing.assert_allclose(found[m:], expected, rtol=1e-9, atol=1e-8)


@settings(max_examples=30, deadline=None)
@given(
    gain=st.builds(
        PidGains, proportional=gains, integral=gains, derivative=gains, limit=st.just(1.0)
    ),
    errors=st.lists(numbers, min_size=1, max_size=12),
    last=st.floats(0.01, 5.0),
)
def test_keeps_the_limit_and_leaves_it_at_once(
    gain: PidGains, errors: list[float], last: float
) -> None:
    # However long an error lasted: when it has turned, the total is inside again, by its part.
    for sign in (1.0, -1.0):
        held = [sign * max(abs(error), 0.01) for error in errors]
        found = single(gain, [*held, -sign * last])
        assert (np.abs(found) <= 1.0).all()
        back = (gain.proportional + gain.integral * PERIOD) * last
        assert sign * found[-1] <= 1.0 - min(back, 2.0) + 1e-9


def test_the_integral_part_does_not_grow_beyond_the_limit() -> None:
    gain = PidGains(proportional=1.0, integral=80.0, limit=10.0)
    found = single(gain, [3.0] * 9 + [-1.0] * 3)
    # The third sample would make 9 + 3 > 10: it is not added. Then 6 - 1 - 1, and one less a time.
    np.testing.assert_allclose(found, [6.0, 9.0, *[9.0] * 7, 4.0, 3.0, 2.0], rtol=1e-12)


def test_a_falling_error_does_not_wind_it_up_behind_the_derivative() -> None:
    gain = PidGains(proportional=0.0, integral=80.0, derivative=20 * PERIOD, limit=10.0)
    found = single(gain, [9.0, 8.0, 8.0, -1.0, -1.0])
    # At the second sample 9 + 8 - 20 is inside the limits; 17 alone is not.
    np.testing.assert_allclose(found, [9.0, -10.0, 10.0, -10.0, 9.0], rtol=1e-12)


def lag_behind_dead_time(gain: float, tau: float, samples: int) -> SettlingPlant:
    plant = LinearSystem([[-1 / tau]], [[gain / tau]], [[1.0]], [[0.0]])
    return sample_plant(plant, PERIOD, delay_samples=samples)


@pytest.mark.parametrize("samples", [0, 2, 5])
@pytest.mark.parametrize("tau", [0.04, 0.125, 0.5, 2.0])
@pytest.mark.parametrize("closed_loop", [0.05, 0.3])
def test_tuning_is_simc_for_a_lag_behind_a_dead_time(
    samples: int, tau: float, closed_loop: float
) -> None:
    gain, theta = 2000.0, (samples + 0.5) * PERIOD  # half a period of the hold
    found = tuned_gains(
        lag_behind_dead_time(gain, tau, samples), closed_loop=closed_loop, period=PERIOD
    )
    proportional = tau / (gain * (closed_loop + theta))
    integral_time = min(tau, 4 * (closed_loop + theta))
    # The response is taken for straight between samples: 1.5 % at three samples a time constant.
    assert found.proportional == pytest.approx(proportional, rel=0.02 if tau < 0.1 else 0.002)
    assert found.integral == pytest.approx(proportional / integral_time, rel=0.01)
    assert found.derivative == 0.0


def test_what_is_left_open_is_that_of_the_most_careful_plant() -> None:
    plants = [lag_behind_dead_time(gain, tau, 2) for gain, tau in ((1.0, 0.1), (3.0, 0.5))]
    tuned = [tuned_gains(plant, closed_loop=0.3, period=PERIOD) for plant in plants]
    least = min(one.proportional for one in tuned), min(one.integral for one in tuned)
    slow = 2.0 * min(one.integral / one.proportional for one in tuned)
    for open_gains, expected in (
        ({"derivative": 0.5}, (*least, 0.5, 9.0)),
        ({"integral": 7.0, "limit": 1.0}, (least[0], 7.0, 0.0, 1.0)),
        ({"proportional": 2.0}, (2.0, slow, 0.0, 9.0)),
    ):
        found = designed_gains(
            OpenPidGains(**open_gains), plants, closed_loop=0.3, period=PERIOD, limit=9.0
        )
        values = (found.proportional, found.integral, found.derivative, found.limit)
        assert values == pytest.approx(expected, rel=5e-3)
