"""The arms find their walls, hold the force along them, and find them again."""

from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.surface.unknown_wall import (
    run_wall,
    run_wall_trials,
    wall_metrics,
)
from chamfer.diagrams.surface.unknown_wall_loop import (
    ADEPT_WALL,
    PLANAR_WALL,
    PUMA_WALL,
    UnknownWallScenario,
    resolve_wall,
)


@pytest.mark.slow
def test_the_adept_finds_its_wall_and_loses_and_finds_it_again() -> None:
    task = replace(ADEPT_WALL.task, kick_time=3.0)
    scenario = resolve_wall(replace(ADEPT_WALL, task=task, duration=4.5, measure_after=2.5))
    traces = run_wall(scenario, seed=3)
    found = wall_metrics(traces, force=5.0, after=2.5, kick=3.0, impact_limit=0.44)
    assert found["error.start"] > 8  # type: ignore[operator]
    assert found["error.max"] < 4  # type: ignore[operator]
    assert (found["contact.losses"], found["contact.losses_seen"]) == (0, 1)  # it is planned
    assert found["recontact.speed"] < 0.2  # type: ignore[operator]
    assert 4.5 < found["force.min"] <= found["force.max"] < 5.5  # type: ignore[operator]
    normals = np.stack([traces[f"true_normal_{axis}"] for axis in "xyz"])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=0), 1, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    "scenario",
    [ADEPT_WALL, PUMA_WALL, PLANAR_WALL],
    ids=lambda one: one.ARM.name,
)
def test_every_arm_holds_the_force_as_in_fig_5_8(scenario: UnknownWallScenario) -> None:
    resolved = resolve_wall(replace(scenario, trials=1))
    outcome = run_wall_trials(resolved, 7, lambda fraction, doing="": None)
    values = {name: metric.value for name, metric in outcome.metrics.items()}
    assert 4.5 < values["force.min"] <= values["force.max"] < 5.4  # type: ignore[operator]
    assert values["error.rms"] < 2  # type: ignore[operator]
    assert values["damage.safe_speed_share"] < 100  # type: ignore[operator]


Array = np.ndarray
STEP = 0.01


def made(**changes: Array) -> dict[str, Array]:
    """Contact at 1 s, 5 N from 1.5 s on; a blow at 6 s, contact again at 6.5 s, 5 N at 7 s."""
    time = STEP * np.arange(1001)
    mode = np.where(time < 1, 0.0, 1.0)
    mode[(time > 6.005) & (time < 6.495)] = 2.0
    force = np.where(time < 1, 0.0, np.minimum(10 * (time - 1) + 0.01, 5.0))
    away = (time > 6.005) & (time < 6.495)
    force = np.where(time > 6.495, np.minimum(10 * (time - 6.5), 5.0), force)
    force[away] = 0.0
    impact = np.zeros_like(time)
    impact[100], impact[650] = 0.05, 0.08
    traces = {
        "time": time,
        "mode": mode,
        "force": force,
        "error": np.full_like(time, 2.0),
        "band": np.full_like(time, 3.0),
        "curvature": np.where((time > 4) & (time < 5), 2.0, 0.5) + 7.0 * away,
        "travel": 0.1 * np.maximum(time - 1, 0),
        "peak_force": force,
        "impact_speed": impact,
    }
    return traces | changes


def measured(kick: float | None = 6.0, **changes: Array) -> dict[str, float | None]:
    return wall_metrics(made(**changes), force=5.0, after=3.0, kick=kick, impact_limit=0.44)


def test_a_run_with_a_blow() -> None:
    found = measured()
    assert found["contact_time"] == pytest.approx(1.0)
    assert found["force.settling_time_10"] == pytest.approx(0.45)
    assert found["force.min"] == found["force.max"] == 5.0
    assert found["force.within_10"] == 100
    assert (found["contact.losses"], found["contact.losses_seen"]) == (0, 1)
    assert found["contact.share"] == found["contact.settled_share"] == 100
    assert found["loss.duration"] == pytest.approx(0.5)
    assert found["recontact.speed"] == 0.08
    assert found["recontact.settling_time_10"] == pytest.approx(0.45)
    assert found["impact.speed"] == 0.05
    assert found["damage.safe_speed_share"] == pytest.approx(40)
    assert found["damage.impact_share"] == pytest.approx(100 * 0.08 / 0.44)
    assert found["position.travel"] == pytest.approx(0.9)
    assert found["wall.smallest_radius"] == 0.5
    assert (found["error.rms"], found["error.max"], found["coverage"]) == (2.0, 2.0, 100)


def test_a_contact_that_is_lost_without_a_blow_counts() -> None:
    found = measured(kick=None)
    assert (found["force.min"], found["force.within_10"]) == (0, 0)
    assert found["contact.losses"] == 1
    assert found["loss.duration"] is None
    assert found["force.settling_time_10"] == pytest.approx(5.95)


def test_a_return_that_never_comes() -> None:
    mode, force = made()["mode"].copy(), made()["force"].copy()
    mode[601:], force[601:] = 2, 0.0
    found = measured(mode=mode, force=force)
    assert found["loss.duration"] is None
    assert found["recontact.settling_time_10"] is None
    assert (found["force.min"], found["force.within_10"]) == (0.0, 0.0)


def test_errors_count_while_something_is_touched() -> None:
    error = np.full(1001, 2.0)
    error[:150], error[601:650], error[400:410] = 90.0, 90.0, 4.0
    found = measured(error=error)
    assert found["error.max"] == 4.0
    rows = (600 - 300) + (1001 - 750)
    assert found["coverage"] == pytest.approx(100 * (1 - 10 / rows), abs=0.05)
    assert found["error.start"] == 90


def test_no_contact_at_all() -> None:
    zero = np.zeros(1001)
    found = measured(mode=zero, force=zero, peak_force=zero, impact_speed=zero)
    assert found["contact_time"] is None
    assert found["force.min"] is None
    assert (found["contact.losses"], found["contact.losses_seen"]) == (None, 0)
