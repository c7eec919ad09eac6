"""Traces of the runs on an unknown surface, and the campaigns of many seeds."""

from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.campaign.campaign import parallel
from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.surface.normal_metrics import (
    ESTIMATION,
    TRACKING,
    estimation_metrics,
    tracking_metrics,
)
from chamfer.analysis.surface.unknown_surface import (
    Traces,
    run_estimation,
    run_estimation_trials,
    run_tracking,
    run_tracking_trials,
)
from chamfer.diagrams.surface.surface_estimation import (
    EstimationScenario,
    LeadSettings,
    NoiseFreeEstimationScenario,
    resolve_estimation,
)
from chamfer.diagrams.surface.surface_scenario import Shape, SurfaceSettings
from chamfer.diagrams.surface.surface_tracking import (
    NoiseFreeTrackingScenario,
    TrackingScenario,
    TrackingTask,
    resolve_tracking,
)

LED = resolve_estimation(EstimationScenario(duration=3.0, trials=5, lead=LeadSettings(halt=2.0)))
CONTROLLED = resolve_tracking(TrackingScenario(duration=1.5, trials=4))
COMMON = {"nees", "time", "force", "error", "band", "change", "status", "speed", "travel"}
PER_AXIS = {"point", "nominal", "normal", "true_normal", "measured_force"}
PLANAR = {"angle", "true_angle", "instantaneous"}


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


IN_SPACE = EstimationScenario(duration=0.5, surface=SurfaceSettings(shape="paraboloid"))


@pytest.fixture(scope="module")
def led() -> Traces:
    return run_estimation(LED, 3)


@pytest.fixture(scope="module")
def controlled() -> Traces:
    return run_tracking(CONTROLLED, 3)


def test_a_row_a_period(led: Traces, controlled: Traces) -> None:
    np.testing.assert_allclose(led["time"], 0.05 * np.arange(61), atol=1e-12)
    np.testing.assert_allclose(controlled["time"], 0.005 * np.arange(301), atol=1e-12)
    columns = {f"{name}_{axis}" for name in PER_AXIS for axis in "xy"} | COMMON | PLANAR
    assert set(led) == columns
    assert set(controlled) == columns | {"effort_x", "effort_y"}
    space = run_estimation(resolve_estimation(IN_SPACE), 3)
    assert set(space) == {f"{name}_{axis}" for name in PER_AXIS for axis in "xyz"} | COMMON
    for traces in (led, controlled, space):
        assert {values.shape for values in traces.values()} == {traces["time"].shape}
    assert next(iter(led)) == "time"


@pytest.mark.parametrize("samples", [10, 11, 16, 23, 33])
def test_the_last_row_is_that_of_the_end(samples: int) -> None:
    # Some of these are a little more, some a little less than a whole number of periods.
    led = run_estimation(replace(LED, duration=round(0.05 * samples, 2)), 0)
    assert led["time"][-1] == pytest.approx(0.05 * samples)
    between = run_estimation(replace(LED, duration=0.05 * samples + 0.04), 0)
    assert between["time"][-1] == led["time"][-1]


def test_angles_fit_the_normals(led: Traces, controlled: Traces) -> None:
    for traces in (led, controlled):
        for angle, name in (("angle", "normal"), ("true_angle", "true_normal")):
            radians = np.radians(traces[angle])
            np.testing.assert_allclose(np.cos(radians), traces[f"{name}_x"], atol=1e-12)
            np.testing.assert_allclose(np.sin(radians), traces[f"{name}_y"], atol=1e-12)
        np.testing.assert_allclose(traces["error"], traces["angle"] - traces["true_angle"])
        np.testing.assert_allclose(traces["change"], traces["angle"] - 90.0, atol=1e-12)


def test_the_truth_fits_the_parabola(led: Traces) -> None:
    x = led["point_x"]
    np.testing.assert_allclose(led["point_y"], 0.05 * x**2, atol=1e-12)
    np.testing.assert_allclose(np.tan(np.radians(led["true_angle"])) * 0.1 * x, -1.0 * (x > 0))
    np.testing.assert_array_equal(led["travel"], x)
    np.testing.assert_allclose(led["nominal_x"], 0.2 * np.minimum(led["time"], 2.0), atol=1e-12)
    np.testing.assert_allclose(led["nominal_y"], -0.1, atol=1e-12)
    speed = np.hypot(np.gradient(x, 0.05), np.gradient(led["point_y"], 0.05))
    middle = (led["time"] > 0.6) & (led["time"] < 1.9)
    np.testing.assert_allclose(led["speed"][middle], speed[middle], rtol=1e-3)


def test_the_force_is_the_true_one_along_the_true_normal() -> None:
    traces = run_estimation(resolve_estimation(NoiseFreeEstimationScenario(duration=2.0)), 0)
    n = np.stack([traces["true_normal_x"], traces["true_normal_y"]], axis=1)
    spring = 100.0 * np.stack(
        [
            traces["point_x"] - traces["nominal_x"],
            traces["point_y"] - traces["nominal_y"],
        ],
        axis=1,
    )
    np.testing.assert_allclose(traces["force"], np.sum(spring * n, axis=1), atol=1e-9)
    # What is measured is of the gripper on the surface.
    np.testing.assert_allclose(traces["measured_force_x"], -spring[:, 0], atol=1e-9)
    np.testing.assert_allclose(traces["measured_force_y"], -spring[:, 1], atol=1e-9)


