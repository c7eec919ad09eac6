"""What a gain block multiplies with, and how that is written."""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import System
from pydrake.systems.primitives import Gain, MatrixGain

_LONGEST: Final = 14  # characters


def gain_matrix(system: System) -> NDArray[np.float64] | None:
    """Return the matrix that a gain block multiplies its input with; None for other systems."""
    if isinstance(system, MatrixGain):
        return np.asarray(system.D(), dtype=np.float64)
    if isinstance(system, Gain):
        # Drake binds no getter for the gain, but the output for ones at the input is the gain.
        context = system.CreateDefaultContext()
        port = system.get_input_port()
        port.FixValue(context, np.ones(port.size()))
        return np.diag(np.asarray(system.get_output_port().Eval(context), dtype=np.float64))
    return None


def is_minus_one(matrix: NDArray[np.float64]) -> bool:
    """Return whether a gain only changes the sign."""
    return matrix.shape[0] == matrix.shape[1] and np.array_equal(matrix, -np.eye(len(matrix)))


def is_negative(matrix: NDArray[np.float64]) -> bool:
    """Return whether a gain has a negative element and no positive one."""
    return bool((matrix <= 0).all() and (matrix < 0).any())


def gain_text(matrix: NDArray[np.float64]) -> str:
    """Return a gain as text: one number for all elements, or a small matrix; "" if it is long."""
    square = matrix.shape[0] == matrix.shape[1]
    if square and np.array_equal(matrix, matrix[0, 0] * np.eye(len(matrix))):
        return _number(matrix[0, 0])
    if square and np.array_equal(matrix, np.diag(np.diag(matrix))):
        text = f"diag({', '.join(map(_number, np.diag(matrix)))})"
    else:
        text = f"[{'; '.join(' '.join(map(_number, row)) for row in matrix)}]"
    return text if len(text) <= _LONGEST else ""


def _number(value: float) -> str:
    return f"{value + 0.0:.4g}".replace("-", "\N{MINUS SIGN}")
