import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from chamfer.analysis.campaign.campaign import Trials
from chamfer.analysis.skills import connector_trials
from chamfer.analysis.skills.connector_runs import INSERTION
from chamfer.analysis.skills.connector_trials import (
    DRAWN,
    BncConnectorSuccessScenario,
    DConnectorSuccessScenario,
    attempt_all,
    attempt_rows,
    success_metrics,
)
from chamfer.analysis.skills.connector_truth import Verdict
from chamfer.analysis.skills.randomised_scenario import drawn_world
from chamfer.analysis.skills.skill_run import AXES
from chamfer.models.validation import ParameterError

D, BNC = DConnectorSuccessScenario(), BncConnectorSuccessScenario()
ERROR = (0.01, 0.02, 0.03, 0.001, 0.002, 0.0)


def attempts(*rows: dict[str, float | None], reasons: list[str] | None = None) -> Trials[int]:
    plain: dict[str, float | None] = dict.fromkeys(INSERTION, 1.0)
    plain |= dict.fromkeys(Verdict._fields, 0.0) | dict.fromkeys(DRAWN, 0.5)
    plain |= {f"initial_{axis}": error for axis, error in zip(AXES, ERROR, strict=True)}
    plain["obstacle"] = None
    reasons = reasons or [""] * len(rows)
    return Trials(
        tasks=tuple(range(len(rows))),
        rows=tuple(
            {**plain, **row, "reason": why} for row, why in zip(rows, reasons, strict=True)
        ),
    )


def test_the_defaults() -> None:
    assert D.initial_error == (0.0,) * 6
    assert BNC.initial_error == (0.0, 0.0, 0.6, 0.0, 0.0, 0.0)
    for scenario in (D, BNC):
        assert scenario.sight is not None
        assert scenario.sensing == "realistic"
        assert scenario.trials == 50


@pytest.mark.parametrize(
    ("make", "message"),
    [
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


def test_a_run_with_an_obstacle_is_no_insertion_but_what_it_says_counts() -> None:
    blocked = {"obstacle": 0.003}
    found = success_metrics(
        attempts(
            {"hindered": 2.0},
            {"hindered": 1.0, "false_hindered": 1.0},
            {**blocked, "hindered": 2.0},
            {**blocked, "false_done": 1.0},
            {**blocked, "false_reason": 1.0},
            reasons=["", "push: jammed", "feel: jammed", "said to be done", "lost"],
        )
    )
    assert found["success_rate"].value == 50.0
    expected = "1 of 2, 3 more with an obstacle; failed: push: jammed (1)"
    assert found["success_rate"].note == expected
    assert found["false_done"].value == 20.0
    assert found["false_hindered"].value == 20.0
    assert found["false_hindered"].note == "1 of 5 times that it was told"
    assert found["false_reason"].value == 25.0
    only = success_metrics(attempts(blocked, reasons=["feel: jammed"]))
    assert only["success_rate"].value is None
    assert only["success_rate.low"].value is None
    assert only["false_hindered"].value is None


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

    true = Verdict(True, False, 1, 0, False)
    monkeypatch.setattr(connector_trials, "run_insertion", fake)
    monkeypatch.setattr(connector_trials, "insertion_metrics", lambda *_: {"success": 1.0})
    monkeypatch.setattr(connector_trials, "verdict", lambda *_: true)
    monkeypatch.setattr(connector_trials, "failure", lambda *_: "")
    scenario = replace(D, trials=3)
    found = attempt_all(scenario, 8, lambda done, doing="": told.append(done))
    worlds = [drawn_world(scenario, scenario.spread, 8, trial) for trial in range(3)]
    assert [error for error, _ in given] == [world.initial_error for world in worlds]
    assert found.tasks == (0, 2)  # an error is no insertion that does not go in
    for row, world in zip(found.rows, worlds[::2], strict=True):
        assert tuple(row[f"initial_{axis}"] for axis in AXES) == world.initial_error
        assert row["mating_force"] == world.connector.mating_force
        assert row["friction"] == world.connector.material.friction
        assert row["wrist_stiffness"] == world.wrist.stiffness[-1]
        assert row["hindered"] == 1.0
    assert len({seed for _, seed in given}) == 3
