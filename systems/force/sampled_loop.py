"""Linear sampled systems, and the stability and margins of a loop around a continuous plant."""

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm

Array = NDArray[np.float64]

NEUTRAL: Final = 1e-2  # 1/s, growth up to here is a pole at 0 in floating point

_LARGEST_FACTOR: Final = 1000.0  # on the torque, what is looked at
_FACTOR_STEP: Final = 1.05
_LONGEST_DELAY: Final = 20  # periods
_DELAY_STEPS: Final = 10  # a period
_HALVINGS: Final = 20


class Sampled(NamedTuple):
    """``z <- A z + B u``, ``y = C z + D u`` once a period."""

    A: Array
    B: Array
    C: Array
    D: Array


def held(flow: Array, drive: Array, read: Array, *, period: float, delay: float = 0.0) -> Sampled:
    """Return ``z' = flow z + drive u``, ``y = read z`` with u held, and late; exact.

    States: z, and the inputs still to come, the earliest first.

    Args:
        flow: Shape (s, s).
        drive: Shape (s, n).
        read: Shape (r, s).
        period: s, over which an input is held.
        delay: s >= 0, after which an input begins to act.
    """
    s, n = drive.shape
    waiting, part = divmod(delay / period, 1.0)
    if part > 1 - 1e-9:
        waiting, part = waiting + 1, 0.0
    before, after = _moved(flow, drive, part * period), _moved(flow, drive, (1 - part) * period)
    count = int(waiting) + (part > 1e-9)
    earlier, later = after[:, :s] @ before[:, s:], after[:, s:]  # of two inputs in one period
    A = np.zeros((s + count * n, s + count * n))
    B = np.zeros((s + count * n, n))
    A[:s, :s] = after[:, :s] @ before[:, :s]
    inputs = np.zeros((s, (count + 1) * n))  # those waiting, and the new one
    if part > 1e-9:
        inputs[:, :n] = earlier
        inputs[:, n : 2 * n] = later
    else:
        inputs[:, :n] = later
    A[:s, s:], B[:s] = inputs[:, : count * n], inputs[:, count * n :]
    if count:
        A[s:-n, s + n :] = np.eye((count - 1) * n)
        B[-n:] = np.eye(n)
    C = np.hstack([read, np.zeros((len(read), count * n))])
    return Sampled(A, B, C, np.zeros((len(read), n)))


def _moved(flow: Array, drive: Array, time: float) -> Array:
    """Return what a time makes of state and held input, shape (s, s + n)."""
    s, n = drive.shape
    both = np.zeros((s + n, s + n))
    both[:s, :s], both[:s, s:] = flow, drive
    return np.asarray(expm(both * time)[:s], dtype=np.float64)


def series(first: Sampled, second: Sampled) -> Sampled:
    """Return the second system with the first one's output as its input."""
    zero = np.zeros((len(first.A), len(second.A)))
    return Sampled(
        np.block([[first.A, zero], [second.B @ first.C, second.A]]),
        np.vstack([first.B, second.B @ first.D]),
        np.hstack([second.D @ first.C, second.C]),
        second.D @ first.D,
    )


def parallel(first: Sampled, second: Sampled) -> Sampled:
    """Return the sum of two systems' outputs, for the same input."""
    zero = np.zeros((len(first.A), len(second.A)))
    return Sampled(
        np.block([[first.A, zero], [zero.T, second.A]]),
        np.vstack([first.B, second.B]),
        np.hstack([first.C, second.C]),
        first.D + second.D,
    )


def closed(plant: Sampled, controller: Sampled, factor: float = 1.0) -> Array:
    """Return what a period does to the states of both, with a factor on the plant's input.

    The plant's output must not depend on its present input.
    """
    through = factor * plant.B
    return np.block(
        [
            [plant.A + through @ controller.D @ plant.C, through @ controller.C],
            [controller.B @ plant.C, controller.A],
        ]
    )


def growth_rate(period_map: Array, period: float) -> float:
    """Return how fast a loop grows, 1/s, from its largest pole; infinite where it overflows."""
    if not np.all(np.isfinite(period_map)):
        return math.inf
    return float(np.log(np.abs(np.linalg.eigvals(period_map)).max()) / period)


def gain_margin(growth: Callable[[float], float]) -> float | None:
    """Return the largest factor on the torque with which a loop is stable.

    It is below 1 for an unstable loop that is stable with less, and None if no factor down to
    a thousandth or up to a thousand makes the difference.

    Args:
        growth: A factor to the loop's growth, 1/s.
    """
    stable = growth(1.0) <= NEUTRAL
    step = _FACTOR_STEP if stable else 1 / _FACTOR_STEP
    factor = 1.0
    while 1 / _LARGEST_FACTOR <= factor <= _LARGEST_FACTOR:
        if (growth(factor * step) <= NEUTRAL) is not stable:
            ends = (factor, factor * step) if stable else (factor * step, factor)
            return _between(growth, *ends)
        factor *= step
    return None


def delay_margin(growth: Callable[[float], float], period: float) -> float | None:
    """Return the delay of the torque, s, up to which a loop is stable; 0 if it is not without.

    None if it is with every one up to 20 periods.

    Args:
        growth: A further delay, s, to the loop's growth, 1/s.
        period: s, of the loop.
    """
    if growth(0.0) > NEUTRAL:
        return 0.0
    for i in range(_LONGEST_DELAY * _DELAY_STEPS):
        first, second = (period * j / _DELAY_STEPS for j in (i, i + 1))
        if growth(second) > NEUTRAL:
            return _between(growth, first, second)
    return None


def _between(growth: Callable[[float], float], stable: float, unstable: float) -> float:
    """Return where stability ends, by halving."""
    for _ in range(_HALVINGS):
        middle = (stable + unstable) / 2
        if growth(middle) <= NEUTRAL:
            stable = middle
        else:
            unstable = middle
    return stable
