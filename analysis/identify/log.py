"""A log of a robot as arrays, in SI units."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Log:
    """What was recorded, n rows; None: it was not.

    Forces are those of the surface on the tool, in the axes in which they were recorded: the
    sensor's (``wrench_axes="tool"``: they turn with the tool) or fixed ones (``"base"``).
    """

    time: Array  # (n,), s, ascending
    force: Array | None = None  # (n, 3), N
    moment: Array | None = None  # (n, 3), N m
    position: Array | None = None  # (n, 3), m, of the tip in the base's axes
    rotation: Array | None = None  # (n, 3), rad, rotation vector, of the tool in the base
    velocity: Array | None = None  # (n, 3), m/s, of the tip
    reference_position: Array | None = None  # (n, 3), m, the impedance's reference
    joint_position: Array | None = None  # (n, k), rad
    joint_velocity: Array | None = None  # (n, k), rad/s
    joint_torque: Array | None = None  # (n, k), N m, of the motors

    @property
    def period(self) -> float:
        """The median time between two rows, s."""
        return float(np.median(np.diff(self.time)))


_NAMES = {"virtual_position": "reference_position"}


def read_log(path: Path) -> Log:
    """Return a log in the recordings' own columns."""
    with np.load(path, allow_pickle=False) as file:
        columns = {_NAMES.get(name, name): file[name].astype(np.float64) for name in file}
    known = Log.__dataclass_fields__
    return Log(**{name: values for name, values in columns.items() if name in known})
