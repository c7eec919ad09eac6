"""The whole loop: a safe stop, with the reason, whatever fails; what is unknown is followed."""

from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.charging.charging_runs import ChargingRun, run_charging
from chamfer.analysis.charging.crucible_charging import measure
from chamfer.diagrams.charging.charging_scenario import (
    CrucibleChargingScenario,
    FaultParams,
    chart_of,
    resolve_charging,
)
from chamfer.models.charging.packing import ItemKind, PlanItem
from chamfer.models.surfaces.damage import SAFE_SPEED

STEP = 2e-4  # s, forces are within 0.3 mN of those at half of it


def run_with(kind: ItemKind, fault: str, state: str = "slew.over") -> ChargingRun:
    """Run one item with a fault."""
    scenario = CrucibleChargingScenario(plan=(PlanItem(kind=kind),), step=STEP)
    given = FaultParams(kind=fault, state=state)  # type: ignore[arg-type]
    return run_charging(resolve_charging(replace(scenario, fault=given)), 0)


def require_safe(run: ChargingRun) -> None:
    """Fail unless the arm has come to rest on its command, and nothing was hit."""
    traces = run.traces
    assert traces["finished"][-1] == 2
    assert traces["mode"][-1] == 0
    for axis in "xyz":
        assert abs(traces[axis][-1] - traces[f"desired_{axis}"][-1]) < 0.003
        assert abs(np.diff(traces[axis][-3:])).max() < 0.005 * 0.05  # m, of 5 ms
    for place in ("feeder", "wall", "layer"):
        assert np.nanmax(traces[f"{place}_force"]) < 20
        assert np.nanmax(traces[f"{place}_impact_speed"]) < SAFE_SPEED


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "fault", "state", "reason"),
    [
        ("wall", "sensor_dead", "acquire.descend", "the force sensor is dead, in acquire.descend"),
        ("wall", "wall_missing", "slew.over", "the wall is not there, in wall.seek"),
        ("wall", "sensor_dead", "wall.slide", "the force sensor is dead, in wall.slide"),
        ("wall", "part_dropped", "wall.slide", "part dropped, in wall.slide"),
        ("crown", "layer_missing", "slew.over", "the layer below is not there, in crown.land"),
        ("crown", "sensor_dead", "crown.land", "the force sensor is dead, in crown.land"),
        ("bulk", "part_dropped", "bulk.lower", "part dropped, in bulk.lower"),
    ],
)
def test_each_mode_stops_safely(kind: ItemKind, fault: str, state: str, reason: str) -> None:
    run = run_with(kind, fault, state)
    assert run.reason == f"{reason}, item 0"
    require_safe(run)


@pytest.mark.slow
def test_contact_that_a_blow_breaks_is_found_again() -> None:
    blow = FaultParams(kind="contact_lost", state="wall.slide")
    plan = (PlanItem(kind="wall"),)
    scenario = resolve_charging(CrucibleChargingScenario(plan=plan, fault=blow, step=STEP))
    run = run_charging(scenario, 0)
    (found,) = measure(scenario, run)
    assert found["wall.losses"] == found["wall.losses_seen"] == 1
    way = list(zip(run.transitions["source"], run.transitions["target"], strict=True))
    assert ("wall.lost", "wall.slide") in way
    assert run.reason == ""
    assert way[-1] == ("return.over", "done")
    assert found["wall.slide_force"] < 2
    assert found["wall.position_error"] < 5e-4


@pytest.mark.slow
def test_a_nugget_of_unknown_normal_is_followed_to_its_place() -> None:
    lies = PlanItem(kind="crown", azimuth=0.3, radius=0.1, tilt=0.4, tilt_azimuth=0.3)
    plan = (PlanItem(kind="crown", azimuth=0.3, radius=0.112),)
    scenario = resolve_charging(CrucibleChargingScenario(plan=plan, laid=(lies,), step=STEP))
    run = run_charging(scenario, 0)
    (found,) = measure(scenario, run)
    assert "crown.follow" in run.transitions["target"]
    traces = run.traces
    rows = np.isin(traces["state"], [chart_of(scenario).state_names.index("crown.follow")])
    assert np.degrees(np.arccos(traces["true_normal_z"][rows][0])) > 10
    assert np.degrees(found["crown.normal_error"]) < 4
    # The force that is wanted is along the estimate.
    force = np.stack([traces[f"desired_force_{axis}"][rows] for axis in "xyz"], axis=1)
    normal = np.stack([traces[f"normal_{axis}"][rows] for axis in "xyz"], axis=1)
    np.testing.assert_allclose(force, -scenario.charging.layer_force * normal, atol=1e-12)
    assert traces["layer_force"][rows].min() > 0.2
    assert found["crown.peak_force"] < 1.5
    assert found["crown.position_error"] < 2e-3
