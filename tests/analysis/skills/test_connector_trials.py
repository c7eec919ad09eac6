import math
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from analysis.run.campaign import Trials
from analysis.skills import connector_trials
from analysis.skills.connector_runs import INSERTION
from analysis.skills.connector_trials import (
    BncConnectorSuccessScenario,
    DConnectorSuccessScenario,
    InitialSpread,
    attempt_all,
    attempt_rows,
    drawn,
    success_metrics,
)
from analysis.skills.skill_run import AXES
from models.validation import ParameterError

D, BNC = DConnectorSuccessScenario(), BncConnectorSuccessScenario()
ERROR = (0.01, 0.02, 0.03, 0.001, 0.002, 0.0)
DRAWN = tuple(f"initial_{axis}" for axis in AXES)
seeds = st.integers(0, 2**63 - 1)


def attempts(*rows: dict[str, float | None], reasons: list[str] | None = None) -> Trials[int]:
    plain = dict.fromkeys(INSERTION, 1.0) | dict(zip(DRAWN, ERROR, strict=True))
    reasons = reasons or [""] * len(rows)
    return Trials(
        tasks=tuple(range(len(rows))),
        rows=tuple(
            {**plain, **row, "reason": why} for row, why in zip(rows, reasons, strict=True)
        ),
    )


@given(seed=seeds, trial=st.integers(0, 10_000_000))
def test_a_trial_is_its_seed_and_its_number(seed: int, trial: int) -> None:
    first = drawn(D, seed, trial)
    assert drawn(D, seed, trial) == first
    assert drawn(replace(D, trials=7), seed, trial).initial_error == first.initial_error
    assert drawn(D, seed, trial + 1).initial_error != first.initial_error
    assert drawn(D, seed + 1, trial).initial_error != first.initial_error
    # Nothing but the error differs.
    assert replace(first, initial_error=D.initial_error) == D


@pytest.mark.parametrize("scenario", [D, BNC])
def test_errors_are_spread_about_the_middle_up_to_both_ends(
    scenario: DConnectorSuccessScenario,
) -> None:
    errors = np.array([drawn(scenario, 0, k).initial_error for k in range(300)])
    off = errors - scenario.initial_error
    edges = [math.radians(3)] * 3 + [0.002] * 2
    for i, edge in enumerate(edges):
        assert off[:, i].max() == pytest.approx(edge, rel=0.05)
        assert off[:, i].min() == pytest.approx(-edge, rel=0.05)
        assert stats.kstest(off[:, i], stats.uniform(-edge, 2 * edge).cdf).pvalue > 0.001
    np.testing.assert_array_equal(off[:, 5], 0.0)
    assert np.abs(np.corrcoef(off[:, :5].T) - np.eye(5)).max() < 0.2


def test_the_defaults() -> None:
    assert D.initial_error == (0.0,) * 6
    assert BNC.initial_error == (0.0, 0.0, 0.6, 0.0, 0.0, 0.0)
    for scenario in (D, BNC):
        assert scenario.sight is None
        assert scenario.trials == 50


def test_no_spread_is_the_scenario_itself() -> None:
    still = replace(BNC, spread=InitialSpread(lateral=0.0, rotational=0.0))
    assert drawn(still, 3, 4) == still


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: InitialSpread(lateral=-1.0), "lateral is -1.0, allowed: a finite number >= 0"),
        (
            lambda: InitialSpread(rotational=math.nan),
            "rotational is nan, allowed: a finite number >= 0",
        ),
        (lambda: replace(D, trials=0), "trials is 0, allowed: 1 to 10000"),
        (lambda: replace(BNC, trials=10_001), "trials is 10001, allowed: 1 to 10000"),
        (lambda: replace(D, height=0.0), "height is 0.0, allowed: a finite number > 0"),
        (lambda: replace(BNC, height=-1.0), "height is -1.0, allowed: a finite number > 0"),
    ],
)
def test_what_is_refused(make: Callable[[], Any], message: str) -> None:
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}$"):
        make()


