"""A hybrid loop that holds its place, for what is linear of it."""

from dataclasses import replace
from typing import TypeVar

from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, Diagram

from chamfer.diagrams.contact.hybrid_scenario import HybridScenario
from chamfer.models.surfaces.friction import SurfaceFriction

HybridScenarioT = TypeVar("HybridScenarioT", bound=HybridScenario)


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
