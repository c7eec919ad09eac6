"""Numerical libraries use one thread, so that any process computes the same bytes."""

import os
from typing import Final

# Several would fight for the cores with the other processes, and sums in another order differ in
# their last digits.
_VARIABLES: Final = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "VECLIB_MAXIMUM_THREADS",
    "NUMBA_NUM_THREADS",
    "OPENCV_FOR_THREADS_NUM",
)


def use_one_thread() -> None:
    """Set one thread for libraries that load later, here and in processes started from here."""
    os.environ.update(dict.fromkeys(_VARIABLES, "1"))
