"""What a period makes of a loop's states, by differences of its diagram."""

from dataclasses import replace
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from diagrams.contact.hybrid_scenario import HybridScenario
from models.surfaces.friction import SurfaceFriction

Array = NDArray[np.float64]
HybridScenarioT = TypeVar("HybridScenarioT", bound=HybridScenario)

_STEP = 1e-6  # of every state, in its unit


def smooth(scenario: HybridScenarioT) -> HybridScenarioT:
    """Return a scenario that holds its place, without dry friction, noise and coarseness."""
    friction = scenario.arm.joint_friction
    still = replace(friction, coulomb=(0.0,) * len(friction.coulomb))
    return replace(
        scenario,
        arm=replace(scenario.arm, joint_friction=still),
        surface=replace(scenario.surface, friction=SurfaceFriction(coefficient=0.0)),
        sensor=replace(scenario.sensor, noise=0.0, drift=0.0, resolution=0.0),
        encoders=replace(scenario.encoders, counts=0.0),
        controller=replace(scenario.controller, computation_jitter=0.0),
    )


def settled(diagram: Diagram, time: float) -> Context:
    """Return the diagram's context after a time, s."""
    simulator = Simulator(diagram)
    simulator.AdvanceTo(time)
    context: Context = simulator.get_context()
    return context


def period_map(diagram: Diagram, context: Context, period: float) -> Array:
    """Return the derivative of all discrete states after a period, s, in those before; (s, s)."""
    rest = _discrete(context)
    cuts = np.cumsum([len(group) for group in rest])[:-1]

    def after(values: Array) -> Array:
        own = context.Clone()
        for i, group in enumerate(np.split(values, cuts)):
            own.get_mutable_discrete_state().set_value(i, group)
        Simulator(diagram, own).AdvanceTo(own.get_time() + period)
        return np.concatenate(_discrete(own))

    flat = np.concatenate(rest)
    columns = [
        (after(flat + _STEP * axis) - after(flat - _STEP * axis)) / (2 * _STEP)
        for axis in np.eye(len(flat))
    ]
    return np.transpose(columns)


def _discrete(context: Context) -> list[Array]:
    state = context.get_discrete_state()
    return [state.value(i).copy() for i in range(state.num_groups())]
