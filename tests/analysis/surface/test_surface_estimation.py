"""Section 5.2 at the thesis' parameters."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.published.hybrid_force_position import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Experiment, Outcome, load, select
from chamfer.diagrams.surface.surface_estimation import EstimationScenario
from chamfer.systems.estimation.surface_observer import Kind


def loaded(name: str) -> Experiment[Any]:
    return load(select(CATALOGUE.entries, [name])[0])


SURFACE_ESTIMATION = loaded("surface-estimation")
SURFACE_ESTIMATION_LARGE_NOISE = load(
    select(CATALOGUE.entries, ["surface-estimation-large-noise"])[0]
)
SURFACE_ESTIMATION_NOISE_FREE = load(
    select(CATALOGUE.entries, ["surface-estimation-noise-free"])[0]
)
SURFACE_ESTIMATION_SMOOTH = loaded("surface-estimation-smooth")

Name = str
SEEDS = 4
EXPERIMENTS: dict[Name, Experiment[EstimationScenario]] = {
    "surface-estimation": SURFACE_ESTIMATION,
    "surface-estimation-smooth": SURFACE_ESTIMATION_SMOOTH,  # type: ignore[dict-item]
    "surface-estimation-noise-free": SURFACE_ESTIMATION_NOISE_FREE,  # type: ignore[dict-item]
    "surface-estimation-large-noise": SURFACE_ESTIMATION_LARGE_NOISE,  # type: ignore[dict-item]
}


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


@pytest.fixture(scope="module")
def outcomes() -> dict[Name, Outcome]:
    found = {}
    for name, experiment in EXPERIMENTS.items():
        scenario = experiment.resolve(experiment.scenario())
        few = replace(scenario, trials=min(scenario.trials, SEEDS))
        found[name] = experiment.run(few, 0, quiet)
    return found


def value(outcome: Outcome, metric: str) -> float:
    found = outcome.metrics[metric].value
    assert found is not None
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", EXPERIMENTS)
def test_what_the_thesis_prints_is_measured(name: Name, outcomes: dict[Name, Outcome]) -> None:
    asked = [one for one in PUBLISHED if one.experiment == name]
    assert asked
    checks = check(asked, outcomes[name].metrics)
    assert len(checks) == len(asked)
    failed = {one.published.metric for one in checks if not one.ok}
    # With so few seeds the coverage of the first may be on either side of 99 %.
    known = {
        "surface-estimation": {"drift_after_halt"},
        "surface-estimation-smooth": {"coverage"},
    }.get(name, set())
    assert failed - ({"coverage"} if name == "surface-estimation" else set()) == known
    assert all(one.published.note for one in checks if not one.ok)


def test_a_sharp_bound_on_the_curvature_gives_six_degrees(outcomes: dict[Name, Outcome]) -> None:
    outcome = outcomes["surface-estimation"]
    assert value(outcome, "band.equilibrium") == pytest.approx(6.06, abs=0.3)
    assert value(outcome, "band.mean") == pytest.approx(6.16, abs=0.3)
    assert value(outcome, "breakaway_time") == pytest.approx(0.5, abs=1e-9)
    assert value(outcome, "error.rms") == pytest.approx(2.44, abs=0.4)
    assert value(outcome, "error.bias") == pytest.approx(1.93, abs=0.4)
    assert value(outcome, "coverage") > 97
    # As printed the filter drifts while the gripper is at rest: reference 7.4 deg over 200 seeds.
    assert 3.5 < value(outcome, "drift_after_halt") < 13.0


def test_the_bound_of_the_surface_gives_three_degrees(outcomes: dict[Name, Outcome]) -> None:
    outcome = outcomes["surface-estimation-smooth"]
    assert value(outcome, "band.mean") == pytest.approx(3.0, abs=0.3)
    assert value(outcome, "band.equilibrium") == pytest.approx(2.29, abs=0.1)
    assert value(outcome, "error.bias") < 0  # it lags
    assert value(outcome, "coverage") < 90


def test_without_noise_the_estimate_is_exact(outcomes: dict[Name, Outcome]) -> None:
    outcome = outcomes["surface-estimation-noise-free"]
    for metric in ("error.max", "band.mean", "band.final", "band.equilibrium"):
        assert value(outcome, metric) < 1e-9
    for metric in ("drift_after_halt", "band_after_halt"):
        assert value(outcome, metric) == 0
    assert value(outcome, "estimate.change") == pytest.approx(13.38, abs=0.1)
    assert value(outcome, "coverage") == 100
    assert outcome.metrics["coverage"].note == ""  # one seed is enough


def test_a_useless_sensor_is_not_used(outcomes: dict[Name, Outcome]) -> None:
    outcome = outcomes["surface-estimation-large-noise"]
    assert value(outcome, "band.final") == pytest.approx(19.8, abs=0.5)
    assert value(outcome, "estimate.change") < 0.01
    assert outcome.traces["time"][-1] == pytest.approx(3.5)
    # Uncertainty is that of the first estimate until the contact point slides.
    band = outcome.traces["band"]
    assert band[9] == pytest.approx(17.3, abs=0.3)
    assert np.all(np.diff(band) > 0)
    assert outcome.metrics["drift_after_halt"].value is None


@pytest.mark.parametrize("kind", ["gated", "adaptive"])
def test_corrected_observers_stay_where_they_are_after_the_halt(kind: Kind) -> None:
    scenario = SURFACE_ESTIMATION.default
    scenario = replace(scenario, observer=replace(scenario.observer, kind=kind), trials=2)
    outcome = SURFACE_ESTIMATION.run(SURFACE_ESTIMATION.resolve(scenario), 0, quiet)
    assert value(outcome, "drift_after_halt") == 0
    assert value(outcome, "band_after_halt") == 0
    assert value(outcome, "breakaway_time") == pytest.approx(0.5, abs=1e-9)
    assert value(outcome, "error.rms") < (3.5 if kind == "gated" else 2.0)


@pytest.mark.parametrize("name", EXPERIMENTS)
def test_figures_and_diagrams_are_its_own(name: Name, outcomes: dict[Name, Outcome]) -> None:
    experiment = EXPERIMENTS[name]
    scenario = experiment.resolve(experiment.scenario())
    figures = experiment.plot(scenario, outcomes[name])
    assert set(figures) == {name}
    (_, normal) = figures[name].axes
    labels = {text.get_text() for text in normal.get_legend().get_texts()}
    printed = {
        "surface-estimation": "published band, ±6°",
        "surface-estimation-smooth": "published band, ±3°",
        "surface-estimation-large-noise": "published band, ±20°",
    }
    assert {label for label in labels if label.startswith("published")} == (
        {printed[name]} if name in printed else set()
    )
    assert experiment.diagram is not None
    assert experiment.diagram(scenario).get_name() == "Surface estimation"
