"""Which loops are refused, what for, and what the others bear."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.contact.contact_runs import run_contact
from chamfer.diagrams.contact.contact_scenarios import (
    PlanarScenario,
    PlanarSlideLateScenario,
    PlanarSlideScenario,
)
from chamfer.diagrams.contact.hybrid_loop_stability import linear_loops, resolve, stability
from chamfer.diagrams.contact.hybrid_scenario import filled
from chamfer.models.arms.gripper import GripperParams
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.validation import ParameterError
from chamfer.systems.force.contact_detection import CONTACT, LOST
from chamfer.systems.force.sampled_loop import NEUTRAL


def changed(**controller: Any) -> PlanarScenario:
    loop = PlanarScenario()
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
    realistic = replace(PlanarScenario(), sensing="realistic")
    with pytest.raises(ParameterError, match="unstable out of contact"):
        resolve(realistic)
    late = PlanarSlideLateScenario().controller
    control = replace(late, computation_delay=None, computation_jitter=None)
    resolve(replace(realistic, controller=control))


def test_gains_for_a_late_torque_bear_it() -> None:
    thesis, late = stability(filled(PlanarScenario())), PlanarSlideLateScenario()
    assert thesis.delay_margin == pytest.approx(2.7e-3, abs=1e-4)
    assert thesis.gain_margin == pytest.approx(1.09, abs=0.01)
    borne = stability(filled(late))
    assert max(borne.growth or 0.0, borne.growth_contact) <= NEUTRAL
    assert borne.delay_margin is not None
    assert borne.delay_margin > 2.5e-3  # beyond the sample that it has
    # A delay that is there and one that is still to come add up.
    in_time = replace(late, controller=replace(late.controller, computation_delay=0.0))
    both = stability(filled(in_time)).delay_margin
    assert both == pytest.approx(borne.delay_margin + late.controller.period, abs=1e-6)


def rough(coefficient: float) -> PlanarSlideScenario:
    """Return a slide on a rough crucible, from near its wall."""
    slide = PlanarSlideScenario(duration=5.5, measure_after=0.5)
    return replace(
        slide,
        surface=replace(slide.surface, friction=SurfaceFriction(coefficient=coefficient)),
        task=replace(slide.task, start=(1.0, -1.45), amplitude=0.03, frequency=2.0),
        controller=replace(slide.controller, allow_unstable=True),
    )


@pytest.mark.slow
def test_on_a_rough_surface_it_slides_one_way_only() -> None:
    # Ahead, friction and push drive each other through the inverse law.
    assert stability(filled(rough(0.3))).growth_contact <= NEUTRAL
    loops = {loop.name: loop.growth_rate() for loop in linear_loops(rough(0.8))}
    assert loops["sliding back"] <= NEUTRAL < 5 < loops["sliding ahead"]
    with pytest.warns(UserWarning, match="unstable in contact, sliding ahead"):
        scenario = resolve(rough(0.8))
    traces = run_contact(scenario, 0)
    lost = np.flatnonzero(np.diff(traces["mode"]) == LOST - CONTACT)
    lost = lost[traces["time"][lost] > traces["time"][lost[0]] + 0.5]  # after the first bounces
    ahead = traces["x"][lost] > traces["x"][lost - 20]  # in the tenth of a second before
    assert len(lost) >= 2
    assert np.all(ahead)


def gripped(stiffness: float) -> PlanarScenario:
    return PlanarScenario(gripper=GripperParams(stiffness=stiffness, damping=20.0))


def test_stability_is_that_of_the_pose_to_which_a_soft_gripper_gives() -> None:
    # 15 N press a gripper of 100 N/m by 0.15 m, to where the arm is nearly straight.
    resolve(gripped(200.0))
    with pytest.raises(ParameterError, match="unstable in contact, it grows at 75"):
        resolve(gripped(100.0))
    with pytest.raises(ParameterError, match=r"gripper\.stiffness is 10\.0, allowed: more, so"):
        resolve(gripped(10.0))


def test_a_motion_that_ends_out_of_reach_is_named() -> None:
    slide = PlanarSlideScenario()
    with pytest.raises(ParameterError, match=r"task\.amplitude is 0\.9, allowed: ends with more"):
        resolve(replace(slide, task=replace(slide.task, amplitude=0.9)))
