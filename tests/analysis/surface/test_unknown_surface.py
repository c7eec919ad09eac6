"""Runs on an unknown surface: their traces, what the thesis prints of them, their figures."""

import math
from contextlib import nullcontext
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.published.hybrid_force_position import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Outcome, quiet
from chamfer.analysis.surface.normal_metrics import (
    ESTIMATION,
    TRACKING,
    estimation_metrics,
    tracking_metrics,
)
from chamfer.analysis.surface.unknown_surface import (
    Traces,
    run_surface,
    run_trials,
)
from chamfer.diagrams.surface.surface_estimation import (
    LARGE_NOISE,
    NOISE_FREE,
    SMOOTH,
    SURFACE_ESTIMATION,
    EstimationScenario,
    LeadSettings,
    resolve_estimation,
)
from chamfer.diagrams.surface.surface_scenario import (
    SurfaceSettings,
)
from chamfer.diagrams.surface.surface_tracking import (
    SURFACE_CONTROL,
    SURFACE_CONTROL_ADAPTIVE,
    SURFACE_CONTROL_NOISE_FREE,
    TrackingScenario,
    TrackingTask,
    resolve_tracking,
)

SHORT = resolve_estimation(EstimationScenario(duration=3.0, trials=5, lead=LeadSettings(halt=2.0)))
SHORT_CONTROL = resolve_tracking(TrackingScenario(duration=1.5, trials=4))
COMMON = {"nees", "time", "force", "error", "band", "change", "status", "speed", "travel"}
PER_AXIS = {"point", "nominal", "normal", "true_normal", "measured_force"}
PLANAR = {"angle", "true_angle", "instantaneous"}


IN_SPACE = EstimationScenario(duration=0.5, surface=SurfaceSettings(shape="paraboloid"))


@pytest.fixture(scope="module")
def led() -> Traces:
    return run_surface(SHORT, 3)


def test_a_row_a_period(led: Traces) -> None:
    controlled = run_surface(SHORT_CONTROL, 3)
    np.testing.assert_allclose(led["time"], 0.05 * np.arange(61), atol=1e-12)
    np.testing.assert_allclose(controlled["time"], 0.005 * np.arange(301), atol=1e-12)
    columns = {f"{name}_{axis}" for name in PER_AXIS for axis in "xy"} | COMMON | PLANAR
    assert set(led) == columns
    assert set(controlled) == columns | {"effort_x", "effort_y"}
    space = run_surface(resolve_estimation(IN_SPACE), 3)
    assert set(space) == {f"{name}_{axis}" for name in PER_AXIS for axis in "xyz"} | COMMON
    for traces in (led, controlled, space):
        assert {values.shape for values in traces.values()} == {traces["time"].shape}
    assert next(iter(led)) == "time"


def test_the_truth_fits_the_parabola(led: Traces) -> None:
    x = led["point_x"]
    np.testing.assert_allclose(led["point_y"], 0.05 * x**2, atol=1e-12)
    np.testing.assert_allclose(np.tan(np.radians(led["true_angle"])) * 0.1 * x, -1.0 * (x > 0))
    np.testing.assert_array_equal(led["travel"], x)
    speed = np.hypot(np.gradient(x, 0.05), np.gradient(led["point_y"], 0.05))
    middle = (led["time"] > 0.6) & (led["time"] < 1.9)
    np.testing.assert_allclose(led["speed"][middle], speed[middle], rtol=1e-3)


