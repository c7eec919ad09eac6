"""An arm about a pose at rest as a linear system, out of contact or sliding along a surface.

Differences of the equations of motion that :class:`systems.contact.arm_in_contact.ArmInContact`
integrates: inertia, viscous friction, gravity and what the contact force does as the arm turns and
the surface bends. Left out is dry friction, of joints and surface: it stops what little moves, and
what is stable without it only hunts.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from models.surfaces.surface import Surface, locate
from systems.contact.arm_dynamics import ArmDynamics, ArmState

Array = NDArray[np.float64]

_STEP: Final = 1e-6  # rad or m, of the differences


class Touch(NamedTuple):
    """The contact in which an arm is at rest."""

    surface: Surface
    stiffness: float  # N/m
    damping: float  # N s/m
    force: float  # N, with which the arm pushes


class LinearArm(NamedTuple):
    """``z' = flow z + drive tau``, ``F = force z`` for s states z and n joints.

    States are the joints' positions and velocities, less those at rest.
    """

    flow: Array  # (s, s)
    drive: Array  # (s, n)
    force: Array  # (3, s), N, of the surface on the arm, world frame, less that at rest


def linear_arm(
    dynamics: ArmDynamics, q: Array, viscous: Array, touch: Touch | None = None
) -> LinearArm:
    """Return an arm about joint positions q at rest; shape (n,).

    Args:
        dynamics: The arm's equations of motion.
        q: Joint positions, in contact those where the tip is in it.
        viscous: Viscous friction of the joints, shape (n,).
        touch: None: out of contact.
    """
    n, still = len(q), np.zeros(len(q))
    rest = dynamics.evaluate(q, still)

    def contact_force(state: ArmState) -> Array:
        if touch is None:
            return np.zeros(3)
        gap, normal = locate(touch.surface, state.p_WC)
        depth = locate(touch.surface, rest.p_WC).gap - gap
        return (touch.force + touch.stiffness * depth) * normal

    turning, force = np.empty((n, n)), np.zeros((3, 2 * n))
    for j, axis in enumerate(np.eye(n)):
        ahead, behind = (dynamics.evaluate(q + sign * _STEP * axis, still) for sign in (1.0, -1.0))
        loads = [state.J_v_WC.T @ contact_force(state) - state.bias for state in (ahead, behind)]
        turning[:, j] = (loads[0] - loads[1]) / (2 * _STEP)
        force[:, j] = (contact_force(ahead) - contact_force(behind)) / (2 * _STEP)
    slowing = -np.diag(viscous)
    if touch is not None:
        normal = locate(touch.surface, rest.p_WC).normal
        force[:, n:] = -touch.damping * np.outer(normal, normal) @ rest.J_v_WC
        slowing = slowing + rest.J_v_WC.T @ force[:, n:]
    moves = np.linalg.solve(rest.mass, np.hstack([turning, slowing, np.eye(n)]))
    flow = np.vstack([np.eye(n, 2 * n, n), moves[:, : 2 * n]])
    return LinearArm(flow, np.vstack([np.zeros((n, n)), moves[:, 2 * n :]]), force)
