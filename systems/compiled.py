"""Machine code for the inner loops that Drake has no block for."""

import hashlib
from collections.abc import Callable
from pathlib import Path
from typing import TypeVar, cast

import numpy as np
from numba import njit
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray

Array = NDArray[np.float64]
Function = TypeVar("Function", bound=Callable[..., object])


def compiled(function: Function) -> Function:
    """Compile a function, and keep the result on disk where that can be written.

    Numba takes up what it kept until the function's own file changes. What the function calls
    from other files is compiled into it, so these files are part of the name under which it is
    kept.
    """
    name = function.__qualname__
    function.__qualname__ = f"{name}{_stamp(function)}"
    try:
        return cast(Function, njit(cache=True)(function))
    except RuntimeError:
        return cast(Function, njit(function))
    finally:
        function.__qualname__ = name


def _stamp(function: Callable[..., object]) -> str:
    """Return a hash of the other files whose compiled functions this one can call, if any."""
    own = function.__code__.co_filename
    files, front = {own}, [function]
    while front:
        for value in front.pop().__globals__.values():
            if isinstance(value, Dispatcher) and value.py_func.__code__.co_filename not in files:
                files.add(value.py_func.__code__.co_filename)
                front.append(value.py_func)
    others = sorted(file for file in files - {own} if Path(file).is_file())
    if not others:
        return ""
    stamp = hashlib.sha256()
    for file in others:
        stamp.update(Path(file).read_bytes())
    return f"-{stamp.hexdigest()[:12]}"


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
