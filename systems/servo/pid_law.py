"""PID control of a compensation from a sampled error: the baseline for the state machine."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from chamfer.models.validation import ParameterError, known, require_not_negative, require_positive
from chamfer.systems.law import Array, HeldLaw, Signal


@dataclass(frozen=True, kw_only=True)
class OpenPidGains:
    """One axis; the compensation's unit C and the error's unit E. None is still to be derived."""

    proportional: float | None = None  # C/E, gain of the error
    integral: float | None = None  # C/(E s), gain of its integral
    derivative: float = 0.0  # C s/E, gain of its derivative
    limit: float | None = None  # C, bound on the total

    def __post_init__(self) -> None:
        require_not_negative(self, "proportional", "integral", "derivative")
        if self.limit is not None and not self.limit > 0:
            raise ParameterError("limit", self.limit, "a number > 0, infinity for no bound")

    @property
    def closed(self) -> "PidGains":
        """The gains with no field left open."""
        return PidGains(**{name: known(name, value) for name, value in vars(self).items()})


@dataclass(frozen=True, kw_only=True)
class PidGains(OpenPidGains):
    """One axis, with nothing left open."""

    proportional: float = field()
    integral: float = field()
    limit: float = math.inf


@dataclass(frozen=True, kw_only=True)
class SampledPidParams:
    """Parameters of :class:`PidLaw`."""

    axes: tuple[PidGains, ...]  # of each axis
    period: float = 1 / 80  # s, the camera's period, section 4

    def __post_init__(self) -> None:
        if not self.axes:
            raise ParameterError("axes", self.axes, "at least one axis")
        require_positive(self, "period")


def pid_step(
    integral: Array, last: Array, error: Array, gains: Sequence[Array] | Array, period: float
) -> tuple[Array, Array]:
    """Return total and integral part after a sample, of the law of :class:`PidLaw`.

    All are of one shape or broadcast to it; the error before, ``last``, is NaN if there is none.
    Gains are those of error, integral and derivative, and the limit.
    """
    proportional, per_second, derivative, limit = gains[0], gains[1], gains[2], gains[3]
    change = np.nan_to_num((error - last) / period)
    more = integral + per_second * error * period
    rest = proportional * error + derivative * change
    beyond = np.abs(more + rest) > limit
    away = beyond & (np.sign(more - integral) == np.sign(more + rest))
    # With a derivative the sum could pass a limit that the total keeps.
    kept = np.clip(np.where(away, integral, more), -limit, limit)
    return np.clip(kept + rest, -limit, limit), kept


class PidState(NamedTuple):
    """The state between two samples, shape (size,) each."""

    compensation: Array
    integral: Array  # the part of it
    last: Array  # error, NaN if there is none


class PidObservation(NamedTuple):
    """The inputs of the law."""

    error: Array
    valid: Array | None


class PidLaw(HeldLaw[PidState, PidObservation, PidState]):
    """A PID law an axis; see :class:`chamfer.systems.servo.sampled_pid.SampledPid`."""

    observation = PidObservation

    def __init__(self, params: SampledPidParams) -> None:
        size = len(params.axes)
        super().__init__(
            period=params.period,
            inputs={"error": Signal(size), "valid": Signal(optional=True)},
            outputs={"compensation": Signal(size)},
            start=PidState(np.zeros(size), np.zeros(size), np.full(size, math.nan)),
        )
        self.params = params
        self._gains = np.array(
            [(one.proportional, one.integral, one.derivative, one.limit) for one in params.axes]
        ).T

    def update(self, state: PidState, observation: PidObservation, time: float) -> PidState:
        """Return the state after a sample."""
        error, valid = observation
        lost = valid is not None and not valid[0] >= 0.5
        if lost or not np.isfinite(error).all():
            return state._replace(last=np.full_like(error, math.nan))
        total, integral = pid_step(state.integral, state.last, error, self._gains, self.period)
        return PidState(total, integral, error)
