import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.analysis.servo.tracking_metrics import as_metrics, tracking_metrics
from chamfer.models.validation import ParameterError

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
    assert as_metrics("fsm", found, "m")["fsm.phase_lag"].unit == "deg"


def test_a_run_that_is_too_short_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"duration is 20\.0, allowed: more than 20\.\d+ s"):
        tracking_metrics(
            TIME, np.sin(TIME), np.sin(TIME), frequency=1.0, transient=1.0, steady=19.0
        )
