r"""The Kalman update whose estimate keeps unit length (4-22 to 4-27), in closed form.

For a prior n with covariance P_d, a measurement n + e with covariance R and a gain G, the thesis
minimises ``tr[(I - G) P_d (I - G)^T + G R G^T] + lambda (|n + G e|^2 - 1)``. Its derivative is
zero for (4-26)::

    G = (P_d - lambda n e^T) (P_d + R + lambda e e^T)^-1

Write ``S = P_d + R``, ``K = P_d S^-1`` (the ordinary gain) and ``s = e^T S^-1 e``. With Sherman
and Morrison ``(S + lambda e e^T)^-1 e = S^-1 e / (1 + lambda s)``, and so::

    n + G e = (n + K e) / (1 + lambda s)

The left side has length one if ``|1 + lambda s| = l``, with ``l = |n + K e|``. The trace is least
where ``1 + lambda s > 0`` (the other root is the antipode), hence ``lambda = (l - 1) / s`` and::

    n+ = (n + K e) / l
    G  = K + (1/l - 1)/s (n + K e) e^T S^-1
    P+ = (I - K) P_d (I - K)^T + K R K^T + (1 - l)^2 / s n+ n+^T

The constrained estimate is the ordinary one, normalised; nothing has to be iterated.
:func:`newton_multiplier` solves the thesis' pair of equations by Newton's method all the same.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.compiled import compiled, inverse

Array = NDArray[np.float64]

_TOLERANCE: Final = 1e-14
_ITERATIONS: Final = 100


class Updated(NamedTuple):
    """An estimate after a measurement."""

    normal: Array  # (d,), unit
    covariance: Array  # (d, d), symmetric, positive semidefinite


@compiled
def constrained_update(normal: Array, covariance: Array, measured: Array, noise: Array) -> Updated:
    """Return the estimate of least covariance and unit length.

    Where it is not defined - neither the prior nor the measurement is uncertain, or both cancel -
    the prior is returned.

    Args:
        normal: n, shape (d,), unit.
        covariance: P_d, shape (d, d).
        measured: Shape (d,), unit.
        noise: R, shape (d, d).
    """
    e = measured - normal
    S_inverse = inverse(covariance + noise)
    K = covariance @ S_inverse
    step = K @ e
    raw = normal + step
    length = math.sqrt(raw @ raw)
    if not _TOLERANCE < length < math.inf:
        return Updated(normal.copy(), covariance.copy())
    left = np.eye(len(e)) - K
    P = left @ covariance @ left.T + K @ noise @ K.T
    s = float(e @ (S_inverse @ e))
    # 1 - l without the rounding of l, which a small s would magnify.
    short = -(2.0 * (normal @ step) + step @ step) / (1.0 + length)
    stretch = short**2 / s if s > 0.0 else 0.0
    updated = raw / length
    for i in range(len(e)):
        for j in range(len(e)):
            P[i, j] += stretch * updated[i] * updated[j]
    return Updated(updated, 0.5 * (P + P.T))


def constrained_gain(
    normal: Array, covariance: Array, measured: Array, noise: Array, multiplier: float
) -> Array:
    """Return the gain G (4-26), shape (d, d), for a Lagrange multiplier."""
    e = measured - normal
    S = covariance + noise
    left, right = covariance - multiplier * np.outer(normal, e), S + multiplier * np.outer(e, e)
    return np.asarray(np.linalg.solve(right.T, left.T).T, dtype=np.float64)


def newton_multiplier(normal: Array, covariance: Array, measured: Array, noise: Array) -> float:
    """Return the Lagrange multiplier by Newton's method, from 0.

    It solves the second equation of (4-26), ``|n + G e|^2 = 1``, as
    ``l^2 / (1 + lambda s)^2 = 1``. The first step crosses the pole at ``-1/s`` if and only if
    ``l < 1 / sqrt(3)``, and then ends at the antipode or nowhere; such a step is cut to go half
    the way to the pole.

    Raises:
        ArithmeticError: If it does not converge, or nothing is uncertain.
    """
    e = measured - normal
    try:
        inverse = np.linalg.inv(covariance + noise)
    except np.linalg.LinAlgError as error:
        raise ArithmeticError("neither the prior nor the measurement is uncertain") from error
    s = float(e @ inverse @ e)
    if s == 0.0:
        return 0.0
    raw = normal + covariance @ inverse @ e
    square = float(raw @ raw)
    x = 1.0  # 1 + lambda s
    for _ in range(_ITERATIONS):
        step = 0.5 * x * (1.0 - x * x / square)
        while x + step <= 0.0:
            step = -0.5 * x
        x += step
        if abs(step) <= _TOLERANCE * x:
            return (x - 1.0) / s
    raise ArithmeticError(f"no multiplier within {_ITERATIONS} iterations")
