"""The linear loop against differences of the diagram's own map over one period."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from diagrams.contact.adept_scenarios import AdeptNuggetHoldScenario
from diagrams.contact.hybrid_loop import make_hybrid_diagram
from diagrams.contact.hybrid_resolve import resolve
from diagrams.contact.hybrid_scenario import HybridScenario
from diagrams.contact.linear_loop import linear_loop, linear_loops
from diagrams.contact.planar_scenarios import PlanarScenario, PlanarSlideScenario
from diagrams.contact.puma_scenarios import PumaRollerHoldScenario
from models.gripper import GripperParams
from models.surfaces.friction import SurfaceFriction
from systems.force.contact_detection import APPROACH, CONTACT, LOST
from systems.force.friction_compensation import FrictionCompensationParams
from systems.force.sampled_loop import NEUTRAL
from systems.sensing.encoders import EncoderParams
from systems.sensing.force_sensor import ForceSensorParams

Array = np.ndarray


def smooth(scenario: Any, **changes: Any) -> HybridScenario:
    """Return a scenario that holds its place, without dry friction and noise, near its surface."""
    friction = scenario.arm.joint_friction
    still = replace(friction, coulomb=(0.0,) * len(friction.coulomb))
    task = {"start": (1.0, -1.4)} if isinstance(scenario, PlanarScenario) else {"distance": 2e-3}
    sensor = replace(scenario.sensor, noise=0.0)
    return replace(  # type: ignore[no-any-return]
        scenario,
        arm=replace(scenario.arm, joint_friction=still),
        surface=replace(scenario.surface, friction=SurfaceFriction(coefficient=0.0)),
        task=replace(scenario.task, **task),
        sensor=sensor,
        controller=replace(scenario.controller, **changes),
    )


def discrete(context: Context) -> list[Array]:
    state = context.get_discrete_state()
    return [state.value(i).copy() for i in range(state.num_groups())]


def differences(diagram: Diagram, context: Context, period: float) -> Array:
    """Return what a period does to all of the diagram's discrete states, by differences."""
    rest = discrete(context)
    cuts = np.cumsum([len(group) for group in rest])[:-1]

    def after(values: Array) -> Array:
        own = context.Clone()
        for i, group in enumerate(np.split(values, cuts)):
            own.get_mutable_discrete_state().set_value(i, group)
        Simulator(diagram, own).AdvanceTo(own.get_time() + period)
        return np.concatenate(discrete(own))

    flat, h = np.concatenate(rest), 1e-6
    columns = [(after(flat + h * e) - after(flat - h * e)) / (2 * h) for e in np.eye(len(flat))]
    return np.transpose(columns)


CASES = {
    "planar, late": smooth(PlanarScenario(), computation_delay=1e-3, computation_jitter=0.0),
    "planar, full dynamics, positive elbow": smooth(
        replace(PlanarScenario(), arm=replace(PlanarScenario().arm, elbow="positive")),
        law="projected",
        full_dynamics=True,
    ),
    "planar, gripper": smooth(
        replace(PlanarScenario(), gripper=GripperParams(stiffness=(3e3, 5e3, 4e3), damping=30.0))
    ),
    "Puma, tracked, friction compensated": smooth(
        replace(
            PumaRollerHoldScenario(),
            encoders=EncoderParams(velocity="tracked", bandwidth=60.0),
            friction_compensation=FrictionCompensationParams(bandwidth=10.0),
        )
    ),
    "Adept, late by a period, differenced, slow sensor": smooth(
        replace(
            AdeptNuggetHoldScenario(),
            encoders=EncoderParams(velocity="differenced", bandwidth=40.0),
            sensor=ForceSensorParams(bandwidth=20.0, delay=7e-3),
        ),
        computation_delay=5e-3,
        computation_jitter=0.0,
    ),
    "Adept, gripper without damping": smooth(
        replace(AdeptNuggetHoldScenario(), gripper=GripperParams(stiffness=2e4)),
        force_damping=300.0,
    ),
}


@pytest.mark.parametrize("name", CASES)
def test_poles_in_contact_are_those_of_the_diagram(name: str) -> None:
    scenario = resolve(CASES[name])
    diagram, period = make_hybrid_diagram(scenario), scenario.controller.period
    simulator = Simulator(diagram)
    simulator.AdvanceTo(2.5)
    context = simulator.get_context()
    assert diagram.GetOutputPort("mode").Eval(context)[0] == CONTACT
    found = np.linalg.eigvals(differences(diagram, context, period))
    q = diagram.GetOutputPort("encoders").Eval(context)[: scenario.ARM.num_joints]
    loop = linear_loop(scenario, "here", CONTACT, scenario.ARM.endpoint(q))
    expected = np.linalg.eigvals(loop.period_map())
    assert np.abs(expected).max() == pytest.approx(1.0, abs=1e-6)
    for pole in expected:
        assert np.abs(found - pole).min() < 8e-3, pole


def test_the_modes_are_looked_at_where_they_happen() -> None:
    loops = linear_loops(resolve(PlanarSlideScenario()))
    modes = [loop.mode for loop in loops]
    assert modes == [APPROACH, APPROACH, LOST, CONTACT, CONTACT, CONTACT]
    assert len({loop.gain_margin() for loop in loops}) == len(loops)
    assert all(loop.growth_rate() <= NEUTRAL for loop in loops)
