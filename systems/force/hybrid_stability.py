"""Kinematic stability of hybrid position control in joint space.

The Jacobian-inverse law turns the projected error into a joint error, ``J^-1 P J``, and feeds it
back through the inertia: the unconstrained motion obeys ``q'' = -Kp M^-1 J^-1 P J q - ...``. That
product can have a negative eigenvalue, for which no gain is stable (An and Hollerbach, 1987, on
the method of Raibert and Craig). With an orthogonal projection in joint space, ``(P J)^+ P J``,
or with the transpose, ``J^T P J``, it is a product of a positive definite and a positive
semidefinite matrix, and its eigenvalues are never negative.

In firm contact the constraint takes the unstable motion away; it appears where contact is lost,
or is soft, while the position domain is already restricted.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

from models.validation import known
from systems.force.hybrid_controller import HybridControllerParams, Law

Array = NDArray[np.float64]

NEUTRAL: Final = 1e-2  # 1/s, growth up to here is a pole at 0 in floating point


def position_map(J: Array, P: Array, law: Law) -> Array:
    """Return what takes joint motion to the error that the law's gains see, shape (n, n).

    Joint coordinates for ``inverse`` and ``projected``, endpoint coordinates for ``transpose``.
    """
    if law == "inverse":
        return np.asarray(np.linalg.solve(J, P @ J), dtype=np.float64)
    projected: Array = P @ J
    if law == "projected":
        projected = np.linalg.pinv(projected, rcond=1e-6) @ projected
    return projected


def stiffness_eigenvalues(mass: Array, J: Array, P: Array, law: Law) -> NDArray[np.complex128]:
    """Return the eigenvalues of ``M^-1 J^-1 P J`` or its kin, for a gain of 1; shape (n,)."""
    seen = position_map(J, P, law)
    if law == "transpose":
        seen = J.T @ seen
    return np.linalg.eigvals(np.linalg.solve(mass, seen)).astype(np.complex128)


def sampled_loop(
    mass: Array, J: Array, P: Array, params: HybridControllerParams, viscous: Array
) -> Array:
    """Return what a period does to the position loop out of contact, shape (3n, 3n).

    State: joint positions and velocities about a pose at rest, and the position integral. The
    torque is held over the period, between ticks the arm moves exactly.

    Args:
        mass: Mass matrix at the pose, shape (n, n).
        J: Jacobian, shape (n, n).
        P: Position domain, shape (n, n).
        params: Law, gains and period.
        viscous: Viscous friction, shape (n,).
    """
    n, period, gains = len(mass), params.period, params.for_joints(len(mass))
    seen = position_map(J, P, params.law)
    gain = J.T if params.law == "transpose" else np.eye(n)
    if params.full_dynamics:
        gain = mass @ np.diag(1 / np.array(known("inertia", params.inertia)))
    growth = period * np.diag(gains.integral) @ seen
    torque = gain @ np.hstack(
        [-np.diag(gains.stiffness) @ seen - growth, -np.diag(gains.damping) @ seen, np.eye(n)]
    )
    flow = np.zeros((3 * n, 3 * n))  # of position, velocity and the torque that is held
    flow[:n, n : 2 * n] = np.eye(n)
    flow[n : 2 * n, n:] = np.linalg.solve(mass, np.hstack([-np.diag(viscous), np.eye(n)]))
    moved = expm(flow * period)[: 2 * n]
    arm = np.hstack([moved[:, : 2 * n], np.zeros((2 * n, n))]) + moved[:, 2 * n :] @ torque
    integral = np.hstack([-growth, np.zeros((n, n)), np.eye(n)])
    return np.vstack([arm, integral])


def growth_rate(
    mass: Array, J: Array, P: Array, params: HybridControllerParams, viscous: Array
) -> float:
    """Return how fast the position loop grows out of contact, 1/s, from its largest pole.

    The force domain's free directions are poles at 1, so that a stable loop has about 0. Gains
    and friction that overflow count as infinite growth.
    """
    with np.errstate(all="ignore"):
        loop = sampled_loop(mass, J, P, params, viscous)
    if not np.all(np.isfinite(loop)):
        return math.inf
    return float(np.log(np.abs(np.linalg.eigvals(loop)).max()) / params.period)
