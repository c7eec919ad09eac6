"""Selection matrices: which directions are under position and which under force control."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

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


class Selection(LeafSystem):
    """Gives the position domain: everything before contact, then all but the normal.

    .. pydrake_system::

        name: Selection
        input_ports:
        - mode
        output_ports:
        - selection

    ``mode``, size 1, is 0 before contact. ``selection``, size m * m, is P row by row; the force
    domain is F = I - P. Section 2.1.4. The surface normal, shape (m,), is of any length.
    """

    def __init__(self, normal: Array) -> None:
        super().__init__()
        free = np.eye(len(normal)).ravel()
        touching = position_selection(np.asarray(normal)).ravel()
        mode = self.DeclareVectorInputPort("mode", 1)

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(free if mode.Eval(context)[0] == 0 else touching)

        self.DeclareVectorOutputPort("selection", len(free), calc, {mode.ticket()})
