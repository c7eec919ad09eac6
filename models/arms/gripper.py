"""The compliant gripper between an endpoint and the tip that touches (section 4.1)."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError

Rows = tuple[tuple[float, ...], ...]
# One number for all directions, one for each axis of the endpoint's frame, or a matrix by rows.
Tensor = float | tuple[float, ...] | Rows


@dataclass(frozen=True, kw_only=True)
class GripperCompliance:
    """A massless spring and damper, with F = K s + D s' for the stretch s.

    Axes are those of the endpoint's frame, or the world's where nothing turns.
    """

    stiffness: Tensor = 100.0  # N/m, K (section 5.2.1)
    # one number for all directions, one for each axis, or a symmetric matrix by rows
    damping: Tensor = 0.0  # N s/m, D, of the spring; in the same form as the stiffness

    def __post_init__(self) -> None:
        for name, positive in (("stiffness", True), ("damping", False)):
            value = getattr(self, name)
            dimensions = (len(value),) if isinstance(value, tuple) else (2, 3)
            for dimension in dimensions:
                matrix = _matrix(name, value, dimension)
                least = float(np.linalg.eigvalsh(matrix)[0])
                if not (least > 0 if positive else least >= 0):
                    definite = "definite" if positive else "semidefinite"
                    allowed = f"a number {'>' if positive else '>='} 0, or positive {definite}"
                    raise ParameterError(name, value, allowed)

    def matrix(self, dimension: int) -> Rows:
        """Return the stiffness matrix K by rows, N/m."""
        return tuple(map(tuple, _matrix("stiffness", self.stiffness, dimension).tolist()))

    def damping_matrix(self, dimension: int) -> Rows:
        """Return the damping matrix D by rows, N s/m."""
        return tuple(map(tuple, _matrix("damping", self.damping, dimension).tolist()))


def _matrix(name: str, value: Tensor, dimension: int) -> NDArray[np.float64]:
    allowed = f"a finite number, {dimension} of them, or a symmetric matrix of {dimension} rows"
    if dimension not in (2, 3):
        raise ParameterError(name, value, "one number, 2 or 3, or a matrix of 2 or 3 rows")
    try:
        given = np.array(value, dtype=np.float64)
    except ValueError as error:  # rows of several lengths
        raise ParameterError(name, value, allowed) from error
    matrix = given
    if given.shape in ((), (dimension,)):
        matrix = np.diag(np.broadcast_to(given, dimension))
    if matrix.shape != (dimension, dimension) or not np.all(np.isfinite(matrix)):
        raise ParameterError(name, value, allowed)
    if not np.array_equal(matrix, matrix.T):
        raise ParameterError(name, value, allowed)
    return matrix
