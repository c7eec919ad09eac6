"""Fills in what a hybrid position/force loop's scenario leaves to be derived, and checks it."""

from dataclasses import replace
from typing import TypeVar

import numpy as np

from diagrams.contact.hybrid_loop_stability import require_stable
from diagrams.contact.hybrid_scenario import ControllerSettings, HybridScenario

HybridScenarioT = TypeVar("HybridScenarioT", bound=HybridScenario)


def resolve(scenario: HybridScenarioT) -> HybridScenarioT:
    """Return the scenario with what the controller is told of the arm filled in, and checked.

    It knows gravity at the start, as a constant (section 2.1.2), and with full dynamics the
    inertia where it should touch.

    Raises:
        ParameterError: If blocks refuse their parameters, the arm can't reach the task, or the
            loop would be unstable and ``controller.allow_unstable`` is not set.
    """
    scenario = replace(scenario, controller=_told(scenario))
    scenario.make_surface()
    scenario.plant  # noqa: B018 - checks
    require_stable(scenario)
    return scenario


def _told(scenario: HybridScenario) -> ControllerSettings:
    controller, dynamics = scenario.controller, scenario.dynamics()
    if controller.feedforward_torque is None:
        q = scenario.joint_positions(np.array(scenario.task.start))
        gravity = dynamics.gravity_torque(q)
        controller = replace(controller, feedforward_torque=tuple(gravity.tolist()))
    if controller.full_dynamics and controller.inertia is None:
        q = scenario.joint_positions(scenario.touching)
        mass = dynamics.evaluate(q, np.zeros(len(q))).mass
        controller = replace(controller, inertia=tuple(np.diag(mass).tolist()))
    return controller
