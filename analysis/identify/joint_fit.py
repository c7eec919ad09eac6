"""Identification of joint friction, each direction by itself.

Assumed: a joint's torque is friction, c+ + b+ w forward and -c- + b- w backward, gravity of this
joint alone, a1 cos q + a2 sin q, and a constant inertia; the torque has no offset, which would be
friction of the other direction. Slow runs forth and back tell most.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np
from scipy.ndimage import binary_erosion

from chamfer.analysis.identify.log import Log
from chamfer.analysis.identify.motion import smooth, smoothing
from chamfer.analysis.identify.quantity import (
    Array,
    Quantity,
    in_blocks,
    jackknife,
    solve,
    unknown,
)

_MOVES = 0.1  # of the largest speed
_LEAST = 100  # rows in either direction
_NAMES: Final = ("coulomb_plus", "coulomb_minus", "viscous_plus", "viscous_minus")
_UNITS: Final = ("N m", "N m", "N m s/rad", "N m s/rad")


def fit_joints(log: Log) -> tuple[dict[str, Quantity], Mapping[int, Array]]:
    """Return the friction of each joint, counted from 1, and its torque's residual, N m."""
    told: dict[str, Quantity] = {}
    left: dict[int, Array] = {}
    if log.joint_position is None or log.joint_torque is None:
        return told, left
    positions, speeds, accelerations = (
        smooth(log.joint_position, log.period, k) for k in range(3)
    )
    if log.joint_velocity is not None:
        speeds = smooth(log.joint_velocity, log.period)
    apart = round(3 * smoothing(log.period))  # from where a joint turns round
    torques = smooth(log.joint_torque, log.period)
    for i, (q, w, a, torque) in enumerate(
        zip(positions.T, speeds.T, accelerations.T, torques.T, strict=True), start=1
    ):
        moves = binary_erosion(np.abs(w) > _MOVES * np.max(np.abs(w)), iterations=apart)
        names = [f"joint_friction.{name}.{i}" for name in _NAMES]
        if min(np.sum(w[moves] > 0), np.sum(w[moves] < 0)) < _LEAST:
            note = "the joint doesn't turn both ways"
            told |= {n: unknown(u, note) for n, u in zip(names, _UNITS, strict=True)}
            continue
        forward, backward = w > 0, w < 0
        rows = np.c_[forward, -1.0 * backward, w * forward, w * backward, np.cos(q), np.sin(q),
            a, torque][moves]  # fmt: skip
        products = in_blocks(rows[:, :, None] * rows[:, None, :])
        found = jackknife(lambda s: solve(s[:7, :7], s[:7, 7]), products)
        note = "gravity of this joint alone, torque without offset"
        for k, name in enumerate(names):
            told[name] = found.quantity(k, _UNITS[k], note)
        rest = np.full_like(torque, np.nan)
        rest[moves] = rows[:, 7] - rows[:, :7] @ found.values
        left[i] = rest
    return told, left
