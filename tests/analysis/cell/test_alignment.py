from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.campaign.campaign import parallel
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.cell.alignment_runs import ALIGNMENT, RepeatabilityScenario, drawn
from chamfer.analysis.published.work_cell import MEAN_ERROR, WORST_ERROR
from chamfer.analysis.scenario.experiment import Outcome, load, select
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario, ControllerChoice

ALIGN, REPEATABILITY = map(load, select(CATALOGUE.entries, ["alignment", "repeatability"]))

SHORT: dict[str, Any] = {"begin": 0.1, "compensation_time": 0.3}
ONE = AlignmentScenario(**SHORT)
MANY = RepeatabilityScenario(**SHORT, trials=2)


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


def value(outcome: Outcome, name: str) -> float:
    measured = outcome.metrics[name].value
    assert measured is not None
    return measured


@pytest.fixture(scope="module")
def one() -> Outcome:
    with pytest.warns(UserWarning, match="larger at the end than at the begin"):  # it is short
        return ALIGN.run(ALIGN.resolve(ONE), 0, quiet)


@pytest.fixture(scope="module")
def many() -> Outcome:
    with pytest.warns(UserWarning, match="^in 1 of 2 trials the true error is larger"):
        return REPEATABILITY.run(REPEATABILITY.resolve(MANY), 0, quiet)


def test_metrics_of_one_run(one: Outcome) -> None:
    assert set(one.metrics) == {*ALIGNMENT, "settling.small_share", "real_time_factor"}
    for name, quantity in ALIGNMENT.items():
        assert one.metrics[name].unit == quantity.unit
    undefined = [name for name, metric in one.metrics.items() if metric.value is None]
    assert undefined == ["settling_time"]  # in so short a time
    assert one.metrics["settling_time"].note
    assert value(one, "real_time_factor") > 0
    assert value(one, "detected") == 100
    assert value(one, "blind") == 0
    assert value(one, "saturated") == 0
    assert value(one, "compensation.lateral") > 1e-3
    assert value(one, "lateral_error") < value(one, "uncompensated.lateral_error")
    assert one.simulated_seconds == pytest.approx(0.4)


def test_traces_and_pictures_of_one_run(one: Outcome) -> None:
    assert len(one.traces["time"]) == 33
    for name, values in one.traces.items():
        assert values.shape == (33,), name
        assert np.isfinite(values).all(), name
    assert set(one.tables) == {"pictures"}
    assert {len(values) for values in one.tables["pictures"].values()} == {320 * 240}


def test_the_pid_takes_its_place() -> None:
    scenario = ALIGN.resolve(replace(ONE, controller=ControllerChoice(kind="pid")))
    outcome = ALIGN.run(scenario, 0, quiet)
    first = np.flatnonzero(outcome.traces["compensation_z"])[0]
    error = outcome.traces["error_z"][first]
    gains = scenario.pid.lateral.closed
    jump = outcome.traces["compensation_z"][first] / error
    assert jump == pytest.approx(gains.proportional + gains.integral / 80, rel=0.2)
    assert ALIGN.charts is not None
    assert len(ALIGN.charts(scenario)) == 0
    assert len(ALIGN.charts(ALIGN.resolve(ONE))) == 2


def test_metrics_of_many_runs(many: Outcome) -> None:
    promised = {
        *(
            f"{kind}_error.{of}"
            for kind in ("lateral", "rotational")
            for of in ("mean", "mean_low", "mean_high", "max")
        ),
        "box_margin.lateral",
        "box_margin.rotation",
        "chamfer_margin",
        "parallelogram_margin",
        "margin",
        "wedging",
        "settling_time",
        "settled",
        "uncompensated.lateral_error",
        "uncompensated.rotational_error",
        "vision.lateral_error",
        "vision.rotational_error",
        "compensation.late_lateral",
        "compensation.late_rotational",
        "detected",
        "blind",
        "diverged",
        "limited",
        "growing",
        "settling.small_share",
        "real_time_factor",
    }
    assert set(many.metrics) == promised
    errors = many.traces["lateral_error"]
    assert value(many, "lateral_error.mean") == pytest.approx(errors.mean())
    assert value(many, "lateral_error.max") == errors.max()
    assert value(many, "rotational_error.mean") == many.traces["rotational_error"].mean()
    assert value(many, "uncompensated.lateral_error") == pytest.approx(
        many.traces["uncompensated.lateral_error"].mean()
    )
    assert value(many, "compensation.late_rotational") == pytest.approx(
        many.traces["compensation.late_rotational"].mean()
    )
    assert many.metrics["settling_time"].value is None
    assert value(many, "settled") == 0
    assert "0 of 2" not in many.metrics["lateral_error.mean"].note
    assert many.metrics["lateral_error.mean"].note == "2 trials"
    assert many.simulated_seconds == pytest.approx(0.8)


def test_rows_are_the_trials(many: Outcome) -> None:
    rows = many.traces
    assert set(ALIGNMENT) < set(rows)
    np.testing.assert_array_equal(rows["trial"], [0, 1])
    for k in range(2):
        trial = drawn(MANY, MANY.spread, 0, k)
        for i, axis in ((1, "y"), (2, "z"), (4, "pitch"), (5, "yaw")):
            assert rows[f"initial_{axis}"][k] == trial.initial_error[i]
        for arm in ("peg", "hole"):
            settings = getattr(trial, arm)
            assert rows[f"{arm}_payload_error"][k] == settings.payload_error
            assert rows[f"{arm}_mass_scale"][k] == settings.mass_scale
            assert rows[f"{arm}_joint_friction"][k] == max(settings.joint_friction)
    table = many.tables["errors"]
    assert set(table) == {"trial", "time", "lateral_error", "rotational_error"}
    for k in range(2):
        of = table["trial"] == k
        np.testing.assert_allclose(table["time"][of], np.arange(33) / 80)
        assert table["lateral_error"][of][-1] == rows["lateral_error"][k]
        assert table["rotational_error"][of][-1] == rows["rotational_error"][k]


@pytest.mark.slow
def test_two_whole_runs_are_better_than_the_paper_s() -> None:
    with parallel(2):
        outcome = REPEATABILITY.run(
            REPEATABILITY.resolve(RepeatabilityScenario(trials=2)), 3, quiet
        )
    assert value(outcome, "lateral_error.mean") < MEAN_ERROR[0] / 5
    assert value(outcome, "lateral_error.max") < WORST_ERROR[0] / 5
    assert value(outcome, "rotational_error.mean") < MEAN_ERROR[1]
    assert value(outcome, "rotational_error.max") < WORST_ERROR[1]
    assert value(outcome, "vision.lateral_error") < 1e-4
    assert value(outcome, "wedging") == value(outcome, "blind") == 0
