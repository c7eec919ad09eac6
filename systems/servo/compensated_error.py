"""What a compensator leaves of many drawn errors at once: linear axes, each behind a play.

The plants are what the settling theorem (:mod:`chamfer.systems.servo.settling`) knows of them, the
plays as of springs against dry friction. So are the loops: nothing couples the axes.
"""

from collections.abc import Callable, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.servo.compensator import AxisParams, class_increment, error_class
from chamfer.systems.servo.sampled_pid import PidGains, pid_step
from chamfer.systems.servo.settling import SettlingPlant

Array = NDArray[np.float64]
Law = Callable[[Array, float], Array]  # from measured errors and the period to the compensation

_NEGLIGIBLE: Final = 0.01  # samples, of an increment, that are never delivered


class CompensatedErrors:
    """Errors of several axes under compensation, from rest, for many draws.

    Args:
        law: From :func:`fsm_law` or :func:`pid_law`, of its own memory: one a run.
        plants: Of each axis the gain, in the output's unit per compensation, and what is not yet
            delivered.
        start: True errors, desired minus actual, in the output's unit, shape (axes, draws).
        play: Half of its width, in the compensation's unit, shape (axes,).
        place: Where in it the start is, from -1 to 1, shape (axes, draws); a compensation > 0
            moves what is at -1 at once.
        period: s.
        bias: Measured minus true error, in the output's unit, shape (axes, draws).
        spread: Standard deviation of a measurement, likewise, shape (axes,).
        generator: Of the noise.
    """

    def __init__(
        self,
        law: Law,
        plants: Sequence[SettlingPlant],
        start: Array,
        *,
        play: Array,
        place: Array,
        period: float,
        bias: Array,
        spread: Array,
        generator: np.random.Generator,
    ) -> None:
        self._law, self._period, self._generator = law, period, generator
        late = [_shown(plant) for plant in plants]
        self._count = max(map(len, late))
        left = np.array([np.pad(one, (0, self._count - len(one))) for one in late])
        self._left = left[:, np.newaxis, ::-1].copy()
        self._gain = np.array([[plant.gain] for plant in plants])
        self._play, self._bias = np.asarray(play)[:, np.newaxis], bias
        self._spread = np.asarray(spread)[:, np.newaxis]
        self._at = self._play * place
        self._rest = np.array(start, dtype=np.float64)  # once all increments have arrived
        self._passed = np.zeros((len(plants), self._count, start.shape[1]))  # the latest one last
        self.true = np.empty((0, *start.shape))  # at every sample, (ticks, axes, draws)
        self.measured = np.empty((0, *start.shape))

    def advance(self, ticks: int) -> None:
        """Go on for some periods."""
        first, shape = len(self.true), self._rest.shape
        noise = self._spread * self._generator.standard_normal((ticks, *shape))
        self.true = np.concatenate([self.true, np.empty((ticks, *shape))])
        self.measured = np.concatenate([self.measured, np.empty((ticks, *shape))])
        passed = np.concatenate([self._passed, np.zeros((shape[0], ticks, shape[1]))], axis=1)
        for k in range(ticks):
            to_come = self._left @ passed[:, k : k + self._count]
            error = self._rest + self._gain * to_come[:, 0]
            measured = error + self._bias + noise[k]
            self.true[first + k], self.measured[first + k] = error, measured
            total = self._law(measured, self._period)
            moved = np.minimum(np.maximum(self._at, total - self._play), total + self._play)
            step = passed[:, k + self._count] = moved - self._at
            self._rest -= self._gain * step
            self._at = moved
        self._passed = passed[:, -self._count :].copy()


def _shown(plant: SettlingPlant) -> Array:
    """Return what is not delivered, up to where the rest of it is negligible."""
    beyond = np.flatnonzero(plant.tail() > _NEGLIGIBLE)
    return plant.undelivered[: int(beyond[-1]) + 1 if len(beyond) else 1]


def fsm_law(axes: Sequence[AxisParams]) -> Law:
    """Return the rule of Fig. 4 for many errors at once; its totals start at zero."""
    dead_zone, large, increment, divider, limit = (
        np.array([[getattr(axis, name)] for axis in axes])
        for name in ("dead_zone", "large_error", "increment", "divider", "limit")
    )
    total: Array = np.zeros_like(limit)

    def law(error: Array, period: float) -> Array:
        nonlocal total
        step = class_increment(error_class(error, dead_zone, large), increment, divider)
        total = np.minimum(np.maximum(total + step, -limit), limit)
        return total

    return law


def pid_law(axes: Sequence[PidGains]) -> Law:
    """Return :class:`chamfer.systems.servo.sampled_pid.SampledPid` for many errors at once."""
    gains = [
        np.array([[getattr(axis, name)] for axis in axes])
        for name in ("proportional", "integral", "derivative", "limit")
    ]
    integral: Array = np.zeros_like(gains[0])
    last: Array = np.full_like(gains[0], np.nan)

    def law(error: Array, period: float) -> Array:
        nonlocal integral, last
        total, integral = pid_step(integral, last, error, gains, period)
        last = error
        return total

    return law


def no_law(error: Array, period: float) -> Array:
    """Compensate nothing."""
    return np.zeros_like(error)
