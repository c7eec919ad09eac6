"""Whether a hybrid position/force loop is stable."""

import warnings

import numpy as np
from numpy.typing import NDArray

from diagrams.contact.hybrid_scenario import HybridScenario
from models.validation import ParameterError
from systems.force.hybrid_stability import NEUTRAL
from systems.force.hybrid_stability import growth_rate as growth_of
from systems.force.selection import position_selection

Array = NDArray[np.float64]


def growth_rate(scenario: HybridScenario) -> float:
    """Return the largest growth of the approach's loop and of the one out of contact, 1/s.

    Raises:
        ParameterError: If the full dynamics' inertia is open, or a point out of reach.
    """
    free = np.eye(len(scenario.task.start))
    return max(
        growth_at(scenario, scenario.touching, position_selection(scenario.direction)),
        growth_at(scenario, scenario.touching, free),
        growth_at(scenario, np.array(scenario.task.start), free),
    )


def growth_at(scenario: HybridScenario, endpoint: Array, selection: Array) -> float:
    """Return the position loop's growth out of contact, 1/s, at an endpoint, shape (m,).

    Args:
        scenario: The loop.
        endpoint: m (rad).
        selection: The position domain, shape (m, m).
    """
    q = scenario.joint_positions(endpoint)
    return growth_of(
        scenario.dynamics().evaluate(q, np.zeros(len(q))).mass,
        scenario.ARM.jacobian(q),
        selection,
        scenario.controller,
        np.array(scenario.arm.joint_friction.viscous),
    )


def require_stable(scenario: HybridScenario) -> None:
    """Refuse a loop that is unstable, or warn of it with ``controller.allow_unstable``.

    Raises:
        ParameterError: If the loop would be unstable out of contact and may not be.
    """
    growth = growth_rate(scenario)
    if growth <= NEUTRAL:
        return
    if not scenario.controller.allow_unstable:
        raise ParameterError(
            "controller.law",
            scenario.controller.law,
            f"one whose position loop is stable out of contact, it grows at {growth:.3g} 1/s "
            "(projected, transpose or other gains; or controller.allow_unstable=true)",
        )
    warnings.warn(
        f"the position loop is unstable out of contact, it grows at {growth:.3g} 1/s",
        stacklevel=1,  # one place, so that it is said once, however often this is called
    )
