"""An arm about a pose at rest as a linear system, out of contact or sliding along a surface.

Differences of the equations of motion that
:class:`chamfer.systems.contact.arm_in_contact.ArmInContact`
integrates: inertia, viscous friction, gravity, the gripper, and what the contact force does as the
arm turns and the surface bends. A surface on which the tip slides drags at it by Coulomb's
friction. Left out is dry friction of what sticks, or turns around: it stops what moves little, and
what is stable without it only hunts.
"""

from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.surfaces.surface import Surface, locate
from chamfer.systems.contact.arm_dynamics import ArmDynamics, ArmState

Array = NDArray[np.float64]

_STEP: Final = 1e-6  # rad or m, of the differences
_TURNS: Final = 8  # of the search for where a stretched gripper's tip is
_FOLLOWS: Final = 1e-5  # s, in which a tip without mass and damping comes to rest


class Touch(NamedTuple):
    """The contact in which an arm is at rest."""

    surface: Surface
    stiffness: float  # N/m
    damping: float  # N s/m
    force: float  # N, with which the arm pushes
    gripper: GripperCompliance | None = None  # None: rigid
    drag: tuple[float, float, float] = (0.0, 0.0, 0.0)
    # of the sliding surface on the tip, per newton of normal force, world frame


class LinearArm(NamedTuple):
    """``z' = flow z + drive tau``, ``F = force z`` for s states z and n joints.

    States are the joints' positions and velocities, and with a gripper the tip's place in the
    world, shape (3,), less those at rest.
    """

    flow: Array  # (s, s)
    drive: Array  # (s, n)
    force: Array  # (3, s), N, of the surface on the arm, world frame, less that at rest


def linear_arm(
    dynamics: ArmDynamics, q: Array, viscous: Array, touch: Touch | None = None
) -> LinearArm:
    """Return an arm about joint positions q at rest; shape (n,).

    In contact q is that of the arm at rest, with the gripper stretched; touch None: out of
    contact. ``viscous``, shape (n,), is the joints' friction.
    """
    n, still = len(q), np.zeros(len(q))
    rest = dynamics.evaluate(q, still)
    contact = _Contact(touch, rest)
    turning, moved = np.empty((n, n)), np.empty((3, n))
    for j, axis in enumerate(np.eye(n)):
        ahead, behind = (dynamics.evaluate(q + sign * _STEP * axis, still) for sign in (1.0, -1.0))
        loads = [state.J_v_WC.T @ contact.rest_force - state.bias for state in (ahead, behind)]
        turning[:, j] = (loads[0] - loads[1]) / (2 * _STEP)
        moved[:, j] = (contact.gripped(ahead) - contact.gripped(behind)) / (2 * _STEP)
    tip, force = contact.tip(rest.J_v_WC, moved)
    load = rest.J_v_WC.T @ force
    load[:, :n] += turning
    load[:, n : 2 * n] -= np.diag(viscous)
    flow = np.vstack([np.eye(n, len(load.T), n), np.linalg.solve(rest.mass, load), tip])
    drive = np.zeros((len(flow), n))
    drive[n : 2 * n] = np.linalg.inv(rest.mass)
    return LinearArm(flow, drive, force)


def rest_stretch(touch: Touch, rest: ArmState) -> Array:
    """Return by how much the gripper gives at rest, m, shape (3,), world frame; rigid: 0."""
    stretch = np.zeros(3)
    if touch.gripper is None:
        return stretch
    stiffness = rest.R_WE @ np.array(touch.gripper.matrix(3)) @ rest.R_WE.T
    for _ in range(_TURNS):
        normal = locate(touch.surface, rest.p_WC + stretch).normal
        stretch = np.linalg.solve(stiffness, touch.force * (normal + np.array(touch.drag)))
    return stretch


class _Contact:
    """A contact about rest: forces of the surface and of the gripper on what is behind them."""

    def __init__(self, touch: Touch | None, rest: ArmState) -> None:
        self._gripper: tuple[Array, Array] | None = None
        self._springs, self._slows = np.zeros((3, 3)), np.zeros((3, 3))
        self.rest_force = np.zeros(3)
        if touch is None:
            return
        drag = np.array(touch.drag)
        place = rest.p_WC + rest_stretch(touch, rest)
        begin = locate(touch.surface, place)
        self.rest_force = touch.force * (begin.normal + drag)
        self._slows = touch.damping * np.outer(begin.normal + drag, begin.normal)

        def pushed(p: Array) -> Array:
            gap, normal = locate(touch.surface, p)
            load: Array = (touch.force + touch.stiffness * (begin.gap - gap)) * (normal + drag)
            return load

        for i, axis in enumerate(_STEP * np.eye(3)):
            self._springs[:, i] = (pushed(place + axis) - pushed(place - axis)) / (2 * _STEP)
        if touch.gripper is not None:
            K, D = (
                np.array(m) for m in (touch.gripper.matrix(3), touch.gripper.damping_matrix(3))
            )
            self._gripper = K, D + _FOLLOWS * K
            self._R_WE = rest.R_WE
            self._tip = place

    def gripped(self, state: ArmState) -> Array:
        """Return the gripper's force on the arm while the tip stays, shape (3,); rigid: 0."""
        if self._gripper is None:
            return np.zeros(3)
        stiffness = state.R_WE @ self._gripper[0] @ state.R_WE.T
        pull: Array = stiffness @ (self._tip - state.p_WC)
        return pull

    def tip(self, J: Array, moved: Array) -> tuple[Array, Array]:
        """Return rows of the flow for the tip, and the force of the surface; shape (3, s) each.

        Args:
            J: Translational Jacobian, shape (3, n).
            moved: By how much the gripper's force changes with the joints, N/rad, shape (3, n).
        """
        if self._gripper is None:
            none = np.zeros((0, 2 * J.shape[1]))
            return none, np.hstack([self._springs @ J, -self._slows @ J])
        K, D = (self._R_WE @ matrix @ self._R_WE.T for matrix in self._gripper)
        # Without mass the tip feels as much from the surface as from the gripper.
        gives = np.hstack([-moved, D @ J, self._springs - K])
        flow = np.asarray(np.linalg.solve(D + self._slows, gives), dtype=np.float64)
        placed = np.hstack([np.zeros((3, 2 * J.shape[1])), self._springs])
        return flow, placed - self._slows @ flow