def test_the_row_has_the_force_and_the_estimate_that_its_sample_made() -> None:
    traces = run_surface(resolve_estimation(replace(NOISE_FREE, duration=2.0)), 0)
    n, point, nominal, measured = (
        np.stack([traces[f"{name}_x"], traces[f"{name}_y"]], axis=1)
        for name in ("true_normal", "point", "nominal", "measured_force")
    )
    spring = 100.0 * (point - nominal)
    np.testing.assert_allclose(traces["force"], np.sum(spring * n, axis=1), atol=1e-9)
    # What is measured is of the gripper on the surface.
    np.testing.assert_allclose(measured, -spring, atol=1e-9)
    sliding, stuck = traces["time"] > 0.549, traces["time"] < 0.499
    # Exact with this sample; the one before would be off by the turning of a period.
    assert np.abs(traces["error"][sliding]).max() < 1e-9
    assert np.diff(traces["true_angle"][sliding]).min() > 0.01
    np.testing.assert_allclose(traces["instantaneous"][sliding], traces["true_angle"][sliding])
    assert np.all(np.isnan(traces["instantaneous"][stuck]))
    assert set(traces["status"][sliding]) == {0}
    assert set(traces["status"][stuck]) == {2}
    assert not traces["speed"][stuck].any()


def test_metrics_are_those_of_the_seeds_and_traces_of_the_first() -> None:
    loop = {"loop.growth_contact", "loop.gain_margin", "loop.delay_margin"}
    scenario = replace(SHORT_CONTROL, task=TrackingTask(force=4.0))
    for short, seed, names, measure in (
        (SHORT, 2, set(ESTIMATION), partial(estimation_metrics, halt=2.0)),
        (scenario, 0, set(TRACKING) | loop, partial(tracking_metrics, force=4.0, every=10)),
    ):
        expects = pytest.warns(UserWarning, match="^task.force is 4 N, in one of 20 runs")
        with nullcontext() if short is SHORT else expects:
            outcome = run_trials(short, seed, quiet)
        assert set(outcome.metrics) == names
        assert outcome.simulated_seconds == pytest.approx(short.trials * short.duration)
        runs = [run_surface(short, trial_seed(seed, trial)) for trial in range(short.trials)]
        for name, values in runs[0].items():
            np.testing.assert_array_equal(outcome.traces[name], values)
        measured = [measure(traces) for traces in runs]
        for name in {"band.mean", "force.min", "force.within_10"} & names:
            expected = np.mean([one[name] for one in measured])
            assert outcome.metrics[name].value == pytest.approx(expected), name
        pooled = "drift_after_halt" if short is SHORT else "error.rms"
        squares = [float(one[pooled] or 0.0) ** 2 for one in measured]
        assert outcome.metrics[pooled].value == pytest.approx(math.sqrt(np.mean(squares)))
        assert len(set(squares)) == short.trials


SEEDS = 4
ESTIMATIONS = {
    "surface-estimation": SURFACE_ESTIMATION,
    "surface-estimation-smooth": SMOOTH,
    "surface-estimation-noise-free": NOISE_FREE,
    "surface-estimation-large-noise": LARGE_NOISE,
}


@pytest.fixture(scope="module")
def outcomes() -> dict[str, Outcome]:
    found = {}
    for name, scenario in ESTIMATIONS.items():
        few = resolve_estimation(replace(scenario, trials=min(scenario.trials, SEEDS)))
        found[name] = run_trials(few, 0, quiet)
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", ESTIMATIONS)
def test_what_the_thesis_prints_is_measured(name: str, outcomes: dict[str, Outcome]) -> None:
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


def test_a_sharp_bound_on_the_curvature_gives_six_degrees(
    outcomes: dict[str, Outcome], value: Any
) -> None:
    outcome = outcomes["surface-estimation"]
    assert value(outcome, "band.equilibrium") == pytest.approx(6.06, abs=0.3)
    assert value(outcome, "band.mean") == pytest.approx(6.16, abs=0.3)
    assert value(outcome, "breakaway_time") == pytest.approx(0.5, abs=1e-9)
    assert value(outcome, "error.rms") == pytest.approx(2.44, abs=0.4)
    assert value(outcome, "error.bias") == pytest.approx(1.93, abs=0.4)
    assert value(outcome, "coverage") > 97
    # As printed the filter drifts while the gripper is at rest: reference 7.4 deg over 200 seeds.
    assert 3.5 < value(outcome, "drift_after_halt") < 13.0


