"""The experiment with few trials, and its metrics on made-up ones."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.published.sensorimotor_primitives import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Outcome, load, select
from chamfer.analysis.skills.vision_primitives import (
    Task,
    VisionPrimitivesScenario,
    map_metrics,
    tasks,
    trial_metrics,
    trial_of,
)
from chamfer.analysis.skills.vision_trials import Trial
from chamfer.diagrams.skills.vision_servo import NAMES
from chamfer.models.validation import ParameterError

VISION_PRIMITIVES = load(select(CATALOGUE.entries, ["vision-primitives"])[0])

SHORT = VisionPrimitivesScenario(
    trials=1, map_focal=(0.15, 1.0), map_angle=(0.0,), map_trials=1, duration=2.5
)


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return VISION_PRIMITIVES.run(VISION_PRIMITIVES.resolve(SHORT), 0, quiet)


def test_published_values(outcome: Outcome) -> None:
    asked = [one for one in PUBLISHED if one.experiment == "vision-primitives"]
    checks = check(asked, outcome.metrics)
    assert [one.ok for one in checks] == [True] * 4


def test_every_primitive_settles_and_the_map_has_both(outcome: Outcome) -> None:
    for name in NAMES:
        assert outcome.metrics[f"{name}.converged"].value == 100
        assert outcome.metrics[f"{name}.theory.largest_root"].value < 1  # type: ignore[operator]
    assert outcome.metrics["fixed_point.excursion.max"].value < 5e-4  # type: ignore[operator]
    cells = outcome.tables["map"]
    np.testing.assert_array_equal(cells["focal_factor"], [0.15, 1.0])
    np.testing.assert_array_equal(cells["converged"], [0, 1])
    assert outcome.metrics["map.agreement"].value == 100
    assert outcome.metrics["margin.focal_factor"].value == 1.0


def test_tables(outcome: Outcome) -> None:
    assert outcome.traces["primitive"].tolist() == [0, 1, 2, 3]
    assert outcome.traces["event"].tolist() == [1, 1, 1, 1]
    courses = outcome.tables["courses"]
    for k in range(4):
        own = courses["primitive"] == k
        assert courses["time"][own][-1] == outcome.traces["time"][k]
        for name in ("error_m", "error_rad"):
            last = courses[name][own][-1]
            np.testing.assert_equal(last, outcome.traces[name][k])
    assert set(VISION_PRIMITIVES.plot(SHORT, outcome)) == {"vision-primitives"}


def test_all_trials_are_different_and_known_beforehand() -> None:
    scenario = VisionPrimitivesScenario(trials=3, map_trials=2)
    asked = tasks(scenario)
    cells = len(scenario.map_focal) * len(scenario.map_angle)
    assert len(asked) == 4 * 3 + 2 * cells
    assert len(set(asked)) == len(asked)
    each = [trial_of(scenario, 0, task) for task in asked]
    assert len(set(each)) == len(each)
    assert [trial_of(scenario, 0, task) for task in asked] == each
    assert trial_of(scenario, 1, asked[0]) != each[0]
    of_map = trial_of(scenario, 0, Task("translation", 1, (0.4, math.radians(40))))
    for belief in (of_map.xz, of_map.yz):
        assert belief.focal_factor == 0.4
        assert np.linalg.norm(belief.turn) == pytest.approx(math.radians(40))
    assert of_map.gap == scenario.map_gap


def trial(event: Any = "done", **changes: Any) -> Trial:
    plain = Trial(
        event=event,
        time=1.0,
        times=np.array([0.0, 1.0]),
        displacement=np.zeros((2, 6)),
        errors=np.array([[0.01, math.nan], [0.001, math.nan]]),
        seen=0.1 if event == "done" else None,
        slowest_root=0.8,
    )
    return replace(plain, **changes)


def test_metrics_of_trials() -> None:
    worse = trial(time=2.0, seen=0.3, slowest_root=0.9)
    metrics = trial_metrics([trial(), worse, trial(), trial("lost", time=9.0), trial(None)])
    values = {name: metric.value for name, metric in metrics.items()}
    assert values["converged"] == 60
    # Clopper and Pearson, 3 of 5.
    assert values["converged.low"] == pytest.approx(14.66, abs=0.01)
    assert values["converged.high"] == pytest.approx(94.73, abs=0.01)
    assert values["settling_time.mean"] == pytest.approx(4 / 3)
    assert values["settling_time.max"] == 2.0
    assert values["error_px.max"] == 0.3
    assert values["error_m.mean"] == 0.001
    assert values["theory.largest_root"] == 0.9
    assert "error_rad.max" not in values


def test_metrics_where_nothing_settles() -> None:
    metrics = trial_metrics([trial("lost")])
    assert metrics["converged"].value == 0
    assert metrics["settling_time.mean"].value is None
    assert metrics["settling_time.mean"].note == "no trial settled"


def test_margins_of_a_map() -> None:
    focal, angle = np.meshgrid([0.2, 0.5, 1.0, 2.0], [0.0, 0.5, 1.0, 1.5], indexing="ij")
    focal, angle = focal.ravel(), angle.ravel()
    good = (focal >= 0.5) & (angle <= 1.0)
    cells = {
        "focal_factor": focal,
        "angle": angle,
        "converged": good.astype(float),
        "theory_root": np.where(good | ((focal == 1.0) & (angle == 1.5)), 0.9, 1.1),
    }
    metrics = {name: metric.value for name, metric in map_metrics(cells).items()}
    assert metrics == {
        "map.agreement": 100 * 15 / 16,
        "margin.focal_factor": 0.5,
        "margin.orientation": 1.0,
        "theory.margin.focal_factor": 0.5,
        "theory.margin.orientation": 1.5,
    }
    # A gap ends the range; without the start there is none.
    cells["converged"] = np.where((focal == 1.0) & (angle == 0.5), 0.0, cells["converged"])
    assert map_metrics(cells)["margin.orientation"].value == 0.0
    cells["converged"] = np.zeros_like(focal)
    assert map_metrics(cells)["margin.focal_factor"].value is None


@pytest.mark.parametrize(
    "changes",
    [
        {"trials": 0},
        {"focal_error": 1.0},
        {"orientation_error": -0.1},
        {"duration": 0.0},
        {"map_focal": (0.5, 2.0)},
        {"map_focal": (1.0, 0.5)},
        {"map_angle": (0.1,)},
        {"map_trials": 0},
    ],
)
def test_scenario_errors(changes: dict[str, Any]) -> None:
    with pytest.raises(ParameterError, match=f"^{next(iter(changes))} is "):
        VisionPrimitivesScenario(**changes)
