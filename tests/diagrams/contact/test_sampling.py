"""Steps, updates and periods."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.diagrams.contact.hybrid_scenario import require_periods, require_steps, updates_of
from chamfer.models.validation import ParameterError


@given(st.integers(1, 5000))
def test_updates_fill_the_period_and_last_a_millisecond_at_most(count: int) -> None:
    step = 0.005 / count
    require_steps(step, 0.005)
    held, window = updates_of(step, 0.005)
    assert held * window == count
    assert held == 1 or held * step <= 1e-3 + step / 2
    longer = (n for n in range(held + 1, count + 1) if count % n == 0)
    assert all(n * step > 1e-3 - step / 2 for n in longer)


@pytest.mark.parametrize("step", [0.003, 0.01, 0.9e-6])
def test_other_steps_are_named(step: float) -> None:
    with pytest.raises(ParameterError, match=rf"^step is {step}, allowed: a whole part of the"):
        require_steps(step, 0.005)


@pytest.mark.parametrize("duration", [0.04, 6000.0])
def test_runs_of_too_few_or_many_periods_are_named(duration: float) -> None:
    with pytest.raises(ParameterError, match=rf"^duration is {duration}, allowed: 10 to 1000000"):
        require_periods(duration, 0.005)
