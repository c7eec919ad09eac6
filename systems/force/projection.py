"""Projections on the directions under position control and under force control."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

_TOLERANCE: Final = 1e-9


def unit(vector: Array, name: str = "normal") -> Array:
    """Return the vector at length 1."""
    length = float(np.linalg.norm(vector))
    if not 0 < length < math.inf:
        raise ParameterError(name, np.asarray(vector).tolist(), "a finite vector other than zero")
    scaled: Array = np.asarray(vector) / length
    return scaled


def position_selection(normal: Array) -> Array:
    """Return P = I - n n^T, shape (m, m), for a surface normal n of any length."""
    n = unit(normal)
    matrix: Array = np.eye(len(n)) - np.outer(n, n)
    return matrix


def require_projection(matrix: Array) -> None:
    """Raise :class:`ParameterError` unless a selection is a symmetric projection.

    With P also F = I - P is one, and P v + F v = v (2-5).
    """
    if not np.all(np.isfinite(matrix)):
        raise ParameterError("selection", matrix.tolist(), "finite numbers")
    off = np.abs(matrix - matrix.T).max() + np.abs(matrix @ matrix - matrix).max()
    if off > _TOLERANCE:
        raise ParameterError("selection", matrix.tolist(), "a symmetric projection, P P = P = P^T")