def test_without_noise_the_estimate_is_exact(outcomes: dict[str, Outcome], value: Any) -> None:
    outcome = outcomes["surface-estimation-noise-free"]
    for metric in ("error.max", "band.mean", "band.final", "band.equilibrium"):
        assert value(outcome, metric) < 1e-9
    for metric in ("drift_after_halt", "band_after_halt"):
        assert value(outcome, metric) == 0
    assert value(outcome, "estimate.change") == pytest.approx(13.38, abs=0.1)
    assert value(outcome, "coverage") == 100
    assert outcome.metrics["coverage"].note == ""  # one seed is enough


def test_a_useless_sensor_is_not_used(outcomes: dict[str, Outcome], value: Any) -> None:
    outcome = outcomes["surface-estimation-large-noise"]
    assert value(outcome, "band.final") == pytest.approx(19.8, abs=0.5)
    assert value(outcome, "estimate.change") < 0.01
    assert outcome.traces["time"][-1] == pytest.approx(3.5)
    # Uncertainty is that of the first estimate until the contact point slides.
    band = outcome.traces["band"]
    assert band[9] == pytest.approx(17.3, abs=0.3)
    assert np.all(np.diff(band) > 0)
    assert outcome.metrics["drift_after_halt"].value is None


def test_without_noise_the_force_settles_at_the_desired_one(value: Any) -> None:
    noise_free = run_trials(resolve_tracking(SURFACE_CONTROL_NOISE_FREE), 0, quiet)
    assert value(noise_free, "force.final") == pytest.approx(5.004, abs=2e-3)
    assert value(noise_free, "force.settling_time") == pytest.approx(0.73, abs=0.03)
    assert value(noise_free, "force.settling_time_10") == pytest.approx(0.44, abs=0.02)
    assert value(noise_free, "force.within_10") == 100
    assert value(noise_free, "error.max") < 0.02
    assert value(noise_free, "band.mean") < 1e-9
    assert value(noise_free, "position.travel") == pytest.approx(4.67, abs=0.02)


@pytest.mark.slow
def test_with_noise_the_thesis_observer_leaves_ten_percent(value: Any) -> None:
    with pytest.warns(UserWarning, match="% with observer.kind=adaptive observer.average=10$"):
        noisy = run_trials(resolve_tracking(replace(SURFACE_CONTROL, trials=3)), 0, quiet)
    assert value(noisy, "force.min") == pytest.approx(4.6, abs=0.15)
    assert value(noisy, "force.max") == pytest.approx(5.4, abs=0.15)
    assert value(noisy, "band.mean") == pytest.approx(6.97, abs=0.2)
    assert value(noisy, "force.within_10") < 100
    assert value(noisy, "position.travel") == pytest.approx(4.67, abs=0.05)
    asked = [one for one in PUBLISHED if one.experiment == "unknown-surface-control"]
    checks = {one.published.metric: one for one in check(asked, noisy.metrics)}
    assert set(checks) >= {"force.min", "force.max", "force.within_10", "band.mean"}
    assert all(one.published.note for one in checks.values() if not one.ok)


@pytest.mark.slow
def test_the_adaptive_observer_with_means_keeps_within_ten_percent(value: Any) -> None:
    scenario = resolve_tracking(replace(SURFACE_CONTROL_ADAPTIVE, trials=3, duration=4.0))
    assert scenario.observer.force_noise == pytest.approx(1 / math.sqrt(10))
    outcome = run_trials(scenario, 0, quiet)
    assert value(outcome, "force.within_10") == 100
    assert value(outcome, "force.min") > 4.6
    assert value(outcome, "force.max") < 5.35
    assert value(outcome, "coverage") > 97
    assert value(outcome, "band.mean") < 3.5  # wide enough for bends that may come
