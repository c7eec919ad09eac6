"""What a charging scenario allows, what is derived of it, and whether its contacts are stable."""

from dataclasses import replace

import numpy as np
import pytest

from chamfer.diagrams.charging.charging_scenario import (
    BelievedMasses,
    CrucibleChargingScenario,
    FaultParams,
    beliefs_of,
    charging_stability,
    contact_loops,
    make_scenes,
    resolve_charging,
)
from chamfer.diagrams.charging.wrist_control import CONTROLLER
from chamfer.models.charging.packing import PlanItem
from chamfer.models.charging.station import StationLayout
from chamfer.models.validation import ParameterError
from chamfer.systems.charging.crucible_world import GraspParams
from chamfer.systems.force.sampled_loop import NEUTRAL


def test_resolve_leaves_nothing_open() -> None:
    scenario = resolve_charging(CrucibleChargingScenario())
    assert scenario.duration == 240
    assert scenario.charging.detection.detect == pytest.approx(0.3)
    assert scenario.sensor.noise == 0
    assert resolve_charging(scenario) == scenario


def test_realistic_sensing_fills_what_is_open_alone() -> None:
    given = CrucibleChargingScenario(sensing="realistic")
    scenario = resolve_charging(replace(given, sensor=replace(given.sensor, noise=0.25)))
    assert scenario.sensor.noise == 0.25
    assert (scenario.sensor.bias or 0) > 0
    assert not scenario.encoders.exact
    assert (scenario.controller.computation_delay or 0) > 0


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
        (
            {"believed_masses": BelievedMasses(links=(1.0, 1.1))},
            r"believed_masses.links is \(1.0, 1.1\), allowed: 7 numbers, or one for all",
        ),
        ({"grasp": GraspParams(period=0.01)}, "grasp.period is 0.01, allowed: controller.period"),
        ({"controller": replace(CONTROLLER, period=0.01)}, "charging.period is 0.005"),
        *(
            ({"fault": FaultParams(kind=kind, state=state, item=item)}, message)
            for kind, state, item, message in (
                ("wall_missing", "slew.over", 2, "^fault.item is 2, allowed: an item that meets"),
                ("layer_missing", "slew.over", 3, "^fault.item is 3, .* wall or crown$"),
                ("halt", "crown.land", 0, "^fault.state is 'crown.land', allowed: a state that"),
            )
        ),
    ],
)
def test_refused(fields: dict[str, object], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        CrucibleChargingScenario(**fields)  # type: ignore[arg-type]
    with pytest.raises(ParameterError, match=r"^state is 'lunch', allowed: home.out"):
        FaultParams(state="lunch")


def test_nugget_that_does_not_fit_is_refused() -> None:
    small = StationLayout(crucible_radius=0.02)
    given = CrucibleChargingScenario()
    station = replace(given.station, believed=small)
    with pytest.raises(ParameterError, match=r"plan\[0\].mass is 0.085"):
        resolve_charging(replace(given, station=station))


WALL = CrucibleChargingScenario(plan=(PlanItem(kind="wall", azimuth=0.3),))


def test_stiffness_is_that_of_the_materials_but_for_what_is_told() -> None:
    found = resolve_charging(WALL)
    assert found.wall.stiffness == pytest.approx(7.12e6, rel=2e-3)  # 2 cm, 1.2 N, by hand
    assert found.layer_contact.stiffness == found.layer.stiffness == pytest.approx(6.6e6, rel=0.01)
    told = resolve_charging(replace(WALL, wall=replace(WALL.wall, stiffness=1e5)))
    assert told.wall_contact.stiffness == 1e5


def test_masses_are_believed_by_the_controller_alone() -> None:
    links = (1.25, 1.0, 0.75, 1.0, 1.0, 1.0, 1.0)
    off = replace(WALL, believed_masses=BelievedMasses(links=links, items=0.8))
    true, believed = off.dynamics().chain, off.believed_dynamics().chain
    np.testing.assert_allclose(believed.mass / true.mass, links)
    found, known = resolve_charging(off), resolve_charging(WALL)
    assert make_scenes(found)[1].load.mass == make_scenes(known)[1].load.mass  # type: ignore[union-attr]
    assert beliefs_of(found).nuggets[0].mass == pytest.approx(0.8 * WALL.plan[0].mass)
    gravity, right = (np.array(one.controller.feedforward_torque) for one in (found, known))
    assert abs(gravity[2] - right[2]) == pytest.approx(0.25 * 9.81, rel=1e-6)  # N, of 1 kg


def test_without_the_whole_model_each_joint_has_a_gain_of_its_own() -> None:
    given = replace(WALL, controller=replace(CONTROLLER, full_dynamics=False))
    found = resolve_charging(given)
    assert found.controller.inertia is None
    over = np.array(found.controller.stiffness) / CONTROLLER.stiffness
    place, nugget = WALL.places(believed=True)[0], WALL.nuggets[0]
    laid = [*place.position, place.layer + nugget.height, 0.3, 0.0, 0.0, WALL.charging.lean]
    q = WALL.ARM.joint_positions(np.array(laid), WALL.arm.elbow)
    np.testing.assert_allclose(over, np.diag(WALL.dynamics().evaluate(q, 0 * q).mass), rtol=1e-9)
    assert resolve_charging(found) == found
    # In coordinates the wrist's gains are not stable, and said to be so.
    transpose = replace(given.controller, law="transpose")
    with pytest.raises(ParameterError, match=r"^controller.law is 'transpose', .* unstable"):
        resolve_charging(replace(given, controller=transpose))


def test_wall_and_crown_are_pressed_on_and_bulk_is_not() -> None:
    resolved = resolve_charging(CrucibleChargingScenario())
    loops = contact_loops(resolved)
    assert len(loops) == sum(item.kind != "bulk" for item in resolved.plan)
    for loop in loops:  # it meets what it is to meet, where that is
        dynamics = loop.dynamics()
        place = dynamics.evaluate(loop.joint_positions(loop.touching), [0.0] * 7).p_WC
        assert abs(loop.make_surface().level(place)) < 1e-9
    bulk = replace(WALL, plan=(PlanItem(kind="bulk"),))
    assert charging_stability(resolve_charging(bulk)) is None


def test_small_nuggets_may_lie_on_one_another() -> None:
    # On a slope the integrators of the wrist would push on; in set-down they are held.
    plan = tuple(PlanItem(kind=kind, mass=0.014) for kind in ("wall", "crown"))  # type: ignore[arg-type]
    found = resolve_charging(replace(WALL, plan=plan))
    assert contact_loops(found)[1].controller.held_integrators == tuple(range(7))


def test_the_loop_bears_its_own_delay_at_the_wall() -> None:
    found = charging_stability(resolve_charging(replace(WALL, sensing="realistic")))
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
        resolve_charging(replace(WALL, controller=controller))
