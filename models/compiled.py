"""Machine code for the inner loops that Drake has no block for."""

import hashlib
import math
import re
from collections.abc import Callable
from functools import cache, cached_property, update_wrapper
from pathlib import Path
from types import FunctionType
from typing import Any, Final, TypeVar, cast

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Function = TypeVar("Function", bound=Callable[..., object])

_ROOT: Final = Path(__file__).parents[1]
_FROM: Final = re.compile(r"^from ([\w.]+) import", re.MULTILINE)


class _Compiled:
    """A function that is compiled once it is called, or compiled into another one.

    Numba takes a quarter of a second to import. Code that only holds a law does not wait for it.
    """

    def __init__(self, function: Callable[..., object], **options: Any) -> None:
        self._function, self._options = function, options
        update_wrapper(self, function)

    def __call__(self, *arguments: object) -> object:
        return self._dispatcher(*arguments)

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        return getattr(self._dispatcher, name)  # also _numba_type_, what it is in another one

    @cached_property
    def _dispatcher(self) -> Any:
        from numba import njit

        function = self._function
        name = function.__qualname__
        function.__qualname__ = f"{name}{_stamp(Path(function.__code__.co_filename))}"
        try:
            return njit(cache=True, **self._options)(function)
        except RuntimeError:
            return njit(**self._options)(function)
        finally:
            function.__qualname__ = name


def compiled(function: Function) -> Function:
    """Compile a function when it is first called, and keep the result on a writable disk.

    Called functions, constants and types from other files are compiled into the function. So these
    files are part of the name under which it is kept. Its own file is too, because Numba reads the
    kept code, with types that may be gone, before it checks whether that is still valid.
    """
    return cast(Function, _Compiled(function, _nrt=True))


def in_place(function: Function) -> Function:
    """Compile a function that makes no arrays and returns none.

    It only changes its arguments. So no reference counts are needed, which otherwise cost more
    than a small function does.
    """
    return cast(Function, _Compiled(function, _nrt=False))


def within(function: Function) -> Function:
    """Compile a function, as :func:`in_place` does, into the middle of each that calls it."""
    return cast(Function, _Compiled(function, _nrt=False, forceinline=True))


def _stamp(own: Path) -> str:
    """Return a hash of a file and of those that it imports from, recursively."""
    stamp = hashlib.sha256()
    for file in sorted(_reached(own)):
        stamp.update(file.read_bytes() if file.is_file() else b"")
    return f"-{stamp.hexdigest()[:12]}"


@cache
def _reached(own: Path) -> frozenset[Path]:
    files, front = {own}, [own]
    while front:
        new = _imported(front.pop()) - files
        files |= new
        front += new
    return frozenset(files)


@cache
def _imported(file: Path) -> frozenset[Path]:
    """Return this project's files that a file imports from, and those next to it."""
    if not file.is_file():
        return frozenset()
    names = _FROM.findall(file.read_text(encoding="utf-8"))
    parts = (f"{name.removeprefix('chamfer.').replace('.', '/')}.py" for name in names)
    places = (folder / part for part in parts for folder in (_ROOT, file.parent))
    return frozenset(place for place in places if place.is_file())


@in_place
def add_product(matrix: Array, vector: Array, total: Array) -> None:
    """Add the product of a matrix and a vector to a total."""
    for i in range(len(total)):
        for k in range(len(vector)):
            total[i] += matrix[i, k] * vector[k]


@compiled
def inverse(matrix: Array) -> Array:
    """Invert a symmetric positive definite matrix (Gauss-Jordan, needs no pivoting).

    A matrix that is singular to rounding gives entries that are not finite.
    """
    right = np.empty((len(matrix), len(matrix)))
    invert(matrix.copy(), right)
    return right


@in_place
def invert(left: Array, right: Array) -> None:
    """Fill in the inverse of a matrix, which is overwritten; further rows do not change."""
    n = len(left)
    for i in range(n):
        for j in range(n):
            right[i, j] = 1.0 if i == j else 0.0
    for k in range(n):
        pivot = left[k, k]
        if pivot <= 0.0:
            for i in range(n):
                for j in range(n):
                    right[i, j] = math.nan
            return
        for j in range(n):
            left[k, j] /= pivot
            right[k, j] /= pivot
        for i in range(n):
            factor = left[i, k]
            if i != k:
                for j in range(n):
                    left[i, j] -= factor * left[k, j]
                    right[i, j] -= factor * right[k, j]


def interpreted(function: Function, **instead: object) -> Function:
    """Return a compiled function as its Python source function.

    So are the functions of its file that it calls; ``instead`` has replacements of called
    functions, by name.
    """
    scope: dict[str, Any] = dict(cast(_Compiled, function).__wrapped__.__globals__)
    for name, value in scope.items():
        if isinstance(value, _Compiled) and value.__module__ == function.__module__:
            scope[name] = FunctionType(value.__wrapped__.__code__, scope)
    scope |= instead
    return cast(Function, scope[function.__name__])
