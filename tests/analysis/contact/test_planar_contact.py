from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest

from analysis.contact.planar_contact import PLANAR_HOLD, PLANAR_SLIDE
from analysis.published.hybrid_force_position import PUBLISHED
from analysis.run.checks import check
from analysis.run.experiment import Metric, Outcome
from analysis.run.registry import find, load, select
from diagrams.contact.hybrid_scenario import resolve
from diagrams.contact.planar_scenarios import PlanarScenario, PlanarSlideScenario

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


def failed(name: str, metrics: Mapping[str, Metric]) -> set[str]:
    values = [value for value in PUBLISHED if value.experiment == name]
    assert values
    return {c.published.metric for c in check(values, metrics) if not c.ok}


@pytest.fixture(scope="module")
def hold() -> Outcome:
    return PLANAR_HOLD.run(resolve(PlanarScenario()), 0, quiet)


@pytest.fixture(scope="module")
def slide() -> Outcome:
    return PLANAR_SLIDE.run(resolve(PlanarSlideScenario()), 0, quiet)


@pytest.mark.parametrize("name", ["planar-hold", "planar-slide"])
def test_the_registry_finds_them(name: str) -> None:
    (entry,) = select(find(), [name])
    assert entry.paper == "hybrid-force-position"
    experiment = load(entry)
    assert experiment.name == name
    assert experiment.scenario().duration > 10


def test_fig_2_5_is_reproduced(hold: Outcome) -> None:
    assert failed("planar-hold", hold.metrics) == set()
    assert hold.metrics["force.final"].value == pytest.approx(15.0, abs=1e-2)
    assert hold.metrics["impact.speed"].value == pytest.approx(0.33, rel=0.05)
    # The approach is faster than what appendix C calls safe.
    share = hold.metrics["damage.safe_speed_share"].value
    assert share is not None
    assert share > 100


def test_fig_2_6_is_reproduced(slide: Outcome) -> None:
    assert failed("planar-slide", slide.metrics) == set()
    value = {name: metric.value for name, metric in slide.metrics.items()}
    assert value["force.deviation"] == pytest.approx(0.5, abs=0.05)
    assert value["position.lag_error"] == pytest.approx(0.003, abs=3e-4)


def test_the_lag_is_damping_over_stiffness(slide: Outcome) -> None:
    # A w Kd / Kp, plus friction
    lag = 0.02 * 1.0 * 60 / 400
    assert slide.metrics["position.lag_error"].value == pytest.approx(lag, rel=0.1)


def test_the_sinusoid_has_its_amplitude_and_frequency(slide: Outcome) -> None:
    time, x = slide.traces["time"], slide.traces["desired_x"] - 1.0
    contact = slide.metrics["contact_time"].value
    assert contact is not None
    late = (time > contact + 0.5) & (time < 19.9)
    np.testing.assert_allclose(x[late], 0.02 * np.sin(time[late] - contact), atol=1.5e-4)
    assert np.ptp(slide.traces["x"][late]) == pytest.approx(0.04, rel=0.1)


def test_metrics_traces_and_tables(hold: Outcome, slide: Outcome) -> None:
    for outcome in (hold, slide):
        assert set(outcome.metrics) >= METRICS
        assert len({len(values) for values in outcome.traces.values()}) == 1
        assert not outcome.tables
    assert hold.simulated_seconds == 12.0
    assert slide.simulated_seconds == 20.0


def test_figures_diagram_and_charts(hold: Outcome) -> None:
    scenario = resolve(PlanarScenario())
    assert set(PLANAR_HOLD.plot(scenario, hold)) == {"planar-hold"}
    assert PLANAR_HOLD.diagram is not None
    assert PLANAR_HOLD.charts is not None
    assert PLANAR_HOLD.diagram(scenario).num_output_ports() == 7
    assert len(PLANAR_HOLD.charts(scenario)) == 1


def test_each_figure_has_its_experiments_name(slide: Outcome) -> None:
    assert set(PLANAR_SLIDE.plot(resolve(PlanarSlideScenario()), slide)) == {"planar-slide"}


def test_without_the_sinusoid_the_slide_holds() -> None:
    slide = PlanarSlideScenario(duration=1.0)
    hold = PlanarScenario(duration=1.0)
    still = replace(slide, task=replace(slide.task, amplitude=0.0))
    outcomes = [PLANAR_SLIDE.run(resolve(one), 0, quiet) for one in (still, hold)]
    for name, values in outcomes[0].traces.items():
        np.testing.assert_array_equal(values, outcomes[1].traces[name])
