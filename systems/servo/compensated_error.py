"""What a compensator leaves of many drawn errors at once: one axis, linear, with a play.

The plant is what the settling theorem (:mod:`systems.servo.settling`) knows of one, behind a play
as of a spring against dry friction. So is the loop: no coupling to other axes.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from systems.servo.compensator import AxisParams
from systems.servo.sampled_pid import PidGains
from systems.servo.settling import SettlingPlant

Array = NDArray[np.float64]
Law = Callable[[Array, float], Array]  # from measured errors and the period to the compensation


class CompensatedError(NamedTuple):
    """Errors at every sample, in the output's unit, shape (ticks, draws)."""

    true: Array
    measured: Array


def compensated_error(
    law: Law,
    plant: SettlingPlant,
    start: Array,
    *,
    play: float,
    place: Array,
    period: float,
    ticks: int,
    bias: Array | float = 0.0,
    noise: Array | None = None,
) -> CompensatedError:
    """Return the course of errors under compensation, from rest.

    Args:
        law: From :func:`fsm_law` or :func:`pid_law`, of its own memory: one a call.
        plant: Gain in the output's unit per compensation, and what is not yet delivered.
        start: True errors, desired minus actual, in the output's unit, shape (draws,).
        play: Half of its width, in the compensation's unit.
        place: Where in it the start is, from -1 to 1, shape (draws,).
        period: s.
        ticks: How many samples.
        bias: Measured minus true error, in the output's unit.
        noise: Of every measurement, likewise, shape (ticks, draws); None: there is none.
    """
    left = plant.undelivered[::-1]
    count = len(left)
    # Increments behind the play, the latest one last.
    passed = np.zeros((count + ticks, len(start)))
    at = play * np.asarray(place, dtype=np.float64)
    rest = np.array(start, dtype=np.float64)  # once all of the increments have arrived
    true, measured = np.empty((2, ticks, len(start)))
    for k in range(ticks):
        true[k] = rest + plant.gain * (left @ passed[k : k + count])
        measured[k] = true[k] + bias + (0.0 if noise is None else noise[k])
        total = law(measured[k], period)
        moved = np.clip(at, total - play, total + play)
        passed[k + count] = moved - at
        rest -= plant.gain * passed[k + count]
        at = moved
    return CompensatedError(true, measured)


def fsm_law(axis: AxisParams) -> Law:
    """Return the rule of Fig. 4 for many errors at once; its total starts at zero."""
    total: Array | float = 0.0

    def law(error: Array, period: float) -> Array:
        nonlocal total
        size = np.abs(error)
        step = np.where(size >= axis.large_error, axis.increment, axis.small_increment)
        step = np.where(size >= axis.dead_zone, np.copysign(step, error), 0.0)
        total = np.clip(total + step, -axis.limit, axis.limit)
        return total

    return law


def pid_law(gains: PidGains) -> Law:
    """Return :class:`systems.servo.sampled_pid.SampledPid` for many errors at once."""
    integral: Array | float = 0.0
    last: Array | None = None

    def law(error: Array, period: float) -> Array:
        nonlocal integral, last
        change = 0.0 if last is None else (error - last) / period
        rest = gains.proportional * error + gains.derivative * change
        more = integral + gains.integral * error * period
        beyond = np.abs(more + rest) > gains.limit
        away = beyond & (np.sign(more - integral) == np.sign(more + rest))
        integral = np.clip(np.where(away, integral, more), -gains.limit, gains.limit)
        last = error
        return np.clip(integral + rest, -gains.limit, gains.limit)

    return law
