"""The linear loop against its diagram, and what it says of stability."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.contact.hybrid_stability import settled, smooth
from chamfer.analysis.linear.to_control import to_control
from chamfer.diagrams.contact.contact_scenarios import (
    ADEPT_NUGGET_HOLD,
    PLANAR_HOLD,
    PLANAR_SLIDE,
    PLANAR_SLIDE_LATE,
    PUMA_ROLLER_HOLD,
    PlanarScenario,
)
from chamfer.diagrams.contact.hybrid_loop import make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_loop_stability import (
    linear_loop,
    linear_loops,
    resolve,
    stability,
)
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario, fill
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_detection import APPROACH, CONTACT, LOST
from chamfer.systems.force.friction_compensation import FrictionCompensationParams
from chamfer.systems.force.sampled_loop import NEUTRAL
from chamfer.systems.sensing.encoders import EncoderParams
from chamfer.systems.sensing.force_sensor import ForceSensorParams


def near(scenario: Any, **changes: Any) -> HybridScenario:
    """Return a scenario without dry friction and noise that starts near its surface."""
    task = {"start": (1.0, -1.4)} if isinstance(scenario, PlanarScenario) else {"distance": 2e-3}
    changed = replace(
        scenario,
        task=replace(scenario.task, **task),
        controller=replace(scenario.controller, **changes),
    )
    return smooth(changed)  # type: ignore[no-any-return]


CASES = {
    "planar, full dynamics, positive elbow": near(
        replace(PLANAR_HOLD, arm=replace(PLANAR_HOLD.arm, elbow="positive")),
        law="projected",
        full_dynamics=True,
    ),
    "planar, gripper": near(
        replace(PLANAR_HOLD, gripper=GripperCompliance(stiffness=(3e3, 5e3, 4e3), damping=30.0))
    ),
    "Puma, tracked, friction compensated": near(
        replace(
            PUMA_ROLLER_HOLD,
            encoders=EncoderParams(velocity="tracked", bandwidth=60.0),
            friction_compensation=FrictionCompensationParams(bandwidth=10.0),
        )
    ),
    "Adept, late by a period, differenced, slow sensor": near(
        replace(
            ADEPT_NUGGET_HOLD,
            encoders=EncoderParams(velocity="differenced", bandwidth=40.0),
            sensor=ForceSensorParams(bandwidth=20.0, delay=7e-3),
        ),
        computation_delay=5e-3,
        computation_jitter=0.0,
    ),
    "Adept, gripper without damping": near(
        replace(ADEPT_NUGGET_HOLD, gripper=GripperCompliance(stiffness=2e4)), force_damping=300.0
    ),
}


# The gate's alone.
PATIENT = {
    "planar, full dynamics, positive elbow",
    "planar, gripper",
    "Adept, gripper without damping",
}


@pytest.mark.parametrize(
    "name",
    [pytest.param(one, marks=[pytest.mark.slow] if one in PATIENT else []) for one in CASES],
)
def test_poles_in_contact_are_those_of_the_diagram(name: str) -> None:
    scenario = resolve(CASES[name])
    diagram, period = make_hybrid_diagram(scenario), scenario.controller.period
    context = settled(diagram, 1.0)
    assert diagram.GetOutputPort("mode").Eval(context)[0] == CONTACT
    found = to_control(diagram, at=context, period=period, whole=True).poles()
    q = diagram.GetOutputPort("encoders").Eval(context)[: scenario.ARM.num_joints]
    loop = linear_loop(scenario, "here", CONTACT, scenario.ARM.endpoint(q))
    expected = np.linalg.eigvals(loop.period_map())
    assert np.abs(expected).max() == pytest.approx(1.0, abs=1e-6)
    for pole in expected:  # the slow ones decide; fast ones feel the contact's implicit steps
        assert np.abs(found - pole).min() < (1.5e-3 if abs(pole) > 0.6 else 6e-3), pole


def test_the_gain_margin_is_that_of_the_diagram_opened_at_its_torque() -> None:
    scenario = resolve(CASES["planar, full dynamics, positive elbow"])
    diagram = make_hybrid_diagram(scenario)
    context = settled(diagram, 1.0)
    opened = to_control(
        diagram,
        input="manipulator and contact::torque",
        at=context,
        period=scenario.controller.period,
    )
    q = diagram.GetOutputPort("encoders").Eval(context)[: scenario.ARM.num_joints]
    margin = linear_loop(scenario, "here", CONTACT, scenario.ARM.endpoint(q)).gain_margin()
    assert margin is not None
    for share, stable in ((0.98, True), (1.02, False)):
        closed = opened.A - share * margin * opened.B @ opened.C
        largest = np.abs(np.linalg.eigvals(closed)).max()
        assert bool(largest < 1 + 1e-6) is stable


def test_the_modes_are_looked_at_where_they_happen() -> None:
    loops = linear_loops(resolve(PLANAR_SLIDE))
    modes = [loop.mode for loop in loops]
    assert modes == [APPROACH, APPROACH, LOST, *5 * [CONTACT]]
    # without friction it does not matter which way the tip slides
    assert len({loop.gain_margin() for loop in loops}) == len(loops) - 2
    assert all(loop.growth_rate() <= NEUTRAL for loop in loops)


def changed(**controller: Any) -> PlanarScenario:
    loop = PLANAR_HOLD
    return replace(loop, controller=replace(loop.controller, **controller))


@pytest.mark.parametrize(
    ("controller", "message"),
    [
        (
            {"force_integral": 20.0},
            "controller.force_integral is 20.0, allowed: a lower one: the loop is unstable in "
            "contact, it grows at 4.93 1/s (or controller.allow_unstable=true)",
        ),
        (
            {"computation_delay": 0.005},
            "controller.computation_delay is 0.005, allowed: a lower one: the loop is unstable "
            "out of contact, it grows at 60.6 1/s (or controller.allow_unstable=true)",
        ),
        (
            {"creep_damping": 2e3},
            "controller.creep_damping is 2000.0, allowed: a lower one: the loop is unstable out "
            "of contact",
        ),
        (
            {"force_damping": 2e3},
            "controller.force_damping is 2000.0, allowed: a lower one: the loop is unstable in "
            "contact",
        ),
        (
            {"damping": 90.0},
            "controller.law is 'inverse', allowed: projected, transpose or other gains: the loop "
            "is unstable out of contact",
        ),
    ],
)
def test_what_makes_a_loop_unstable_is_named(controller: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        resolve(changed(**controller))
    assert str(caught.value).startswith(message)


def test_with_sensors_and_computer_as_they_are_chapter_2s_gains_are_too_high() -> None:
    realistic = replace(PLANAR_HOLD, sensing="realistic")
    with pytest.raises(ParameterError, match="unstable out of contact"):
        resolve(realistic)
    late = PLANAR_SLIDE_LATE.controller
    control = replace(late, computation_delay=None, computation_jitter=None)
    resolve(replace(realistic, controller=control))


def test_gains_for_a_late_torque_bear_it() -> None:
    thesis, late = stability(fill(PLANAR_HOLD)), PLANAR_SLIDE_LATE
    assert thesis.delay_margin == pytest.approx(2.7e-3, abs=1e-4)
    assert thesis.gain_margin == pytest.approx(1.09, abs=0.01)
    borne = stability(fill(late))
    assert max(borne.growth or 0.0, borne.growth_contact) <= NEUTRAL
    assert borne.delay_margin is not None
    assert borne.delay_margin > 2.5e-3  # beyond the sample that it has
    # A delay that is there and one that is still to come add up.
    in_time = replace(late, controller=replace(late.controller, computation_delay=0.0))
    both = stability(fill(in_time)).delay_margin
    assert both == pytest.approx(borne.delay_margin + late.controller.period, abs=1e-6)


def rough(coefficient: float) -> PLANAR_SLIDE:
    """Return a slide on a rough crucible, from near its wall."""
    slide = replace(PLANAR_SLIDE, duration=5.5, measure_after=0.5)
    return replace(
        slide,
        surface=replace(slide.surface, friction=SurfaceFriction(coefficient=coefficient)),
        task=replace(slide.task, start=(1.0, -1.45), amplitude=0.03, frequency=2.0),
        controller=replace(slide.controller, allow_unstable=True),
    )


def test_on_a_rough_surface_it_slides_one_way_only() -> None:
    # Ahead, friction and push drive each other through the inverse law.
    assert stability(fill(rough(0.3))).growth_contact <= NEUTRAL
    loops = {loop.name: loop.growth_rate() for loop in linear_loops(fill(rough(0.8)))}
    assert loops["sliding back"] <= NEUTRAL < 5 < loops["sliding ahead"]
    with pytest.warns(UserWarning, match="unstable in contact, sliding ahead"):
        resolve(rough(0.8))


def gripped(stiffness: float) -> PlanarScenario:
    return PlanarScenario(gripper=GripperCompliance(stiffness=stiffness, damping=20.0))


def test_stability_is_that_of_the_pose_to_which_a_soft_gripper_gives() -> None:
    # 15 N press a gripper of 100 N/m by 0.15 m, to where the arm is nearly straight.
    resolve(gripped(200.0))
    with pytest.raises(ParameterError, match="unstable in contact, it grows at 75"):
        resolve(gripped(100.0))
    with pytest.raises(ParameterError, match=r"gripper\.stiffness is 10\.0, allowed: more, so"):
        resolve(gripped(10.0))


def test_a_motion_that_ends_out_of_reach_is_named() -> None:
    slide = PLANAR_SLIDE
    with pytest.raises(ParameterError, match=r"task\.amplitude is 0\.9, allowed: ends with more"):
        resolve(replace(slide, task=replace(slide.task, amplitude=0.9)))
