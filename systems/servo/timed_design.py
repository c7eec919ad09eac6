"""State machine and PID, each designed by its theory to have settled after a given time."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.servo.compensator_law import (
    AxisParams,
    class_increment,
    error_class,
    limited_sum,
)
from chamfer.systems.servo.pid_law import PidGains
from chamfer.systems.servo.sampled_pid import lag_and_dead_time, tuned_gains
from chamfer.systems.servo.settling import SettlingPlant, allowed_axis

_DIVIDERS: Final = (1.0, 1.5, 2.0, 3.0, 5.0, 8.0, 12.0, 20.0)
_HALVINGS: Final = 20
_LONGEST: Final = 10_000  # ticks that are looked at


@dataclass(frozen=True, kw_only=True)
class SettlingTask:
    """The requirement for a controller: to correct an error of a given size within a time."""

    error: float  # m, at the start
    tolerance: float  # m, within which it counts as settled
    settling_time: float  # s
    measurement_error: float  # m, largest of the camera
    period: float  # s, of camera and controller

    def __post_init__(self) -> None:
        require_positive(self, "error", "settling_time", "period")
        if not 0 < self.tolerance < self.error:
            raise ParameterError("tolerance", self.tolerance, f"0 < m < the step, {self.error:g}")
        if not self.tolerance > 2 * self.measurement_error:
            allowed = (
                f"more than {2 * self.measurement_error:g} m, twice the largest error of the "
                "camera, half a resolution and its noise"
            )
            raise ParameterError("tolerance", self.tolerance, allowed)


def timed_axis(task: SettlingTask, plant: SettlingPlant, *, limit: float = math.inf) -> AxisParams:
    """Return the state machine's parameters that do a task with the largest margin.

    A measured error inside the dead zone means that the true one is within the tolerance. Of all
    increments that are fast enough, by :func:`settled_after`, those are taken that use the
    smallest share of what the settling theorem allows. The plant, with all dead times, is sampled
    at the task's period.

    Raises:
        ParameterError: If even the largest increments that the theorem allows are too slow.
    """
    ticks = math.ceil(task.settling_time / task.period) + 1

    def axis(divider: float, share: float) -> AxisParams:
        return allowed_axis(
            plant,
            dead_zone=task.tolerance - task.measurement_error,
            measurement_error=task.measurement_error,
            divider=divider,
            share=share,
            limit=limit,
        )

    def in_time(one: AxisParams) -> bool:
        return settled_after(one, plant, task, ticks=ticks) <= task.settling_time

    shares: dict[float, float] = {}  # smallest one that is fast enough, by divider
    for divider in _DIVIDERS:
        slow, fast = 0.0, 1.0
        if not in_time(axis(divider, fast)):
            continue
        for _ in range(_HALVINGS):
            middle = (slow + fast) / 2
            slow, fast = (slow, middle) if in_time(axis(divider, middle)) else (middle, fast)
        shares[divider] = fast
    if not shares:
        least = min(settled_after(axis(one, 1.0), plant, task) for one in _DIVIDERS)
        allowed = f"at least {least:.4g} s, for the state machine with this plant and camera"
        raise ParameterError("settling_time", task.settling_time, allowed)
    best = min(shares, key=lambda one: shares[one])
    return axis(best, shares[best])


def settled_after(
    axis: AxisParams, plant: SettlingPlant, task: SettlingTask, *, ticks: int = _LONGEST
) -> float:
    """Return when the error that a state machine sees comes within the tolerance, s.

    By its law and the plant's step response, without noise; infinite if it does not come to that
    in so many ticks. Where the settling theorem holds it stays there.
    """
    position, arrived = np.zeros(ticks), np.ones(ticks)
    count = min(len(plant.undelivered), ticks)
    arrived[:count] = 1 - plant.undelivered[:count]
    total = 0.0
    for tick in range(ticks - 1):
        error = task.error - float(position[tick])
        if abs(error) <= task.tolerance:
            return tick * task.period
        found = error_class(error, axis.dead_zone, axis.large_error)
        asked = class_increment(found, axis.increment, axis.divider)
        following = limited_sum(total, asked, axis.limit)
        if following != total:
            position[tick + 1 :] += plant.gain * (following - total) * arrived[: -tick - 1]
        total = following
    return math.inf


def timed_gains(task: SettlingTask, plant: SettlingPlant, *, limit: float = math.inf) -> PidGains:
    """Return the PI gains, by Skogestad's rules, of a closed loop that is settled in time.

    Its error falls off as exp(-(t - theta) / tau_c) behind the dead time theta, so that the time
    until it is within the tolerance gives tau_c. The rules want tau_c >= theta. The plant is that
    of :func:`timed_axis`.

    Raises:
        ParameterError: If that takes a faster loop than the rules allow.
    """
    _, dead = lag_and_dead_time(plant, task.period)
    falls = math.log(task.error / task.tolerance)
    closed_loop = (task.settling_time - dead) / falls
    if not closed_loop >= dead:
        allowed = f"at least {dead * (1 + falls):.4g} s, for the PID with this plant and camera"
        raise ParameterError("settling_time", task.settling_time, allowed)
    return tuned_gains(plant, closed_loop=closed_loop, period=task.period, limit=limit)
