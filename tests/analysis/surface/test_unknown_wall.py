"""The arms find their walls, hold the force along them, and find them again."""

from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.surface.unknown_wall import (
    plot_wall,
    run_wall,
    run_wall_trials,
    wall_metrics,
)
from chamfer.diagrams.surface.unknown_wall_loop import (
    AdeptUnknownWallScenario,
    PlanarUnknownWallScenario,
    PumaUnknownWallScenario,
    UnknownWallScenario,
    resolve_wall,
)


@pytest.mark.slow
def test_the_adept_finds_its_wall_and_loses_and_finds_it_again() -> None:
    scenario = AdeptUnknownWallScenario()
    task = replace(scenario.task, kick_time=3.0)
    scenario = resolve_wall(replace(scenario, task=task, duration=4.5, measure_after=2.5))
    traces = run_wall(scenario, seed=3)
    found = wall_metrics(traces, force=5.0, after=2.5, kick=3.0, impact_limit=0.44)
    assert found["error.start"] > 8  # type: ignore[operator]
    assert found["error.max"] < 4  # type: ignore[operator]
    assert found["contact.losses"] == 1
    assert found["recontact.speed"] < 0.2  # type: ignore[operator]
    assert 4.5 < found["force.min"] <= found["force.max"] < 5.5  # type: ignore[operator]
    normals = np.stack([traces[f"true_normal_{axis}"] for axis in "xyz"])
    np.testing.assert_allclose(np.linalg.norm(normals, axis=0), 1, atol=1e-12)


@pytest.mark.slow
@pytest.mark.parametrize(
    "scenario",
    [AdeptUnknownWallScenario(), PumaUnknownWallScenario(), PlanarUnknownWallScenario()],
    ids=lambda one: one.ARM.name,
)
def test_every_arm_holds_the_force_as_in_fig_5_8(scenario: UnknownWallScenario) -> None:
    scenario = resolve_wall(replace(scenario, trials=1))
    outcome = run_wall_trials(scenario, 7, lambda fraction, doing="": None)
    values = {name: metric.value for name, metric in outcome.metrics.items()}
    assert 4.5 < values["force.min"] <= values["force.max"] < 5.4  # type: ignore[operator]
    assert values["error.rms"] < 2  # type: ignore[operator]
    assert values["damage.safe_speed_share"] < 100  # type: ignore[operator]
    assert len(plot_wall(scenario, outcome).axes) == 4
