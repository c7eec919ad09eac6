"""Observers on slides that are simulated once, against the loop and the printed equations."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.analysis.surface import normal_trials
from chamfer.analysis.surface.normal_trials import (
    Contender,
    Slide,
    contender,
    cost,
    run_trial,
    sensed,
    slide,
)
from chamfer.analysis.surface.unknown_surface import run_surface
from chamfer.diagrams.surface.surface_estimation import (
    NOISE_FREE,
    EstimationScenario,
    resolve_estimation,
)
from chamfer.diagrams.surface.surface_scenario import THESIS, ObserverSettings, SurfaceSettings
from chamfer.systems.estimation.normal_filter import Estimate, NormalStatus, Sample
from chamfer.systems.sensing.force_rate import ForceRateParams, ForceRateSensorParams

Array = NDArray[np.float64]

SCENARIO = resolve_estimation(EstimationScenario(duration=6.0))
UP = np.array([0.0, 1.0])
MEASURED = {name: name for name in ("error.rms", "error.bias", "error.max", "coverage")}


@pytest.fixture(scope="module")
def on() -> Slide:
    return slide(SCENARIO)


def test_a_slide_is_the_loops_without_noise(on: Slide) -> None:
    traces = run_surface(resolve_estimation(replace(NOISE_FREE, duration=6.0)), 0)
    rows = len(on.time)
    assert rows >= 120
    np.testing.assert_allclose(on.time, traces["time"][:rows], atol=1e-12)
    for i, axis in enumerate("xy"):
        # The force is of the surface on the gripper, what is measured the opposite.
        np.testing.assert_array_equal(on.force[:, i], -traces[f"measured_force_{axis}"][:rows])
        np.testing.assert_array_equal(on.nominal[:, i], traces[f"nominal_{axis}"][:rows])
        np.testing.assert_array_equal(on.normal[:, i], traces[f"true_normal_{axis}"][:rows])
    middle = slice(20, 110)
    rate = np.gradient(on.force, 0.05, axis=0)
    np.testing.assert_allclose(on.force_rate[middle], rate[middle], rtol=1e-3, atol=1e-3)
    np.testing.assert_allclose(on.nominal[:100, 2:], [[0.2, 0.0]] * 100, atol=1e-12)


def thesis_by_hand(on: Slide, force: Array, rate: Array) -> tuple[Array, Array]:
    """Error and band, deg, of the filter (4-18) to (4-27), as a normalised Kalman update."""
    n, P = np.array([0.0, 1.0]), 0.01 * np.eye(2)
    errors, bands = [], []
    for F, dF, nominal, truth in zip(force, rate, on.nominal, on.normal, strict=True):
        v = nominal[2:] + dF / 100.0
        P = P + (0.05 / 0.75) ** 2 * (v @ v) / 3 * np.eye(2)
        N = F - v * (v @ F) / (v @ v)
        by_force = 1.0 / (math.sqrt(3) * np.linalg.norm(N))
        by_rate = 5.0 / (100.0 * math.sqrt(3) * np.linalg.norm(v))
        by_rate *= 1 + np.linalg.norm(F - N) / np.linalg.norm(N)
        R = (by_force**2 + by_rate**2) / 3 * np.eye(2)
        S = np.linalg.inv(P + R)
        K = P @ S
        e = N / np.linalg.norm(N) - n
        raw = n + K @ e
        length = np.linalg.norm(raw)
        n = raw / length
        rest = np.eye(2) - K
        P = rest @ P @ rest.T + K @ R @ K.T + (1 - length) ** 2 / (e @ S @ e) * np.outer(n, n)
        t = np.array([-n[1], n[0]])
        errors.append(math.degrees(math.atan2(truth[0] * n[1] - truth[1] * n[0], truth @ n)))
        bands.append(3 * math.degrees(math.sqrt(t @ P @ t)))
    return np.array(errors), np.array(bands)


def test_the_thesis_observer_gives_what_its_equations_give(on: Slide) -> None:
    thesis = contender(SCENARIO, THESIS, on)
    random = np.random.default_rng(4)
    shown = sensed(on, ForceRateSensorParams(force_noise=1.0, force_rate_noise=5.0), random)
    error, band = thesis_by_hand(on, *shown)
    for window in ((2.0, 6.0), (1.0, 4.0)):
        found = run_trial(on, [thesis], MEASURED, shown, up=UP, window=window)
        rows = (on.time > window[0] - 1e-9) & (on.time < window[1] - 1e-9)
        covered = 100 * np.mean(np.abs(error) <= band, where=rows)
        assert found["error.rms"][0] == pytest.approx(math.sqrt(np.mean(error[rows] ** 2)))
        assert found["error.bias"][0] == pytest.approx(error[rows].mean())
        assert found["error.max"][0] == pytest.approx(np.abs(error[rows]).max())
        assert found["coverage"][0] == pytest.approx(covered)


def test_noise_is_what_is_asked_for(on: Slide) -> None:
    for force_noise, rate_noise in ((0.0, 0.0), (2.0, 0.0), (0.0, 5.0)):
        sensor = ForceRateSensorParams(force_noise=force_noise, force_rate_noise=rate_noise)
        force, rate = sensed(on, sensor, np.random.default_rng(0))
        off = (force - on.force, rate - on.force_rate)
        rms = [math.sqrt(np.mean(np.sum(one**2, axis=1))) for one in off]
        # Two of three axes.
        expected = math.sqrt(2 / 3) * np.array([force_noise, rate_noise])
        np.testing.assert_allclose(rms, expected, rtol=0.1)


def test_what_a_sensor_does_to_the_force() -> None:
    time = 0.05 * np.arange(200)
    force = np.stack([np.sin(time), np.cos(time)], axis=1)
    rate = np.stack([np.cos(time), -np.sin(time)], axis=1)
    on = Slide(time=time, force=force, force_rate=rate, nominal=np.zeros((200, 4)), normal=force)
    silent = ForceRateSensorParams(force_noise=0.0, force_rate_noise=0.0)
    random = np.random.default_rng(0)
    biased = replace(silent, bias=(1.0, -2.0))
    late = sensed(on, biased, random, late=3)
    np.testing.assert_allclose(late[0][3:], force[:-3] + np.array([1.0, -2.0]), rtol=0, atol=1e-15)
    np.testing.assert_array_equal(late[1][3:], rate[:-3])
    differenced = sensed(on, silent, random, differenced=ForceRateParams(time_constant=0.1))
    np.testing.assert_array_equal(differenced[0], force)
    # It lags by the filter's time constant, less half a period.
    lagging = np.cos(time[40:] - 0.1 + 0.025)
    np.testing.assert_allclose(differenced[1][40:, 0], lagging, rtol=0, atol=0.03)


def test_a_contender_is_told_the_normal_of_the_predicted_surface(on: Slide) -> None:
    seen = SurfaceSettings(coefficients=(0.04,))
    found = contender(SCENARIO, ObserverSettings(kind="prior_weights", prediction=seen), on)
    assert found.predicted is not None
    slope = 0.08 * on.nominal[:, 0]
    expected = np.stack([-slope, np.ones_like(slope)], axis=1) / np.hypot(1, slope)[:, np.newaxis]
    np.testing.assert_allclose(found.predicted, expected)
    assert contender(SCENARIO, THESIS, on).predicted is None


class Clock:
    """Each update takes what is next in the list."""

    def __init__(self, seconds: list[float]) -> None:
        self.now, self.seconds = 0.0, iter(seconds)
        self.updates = 0

    def __call__(self) -> float:
        return self.now

    def start(self, normal: Array) -> Array:
        return normal

    def update(self, memory: Array, sample: Sample) -> Estimate:
        self.updates += 1
        self.now += next(self.seconds)
        return Estimate(memory, memory, np.eye(2), NormalStatus.MEASURED)


def test_cost_is_the_least_mean_of_a_round(on: Slide, monkeypatch: pytest.MonkeyPatch) -> None:
    count = len(on.time) - len(on.time) // 2  # of a round
    clock = Clock([3.0] * count + [2.0, 4.0] * (count // 2) + [2.0] * (count % 2) + [5.0] * count)
    monkeypatch.setattr(normal_trials, "process_time", clock)
    one = Contender(filter=clock, predicted=None)
    found = cost(one, on, up=UP, updates=3 * count)
    assert clock.updates == 3 * count
    assert found == pytest.approx(3.0, rel=0.02)
    fresh = Clock([7.0] * count)
    monkeypatch.setattr(normal_trials, "process_time", fresh)
    few = cost(Contender(filter=fresh, predicted=None), on, up=UP, updates=1)
    assert few == pytest.approx(7.0)  # a round is the least
