"""Stability of the charging loop where nuggets touch, and what is refused."""

from dataclasses import asdict, replace

import pytest

from diagrams.charging.base_compensation import BaseCompensationParams
from diagrams.charging.charging_resolve import resolve
from diagrams.charging.charging_scenario import CrucibleChargingScenario
from diagrams.charging.contact_loops import charging_stability, contact_loops
from models.charging.packing import PlanItem
from models.validation import ParameterError
from systems.force.sampled_loop import NEUTRAL
from systems.sensing.force_sensor import BaseSensorParams

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


def test_a_sensor_under_the_base_is_filled_in_and_its_joints_are_checked() -> None:
    given = BaseCompensationParams(sensor=BaseSensorParams(noise=3.0))
    found = resolve(replace(WALL, sensing="realistic", friction_compensation=given))
    assert found.friction_compensation is not None
    sensor = found.friction_compensation.sensor
    assert sensor.noise == 3.0
    assert None not in asdict(sensor).values()
    wrong = replace(given, joints=(7,))
    with pytest.raises(ParameterError, match=r"^friction_compensation.joints is \(7,\)"):
        resolve(replace(WALL, friction_compensation=wrong))
