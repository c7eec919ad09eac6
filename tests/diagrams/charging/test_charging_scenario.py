"""What a charging scenario allows, and what is derived of it."""

from dataclasses import replace
from typing import Any

import pytest

from chamfer.diagrams.charging.charging_scenario import (
    CrucibleChargingScenario,
    FaultParams,
    resolve,
)
from chamfer.diagrams.charging.wrist_control import CONTROLLER
from chamfer.models.charging.packing import PlanItem
from chamfer.models.charging.station import StationLayout
from chamfer.models.validation import ParameterError, known
from chamfer.systems.charging.crucible_world import GraspParams


def test_resolve_leaves_nothing_open() -> None:
    scenario = resolve(CrucibleChargingScenario())
    assert known("duration", scenario.duration) > 0
    assert scenario.charging.detection.detect is not None
    assert scenario.sensor.noise == 0
    assert resolve(scenario) == scenario


def test_realistic_sensing_fills_what_is_open_alone() -> None:
    given = CrucibleChargingScenario(sensing="realistic")
    scenario = resolve(replace(given, sensor=replace(given.sensor, noise=0.25)))
    assert scenario.sensor.noise == 0.25
    assert known("bias", scenario.sensor.bias) > 0
    assert not scenario.encoders.exact
    assert known("delay", scenario.controller.computation_delay) > 0


def test_bulk_hangs_with_its_filler() -> None:
    plan = (PlanItem(kind="bulk", mass=0.3),)
    scenario = CrucibleChargingScenario(plan=plan, filler_mass=0.5)
    assert scenario.nuggets[0].mass == pytest.approx(0.8)
    assert scenario.nuggets[0].semi_axes == plan[0].true_nugget.semi_axes


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"plan": ()}, "plan is 0"),
        ({"step": 3e-4}, "step is 0.0003"),
        ({"fault": FaultParams(item=4)}, "fault.item is 4, allowed: 0 to 3"),
        ({"duration": 0.001}, "duration is 0.001"),
        ({"grasp": GraspParams(period=0.01)}, "grasp.period is 0.01, allowed: controller.period"),
        ({"controller": replace(CONTROLLER, period=0.01)}, "charging.period is 0.005"),
    ],
)
def test_refused(fields: dict[str, object], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        CrucibleChargingScenario(**fields)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("fault", "message"),
    [
        ({"state": "lunch"}, r"^state is 'lunch', allowed: home.out"),
        (
            {"kind": "wall_missing", "item": 2},
            "^fault.item is 2, allowed: an item that meets",
        ),
        ({"kind": "layer_missing", "item": 3}, "^fault.item is 3, allowed: .* wall or crown$"),
        ({"kind": "halt", "state": "crown.land"}, "^fault.state is 'crown.land', allowed: one th"),
    ],
)
def test_fault_that_would_not_happen_is_refused(fault: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        CrucibleChargingScenario(fault=FaultParams(**fault))


def test_nugget_that_does_not_fit_is_refused() -> None:
    small = StationLayout(crucible_radius=0.02)
    given = CrucibleChargingScenario()
    station = replace(given.station, believed=small)
    with pytest.raises(ParameterError, match=r"plan\[0\].mass is 0.085"):
        resolve(replace(given, station=station))
