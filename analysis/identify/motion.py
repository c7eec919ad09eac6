"""The signals of a log, smoothed alike, so that linear relations between them hold."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_erosion, gaussian_filter1d
from scipy.spatial.transform import Rotation

from chamfer.analysis.identify.log import Log
from chamfer.analysis.identify.quantity import Array

_SMOOTH = 0.03  # s, standard deviation of the bell that signals are smoothed with
_ROWS = 2.0  # at least
_RATE = 50.0  # Hz, of the rows that are kept
_SLOW = 0.3  # of the rms speed: slower rows have no way
_FEWEST = 10  # rows that are kept
_RESTS = 1e-3  # m/s, below which the direction of a velocity fades


@dataclass(frozen=True, kw_only=True)
class Motion:
    """Smoothed signals, n rows; ``None``: not in the log."""

    time: Array  # (n,), s
    period: float  # s, from row to row
    row: float  # s, the same of the log
    quieter: float  # share of white noise that smoothing leaves
    position: Array  # (n, 3), m
    velocity: Array  # (n, 3), m/s
    acceleration: Array  # (n, 3), m/s^2
    heading: Array  # (n, 3), direction of the velocity, none at rest; smoothed as forces are
    force: Array  # (n, 3), N
    moment: Array | None  # (n, 3), N m
    reference: Array | None  # (n, 3), m
    turn: Rotation | None  # n rotations

    def moves(self, among: NDArray[np.bool_]) -> NDArray[np.bool_]:
        """Return for each row whether the tool moves, there and just before and after."""
        speed = np.linalg.norm(self.velocity, axis=1)
        steady = speed > _SLOW * np.sqrt(np.mean(speed[among] ** 2))
        return binary_erosion(steady, iterations=max(1, round(3 * _SMOOTH / self.period)))


def smoothing(period: float) -> float:
    """Return the standard deviation of the bell that signals are smoothed with, rows."""
    return max(_SMOOTH / period, _ROWS)


def smooth(values: Array, period: float, order: int = 0) -> Array:
    """Return signals, (n, ...), or their derivatives of an order, per s, smoothed alike."""
    shaped = gaussian_filter1d(
        values, smoothing(period), axis=0, order=order, mode="nearest", truncate=6.0
    )
    return np.asarray(shaped / period**order)


def smooth_motion(log: Log, force: Array, moment: Array | None) -> Motion | None:
    """Return the smoothed signals with these forces, N, and moments, N m.

    None where the log has no path, or a very short one.
    """
    ends = round(6 * smoothing(log.period))
    every = max(1, round(1 / _RATE / log.period))
    if log.position is None or len(log.time) < 2 * ends + _FEWEST * every:
        return None
    kept = slice(ends, -ends, every)

    def thin(values: Array, order: int = 0) -> Array:
        return smooth(values, log.period, order)[kept]

    velocity = smooth(log.position, log.period, 1)
    speed = np.sqrt(np.sum(velocity**2, axis=1, keepdims=True) + _RESTS**2)
    reference, turn = log.reference_position, log.rotation
    return Motion(
        time=log.time[kept],
        period=every * log.period,
        row=log.period,
        quieter=(4 * np.pi * smoothing(log.period) ** 2) ** -0.25,
        position=thin(log.position),
        velocity=velocity[kept],
        acceleration=thin(log.position, 2),
        heading=thin(velocity / speed),
        force=thin(force),
        moment=None if moment is None else thin(moment),
        reference=None if reference is None else thin(reference),
        turn=None if turn is None else Rotation.from_rotvec(turn[kept]),
    )
