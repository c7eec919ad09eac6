import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.analysis.servo.response_metrics import step_metrics, tracking_metrics
from chamfer.models.validation import ParameterError


def second_order(time: np.ndarray, ratio: float, frequency: float) -> np.ndarray:
    damped = frequency * math.sqrt(1 - ratio**2)
    return 1 - np.exp(-ratio * frequency * time) * (
        np.cos(damped * time) + ratio * frequency / damped * np.sin(damped * time)
    )


def test_first_order_response() -> None:
    time = np.linspace(0, 20, 401)
    measured = step_metrics(time, 3 * (1 - np.exp(-time)), 3.0)
    assert measured.rise_time == pytest.approx(math.log(9), rel=2e-3)
    assert measured.settling_time == pytest.approx(math.log(50), rel=2e-3)
    assert measured.overshoot == pytest.approx(0, abs=1e-4)
    assert measured.steady_state_error == pytest.approx(0, abs=1e-6)


@given(ratio=st.floats(0.2, 0.9), height=st.floats(-5, 5).filter(lambda h: abs(h) > 0.1))
def test_overshoot_of_a_second_order_response(ratio: float, height: float) -> None:
    time = np.linspace(0, 60, 30_001)
    measured = step_metrics(time, height * second_order(time, ratio, 2.0), height)
    expected = 100 * math.exp(-math.pi * ratio / math.sqrt(1 - ratio**2))
    assert measured.overshoot == pytest.approx(expected, abs=0.01)


def test_crossings_are_interpolated() -> None:
    coarse = np.array([0.0, 1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0])
    ramp = np.minimum(coarse / 4, 1.0)
    measured = step_metrics(coarse, ramp, 1.0)
    assert measured.rise_time == pytest.approx(0.8 * 4)
    assert measured.settling_time == pytest.approx(0.98 * 4)


def test_overshoot_is_relative_to_the_final_value_and_the_error_to_the_reference() -> None:
    time = np.linspace(0, 10, 1001)
    response = np.where(time < 1, 0.6, 0.5)
    measured = step_metrics(time, response, 1.0)
    assert measured.overshoot == pytest.approx(20.0)
    assert measured.steady_state_error == pytest.approx(0.5)
    assert measured.error_max == pytest.approx(0.5)


def test_ripple_and_an_oscillation_that_does_not_settle() -> None:
    time = np.linspace(0, 100, 10_001)
    response = 1 + 0.1 * np.sin(2 * np.pi * time)
    measured = step_metrics(time, response, 1.0)
    assert measured.ripple == pytest.approx(20.0, rel=1e-3)
    assert measured.settling_time is None
    metrics = measured.as_metrics("loop", "m")
    assert metrics["loop.settling_time"].value is None
    assert metrics["loop.settling_time"].note
    assert metrics["loop.overshoot"].unit == "%"


def test_a_response_that_stays_at_zero_has_nothing_to_measure() -> None:
    time = np.linspace(0, 1, 11)
    measured = step_metrics(time, np.zeros(11), 1.0)
    assert (measured.rise_time, measured.overshoot, measured.ripple) == (None, None, None)
    assert measured.steady_state_error == 1.0


TIME = np.linspace(0, 20, 4001)


@given(
    ratio=st.floats(0.05, 3.0),
    lag=st.floats(-170.0, 170.0),
    offset=st.floats(-1.0, 1.0),
    frequency=st.floats(0.6, 5.0),
)
def test_amplitude_and_phase_of_a_sinusoid(
    ratio: float, lag: float, offset: float, frequency: float
) -> None:
    desired = 2 * np.sin(frequency * TIME)
    response = offset + 2 * ratio * np.sin(frequency * TIME - math.radians(lag))
    found = tracking_metrics(
        TIME, desired, response, frequency=frequency, transient=1.0, steady=5.0
    )
    assert found.amplitude_ratio == pytest.approx(ratio, rel=1e-6)
    assert found.phase_lag == pytest.approx(lag, abs=1e-6)


def test_errors_of_transient_and_steady_state_are_kept_apart() -> None:
    desired = np.sin(TIME)
    response = desired - np.where(TIME < 1.0, 0.5, np.where(TIME < 5.0, 9.0, 0.1))
    found = tracking_metrics(TIME, desired, response, frequency=1.0, transient=1.0, steady=5.0)
    assert found.transient_error_rms == pytest.approx(0.5)
    assert found.error_rms == pytest.approx(0.1)
    assert found.error_max == pytest.approx(0.1)
    assert found.as_metrics("fsm", "m")["fsm.phase_lag"].unit == "deg"


def test_a_run_that_is_too_short_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"duration is 20\.0, allowed: more than 20\.\d+ s"):
        tracking_metrics(
            TIME, np.sin(TIME), np.sin(TIME), frequency=1.0, transient=1.0, steady=19.0
        )
