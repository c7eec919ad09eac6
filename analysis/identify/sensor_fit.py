"""What the free part of a log tells of the sensor: its offset, drift and noise."""

import numpy as np

from chamfer.analysis.identify.log import Log
from chamfer.analysis.identify.quantity import Quantity, unknown

_FREE = 2.0  # s, at the beginning


def sensor_quantities(log: Log) -> dict[str, Quantity]:
    """Return the offset of each axis, N."""
    names = [f"sensor.offset.{axis}" for axis in "xyz"]
    if log.force is None:
        return {name: unknown("N", "the log has no force") for name in names}
    free = log.force[log.time < log.time[0] + _FREE]
    blocks = [block.mean(axis=0) for block in np.array_split(free, 8)]
    half = 2.36 * np.std(blocks, axis=0, ddof=1) / np.sqrt(len(blocks))
    return {
        name: Quantity(float(value), float(value - h), float(value + h), "N")
        for name, value, h in zip(names, free.mean(axis=0), half, strict=True)
    }
