import math

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.published.fsm_visual_servoing import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Outcome, load, select
from chamfer.analysis.servo.fsm_stability import MapParams, StabilityScenario
from chamfer.models.validation import ParameterError

FSM_STABILITY = load(select(CATALOGUE.entries, ["fsm-stability"])[0])


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


SMALL = StabilityScenario(map=MapParams(points=9, trials=3, settings=40))


@pytest.fixture(scope="module")
def outcome() -> Outcome:
    return FSM_STABILITY.run(SMALL, 0, quiet)


def test_the_default_map_is_large_enough() -> None:
    assert StabilityScenario().map.points >= 40


def test_what_is_guaranteed_settles_and_both_sides_are_shown(outcome: Outcome) -> None:
    value = {name: metric.value for name, metric in outcome.metrics.items()}
    assert value["map.cells"] == 81
    assert value["map.guaranteed_not_settling"] == 0
    assert value["map.unfinished"] == 0
    assert value["map.guaranteed"] >= 20
    assert value["map.cycling"] >= 10
    assert value["map.first_reversal"] > 1


@pytest.mark.slow
def test_what_is_guaranteed_settles_on_the_whole_map() -> None:
    scenario = StabilityScenario(map=MapParams(trials=12, settings=1))
    value = {
        name: metric.value
        for name, metric in FSM_STABILITY.run(scenario, 1, quiet).metrics.items()
    }
    assert value["map.guaranteed_not_settling"] == 0
    assert value["map.unfinished"] == 0
    assert 1.0 < value["map.first_reversal"] < 1.3


def test_the_describing_function_predicts_the_frequency(outcome: Outcome) -> None:
    assert outcome.metrics["describing_function.frequency_error"].value == pytest.approx(4, abs=2)
    cycles = outcome.tables["limit_cycles"]
    # As a certificate it is optimistic: the first limit cycle is there before it says so.
    assert np.isfinite(cycles["measured_frequency"]).sum() > (
        np.isfinite(cycles["predicted_frequency"]).sum()
    )


def test_the_papers_criteria(outcome: Outcome) -> None:
    values = [value for value in PUBLISHED if value.experiment == "fsm-stability"]
    failed = {c.published.metric for c in check(values, outcome.metrics) if not c.ok}
    assert failed == {"compensation.tarraf_properties"}
    assert outcome.metrics["folded.gore_criteria"].value == 1


def test_force_to_velocity_keeps_an_error_beyond_the_dead_zone(outcome: Outcome) -> None:
    slow = outcome.metrics["velocity_80hz.least_error"].value
    fast = outcome.metrics["velocity_1000hz.least_error"].value
    assert slow is not None
    assert fast is not None
    assert slow > fast > 0.01


def test_figures(outcome: Outcome) -> None:
    figures = FSM_STABILITY.plot(SMALL, outcome)
    assert set(figures) == {"settling-map", "limit-cycles"}


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"points": 1}, "points is 1, allowed: a whole number >= 2"),
        ({"trials": 0}, "trials is 0"),
        ({"settings": 0}, "settings is 0"),
        ({"dead_zone": (0.02, 0.01)}, r"dead_zone is \(0\.02, 0\.01\), allowed: two increasing"),
        ({"increment": (0.0, math.inf)}, r"increment is \(0\.0, inf\)"),
    ],
)
def test_grids_that_are_none(arguments: dict[str, object], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        MapParams(**arguments)  # type: ignore[arg-type]


def test_dead_zones_within_the_cameras_error_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"map\.dead_zone is \(0\.001, 0\.03\)"):
        StabilityScenario(map=MapParams(dead_zone=(0.001, 0.03)))
