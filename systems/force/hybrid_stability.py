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

from typing import Final

import numpy as np
from numpy.typing import NDArray

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


def closed_loop(
    mass: Array, J: Array, P: Array, params: HybridControllerParams, viscous: Array
) -> Array:
    """Return the state matrix of the position loop out of contact, shape (3n, 3n).

    State: joint positions and velocities about a pose at rest, and the position integral.

    Args:
        mass: Mass matrix at the pose, shape (n, n).
        J: Jacobian, shape (n, n).
        P: Position domain, shape (n, n).
        params: Law and gains.
        viscous: Viscous friction, shape (n,).
    """
    n = len(mass)
    seen = position_map(J, P, params.law)
    applied = J.T if params.law == "transpose" else np.eye(n)
    gain = applied
    if params.inertia is not None:
        gain = mass @ np.diag(1 / np.array(params.inertia))
    stiffness = gain @ np.diag(params.stiffness) @ seen
    damping = gain @ np.diag(params.damping) @ seen + np.diag(viscous)
    rows = np.linalg.solve(mass, np.hstack([-stiffness, -damping, gain]))
    return np.block(
        [
            [np.zeros((n, n)), np.eye(n), np.zeros((n, n))],
            [rows],
            [-np.diag(params.integral) @ seen, np.zeros((n, 2 * n))],
        ]
    )


def growth_rate(
    mass: Array, J: Array, P: Array, params: HybridControllerParams, viscous: Array
) -> float:
    """Return the largest real part of the position loop's poles out of contact, 1/s.

    The force domain's free directions are poles at 0, so that a stable loop has about 0.
    """
    return float(np.linalg.eigvals(closed_loop(mass, J, P, params, viscous)).real.max())
