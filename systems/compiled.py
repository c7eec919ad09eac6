"""Machine code for the inner loops that Drake has no block for."""

from collections.abc import Callable
from typing import TypeVar, cast

import numpy as np
from numba import njit
from numpy.typing import NDArray

Array = NDArray[np.float64]
Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Compile a function, and keep the result on disk where that can be written."""
    try:
        return cast(Function, njit(cache=True)(function))
    except RuntimeError:
        return cast(Function, njit(function))


@compiled
def inverse(matrix: Array) -> Array:
    """Invert a symmetric positive definite matrix (Gauss-Jordan, needs no pivoting).

    A matrix that is singular to rounding gives entries that are not finite.
    """
    n = len(matrix)
    left, right = matrix.copy(), np.eye(n)
    for k in range(n):
        pivot = left[k, k]
        if pivot <= 0.0:
            right[:] = np.nan
            return right
        for j in range(n):
            left[k, j] /= pivot
            right[k, j] /= pivot
        for i in range(n):
            factor = left[i, k]
            if i != k:
                for j in range(n):
                    left[i, j] -= factor * left[k, j]
                    right[i, j] -= factor * right[k, j]
    return right
