"""The hybrid law about a pose at rest: linear, and how its position loop grows without contact."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import known
from chamfer.systems.force.contact_detection_law import APPROACH, LOST
from chamfer.systems.force.hybrid_law import HybridControllerParams, LawKind
from chamfer.systems.force.sampled_loop import Plant, Sampled, closed, growth_rate, held

Array = NDArray[np.float64]


def position_map(J: Array, P: Array, law: LawKind) -> Array:
    """Return the matrix from joint motion to the error that the gains act on, shape (n, n).

    Joint coordinates for ``inverse`` and ``projected``, endpoint coordinates for ``transpose``.
    """
    if law == "inverse":
        return np.asarray(np.linalg.solve(J, P @ J), dtype=np.float64)
    projected: Array = P @ J
    if law == "projected":
        projected = np.linalg.pinv(projected, rcond=1e-6) @ projected
    return projected


def stiffness_eigenvalues(mass: Array, J: Array, P: Array, law: LawKind) -> NDArray[np.complex128]:
    """Return the eigenvalues of ``M^-1 J^-1 P J`` or its kin, for a gain of 1; shape (n,)."""
    seen = position_map(J, P, law)
    if law == "transpose":
        seen = J.T @ seen
    return np.linalg.eigvals(np.linalg.solve(mass, seen)).astype(np.complex128)


class Pose(NamedTuple):
    """An arm at rest in the hybrid controller's model, n joints."""

    mass: Array  # (n, n)
    J: Array  # (n, n), of the endpoint
    turning: Array  # (n, n), N m/rad, how a constant endpoint force's torque changes with q
    sinking: Array  # (n, n), N m/rad, how gravity's torque does, as the full dynamics know


def linear_law(pose: Pose, P: Array, params: HybridControllerParams, mode: int) -> Sampled:
    """Return the hybrid controller about a pose at rest, in a mode of contact detection.

    Input: joint positions and velocities, and the measured force, shape (2n + m,). Output: the
    torque, shape (n,). States: the position integral, shape (n,), the force integral (m,), and
    the push with which lost contact is sought (1,). P, shape (m, m), is the position domain.
    """
    n, m, period = len(pose.J), len(P), params.period
    stiffness, integrates, damping = params.for_joints(n)
    seen = position_map(pose.J, P, params.law)
    grows = period * np.diag(integrates) @ seen
    if mode != APPROACH:
        grows[list(params.held_integrators)] = 0.0
    if mode > LOST:
        grows[:] = 0.0
    gain, known_load = np.eye(n), np.zeros((n, n))
    if params.law == "transpose":
        gain = pose.J.T
    elif params.full_dynamics:
        gain = pose.mass @ np.diag(1 / np.array(known("inertia", params.inertia)))
        known_load = pose.sinking
    integral, force, push = slice(0, n), slice(n, n + m), slice(n + m, n + m + 1)
    q, v, measured = slice(0, n), slice(n, 2 * n), slice(2 * n, 2 * n + m)
    A, B = np.eye(n + m + 1), np.zeros((n + m + 1, 2 * n + m))
    C, D = np.zeros((n, n + m + 1)), np.zeros((n, 2 * n + m))
    B[integral, q] = -grows
    C[:, integral] = gain
    D[:, q] = known_load - gain @ (np.diag(stiffness) @ seen + grows)
    D[:, v] = -gain @ np.diag(damping) @ seen
    pushes = np.eye(m) - P
    if mode == LOST and params.loss_mode:
        ahead = np.linalg.eigh(pushes)[1][:, -1:]
        slows = params.creep_ramp * period / params.creep_speed * ahead.T @ pose.J
        B[push, v] = -slows
        C[:, push] = pose.J.T @ ahead
        D[:, v] -= pose.J.T @ (ahead @ slows + params.creep_damping * pushes @ pose.J)
    else:
        B[force, measured] = -params.force_integral * period * pushes
        C[:, force] = pose.J.T
        D[:, measured] = pose.J.T @ B[force, measured]
        D[:, v] -= params.force_damping * pose.J.T @ pushes @ pose.J
        D[:, q] += pose.turning
    return Sampled(A, B, C, D)


def free_loop(
    mass: Array, J: Array, P: Array, params: HybridControllerParams, viscous: Array
) -> Array:
    """Return the one-period map of the position loop out of contact and without gravity.

    States: joint positions and velocities about a pose at rest, and those of the law. Mass matrix,
    Jacobian and position domain P have shape (n, n), the viscous friction (n,).
    """
    n = len(mass)
    zero = np.zeros((n, n))
    slowing = np.linalg.solve(mass, np.hstack([-np.diag(viscous), np.eye(n)]))
    flow = np.block([[zero, np.eye(n)], [zero, slowing[:, :n]]])
    drive = np.vstack([zero, slowing[:, n:]])
    unmeasured = np.zeros((n, 2 * n))  # the force
    arm = held(Plant(flow, drive, np.eye(2 * n), unmeasured), period=params.period)
    return closed(arm, linear_law(Pose(mass, J, zero, zero), P, params, APPROACH))


def free_growth_rate(
    mass: Array, J: Array, P: Array, params: HybridControllerParams, viscous: Array
) -> float:
    """Return how fast :func:`free_loop` grows, 1/s.

    The force domain's free directions are poles at 1, so that a stable loop has about 0. Gains
    and friction that overflow count as infinite growth.
    """
    with np.errstate(all="ignore"):
        return growth_rate(free_loop(mass, J, P, params, viscous), params.period)
