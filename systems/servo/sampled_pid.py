"""PID control of a compensation from a sampled error as a block, and its tuning by SIMC rules."""

import math
from collections.abc import Sequence

import numpy as np

from chamfer.models.validation import ParameterError
from chamfer.systems.law_block import LawBlock
from chamfer.systems.servo.pid_law import OpenPidGains, PidGains, PidLaw, SampledPidParams
from chamfer.systems.servo.settling import SettlingPlant


class SampledPid(LawBlock[PidLaw]):
    """Turns a sampled error into a compensation, with one PID law per axis.

    .. pydrake_system::

        name: SampledPid
        input_ports:
        - error
        - valid (optional)
        output_ports:
        - compensation

    It replaces :class:`chamfer.systems.servo.compensator.TrajectoryCompensator`:
    ``error`` and ``compensation`` have one element per axis. Once a period it computes
    ``c = P e + I sum(e) T + D (e - e_last) / T``, limits it and holds it until the next one. The
    integral part stops where it would drive the total further beyond a limit, and is itself
    limited too. While ``valid`` (size 1) is 0, or an error is not finite, the output is held, and
    the next difference is 0.

    Discrete state: the compensation, the integral part and the last error (NaN before the first).
    """

    def __init__(self, params: SampledPidParams) -> None:
        super().__init__(PidLaw(params))


def lag_and_dead_time(plant: SettlingPlant, period: float) -> tuple[float, float]:
    """Return the lag and the dead time, s, for which a measured step response is taken.

    Two times say so at which a tenth and three tenths of it have arrived; half a period, s, is
    added to the dead time for the hold. The area above the response is that of both, so that the
    lag has what the dead time leaves of it.
    """
    early, later = (period * _arrival(plant, share) for share in (0.1, 0.3))
    # exp(-(t - theta) / tau) is 0.9 at the first and 0.7 at the second.
    intercept = early - (later - early) * math.log(0.9) / math.log(0.7 / 0.9)
    dead = max(intercept, 0.0) + period / 2
    lag = max(period * (1.0 + float(plant.undelivered.sum())) - dead, period / 2)
    return lag, dead


def tuned_gains(
    plant: SettlingPlant, *, closed_loop: float, period: float, limit: float = math.inf
) -> PidGains:
    """Return PI gains by Skogestad's SIMC rules for a measured step response.

    The response is taken for a lag behind a dead time, :func:`lag_and_dead_time`. S. Skogestad,
    Simple analytic rules for model reduction and PID controller tuning, J. Process Control 13
    (2003) 291-309, eqs. (23) and (24); its half rule counts half a sampling period as dead time.
    ``closed_loop``, s, is the wanted time constant tau_c of the closed loop.
    """
    for name, value in (("closed_loop", closed_loop), ("period", period)):
        if not 0 < value < math.inf:
            raise ParameterError(name, value, "a finite number > 0")
    lag, dead = lag_and_dead_time(plant, period)
    proportional = lag / (plant.gain * (closed_loop + dead))
    integral_time = min(lag, 4.0 * (closed_loop + dead))
    return PidGains(proportional=proportional, integral=proportional / integral_time, limit=limit)


def designed_gains(
    given: OpenPidGains,
    plants: Sequence[SettlingPlant],
    *,
    closed_loop: float,
    period: float,
    limit: float,
) -> PidGains:
    """Return an axis with open gains by :func:`tuned_gains`, the most careful of all plants.

    To three digits, so that they don't depend on how a machine rounds the response. A gain of the
    error that is given keeps the integral time.
    """
    tuned = [tuned_gains(one, closed_loop=closed_loop, period=period) for one in plants]
    proportional, integral = given.proportional, given.integral
    if proportional is None:
        proportional = float(f"{min(one.proportional for one in tuned):.3g}")
        if integral is None:
            integral = float(f"{min(one.integral for one in tuned):.3g}")
    elif integral is None:
        rate = min(one.integral / one.proportional for one in tuned)
        integral = float(f"{proportional * rate:.3g}")
    return PidGains(
        proportional=proportional,
        integral=integral,
        derivative=given.derivative,
        limit=limit if given.limit is None else given.limit,
    )


def _arrival(plant: SettlingPlant, share: float) -> float:
    """Return when a share of a step has arrived first, samples."""
    left = np.concatenate([[1.0], plant.undelivered, [0.0]])
    after = int(np.argmax(left < 1 - share))
    before = left[after - 1]
    return float(after - 1 + (before - (1 - share)) / (before - left[after]))
