from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from chamfer.analysis.contact.planar_contact import PLANAR_HOLD, PLANAR_SLIDE

from chamfer.analysis.published.hybrid_force_position import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Metric, Outcome
from chamfer.diagrams.contact.contact_scenarios import PlanarScenario, PlanarSlideScenario
from chamfer.diagrams.contact.hybrid_loop_stability import resolve


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


@pytest.mark.slow
def test_fig_2_5_is_reproduced(hold: Outcome) -> None:
    assert failed("planar-hold", hold.metrics) == set()
    assert hold.metrics["force.final"].value == pytest.approx(15.0, abs=1e-2)
    assert hold.metrics["impact.speed"].value == pytest.approx(0.33, rel=0.05)
    # The approach is faster than what appendix C calls safe.
    share = hold.metrics["damage.safe_speed_share"].value
    assert share is not None
    assert share > 100


@pytest.mark.slow
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


def test_without_the_sinusoid_the_slide_holds() -> None:
    slide = PlanarSlideScenario(duration=1.0)
    hold = PlanarScenario(duration=1.0)
    still = replace(slide, task=replace(slide.task, amplitude=0.0))
    outcomes = [PLANAR_SLIDE.run(resolve(one), 0, quiet) for one in (still, hold)]
    for name, values in outcomes[0].traces.items():
        np.testing.assert_array_equal(values, outcomes[1].traces[name])
