from collections.abc import Callable
from dataclasses import replace
from typing import Any

import pytest

from analysis.contact.adept_contact import (
    ADEPT_NUGGET_HOLD,
    ADEPT_NUGGET_MOTION,
    ADEPT_ROLLER_HOLD,
    ADEPT_ROLLER_MOTION,
)
from analysis.published.hybrid_force_position import PUBLISHED
from analysis.run.experiment import Experiment, Outcome
from analysis.run.registry import find, load, select
from diagrams.contact.adept_scenarios import (
    AdeptNuggetHoldScenario,
    AdeptNuggetMotionScenario,
    AdeptRollerHoldScenario,
    AdeptRollerMotionScenario,
    AdeptScenario,
)
from diagrams.contact.hybrid_scenario import resolve
from models.validation import ParameterError

ALL: dict[str, tuple[Experiment[Any], Callable[..., Any]]] = {
    "adept-roller-hold": (ADEPT_ROLLER_HOLD, AdeptRollerHoldScenario),
    "adept-roller-motion": (ADEPT_ROLLER_MOTION, AdeptRollerMotionScenario),
    "adept-nugget-hold": (ADEPT_NUGGET_HOLD, AdeptNuggetHoldScenario),
    "adept-nugget-motion": (ADEPT_NUGGET_MOTION, AdeptNuggetMotionScenario),
}
METRICS = {
    "contact_time",
    "force.final",
    "force.peak",
    "force.deviation",
    "force.settling_time",
    "position.lag_error",
    "recontact.speed",
}


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


def short(make: Callable[..., AdeptScenario], **values: Any) -> AdeptScenario:
    """A run that ends before contact."""
    return resolve(make(duration=0.1, trials=1, **values))


@pytest.mark.parametrize("name", ALL)
def test_the_registry_finds_them(name: str) -> None:
    (entry,) = select(find(), [name])
    assert entry.paper == "hybrid-force-position"
    experiment, make = ALL[name]
    assert load(entry) is experiment
    assert experiment.scenario is make


@pytest.mark.parametrize("name", ALL)
def test_every_published_value_is_measured(name: str) -> None:
    experiment, make = ALL[name]
    outcome = experiment.run(short(make), 0, quiet)
    asked = {value.metric for value in PUBLISHED if value.experiment == name}
    assert asked
    assert set(outcome.metrics) >= METRICS | asked
    units = {metric: outcome.metrics[metric].unit for metric in asked}
    for value in PUBLISHED:
        if value.experiment == name:
            assert value.unit == units[value.metric]
    assert len({len(values) for values in outcome.traces.values()}) == 1
    assert not outcome.tables


@pytest.mark.parametrize("name", ALL)
def test_figures_are_named_after_the_experiment(name: str) -> None:
    experiment, make = ALL[name]
    scenario = short(make)
    outcome = experiment.run(scenario, 0, quiet)
    figures = experiment.plot(scenario, outcome)
    assert set(figures) == {name}
    assert experiment.diagram is not None
    assert experiment.charts is not None
    assert experiment.diagram(scenario).num_input_ports() == 0
    assert len(experiment.charts(scenario)) == 1


@pytest.fixture(scope="module")
def touch() -> Outcome:
    scenario = AdeptNuggetHoldScenario(duration=1.5, measure_after=1.0, trials=2)
    task = replace(scenario.task, start=(0.499, -0.3, 0.3, 0.0), distance=0.001)
    return ADEPT_NUGGET_HOLD.run(resolve(replace(scenario, task=task)), 0, quiet)


def test_a_nugget_is_pressed_on_the_wall(touch: Outcome) -> None:
    value = {name: metric.value for name, metric in touch.metrics.items()}
    assert touch.simulated_seconds == 3.0
    assert value["contact_time"] is not None
    assert 0 < value["contact_time"] < 0.5
    assert value["impact.speed"] is not None
    assert 0 < value["impact.speed"] < 0.15
    assert value["force.final"] == pytest.approx(5.0, rel=0.5)
    assert touch.metrics["force.final"].note.startswith("mean of 2 seeds")


def test_out_of_reach_is_one_line() -> None:
    scenario = AdeptNuggetHoldScenario()
    far = replace(scenario, task=replace(scenario.task, distance=3.0))
    with pytest.raises(ParameterError, match=r"endpoint is \(.*\), allowed: ") as caught:
        ADEPT_NUGGET_HOLD.resolve(far)
    assert "\n" not in str(caught.value)


def test_the_sensors_noise_does_not_count_as_contact() -> None:
    experiment, make = ALL["adept-roller-hold"]
    outcome = experiment.run(resolve(make(duration=1.5, trials=1)), 0, quiet)
    assert outcome.metrics["contact_time"].value is None
    assert abs(outcome.traces["measured_force"]).max() > 0.45
    assert outcome.metrics["force.deviation"].note == "does not occur, or settle, in the run"
