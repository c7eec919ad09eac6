"""Drawn cycles, and how the shares within the limits are counted."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.charging import charging_campaign
from chamfer.analysis.charging.charging_campaign import (
    REMEDIES,
    ChargingCampaignScenario,
    RemedyMeans,
    SpreadParams,
    drawn,
    limits_of,
    run_campaign,
    with_remedy,
)
from chamfer.analysis.published.hybrid_force_position_charging import CHARGING
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.charging.packing import places
from chamfer.models.validation import ParameterError

SCENARIO = ChargingCampaignScenario()


def test_a_draw_is_of_its_seed_and_within_its_spread() -> None:
    spread = SpreadParams()
    cycles = [drawn(SCENARIO.cycle, spread, seed) for seed in range(40)]
    assert drawn(SCENARIO.cycle, spread, 3) == cycles[3]
    dry = np.array([one.arm.joint_friction.coulomb for one in cycles])
    dry /= SCENARIO.cycle.arm.joint_friction.coulomb
    centre = np.array([one.station.true.crucible_centre for one in cycles])
    sizes = np.array([[item.scanned_size for item in one.plan] for one in cycles])
    for values, middle, width in (
        (dry, 1.0, spread.joint_friction),
        ([one.wall.lean for one in cycles], 0.0, spread.normal),
        ([one.layer.tilt for one in cycles], 0.0, spread.normal),
        ([one.sensor.bias for one in cycles], 0.0, spread.bias),
        (centre, SCENARIO.cycle.station.true.crucible_centre, spread.place),
        (sizes, 1.0, spread.size),
        ([one.believed_masses.links for one in cycles], 1.0, spread.believed_mass),
        ([one.believed_masses.items for one in cycles], 1.0, spread.believed_mass),
        ([one.layer.slip_friction for one in cycles], 0.5, spread.slip_friction),
    ):
        off = np.abs(np.array(values, dtype=float) - middle)
        assert off.max() <= width + 1e-12
        assert off.max() > 0.8 * width
    # What is believed stays.
    assert {one.station.believed for one in cycles} == {SCENARIO.cycle.station.believed}


def test_nuggets_of_a_cycle_have_one_of_the_masses_and_fit() -> None:
    plans = [drawn(SCENARIO.cycle, SpreadParams(), seed).plan for seed in range(40)]
    assert {plan[0].mass for plan in plans} == set(SpreadParams().masses)
    for plan in plans:
        assert [item.mass for item in plan] == [plan[0].mass, plan[0].mass, 0.4]
        places(plan, SCENARIO.cycle.station.true, believed=True)
    with pytest.raises(ParameterError, match=r"^masses is \(0.085, -0.1\)"):
        SpreadParams(masses=(0.085, -0.1))


def test_a_trial_is_the_same_in_a_longer_campaign(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = []

    def run_each(function: Any, tasks: Any, progress: Any) -> Any:
        asked.append((function.args, tasks))
        raise InterruptedError

    monkeypatch.setattr(charging_campaign, "run_each", run_each)
    for trials, remedies in ((2, ("none",)), (3, ("none", "all"))):
        scenario = ChargingCampaignScenario(trials=trials, remedies=remedies)
        with pytest.raises(InterruptedError):
            run_campaign(scenario, 0, lambda fraction, doing="": None)
    (few, short), (many, long) = asked
    assert few == many
    assert set(short) < set(long)


def test_a_limit_that_a_cycle_does_not_come_to_is_not_kept(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    kept = {one.metric: one.value for one in CHARGING}

    def row(cycle: Any, spread: Any, means: Any, seed: int, task: Any) -> dict[str, Any]:
        found = dict.fromkeys(
            (*charging_campaign.DRAWN, *charging_campaign.SLIDES, *charging_campaign.NORMALS), 0.0
        )
        values = {**kept, "wall.slide_force": 3.0} if task.trial == 1 else dict(kept)
        if task.trial == 2:
            values = dict.fromkeys(kept)
        stopped = "no part" if task.trial == 2 else ""
        if task.trial == 3:
            raise ParameterError("step", 1e-4, "less")
        return {"finished": float(not stopped), "reason": stopped, "time": 1.0, **found, **values}

    monkeypatch.setattr(charging_campaign, "_run_task", row)
    scenario = ChargingCampaignScenario(remedies=("none",), trials=4)
    metrics = run_campaign(scenario, 0, lambda fraction, doing="": None).metrics
    assert metrics["none.cycle.finished"].value == 50.0
    assert metrics["none.cycle.finished"].note == (
        "2 of 4; 1 failed in the simulation; stopped: no part"
    )
    assert metrics["none.wall.slide_force"].value == 25.0
    assert metrics["none.scan.position_error"].value == 50.0
    assert metrics["none.cycle.all_limits"].value == 25.0
    # Clopper and Pearson of 2 of 4, from tables of the beta distribution
    assert metrics["none.scan.position_error.low"].value == pytest.approx(6.759, abs=1e-3)
    assert metrics["none.scan.position_error.high"].value == pytest.approx(93.241, abs=1e-3)


def test_limits_are_those_of_the_modes_in_the_plan() -> None:
    wall = replace(SCENARIO.cycle, plan=SCENARIO.cycle.plan[:1])
    modes = {one.metric.partition(".")[0] for one in limits_of(wall)}
    assert modes == {"acquire", "scan", "slew", "wall"}
    bulk = replace(SCENARIO.cycle, plan=SCENARIO.cycle.plan[2:])
    assert not any(one.metric.startswith("scan") for one in limits_of(bulk))
    assert limits_of(SCENARIO.cycle) == CHARGING


def test_remedies_are_applied() -> None:
    means = RemedyMeans(soft_gripper=GripperCompliance(stiffness=200.0))
    cycles = {name: with_remedy(SCENARIO.cycle, name, means) for name in REMEDIES}
    assert cycles["none"] == SCENARIO.cycle
    assert cycles["all"].sensor == cycles["decoupling"].sensor != SCENARIO.cycle.sensor
    assert cycles["all"].friction_compensation == means.compensation
    assert cycles["all"].gripper == means.soft_gripper


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"remedies": ("luck",)}, "remedies is ('luck',), allowed: some of none, decoupling"),
        ({"remedies": ("none", "none")}, "remedies is ('none', 'none'), allowed: each once"),
    ],
)
def test_campaigns_that_are_none_are_refused(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        ChargingCampaignScenario(**changes)
    assert str(caught.value).startswith(message)
