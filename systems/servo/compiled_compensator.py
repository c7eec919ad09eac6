"""The compensator of one axis as machine code, for loops that are run ten thousand times.

It is made of the functions that the guards and actions of :mod:`chamfer.systems.servo.compensator`
call, and of the same bands in the same order; a tick's time is left out, as nothing here depends
on it.
"""

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.compiled import compiled
from chamfer.systems.servo.compensator import (
    AxisParams,
    axis_bands,
    in_band,
    is_measured,
    is_outside,
    limited_sum,
)

Array = NDArray[np.float64]

_in_band = compiled(in_band)
_is_measured = compiled(is_measured)
_is_outside = compiled(is_outside)
_limited_sum = compiled(limited_sum)


def band_rows(params: AxisParams) -> Array:
    """Return the bands of Fig. 4 in their order: sign, low, high, increment; shape (4, 4)."""
    rows = [(band.sign, band.low, band.high, band.increment) for band in axis_bands(params)]
    return np.array(rows, dtype=np.float64)


@compiled
def compensate(
    compensation: float, error: float, dead_zone: float, limit: float, bands: Array
) -> tuple[float, float]:
    """Run one tick of Figs. 3 and 4.

    Args:
        compensation: The total so far.
        error: As measured, NaN where nothing was.
        dead_zone: Of the axis.
        limit: Of the axis.
        bands: From :func:`band_rows`.

    Returns:
        The new total, and the increment that the tick asked for before the limit.
    """
    if not _is_measured(error):
        return compensation, 0.0  # hold
    if _is_outside(error, dead_zone):
        for sign, low, high, increment in bands:
            if _in_band(error, sign, low, high):
                return _limited_sum(compensation, increment, limit), increment
    return compensation, 0.0  # aligned
