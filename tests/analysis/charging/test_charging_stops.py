"""Whatever fails in whichever mode of the whole loop: a safe stop, with the reason."""

from dataclasses import replace

import numpy as np
import pytest

from chamfer.analysis.charging.charging_runs import ChargingRun, run_charging
from chamfer.analysis.charging.crucible_charging import measure
from chamfer.diagrams.charging.charging_scenario import (
    CrucibleChargingScenario,
    FaultParams,
    resolve_charging,
)
from chamfer.models.charging.packing import ItemKind, PlanItem
from chamfer.models.surfaces.damage import SAFE_SPEED

WALL = CrucibleChargingScenario(plan=(PlanItem(kind="wall"),))


def run_with(kind: ItemKind, fault: str, state: str = "slew.over") -> ChargingRun:
    """Run one item with a fault."""
    scenario = CrucibleChargingScenario(plan=(PlanItem(kind=kind),))
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
    scenario = resolve_charging(replace(WALL, fault=blow))
    run = run_charging(scenario, 0)
    (found,) = measure(scenario, run)
    assert found["wall.losses"] == found["wall.losses_seen"] == 1
    way = list(zip(run.transitions["source"], run.transitions["target"], strict=True))
    assert ("wall.lost", "wall.slide") in way
    assert run.reason == ""
    assert way[-1] == ("return.over", "done")
    assert found["wall.slide_force"] < 2
    assert found["wall.position_error"] < 5e-4
