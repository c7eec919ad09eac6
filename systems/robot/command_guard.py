"""The guard between a controller and a robot: only commands within their limits leave it."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError, require_between, require_positive
from chamfer.systems.robot.command_limits import Limits, Moving, PoseLimits, PositionLimits

Array = NDArray[np.float64]

_ROUNDING: Final = 1e-9  # relative, of times
_UNIT: Final = 0.01  # by which the length of a quaternion may differ from 1
_MOST: Final = 1e9  # in any unit: what is more was not meant


class Reading(NamedTuple):
    """The measurements of a robot."""

    time: float  # s, by the robot's own clock; a time that does not increase is no new measurement
    values: Mapping[str, Array | None]  # vectors by name


class Intervention(NamedTuple):
    """A change of a command by the guard, or the reason of a stop.

    Causes of a change are ``velocity``, ``workspace``, ``acceleration`` and ``behind`` (a place
    got away before), with velocities as value and limit, and ``effort`` and ``rate``, with
    efforts. Any other is the cause of a stop.
    """

    time: float  # s
    cause: str
    name: str  # of the command or the input
    value: float
    limit: float


@dataclass(frozen=True, kw_only=True)
class CommandGuardParams:
    """Parameters of :class:`CommandGuard`."""

    period: float  # s, between two steps
    timeout: float  # s, longest without a new measurement, and between two steps
    limits: Mapping[str, Limits | None]
    # of each command to the robot; None: it passes unchanged, and is held in a stop
    torque: float = math.inf  # N m, of the input wrench, N m above N; a larger one stops the robot
    force: float = math.inf  # N, likewise
    unchecked: tuple[str, ...] = ()  # inputs that may be non-finite, such as a camera's errors

    def __post_init__(self) -> None:
        require_positive(self, "period", "timeout")
        require_between(self, 1e-9, math.inf, "torque", "force")
        if self.timeout < self.period:
            raise ParameterError("timeout", self.timeout, f"at least the period, {self.period:g}")
        if not any(self.limits.values()):
            raise ParameterError("limits", dict(self.limits), "limits of at least one command")


class GuardState(NamedTuple):
    """The memory of the guard."""

    moving: Mapping[str, Moving]
    stop: Intervention | None = None  # reason of a stop, until it is reset
    time: float = math.nan  # s, of the step before; NaN: there was none
    measured: float = -math.inf  # s, by the robot's clock
    fresh: float = math.nan  # s, time of the last new measurement


class CommandGuard:
    """Limits the commands, and stops the robot if necessary.

    A command within its limits goes through unchanged, to the bit. Otherwise each axis is as near
    to the command as the limits allow. The first command starts from rest, a position from the
    robot's own. A stop takes velocities to 0 at the allowed acceleration, within
    ``stopping_time``, and lasts until :meth:`reset`. The robot's own watchdog has to stop it if
    nothing was sent for ``timeout``: the guard plans that it goes on for that time, and stops
    after a step that is late.
    """

    def __init__(self, params: CommandGuardParams) -> None:
        self.params = params
        self._limits = [one for one in params.limits.values() if one is not None]
        self._needed: list[tuple[str, int, Limits | None]] = [
            (one.measured, one.reads, one) for one in self._limits if one.measured
        ]
        if min(params.torque, params.force) < math.inf:
            self._needed.append(("wrench", 6, None))

    @property
    def stopping_time(self) -> float:
        """Longest time, s, from the cause of a stop until nothing moves."""
        return max(one.stopping_time for one in self._limits) + self.params.timeout

    def start(self) -> GuardState:
        """Return the state before the first step."""
        return GuardState(dict.fromkeys(self.params.limits, Moving()))

    def reset(self, state: GuardState) -> GuardState:
        """Return the state after a stop has ended; an axis that still moves continues from there.

        An axis at rest starts again from the robot's position: somebody may have moved it.
        """
        moving = self.start().moving if self.at_rest(state) else state.moving
        return state._replace(moving=moving, stop=None, time=math.nan, fresh=math.nan)

    def at_rest(self, state: GuardState) -> bool:
        """Return whether a stop has ended: nothing moves."""
        return state.stop is not None and not any(
            one.velocity.any() for one in state.moving.values()
        )

    def trouble(
        self, state: GuardState, reading: Reading, time: float, *, abort: bool = False
    ) -> Intervention | None:
        """Return the reason to stop the robot whatever is commanded; None: there is none."""
        params, values = self.params, reading.values
        longest = params.timeout * (1 + _ROUNDING)
        if abort:
            return Intervention(time, "abort", "", 1.0, 0.0)
        if not math.isfinite(time) or time <= state.time:
            return Intervention(time, "time", "", time, state.time)
        if time - state.time > longest:
            return Intervention(time, "late", "", time - state.time, params.timeout)
        if not reading.time > state.measured and not time - state.fresh <= longest:
            return Intervention(time, "stale", "", time - state.fresh, params.timeout)
        for name, size, limits in self._needed:
            if fault := _fault(values.get(name), limits, size):
                return Intervention(time, "input", name, *fault)
        for name, value in values.items():
            if value is None or name in params.unchecked:
                continue
            if not (finite := np.isfinite(value)).all():
                return Intervention(time, "input", name, float(value[~finite][0]), math.inf)
        if (wrench := values.get("wrench")) is not None:
            for cause, axes in ("torque", wrench[:3]), ("force", wrench[3:]):
                load, most = float(np.linalg.norm(axes)), getattr(params, cause)
                if load > most:
                    return Intervention(time, cause, "wrench", load, most)
        return None

    def step(
        self,
        state: GuardState,
        reading: Reading,
        command: Mapping[str, Array] | None,
        time: float,
        *,
        abort: bool = False,
    ) -> tuple[GuardState, Mapping[str, Array], tuple[Intervention, ...]]:
        """Return the state after a step, the command to send, and the reason of each difference.

        The ``command`` is the law's answer by name, or None. A position is not sent as long as its
        start is unknown.
        """
        params, fresh = self.params, reading.time > state.measured
        given = command or {}
        asked = {name: np.array(given[name]).ravel() for name in params.limits if name in given}
        stop = state.stop or self.trouble(state, reading, time, abort=abort)
        stop = stop or self._not_meant(asked, time)
        interventions = [stop] if stop and not state.stop else []
        # Where there was no step before, or the clock can't be believed, it took the period.
        elapsed = time - state.time if state.time < time < math.inf else params.period
        moving = dict(state.moving)
        for name, limits in params.limits.items():
            wanted = None if stop else asked[name]
            if limits is not None:
                seen = reading.values.get(limits.measured) if fresh and not stop else None
                hold = params.period if isinstance(limits, PositionLimits) else params.timeout
                moving[name], held = limits.step(moving[name], wanted, seen, elapsed, hold)
                if not stop:
                    interventions += [Intervention(time, one[0], name, *one[1:]) for one in held]
            elif wanted is not None:
                moving[name] = Moving(wanted)
        now = time if math.isfinite(time) else state.time + elapsed
        changed = GuardState(
            moving=moving,
            stop=stop,
            time=now,
            measured=reading.time if fresh else state.measured,
            fresh=now if fresh else state.fresh,
        )
        sent = {name: one.command for name, one in moving.items() if one.command is not None}
        return changed, sent, tuple(interventions)

    def _not_meant(self, asked: Mapping[str, Array], time: float) -> Intervention | None:
        for name, limits in self.params.limits.items():
            sizes = (limits.size, limits.size) if limits else (0,)
            if fault := _fault(asked.get(name), limits, *sizes):
                return Intervention(time, "command", name, *fault)
        return None


def _fault(
    value: Array | None, limits: Limits | None, least: int, most: float = math.inf
) -> tuple[float, float] | None:
    """Return the wrong part of a vector, and the allowed values; None if it is valid."""
    if value is None or not least <= value.size <= most:
        return 0 if value is None else value.size, least
    if not (meant := np.abs(value) <= _MOST).all():
        return float(value[~meant][0]), _MOST
    if isinstance(limits, PoseLimits):
        length = float(np.linalg.norm(value[:4]))
        return (length, 1.0) if abs(length - 1) > _UNIT else None
    return None
