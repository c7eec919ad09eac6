import math
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.campaign.trial_metrics import (
    Quantity,
    bootstrap_interval,
    mean_interval,
    over_trials,
    rate,
    trial_seed,
)
from chamfer.analysis.scenario.experiment import Metric

QUANTITIES = {"angle": Quantity("deg", "rms"), "force": Quantity("N")}


def test_a_mean_and_a_root_of_the_mean_square() -> None:
    trials = [{"angle": 3.0, "force": 3.0}, {"angle": -4.0, "force": -4.0}]
    angle, force = over_trials(trials, QUANTITIES).values()
    assert (angle.value, angle.note) == (math.sqrt(12.5), "rms of 2 seeds, -4 to 3")
    assert (force.value, force.note) == (-0.5, "mean of 2 seeds, -4 to 3")
    assert angle.trials == force.trials == (3.0, -4.0)  # for limits, which each has to keep


def test_one_trial_has_no_spread_and_quantities_keep_their_order() -> None:
    found = over_trials([{"force": 5.0, "angle": -2.0, "more": 3.0}], QUANTITIES)
    assert list(found.items()) == [
        ("angle", Metric(value=2.0, unit="deg", note="")),
        ("force", Metric(value=5.0, unit="N", note="")),
    ]


def test_undefined_values_are_left_out_and_counted() -> None:
    trials = [{"angle": None, "force": one} for one in (None, 1.0, None, 2.0)]
    found = over_trials(trials, QUANTITIES)
    force, angle = found["force"], found["angle"]
    assert (force.value, force.note) == (1.5, "mean of 2 seeds, 1 to 2, undefined in 2")
    assert (angle.value, angle.note) == (None, "does not occur, or settle, in the run")
    assert (force.trials, angle.trials) == ((None, 1.0, None, 2.0), (None,) * 4)


def test_a_sum_of_many_loses_nothing() -> None:
    values = [1e16, 1.0, -1e16] * 100
    found = over_trials([{"force": one} for one in values], {"force": Quantity("N")})
    assert found["force"].value == pytest.approx(1 / 3, rel=1e-15)


@pytest.mark.parametrize(("pooled", "value"), [("least", 1.0), ("most", 4.0)])
def test_the_extreme_of_trials(pooled: Any, value: float) -> None:
    trials = [{"force": 2.0}, {"force": 1.0}, {"force": None}, {"force": 4.0}]
    assert over_trials(trials, {"force": Quantity("N", pooled)})["force"].value == value


def test_seeds_of_trials_do_not_meet() -> None:
    seeds = {trial_seed(seed, trial) for seed in range(4) for trial in range(1000)}
    assert len(seeds) == 4000
    assert trial_seed(0, 0) == 0


def test_a_rate_has_the_exact_interval_of_the_binomial() -> None:
    found = rate("success", 50, 50, "all")
    assert (found["success"].value, found["success"].note) == (100.0, "all")
    # For all of n the lower bound is (alpha / 2)^(1 / n), and for none the mirror image.
    assert found["success.low"].value == pytest.approx(100 * 0.025 ** (1 / 50))
    assert found["success.high"].value == 100.0
    assert rate("x", 0, 50, "")["x.high"].value == pytest.approx(100 - 100 * 0.025 ** (1 / 50))


def test_an_interval_of_the_mean_is_students() -> None:
    mean, half = mean_interval(np.array([1.0, 2.0, 3.0, 4.0]))
    assert mean == 2.5
    assert half == pytest.approx(3.1824463 * math.sqrt(5 / 3) / 2)
    assert math.isnan(mean_interval(np.array([1.0]))[1])


def test_a_bootstrap_interval_is_near_students_for_many_values() -> None:
    values = np.random.default_rng(3).gamma(9.0, 1.0, 400)
    mean, half = mean_interval(values)
    assert bootstrap_interval(values) == pytest.approx((mean - half, mean + half), rel=0.01)
    assert bootstrap_interval(values) == bootstrap_interval(values.copy())


def test_a_bootstrap_interval_of_sizes_is_not_negative() -> None:
    values = np.array([0.0, 0.001, 0.0, 0.03])
    mean, half = mean_interval(values)
    low, high = bootstrap_interval(values)
    assert mean - half < 0 <= low < mean < high <= 0.03


def test_a_bootstrap_interval_of_one_value_and_of_equal_ones() -> None:
    assert all(map(math.isnan, bootstrap_interval(np.array([1.0]))))
    assert bootstrap_interval(np.full(5, 0.25)) == (0.25, 0.25)
