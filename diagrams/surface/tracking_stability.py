"""Whether the loop along an unknown surface is stable, with a normal that is known and fixed.

Left out is the observer: what its normal does with the force is not linear. The tip slides, so
that Coulomb's friction is in it.
"""

import numpy as np

from chamfer.diagrams.contact.hybrid_loop_stability import (
    LinearLoop,
    Stability,
    refuse_or_warn,
    stability_of,
)
from chamfer.diagrams.surface.tracking_scenario import TrackingScenario, always_in_contact
from chamfer.systems.force.contact_detection import CONTACT
from chamfer.systems.force.hybrid_controller import Pose, linear_law
from chamfer.systems.force.sampled_loop import NEUTRAL, Plant
from chamfer.systems.force.selection import position_selection


def tracking_loop(scenario: TrackingScenario) -> LinearLoop:
    """Return the loop where it begins, sliding along the surface.

    The contact force acts at once; the block updates it every step.
    """
    d, manipulator = scenario.dimension, scenario.manipulator
    normal = scenario.up
    along = np.eye(d)[0] * np.sign(scenario.task.speed)
    mu = scenario.friction.at(np.array(scenario.start))
    acts = normal - mu * along  # the contact force per newton of normal force
    gives = normal @ np.linalg.solve(np.array(scenario.gripper.matrix(d)), acts)
    zero, free = np.zeros((d, d)), np.eye(d)
    force = np.hstack([-np.outer(acts, normal) / gives, zero])
    slowing = np.hstack([zero, -manipulator.damping * free])
    flow = np.vstack([np.hstack([zero, free]), (force + slowing) / manipulator.mass])
    drive = np.vstack([zero, free / manipulator.mass])
    control = always_in_contact(scenario.controller)
    law = linear_law(
        Pose(manipulator.mass * free, free, zero, zero),
        position_selection(normal),
        control,
        CONTACT,
    )
    plant = Plant(flow, drive, np.eye(2 * d), -force, scenario.force_delay)
    return LinearLoop("contact", CONTACT, plant, law, control.period)


def tracking_stability(scenario: TrackingScenario) -> Stability:
    """Return growth and margins of the loop."""
    return stability_of((tracking_loop(scenario),))


def require_stable_tracking(scenario: TrackingScenario) -> None:
    """Refuse a loop that is unstable, or warn of it with ``controller.allow_unstable``.

    Raises:
        ParameterError: If the loop would be unstable and may not be.
    """
    growth, control = tracking_loop(scenario).growth_rate(), scenario.controller
    if growth <= NEUTRAL:
        return
    refuse_or_warn(
        f"the loop is unstable in contact, it grows at {growth:.3g} 1/s",
        "force_integral",
        control,
        "a lower one, or other gains",
    )
