"""Stability of the charging loop where nuggets touch, and what is refused."""

from dataclasses import replace

import pytest

from chamfer.diagrams.charging.charging_scenario import (
    CrucibleChargingScenario,
    charging_stability,
    contact_loops,
    resolve,
)
from chamfer.models.charging.packing import PlanItem
from chamfer.models.validation import ParameterError
from chamfer.systems.force.sampled_loop import NEUTRAL

WALL = CrucibleChargingScenario(plan=(PlanItem(kind="wall", azimuth=0.3),))


def test_wall_and_crown_are_pressed_on_and_bulk_is_not() -> None:
    resolved = resolve(CrucibleChargingScenario())
    loops = contact_loops(resolved)
    assert len(loops) == sum(item.kind != "bulk" for item in resolved.plan)
    for loop in loops:  # it meets what it is to meet, where that is
        dynamics = loop.dynamics()
        place = dynamics.evaluate(loop.joint_positions(loop.touching), [0.0] * 7).p_WC
        assert abs(loop.make_surface().level(place)) < 1e-9
    bulk = replace(WALL, plan=(PlanItem(kind="bulk"),))
    assert charging_stability(resolve(bulk)) is None


def test_the_loop_bears_its_own_delay_at_the_wall() -> None:
    found = charging_stability(resolve(replace(WALL, sensing="realistic")))
    assert found is not None
    assert found.growth is not None
    assert max(found.growth, found.growth_contact) <= NEUTRAL
    assert found.gain_margin is not None
    assert found.gain_margin > 2
    assert found.delay_margin is not None
    assert found.delay_margin > 0.005  # s, one sample


def test_an_unstable_contact_is_refused_by_what_makes_it_so() -> None:
    controller = replace(WALL.controller, force_integral=3000.0)
    with pytest.raises(ParameterError, match=r"^controller.force_integral is 3000.0, .* unstable"):
        resolve(replace(WALL, controller=controller))