@given(n=st.integers(1, 200), data=st.data())
def test_the_interval_is_that_of_clopper_and_pearson(n: int, data: st.DataObject) -> None:
    bad = data.draw(st.integers(0, n))
    reasons = ["push: jammed"] * bad + [""] * (n - bad)
    found = success_metrics(attempts(*[{}] * n, reasons=reasons))
    good = n - bad
    assert found["success_rate"].value == pytest.approx(100 * good / n)
    low = stats.beta.ppf(0.025, good, n - good + 1) if good else 0.0
    high = stats.beta.ppf(0.975, good + 1, n - good) if bad else 1.0
    assert found["success_rate.low"].value == pytest.approx(100 * low, abs=1e-6)
    assert found["success_rate.high"].value == pytest.approx(100 * high, abs=1e-6)


def test_failures_are_counted_by_reason() -> None:
    reasons = ["", "push: jammed", "level: lost", "push: jammed"]
    found = success_metrics(attempts({}, {}, {}, {}, reasons=reasons))
    assert found["success_rate"].note == "1 of 4; failed: level: lost (1), push: jammed (2)"
    assert success_metrics(attempts({}, {}))["success_rate"].note == "2 of 2"


def test_peaks_are_the_largest_and_the_rest_are_means() -> None:
    found = success_metrics(
        attempts(
            {"force.peak": 10.0, "force.peak_share": 0.5, "torque.peak": 3.0, "duration": 4.0},
            {"force.peak": 30.0, "force.peak_share": 1.5, "torque.peak": 2.0, "retries": 3.0},
        )
    )
    values = {name: metric.value for name, metric in found.items()}
    assert values["force.peak"] == 30.0
    assert values["force.peak_mean"] == 20.0
    assert values["force.peak_share"] == 1.5
    assert values["torque.peak"] == 3.0
    assert values["duration"] == 2.5
    assert values["retries"] == 2.0
    assert values["real_time_factor"] == 1.0
    assert found["force.peak"].note == "largest of 2 trials, 10 to 30"
    assert found["duration"].note == "mean of 2 trials, 1 to 4"
    assert [found[name].unit for name in ("force.peak", "force.peak_mean", "duration")] == [
        "N",
        "N",
        "s",
    ]


def test_a_row_for_each_trial() -> None:
    rows = attempt_rows(
        attempts({"depth": 0.005}, {"depth": 0.001, "success": 0.0}, reasons=["", "level: lost"])
    )
    np.testing.assert_array_equal(rows["trial"], [0, 1])
    np.testing.assert_array_equal(rows["initial_ry"], [0.02, 0.02])
    np.testing.assert_array_equal(rows["initial_x"], [0.001, 0.001])
    np.testing.assert_array_equal(rows["depth"], [0.005, 0.001])
    np.testing.assert_array_equal(rows["success"], [1.0, 0.0])
    assert rows["reason"].tolist() == ["", "level: lost"]
    assert "real_time_factor" not in rows  # which no two runs have in common


def test_every_trial_is_run_once_with_its_own_noise(monkeypatch: pytest.MonkeyPatch) -> None:
    given: list[tuple[Any, int]] = []
    told: list[float] = []

    def fake(scenario: Any, seed: int) -> Any:
        given.append((scenario.initial_error, seed))
        if len(given) == 2:
            raise ValueError("no")

    monkeypatch.setattr(connector_trials, "run_insertion", fake)
    monkeypatch.setattr(connector_trials, "insertion_metrics", lambda *_: {"success": 1.0})
    monkeypatch.setattr(connector_trials, "failure", lambda *_: "")
    scenario = replace(D, trials=3)
    found = attempt_all(scenario, 8, lambda done, doing="": told.append(done))
    expected = [drawn(scenario, 8, trial).initial_error for trial in range(3)]
    assert [error for error, _ in given] == expected
    assert found.tasks == (0, 2)  # an error is no insertion that does not go in
    for row, error in zip(found.rows, expected[::2], strict=True):
        assert tuple(row[name] for name in DRAWN) == error
    assert len({seed for _, seed in given}) == 3
    assert told[-1] == 1.0