def test_the_row_has_the_estimate_that_its_sample_made() -> None:
    traces = run_estimation(resolve_estimation(NoiseFreeEstimationScenario(duration=2.0)), 0)
    sliding = traces["time"] > 0.549
    # Exact with this sample; the one before would be off by the turning of a period.
    assert np.abs(traces["error"][sliding]).max() < 1e-9
    assert np.diff(traces["true_angle"][sliding]).min() > 0.01
    np.testing.assert_allclose(traces["instantaneous"][sliding], traces["true_angle"][sliding])
    assert np.all(traces["status"][sliding] == 0)
    stuck = traces["time"] < 0.499
    assert np.all(np.isnan(traces["instantaneous"][stuck]))
    assert np.all(traces["status"][stuck] == 2)
    assert np.all(traces["speed"][stuck] == 0)


def test_the_band_is_of_three_standard_deviations() -> None:
    useless = replace(LED.observer, force_rate_noise=1e12)
    traces = run_estimation(replace(LED, observer=useless), 0)
    # Nothing is learnt from the first sample: the initial 0.1 rad and what the surface may turn.
    # It sticks, so that only noise of 0.03 m/s an axis seems to move it.
    turned = 0.1 * 0.05 / 0.75
    least, most = (3 * np.degrees(np.hypot(0.1, one)) for one in (0.0, turned))
    assert least < traces["band"][0] < most


def test_the_normal_force_in_contact_is_what_the_controller_sees(controlled: Traces) -> None:
    n = np.stack([controlled["true_normal_x"], controlled["true_normal_y"]], axis=1)
    measured = np.stack([controlled["measured_force_x"], controlled["measured_force_y"]], axis=1)
    noise = controlled["force"] + np.sum(measured * n, axis=1)
    assert abs(noise.mean()) < 0.15
    assert noise.std() == pytest.approx(1 / np.sqrt(3), rel=0.15)


@pytest.mark.parametrize("shape", ["parabola", "sphere"])
def test_a_seed_fixes_every_byte(shape: Shape) -> None:
    surface = SurfaceSettings(shape=shape)
    led = resolve_estimation(EstimationScenario(surface=surface, duration=1.0))
    controlled = resolve_tracking(TrackingScenario(surface=surface, duration=0.5))
    for run, scenario in ((run_estimation, led), (run_tracking, controlled)):
        one, same, other = (run(scenario, seed) for seed in (7, 7, 8))  # type: ignore[operator]
        assert {name for name in one if one[name].tobytes() != same[name].tobytes()} == set()
        unlike = {name for name in one if one[name].tobytes() != other[name].tobytes()}
        assert {"measured_force_x", "error", "band", "normal_x"} <= unlike
        if run is run_tracking:
            assert {"force", "point_x", "nominal_x", "effort_x"} <= unlike


def test_without_noise_the_seed_does_not_matter() -> None:
    scenario = resolve_tracking(NoiseFreeTrackingScenario(duration=0.5))
    one, other = (run_tracking(scenario, seed) for seed in (0, 1))
    for name, values in one.items():
        np.testing.assert_array_equal(values, other[name])


@pytest.mark.slow
def test_campaigns_do_not_depend_on_the_number_of_processes() -> None:
    runs = []
    for workers in (1, 2):
        with parallel(workers):
            runs.append(run_tracking_trials(CONTROLLED, 1, quiet))
    one, two = runs
    assert one.metrics == two.metrics
    assert list(one.traces) == list(two.traces)
    for name, values in one.traces.items():
        assert values.tobytes() == two.traces[name].tobytes()
    assert one.simulated_seconds == two.simulated_seconds == pytest.approx(4 * 1.5)


def test_metrics_are_those_of_the_seeds_and_traces_of_the_first() -> None:
    outcome = run_estimation_trials(LED, 2, quiet)
    assert set(outcome.metrics) == set(ESTIMATION)
    assert outcome.simulated_seconds == pytest.approx(5 * 3.0)
    runs = [run_estimation(LED, trial_seed(2, trial)) for trial in range(5)]
    measured = [estimation_metrics(traces, halt=2.0) for traces in runs]
    for name, values in runs[0].items():
        np.testing.assert_array_equal(outcome.traces[name], values)
    final = np.array([one["band.final"] for one in measured], dtype=float)
    assert outcome.metrics["band.final"].value == pytest.approx(final.mean())
    drift = np.array([one["drift_after_halt"] for one in measured], dtype=float)
    assert outcome.metrics["drift_after_halt"].value == pytest.approx(np.sqrt(np.mean(drift**2)))
    assert len(set(drift)) == 5
    assert "5 seeds" in outcome.metrics["drift_after_halt"].note


def test_metrics_of_controlled_runs() -> None:
    scenario = replace(CONTROLLED, task=TrackingTask(force=4.0))
    outcome = run_tracking_trials(scenario, 0, quiet)
    loop = {"loop.growth_contact", "loop.gain_margin", "loop.delay_margin"}
    assert set(outcome.metrics) == set(TRACKING) | loop
    runs = [run_tracking(scenario, trial_seed(0, trial)) for trial in range(4)]
    measured = [tracking_metrics(traces, force=4.0, every=10) for traces in runs]
    for name in ("force.min", "force.max", "force.final", "band.mean", "force.within_10"):
        values = np.array([one[name] for one in measured], dtype=float)
        assert outcome.metrics[name].value == pytest.approx(values.mean()), name
    assert outcome.metrics["force.final"].value == pytest.approx(4.0, rel=0.1)
    errors = np.array([one["error.rms"] for one in measured], dtype=float)
    assert outcome.metrics["error.rms"].value == pytest.approx(np.sqrt(np.mean(errors**2)))
