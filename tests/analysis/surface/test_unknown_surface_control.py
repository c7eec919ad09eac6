"""Section 5.3 at the thesis' parameters."""

import math
from dataclasses import replace
from typing import Any

import pytest

from chamfer.analysis.campaign.campaign import parallel
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.published.hybrid_force_position import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Experiment, Outcome, load, select
from chamfer.diagrams.surface.surface_tracking import resolve_tracking
from chamfer.diagrams.surface.tracking_scenario import AdaptiveTrackingScenario, TrackingScenario
from chamfer.systems.estimation.surface_observer import Kind


def loaded(name: str) -> Experiment[Any]:
    return load(select(CATALOGUE.entries, [name])[0])


UNKNOWN_SURFACE_CONTROL = loaded("unknown-surface-control")
UNKNOWN_SURFACE_CONTROL_ADAPTIVE = load(
    select(CATALOGUE.entries, ["unknown-surface-control-adaptive"])[0]
)
UNKNOWN_SURFACE_CONTROL_NOISE_FREE = load(
    select(CATALOGUE.entries, ["unknown-surface-control-noise-free"])[0]
)

NOISY, NOISE_FREE = "unknown-surface-control", "unknown-surface-control-noise-free"
EXPERIMENTS: dict[str, Experiment[TrackingScenario]] = {
    NOISY: UNKNOWN_SURFACE_CONTROL,
    NOISE_FREE: UNKNOWN_SURFACE_CONTROL_NOISE_FREE,  # type: ignore[dict-item]
}


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


def observed_by(kind: Kind, *, trials: int, duration: float) -> TrackingScenario:
    scenario = TrackingScenario(trials=trials, duration=duration)
    return UNKNOWN_SURFACE_CONTROL.resolve(
        replace(scenario, observer=replace(scenario.observer, kind=kind))
    )


@pytest.fixture(scope="module")
def noise_free() -> Outcome:
    experiment = UNKNOWN_SURFACE_CONTROL_NOISE_FREE
    return experiment.run(experiment.resolve(experiment.scenario()), 0, quiet)


@pytest.fixture(scope="module")
def noisy() -> Outcome:
    return UNKNOWN_SURFACE_CONTROL.run(observed_by("thesis", trials=3, duration=10.0), 0, quiet)


def value(outcome: Outcome, metric: str) -> float:
    found = outcome.metrics[metric].value
    assert found is not None
    return found


def test_without_noise_the_force_settles_at_the_desired_one(noise_free: Outcome) -> None:
    assert value(noise_free, "force.final") == pytest.approx(5.004, abs=2e-3)
    assert value(noise_free, "force.settling_time") == pytest.approx(0.73, abs=0.03)
    assert value(noise_free, "force.settling_time_10") == pytest.approx(0.44, abs=0.02)
    assert value(noise_free, "force.within_10") == 100
    assert value(noise_free, "error.max") < 0.02
    assert value(noise_free, "band.mean") < 1e-9
    assert value(noise_free, "position.travel") == pytest.approx(4.67, abs=0.02)


def test_what_the_thesis_prints_without_noise(noise_free: Outcome) -> None:
    asked = [one for one in PUBLISHED if one.experiment == NOISE_FREE]
    assert {one.metric for one in asked} == {"force.settling_time_10", "force.final"}
    assert all(one.ok for one in check(asked, noise_free.metrics))


@pytest.mark.slow
def test_with_noise_the_thesis_observer_leaves_ten_percent(noisy: Outcome) -> None:
    assert value(noisy, "force.min") == pytest.approx(4.6, abs=0.15)
    assert value(noisy, "force.max") == pytest.approx(5.4, abs=0.15)
    assert value(noisy, "band.mean") == pytest.approx(6.97, abs=0.2)
    assert value(noisy, "force.within_10") < 100
    assert value(noisy, "position.travel") == pytest.approx(4.67, abs=0.05)
    asked = [one for one in PUBLISHED if one.experiment == NOISY]
    checks = {one.published.metric: one for one in check(asked, noisy.metrics)}
    assert set(checks) >= {"force.min", "force.max", "force.within_10", "band.mean"}
    assert all(one.published.note for one in checks.values() if not one.ok)


@pytest.mark.slow
def test_the_adaptive_observer_with_means_keeps_within_ten_percent() -> None:
    scenario = resolve_tracking(AdaptiveTrackingScenario(trials=3, duration=4.0))
    assert scenario.observer.force_noise == pytest.approx(1 / math.sqrt(10))
    outcome = UNKNOWN_SURFACE_CONTROL_ADAPTIVE.run(scenario, 0, quiet)
    assert value(outcome, "force.within_10") == 100
    assert value(outcome, "force.min") > 4.6
    assert value(outcome, "force.max") < 5.35
    assert value(outcome, "coverage") > 97
    assert value(outcome, "band.mean") < 2


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPERIMENTS)
def test_figures_and_diagrams_are_its_own(name: str, noise_free: Outcome, noisy: Outcome) -> None:
    experiment = EXPERIMENTS[name]
    scenario = experiment.resolve(experiment.scenario())
    figures = experiment.plot(scenario, noisy if name == NOISY else noise_free)
    assert set(figures) == {name}
    force, position, normal = figures[name].axes
    labels = [text.get_text() for text in force.get_legend().get_texts()]
    drawn = [label for label in labels if label.startswith("published")]
    assert drawn == (
        ["published least, 4.5 N", "published largest, 5.2 N"] if name == NOISY else []
    )
    assert position.get_ylabel() == "position / m"
    assert normal.get_xlim() == (0, 10)
    assert experiment.diagram is not None
    assert experiment.diagram(scenario).get_name() == "Control along an unknown surface"


@pytest.mark.slow
def test_nearly_all_adaptive_runs_keep_within_ten_percent() -> None:
    scenario = resolve_tracking(AdaptiveTrackingScenario(trials=30))
    with parallel(2):
        outcome = UNKNOWN_SURFACE_CONTROL_ADAPTIVE.run(scenario, 1, quiet)
    assert value(outcome, "force.within_10") >= 95
    assert "30 seeds" in outcome.metrics["force.within_10"].note
    assert value(outcome, "coverage") >= 99
    assert 0.5 < value(outcome, "nees") < 1.5
