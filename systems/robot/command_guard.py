"""The guard between a controller and a robot: nothing leaves it that is not within its limits."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.robot.command_limits import Limits, Moving, PoseLimits, Times

Array = NDArray[np.float64]

_ROUNDING: Final = 1e-9  # relative, of times
_UNIT: Final = 0.01  # by which the length of a quaternion may differ from 1
_MOST: Final = 1e9  # in any unit: what is more was not meant


class Reading(NamedTuple):
    """What a robot measured."""

    time: float  # s, when, by the robot's own clock; one that does not go on is nothing new
    values: Mapping[str, Array | None]  # vectors by name


class Intervention(NamedTuple):
    """Where the guard changed a command, or why it stops.

    Causes of a change are ``velocity``, ``workspace``, ``acceleration`` and ``behind`` (a place
    got away before), of which value and limit are velocities, and ``effort`` and ``rate``, of
    which they are efforts. Any other is the cause of a stop.
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
    timeout: float  # s, longest without anything new, and between two steps
    limits: Mapping[str, Limits | None]
    # of each command that goes to the robot; None: it goes as it is, and is held in a stop
    torque: float = math.inf  # N m, of the measured wrench; what feels more is stopped
    force: float = math.inf  # N, likewise
    wrench: str = "wrench"  # input, shape (6,), N m above N, where torque or force is limited
    unchecked: tuple[str, ...] = ()  # inputs that may be not finite, such as a camera's errors

    def __post_init__(self) -> None:
        require_positive(self, "period", "timeout")
        if self.timeout < self.period:
            raise ParameterError("timeout", self.timeout, f"at least the period, {self.period:g}")
        if not any(self.limits.values()):
            raise ParameterError("limits", dict(self.limits), "limits of at least one command")
        for name in ("torque", "force"):
            if not getattr(self, name) > 0:
                raise ParameterError(name, getattr(self, name), "a number > 0, infinity for none")


class GuardState(NamedTuple):
    """What the guard remembers."""

    moving: Mapping[str, Moving]
    stop: Intervention | None = None  # why it stops, until it is reset
    time: float = math.nan  # s, of the step before; NaN: there was none
    measured: float = -math.inf  # s, by the robot's clock
    fresh: float = math.nan  # s, when something new was measured last


