"""Linear sampled systems, and the stability and margins of a loop around a continuous plant."""

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

NEUTRAL: Final = 1e-2  # 1/s, growth up to here is a pole at 0 in floating point

_TERMS: Final = 15  # of the exponential's series, the next is below the rounding
_LARGEST_NORM: Final = 1e12  # of its matrix, beyond which rounding decides
_LARGEST_FACTOR: Final = 1000.0  # on the torque, what is looked at
_FACTOR_STEP: Final = 1.05
_LONGEST_DELAY: Final = 10  # periods
_DELAY_STEPS: Final = 10  # a period
_HALVINGS: Final = 20


class Sampled(NamedTuple):
    """``z <- A z + B u``, ``y = C z + D u`` once a period."""

    A: Array
    B: Array
    C: Array
    D: Array


class Plant(NamedTuple):
    """``z' = flow z + drive u``, measured as ``read z`` at once and as ``late z`` a delay later.

    It has s states, n inputs, r and l outputs.
    """

    flow: Array  # (s, s)
    drive: Array  # (s, n)
    read: Array  # (r, s)
    late: Array  # (l, s)
    lateness: float = 0.0  # s, of the second outputs


def held(plant: Plant, *, period: float, delay: float = 0.0) -> Sampled:
    """Return a plant whose input is held over a period, s, and begins to act a delay later; exact.

    Output: what is read at once, then what is late. States: z, the inputs still to come with the
    earliest first, and the late outputs under way with the last first.
    """
    s, n = plant.drive.shape
    late = len(plant.late)
    waiting, begins = _periods(delay, period)
    count = waiting + (begins > 0)
    size = s + (count + 1) * n  # of state, inputs that wait and the new one

    def reached(time: float) -> Array:
        """Return z after a part of the period, shape (s, size)."""
        before = _moved(plant, min(time, begins))
        after = _moved(plant, max(time - begins, 0.0))
        found = np.zeros((s, size))
        found[:, :s] = after[:, :s] @ before[:, :s]
        earlier = slice(s, s + n)
        later = slice(s + n, s + 2 * n) if begins > 0 else earlier
        if begins > 0:
            found[:, earlier] = after[:, :s] @ before[:, s:]
        found[:, later] += after[:, s:]
        return found

    behind, part = _periods(plant.lateness, period)
    under_way = behind + (part > 0)
    moves = np.zeros((size - n + under_way * late, size + under_way * late))
    moves[:s, :size] = reached(period)
    moves[s : size - n, s + n : size] = np.eye(count * n)
    if under_way:
        now = plant.late @ reached(period - part)
        if not part:  # what is seen at the tick itself, a whole number of periods later
            now = plant.late @ np.eye(s, size)
        moves[size - n : size - n + late, :size] = now
        moves[size - n + late :, size : size + (under_way - 1) * late] = np.eye(
            (under_way - 1) * late
        )
    old, new = [*range(size - n), *range(size, size + under_way * late)], range(size - n, size)
    C = np.zeros((len(plant.read) + late, len(old)))
    C[: len(plant.read), :s] = plant.read
    if under_way:
        C[len(plant.read) :, -late:] = np.eye(late)
    else:
        C[len(plant.read) :, :s] = plant.late
    return Sampled(moves[:, old], moves[:, new], C, np.zeros((len(C), n)))


def _periods(delay: float, period: float) -> tuple[int, float]:
    """Return a delay as whole periods and the rest, s."""
    whole, part = divmod(delay / period, 1.0)
    if part > 1 - 1e-9:
        return int(whole) + 1, 0.0
    return int(whole), part * period if part > 1e-9 else 0.0


def _moved(plant: Plant, time: float) -> Array:
    """Return the map of state and held input over a time, shape (s, s + n)."""
    s, n = plant.drive.shape
    both = np.zeros((s + n, s + n))
    both[:s, :s], both[:s, s:] = plant.flow, plant.drive
    return _exponential(both * time)[:s]


def _exponential(matrix: Array) -> Array:
    """Return the exponential of a small matrix, by its series and squaring.

    SciPy's goes through a threaded LAPACK, which takes milliseconds where cores are busy.
    """
    norm = float(np.abs(matrix).sum(axis=0).max(initial=0.0))
    if not norm < _LARGEST_NORM:
        return np.full_like(matrix, math.nan)
    halvings = max(0, math.frexp(norm)[1] + 1)  # to a norm of at most a half
    part = matrix / 2.0**halvings
    term = found = np.eye(len(matrix))
    for k in range(1, _TERMS):
        term = term @ part / k
        found = found + term
    for _ in range(halvings):
        found = found @ found
    return found


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
    """Return the one-period map of the states of both, with a factor on the plant's input.

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
    """Return the largest factor on the torque with which a loop is stable, by its growth, 1/s.

    It is below 1 for an unstable loop that is stable with less, and None if no factor down to
    a thousandth or up to a thousand makes the difference.
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
    """Return the delay of the torque, s, up to which a loop is stable, by its growth, 1/s.

    0 if it is not without; None if it is with every one up to 10 periods.
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
