"""The experiment's rows: the worst of all items, and what each item did."""

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.charging import crucible_charging
from chamfer.analysis.charging.charging_metrics import LIMITS
from chamfer.analysis.charging.charging_runs import ChargingRun
from chamfer.analysis.charging.crucible_charging import measure, placed, worst
from chamfer.analysis.scenario.experiment import load, select
from chamfer.diagrams.charging.charging_cycle import chart_of
from chamfer.diagrams.charging.charging_resolve import resolve
from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario
from chamfer.models.charging.packing import PlanItem

CRUCIBLE_CHARGING = load(select(CATALOGUE.entries, ["crucible-charging"])[0])

VISITS = (  # item and state, a row each
    *((0, name) for name in ("acquire.touch", "slew.over", "wall.slide", "retreat.up")),
    *((1, name) for name in ("acquire.touch", "acquire.grip", "slew.over")),
)


@pytest.fixture(scope="module")
def scenario() -> CrucibleChargingScenario:
    plan = (PlanItem(azimuth=0.3), PlanItem(kind="crown", mass=0.14, azimuth=1.0))
    return resolve(CrucibleChargingScenario(plan=plan))


@pytest.fixture(scope="module")
def run(scenario: CrucibleChargingScenario) -> ChargingRun:
    names = chart_of(scenario).state_names
    rows = len(VISITS)
    columns = ["held", "layer_shift", *scenario.ARM.coordinates]
    columns += [f"{what}_{axis}" for what in ("nugget", "desired") for axis in "xyz"]
    for place in ("feeder", "wall", "layer"):
        columns += [f"{place}_{what}" for what in ("force", "gap", "peak_force", "impact_speed")]
    traces = dict.fromkeys(columns, np.zeros(rows)) | {
        "time": 0.5 * np.arange(rows),
        "state": np.array([float(names.index(name)) for _, name in VISITS]),
        "item": np.array([float(item) for item, _ in VISITS]),
        "feeder_peak_force": np.array([3.0, 0, 0, 0, 4.0, 5.0, 0]),
        "wall_force": np.array([9.0, 9.0, 0.8, 9.0, 9.0, 9.0, 9.0]),
    }
    targets = np.array(["slew.over", "retreat.up", "acquire.touch", "stopped"])
    return ChargingRun(traces, {"target": targets}, "off its path")


def test_each_item_is_measured_in_its_own_rows(
    scenario: CrucibleChargingScenario, run: ChargingRun
) -> None:
    first, second = measure(scenario, run)
    assert (first["acquire.grip_force"], second["acquire.grip_force"]) == (3.0, 5.0)
    assert first["wall.slide_force_min"] == 0.8
    assert not any(name.startswith("wall.") for name in second)


def test_the_worst_is_the_most_or_the_least() -> None:
    items = (
        {"acquire.grip_force": 3.0, "slew.clearance": 0.02, "wall.slide_force_min": 0.3},
        {"acquire.grip_force": 5.0, "slew.clearance": 0.01},
    )
    found = worst(items)
    assert list(found) == list(LIMITS)
    assert found["acquire.grip_force"].value == 5.0
    assert found["slew.clearance"].value == 0.01
    slide = found["wall.slide_force_min"]
    assert (slide.value, slide.unit, slide.note) == (0.3, "N", "by item: 0.3, -")
    assert (found["bulk.position_error"].value, found["scan.speed_error"].note) == (
        None,
        "no item came to it",
    )


def test_what_lies_elsewhere_is_not_placed() -> None:
    items = (
        {"wall.position_error": 0.009, "slew.position_error": 0.001},
        {"crown.position_error": 0.011},
        {"slew.position_error": 0.001},
    )
    assert placed(items) == 1


def test_a_run_says_how_many_it_laid_and_why_it_stopped(
    scenario: CrucibleChargingScenario, run: ChargingRun, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(crucible_charging, "run_charging", lambda *_: run)
    monkeypatch.setattr(crucible_charging, "charging_stability", lambda _: None)
    outcome = CRUCIBLE_CHARGING.run(scenario, 0, lambda *_: None)
    laid = outcome.metrics["cycle.laid"]
    assert (laid.value, laid.note) == (1, "off its path")
    assert outcome.metrics["cycle.time"].value == outcome.simulated_seconds == 3.0
    table = outcome.tables["nuggets"]
    assert (table["kind"].tolist(), table["mass"].tolist()) == (["wall", "crown"], [0.085, 0.14])
    np.testing.assert_array_equal(table["wall.slide_force_min"], [0.8, np.nan])