class CommandGuard:
    """Bounds what is commanded, and stops the robot where it has to.

    A command within its limits goes through unchanged, to the bit; of another each axis is taken
    as near to it as may be. The first command starts from rest, a place from where the robot is.
    A stop takes velocities to 0 at the acceleration that is allowed, within ``stopping_time``,
    and lasts until :meth:`reset`. The robot's own watchdog has to stop it if nothing was sent for
    ``timeout``: the guard plans that it goes on for as long, and stops after a step that is late.
    """

    def __init__(self, params: CommandGuardParams) -> None:
        self.params = params
        self._limits = {name: one for name, one in params.limits.items() if one is not None}
        self._needed: list[tuple[str, int, Limits | None]] = [
            (one.measured, one.reads, one) for one in self._limits.values() if one.measured
        ]
        if min(params.torque, params.force) < math.inf:
            self._needed.append((params.wrench, 6, None))

    @property
    def stopping_time(self) -> float:
        """Time, s, from the cause of a stop until nothing moves, at most."""
        return max(one.stopping_time for one in self._limits.values()) + self.params.timeout

    def start(self) -> GuardState:
        """Return the state before the first step."""
        return GuardState(dict.fromkeys(self.params.limits, Moving()))

    def reset(self, state: GuardState) -> GuardState:
        """Return the state in which a stop is over; what still moves goes on from there."""
        return state._replace(stop=None, time=math.nan, fresh=math.nan)

    def at_rest(self, state: GuardState) -> bool:
        """Return whether a stop has ended: nothing moves."""
        velocities = (one.velocity for one in state.moving.values())
        return state.stop is not None and not any(v is not None and v.any() for v in velocities)

    def trouble(
        self, state: GuardState, reading: Reading, time: float, *, abort: bool = False
    ) -> Intervention | None:
        """Return why the robot has to stop whatever is commanded; None: it has not to."""
        timeout = self.params.timeout
        longest = timeout * (1 + _ROUNDING)
        if abort:
            return Intervention(time, "abort", "", 1.0, 0.0)
        if not math.isfinite(time) or time <= state.time:
            return Intervention(time, "time", "", time, state.time)
        if time - state.time > longest:
            return Intervention(time, "late", "", time - state.time, timeout)
        if not reading.time > state.measured and not time - state.fresh <= longest:
            return Intervention(time, "stale", "", time - state.fresh, timeout)
        for name, size, limits in self._needed:
            if fault := _fault(reading.values.get(name), size, limits):
                return Intervention(time, "input", name, *fault)
        for name, value in reading.values.items():
            if value is None or name in self.params.unchecked:
                continue
            if not (finite := np.isfinite(value)).all():
                return Intervention(time, "input", name, float(value[~finite][0]), math.inf)
        params, wrench = self.params, reading.values.get(self.params.wrench)
        if wrench is not None:
            for cause, part in (("torque", wrench[:3]), ("force", wrench[3:])):
                load, most = float(np.linalg.norm(part)), getattr(params, cause)
                if load > most:
                    return Intervention(time, cause, params.wrench, load, most)
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
        """Return the state after a step, what may be sent, and why that is not what was asked.

        The ``command`` is the law's answer by name, or None. What is sent lacks a place as long
        as it is not known from where it starts.
        """
        params, fresh = self.params, reading.time > state.measured
        given = command or {}
        asked = {name: np.array(given[name]) if name in given else None for name in params.limits}
        stop = state.stop or self.trouble(state, reading, time, abort=abort)
        stop = stop or self._not_meant(asked, time)
        interventions = [] if stop is None or stop is state.stop else [stop]
        # Where there was no step before, or the clock can't be believed, it took the period.
        known = math.isfinite(time) and time > state.time
        elapsed = time - state.time if known else params.period
        times = Times(elapsed, params.period, params.timeout)
        moving = dict[str, Moving]()
        for name, limits in params.limits.items():
            wanted = None if stop else asked[name]
            if limits is None:
                moving[name] = state.moving[name] if wanted is None else Moving(wanted)
                continue
            seen = reading.values.get(limits.measured) if fresh else None
            if seen is not None and not np.isfinite(seen).all():
                seen = None
            moving[name], held = limits.step(state.moving[name], wanted, seen, times)
            if not stop:
                interventions += [Intervention(time, one[0], name, *one[1:]) for one in held]
        now = time if math.isfinite(time) else state.time + elapsed
        changed = GuardState(
            moving=moving,
            stop=stop,
            time=now,
            measured=reading.time if fresh else state.measured,
            fresh=now if fresh or math.isnan(state.fresh) else state.fresh,
        )
        sent = {name: one.command for name, one in moving.items() if one.command is not None}
        return changed, sent, tuple(interventions)

    def _not_meant(self, asked: Mapping[str, Array | None], time: float) -> Intervention | None:
        for name, limits in self.params.limits.items():
            value, size = asked[name], 0 if limits is None else limits.size
            if limits is not None and value is not None and value.shape != (size,):
                return Intervention(time, "command", name, value.size, size)
            if fault := _fault(value, size, limits):
                return Intervention(time, "command", name, *fault)
        return None


def _fault(value: Array | None, size: int, limits: Limits | None) -> tuple[float, float] | None:
    """Return what of a vector can't be, and what would be allowed; None if it may be."""
    if value is None or value.size < size:
        return 0 if value is None else value.size, size
    if not (meant := np.abs(value) <= _MOST).all():
        return float(value[~meant][0]), _MOST
    if isinstance(limits, PoseLimits):
        length = float(np.linalg.norm(value[:4]))
        return (length, 1.0) if abs(length - 1) > _UNIT else None
    return None
