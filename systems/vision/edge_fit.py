"""Straight lines and half ellipses through points of edges, some of which lie elsewhere."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.compiled import compiled

Array = NDArray[np.float64]


class Line(NamedTuple):
    """A straight line through points of an edge: ``v = intercept + slope u``."""

    intercept: float  # pixels
    slope: float
    rms: float  # pixels, of the points that fit
    points: int  # number of those
    bend: float  # pixels, of the middle third of the points that fit from the others


@compiled
def _solve(matrix: Array, right: Array, x: Array) -> None:
    """Solve a small positive definite system, which is changed (elimination needs no pivots)."""
    m = len(right)
    for k in range(m):
        for i in range(k + 1, m):
            factor = matrix[i, k] / matrix[k, k]
            for j in range(k, m):
                matrix[i, j] -= factor * matrix[k, j]
            right[i] -= factor * right[k]
    for k in range(m - 1, -1, -1):
        x[k] = right[k]
        for j in range(k + 1, m):
            x[k] -= matrix[k, j] * x[j]
        x[k] /= matrix[k, k]


@compiled
def robust_fit(basis: Array, y: Array) -> tuple[Array, float, int, float]:
    """Solve ``basis @ x = y`` by least squares with Tukey's weights.

    Args:
        basis: Shape (n, m).
        y: Shape (n,); NaN elements are not there.

    Returns:
        x, shape (m,); the rms of the residuals that count; their number; by how much those in the
        middle third differ from the others in the mean.
    """
    m = basis.shape[1]
    there = np.nonzero(np.isfinite(y))[0]
    weight = np.ones(len(there))
    residual = np.empty(len(there))
    x = np.zeros(m)
    for _ in range(_ROUNDS):
        normal = 1e-9 * np.eye(m)
        right = np.zeros(m)
        for a in range(len(there)):
            k = there[a]
            for i in range(m):
                share = weight[a] * basis[k, i]
                right[i] += share * y[k]
                for j in range(m):
                    normal[i, j] += share * basis[k, j]
        _solve(normal, right, x)
        for a in range(len(there)):
            residual[a] = y[there[a]]
            for i in range(m):
                residual[a] -= basis[there[a], i] * x[i]
        reach = _STRAIGHT
        if len(there) > 0:
            reach = max(reach, 6.0 * np.median(np.abs(residual)))
        for a in range(len(there)):
            part = residual[a] / reach
            weight[a] = (1 - part * part) ** 2 if abs(part) < 1 else 0.0
    square, count = 0.0, 0
    middle, middles, others, rest = 0.0, 0, 0.0, 0
    for a in range(len(there)):
        if weight[a] > 0:
            square += residual[a] ** 2
            count += 1
            if len(y) <= 3 * there[a] < 2 * len(y):
                middle += residual[a]
                middles += 1
            else:
                others += residual[a]
                rest += 1
    bend = middle / max(middles, 1) - others / max(rest, 1)
    return x, math.sqrt(square / max(count, 1)), count, abs(bend)


_ROUNDS: Final = 5
_STRAIGHT: Final = 0.2  # pixels; residuals below are never left out


@compiled
def fit_line(u: Array, v: Array) -> tuple[float, float, float, int, float]:
    """Fit a line, leaving out what does not lie on it; NaN elements of v are not there.

    Returns:
        What a :class:`Line` has; without points it is no line.
    """
    basis = np.ones((len(u), 2))
    basis[:, 1] = u - u[0]
    x, rms, points, bend = robust_fit(basis, v)
    return x[0] - x[1] * u[0], x[1], rms, points, bend


@compiled
def fit_end(across: Array, along: Array, flat: bool = False) -> tuple[float, float, float, int]:
    """Fit an end's edge: half an ellipse, its ends level with the middle of the face; or a line.

    Args:
        across: Of points of the edge, relative to the face's radius, shape (n,), between -1 and 1.
        along: Of the same points, pixels, out of the part, shape (n,).
        flat: Whether it is a line, as of a square face.

    Returns:
        Where the middle of the face is, pixels; by how much the ellipse is ahead of it, pixels;
        the rms of the residuals that count, pixels; their number.
    """
    n = len(across)
    basis, y = np.zeros((n + 1, 3)), np.zeros(n + 1)
    for k in range(n):
        basis[k, 0], basis[k, 1] = 1.0, across[k]
        basis[k, 2], y[k] = math.sqrt(1.0 - across[k] * across[k]), along[k]
    basis[n, 2] = _BULGE
    if not flat:
        x, rms, points, _ = robust_fit(basis, y)
        if x[2] >= 0.0:
            return x[0], x[2], rms, points
    x, rms, points, _ = robust_fit(basis[:, :2].copy(), y)
    return x[0], 0.0, rms, points


_BULGE: Final = 0.05  # weight of the expectation that the end's edge is straight
