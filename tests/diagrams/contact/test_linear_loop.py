"""The linear loop against differences of the diagram's own map over one period."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from chamfer.analysis.contact.hybrid_stability import settled, smooth
from chamfer.analysis.linear.to_control import to_control
from chamfer.diagrams.contact.contact_scenarios import (
    AdeptNuggetHoldScenario,
    PlanarScenario,
    PlanarSlideScenario,
    PumaRollerHoldScenario,
)
from chamfer.diagrams.contact.hybrid_loop import make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_loop_stability import linear_loop, linear_loops, resolve
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario
from chamfer.models.arms.gripper import GripperParams
from chamfer.systems.force.contact_detection import APPROACH, CONTACT, LOST
from chamfer.systems.force.friction_compensation import FrictionCompensationParams
from chamfer.systems.force.sampled_loop import NEUTRAL
from chamfer.systems.sensing.encoders import EncoderParams
from chamfer.systems.sensing.force_sensor import ForceSensorParams

Array = np.ndarray


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
    "planar, late": near(PlanarScenario(), computation_delay=1e-3, computation_jitter=0.0),
    "planar, full dynamics, positive elbow": near(
        replace(PlanarScenario(), arm=replace(PlanarScenario().arm, elbow="positive")),
        law="projected",
        full_dynamics=True,
    ),
    "planar, gripper": near(
        replace(PlanarScenario(), gripper=GripperParams(stiffness=(3e3, 5e3, 4e3), damping=30.0))
    ),
    "Puma, tracked, friction compensated": near(
        replace(
            PumaRollerHoldScenario(),
            encoders=EncoderParams(velocity="tracked", bandwidth=60.0),
            friction_compensation=FrictionCompensationParams(bandwidth=10.0),
        )
    ),
    "Adept, late by a period, differenced, slow sensor": near(
        replace(
            AdeptNuggetHoldScenario(),
            encoders=EncoderParams(velocity="differenced", bandwidth=40.0),
            sensor=ForceSensorParams(bandwidth=20.0, delay=7e-3),
        ),
        computation_delay=5e-3,
        computation_jitter=0.0,
    ),
    "Adept, gripper without damping": near(
        replace(AdeptNuggetHoldScenario(), gripper=GripperParams(stiffness=2e4)),
        force_damping=300.0,
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
    context = settled(diagram, 2.0)
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
    context = settled(diagram, 2.0)
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
    loops = linear_loops(resolve(PlanarSlideScenario()))
    modes = [loop.mode for loop in loops]
    assert modes == [APPROACH, APPROACH, LOST, *5 * [CONTACT]]
    # without friction it does not matter which way the tip slides
    assert len({loop.gain_margin() for loop in loops}) == len(loops) - 2
    assert all(loop.growth_rate() <= NEUTRAL for loop in loops)
