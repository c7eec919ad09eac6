"""The state machine against a PID law in the same cell."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from scipy import stats

from chamfer.analysis.campaign.campaign import Trials
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cell import alignment_comparison
from chamfer.analysis.cell.alignment_comparison import (
    CONTROLLERS,
    AlignmentComparisonScenario,
    ControllerTrial,
    resolve,
    score,
)
from chamfer.analysis.cell.alignment_runs import STOPPED, AlignmentTrialsScenario, drawn
from chamfer.analysis.scenario.experiment import load, quiet, select
from chamfer.diagrams.cell.alignment_scenario import ControllerChoice
from chamfer.diagrams.cell.controller_design import design_compensator, design_pid
from chamfer.models.validation import ParameterError
from chamfer.systems.servo.settling import SettlingPlant

ALIGNMENT_COMPARISON = load(select(CATALOGUE.entries, ["alignment-fsm-vs-pid"])[0])

OPEN = AlignmentComparisonScenario(
    trials=3,
    tuning_trials=2,
    small_lateral=(2e-5, 3e-5),
    small_rotational=(4e-4, 8e-4),
    closed_loop=(0.05, 0.1, 0.2),
)
SCENARIO = resolve(OPEN)
COUNT = 4 + 3  # candidates
NAMES = ("lateral_error", "rotational_error", "lateral_overshoot", "rotational_overshoot")


def finished(lateral: float, rotational: float, settling_time: float | None) -> Row:
    return {
        **dict.fromkeys(NAMES, 0.0),
        "lateral_error": lateral,
        "rotational_error": rotational,
        "settling_time": settling_time,
        "detected": 95.0,
        **dict.fromkeys(STOPPED, 0.0),
        "time": np.array([0.0, 1.0, 2.0]),
        "lateral_errors": np.full(3, lateral),
        "rotational_errors": np.full(3, rotational),
    }


class Cell:
    """Takes the place of the cell: the closer to the best parameters, the less error."""

    def __init__(self) -> None:
        self.asked: list[tuple[AlignmentTrialsScenario, int, int]] = []
        self.failing: set[tuple[str, int]] = set()

    def __call__(self, scenario: AlignmentTrialsScenario, seed: int, trial: int) -> Row:
        self.asked.append((scenario, seed, trial))
        if scenario.controller.kind == "fsm":
            axes = scenario.compensator.axes
            off = abs(axes[0].small_increment - 3e-5) / 1e-5
            off += abs(axes[3].small_increment - 4e-4) / 4e-4
        else:
            off = abs(scenario.pid.axes[0].integral - best_pid().axes[0].integral)
        share = 1 + off + trial % 10
        settled = None if trial == 1 and scenario.controller.kind == "fsm" else 0.5 * share
        if (scenario.controller.kind, trial) in self.failing:
            raise ParameterError("trial", trial, "another one")
        return finished(
            1e-4 * share,
            1e-3 * share * (1 if scenario.controller.kind == "fsm" else 0.5),
            settling_time=settled,
        )


def plants() -> tuple[dict[str, SettlingPlant]]:
    undelivered = np.concatenate([np.ones(2), 0.85 ** np.arange(1, 120)])
    pixels = {axis: SettlingPlant(2000.0, undelivered) for axis in ("x", "y", "z")}
    return (pixels | {axis: SettlingPlant(1.0, undelivered) for axis in ("pitch", "yaw")},)


def best_pid() -> Any:
    return design_pid(OPEN, plants(), 0.1)


@pytest.fixture
def cell(monkeypatch: pytest.MonkeyPatch) -> Cell:
    made = Cell()
    monkeypatch.setattr(alignment_comparison, "align", made)
    monkeypatch.setattr(alignment_comparison, "arm_responses", lambda scenario: plants())
    return made


def test_the_score_is_the_mean_of_both_errors_relative_to_the_paper_s() -> None:
    rows = (finished(0.0025, 0.011, 1.0), finished(0.005, 0.0, 1.0))
    tasks = tuple(ControllerTrial(SCENARIO, trial) for trial in range(2))
    assert score(Trials(tasks=tasks, rows=rows)) == pytest.approx((1 + 0.5 + 2 + 0) / 2)
    assert score(Trials(tasks=(), rows=())) == math.inf  # all have failed


def test_both_controllers_have_the_same_starts(cell: Cell) -> None:
    outcome = ALIGNMENT_COMPARISON.run(replace(SCENARIO, tuning_trials=0), 4, quiet)
    assert [(one.controller.kind, seed, trial) for one, seed, trial in cell.asked] == [
        (name, 4, trial) for name in CONTROLLERS for trial in range(3)
    ]
    for scenario, _, _ in cell.asked:  # the scenario's own parameters
        assert scenario.compensator == SCENARIO.compensator
        assert scenario.pid == SCENARIO.pid
    starts = [drawn(one, one.spread, seed, trial) for one, seed, trial in cell.asked]
    for fsm, pid in zip(starts[:3], starts[3:], strict=True):
        assert replace(fsm, controller=ControllerChoice(kind="pid")) == pid
    assert outcome.simulated_seconds == 6 * SCENARIO.duration
    assert "tuning" not in outcome.tables


def test_tuning_uses_other_trials_and_the_comparison_the_best(cell: Cell, value: Any) -> None:
    with pytest.warns(UserWarning, match="^the rotational increments are 1.76 times"):
        outcome = ALIGNMENT_COMPARISON.run(SCENARIO, 4, quiet)
    tuning, comparison = cell.asked[: 2 * COUNT], cell.asked[2 * COUNT :]
    trials = [trial for _, _, trial in tuning]
    assert trials == [1_000_000, 1_000_001] * COUNT
    assert {seed for _, seed, _ in cell.asked} == {4}
    assert not set(trials) & {trial for _, _, trial in comparison}
    assert [trial for _, _, trial in comparison] == [0, 1, 2, 0, 1, 2]
    fsm, pid = comparison[0][0], comparison[-1][0]
    best = design_compensator(OPEN, plants(), {"lateral": 5 * 3e-5, "rotational": 5 * 4e-4})
    assert fsm.controller.kind == "fsm"
    assert fsm.compensator == best
    assert pid.controller.kind == "pid"
    assert pid.pid == best_pid()
    assert {one.compensator for one, _, _ in comparison[:3]} == {best}
    assert outcome.simulated_seconds == (2 * COUNT + 6) * SCENARIO.duration
    assert value(outcome, "fsm.lateral.small_increment") == pytest.approx(3e-5)
    assert value(outcome, "fsm.rotational.dead_zone") == best.rotational.dead_zone
    assert value(outcome, "pid.lateral.integral") == best_pid().lateral.integral
    assert value(outcome, "pid.rotational.proportional") == best_pid().rotational.proportional


def test_metrics(cell: Cell, value: Any) -> None:
    outcome = ALIGNMENT_COMPARISON.run(replace(SCENARIO, tuning_trials=0), 0, quiet)
    assert value(outcome, "fsm.settled") == pytest.approx(200 / 3)
    assert value(outcome, "pid.settled") == 100
    assert "2 of 3" in outcome.metrics["fsm.settling_time"].note
    settled = outcome.traces["fsm.settling_time"]
    assert value(outcome, "fsm.settling_time") == pytest.approx(np.nanmean(settled))


def test_the_difference_is_paired(cell: Cell, value: Any) -> None:
    outcome = ALIGNMENT_COMPARISON.run(replace(SCENARIO, tuning_trials=0), 0, quiet)
    for name in ("lateral_error", "rotational_error"):
        off = outcome.traces[f"fsm.{name}"] - outcome.traces[f"pid.{name}"]
        interval = (off.mean(),) * 2  # the same from every start
        if stats.sem(off) > 1e-12:
            interval = stats.t.interval(0.95, 2, loc=off.mean(), scale=stats.sem(off))
        assert value(outcome, f"difference.{name}.mean") == pytest.approx(off.mean())
        assert value(outcome, f"difference.{name}.mean_low") == pytest.approx(interval[0])
        assert value(outcome, f"difference.{name}.mean_high") == pytest.approx(interval[1])


def test_rows_and_errors_over_time(cell: Cell) -> None:
    outcome = ALIGNMENT_COMPARISON.run(replace(SCENARIO, tuning_trials=0), 0, quiet)
    table = outcome.tables["errors"]
    np.testing.assert_array_equal(table["controller"], np.repeat([0, 1], 9))
    np.testing.assert_array_equal(table["trial"], np.tile(np.repeat([0, 1, 2], 3), 2))
    np.testing.assert_array_equal(table["time"], np.tile([0.0, 1.0, 2.0], 6))
    for i, name in enumerate(CONTROLLERS):
        for run in range(3):
            of = (table["controller"] == i) & (table["trial"] == run)
            assert set(table["lateral_error"][of]) == {
                outcome.traces[f"{name}.lateral_error"][run]
            }
