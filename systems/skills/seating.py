"""Pushing with as much force as it takes: a ramp up to a limit, until something is seated.

Under damping control a commanded velocity v is a force of D v where nothing moves, and D (v - w)
where it moves with w. The ramp raises v only while nothing moves: whatever gives way has been
pushed hardly more than it needed, and what is behind it is met with that force at most.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

from models.validation import ParameterError, require_finite, require_one_of, require_positive
from systems.skills.force_primitives import DIRECTIONS, Direction, Load, along, velocity
from systems.skills.primitive import STILL, Event, Sensed, Stepped
from systems.statechart.chart import TIME_TOLERANCE


class _Pushing(NamedTuple):
    """What a ramp remembers; places in m or rad, forces in N or N m against the motion."""

    start: float  # place from which the way counts
    speed: float  # commanded now, m/s or rad/s
    since: float = 0.0  # s, when the window began
    place: float = 0.0  # sum of the window's samples
    force: float = 0.0  # likewise
    samples: int = 0
    last: tuple[float, float] | None = None  # place and force, means of the window before
    moved: float = 0.0  # way after the first window, and what moved since
    sliding: float = 0.0  # least force of the windows in which it moved last
    still: int = 0  # windows in a row in which nothing moved


@dataclass(frozen=True, kw_only=True)
class Seat:
    """Pushes with a rising force until the end stop, or until the limit.

    Window by window it compares the means of place and force. Where the force rises as against
    something stiffer than ``stiffness``, nothing moves, and the command grows; else it stays. The
    way is the one at the begin, and what moved since: what the wrist gives by is left out as far
    as its stiffness is not known.

    Events: ``done`` where nothing moves any more, far enough, and the force is ``rise`` times
    that of the sliding before: the end stop. ``jammed`` where nothing moves at the limit.
    """

    direction: Direction = "-z"
    speed: float = 0.006  # m/s or rad/s, at first; its force is D times it; assumed
    growth: float = 1.1  # of the speed, per window in which nothing moves; assumed
    fastest: float = 0.2  # m/s or rad/s, that the speed grows to at most; assumed
    window: float = 0.08  # s; assumed
    still: float = 4e-5  # m or rad, per window: less is no motion; assumed
    stiffness: float = 3e4
    # N/m or N m/rad, of an end stop at least; it appears as soft as 4.7e4 where the wrist has
    # 30 % less stiffness than the 2e4 N/m that are believed
    rise: float = 1.12  # of the force at the end stop over that of sliding; assumed
    limit: float = 60.0  # N or N m, against the motion: jammed
    distance: float = 0.004  # m or rad, least way of what is seated

    def __post_init__(self) -> None:
        require_one_of(self, "direction", DIRECTIONS)
        require_positive(self, "speed", "fastest", "window", "still", "stiffness", "limit")
        require_finite(self, "distance")
        for name in ("growth", "rise"):
            if not 1 < getattr(self, name) < math.inf:
                raise ParameterError(name, getattr(self, name), "a finite number > 1")

    @property
    def label(self) -> str:
        """What a chart shows of it."""
        return f"seat {self.direction}"

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, each with the earliest time, s."""
        return {"done": 2 * self.window, "jammed": 2 * self.window}

    @property
    def load(self) -> Load:
        """How hard it pushes."""
        return Load(self.direction, self.fastest, self.limit)

    def begin(self, sensed: Sensed) -> _Pushing:
        """Remember where its way begins."""
        return _Pushing(along(self.direction, sensed.carriage), self.speed)

    def step(self, sensed: Sensed, memory: object, time: float) -> Stepped:
        """Push; at the end of a window see what that did."""
        assert isinstance(memory, _Pushing)
        place = along(self.direction, sensed.carriage)
        memory = memory._replace(
            place=memory.place + place,
            force=memory.force - along(self.direction, sensed.wrench),
            samples=memory.samples + 1,
        )
        event: Event | None = None
        if time - memory.since >= self.window - TIME_TOLERANCE:
            memory, event = self._judged(memory, time)
        speed = velocity(self.direction, memory.speed)
        return Stepped(memory, STILL if event else speed, event)

    def _judged(self, memory: _Pushing, time: float) -> tuple[_Pushing, Event | None]:
        place, force = memory.place / memory.samples, memory.force / memory.samples
        fresh = memory._replace(since=time, place=0.0, force=0.0, samples=0, last=(place, force))
        if memory.last is None:
            return fresh._replace(moved=place - memory.start), None
        way, rise = place - memory.last[0], force - memory.last[1]
        if way > max(self.still, rise / self.stiffness):
            sliding = force if memory.still else min(force, memory.sliding)
            moved = memory.moved + way
            return fresh._replace(moved=moved, sliding=sliding, still=0), None
        fresh = fresh._replace(still=memory.still + 1)
        if memory.moved >= self.distance and force >= self.rise * memory.sliding:
            return fresh, "done" if fresh.still > 1 else None
        if force >= self.limit:
            return fresh, "jammed"
        return fresh._replace(speed=min(memory.speed * self.growth, self.fastest)), None


@dataclass(frozen=True, kw_only=True)
class Press:
    """Goes on with the velocity that was commanded before it began; it has no event."""

    direction: Direction = "-z"

    def __post_init__(self) -> None:
        require_one_of(self, "direction", DIRECTIONS)

    @property
    def label(self) -> str:
        """What a chart shows of it."""
        return f"press {self.direction}"

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, each with the earliest time, s."""
        return {}

    def begin(self, sensed: Sensed) -> float:
        """Remember what accommodation perturbed last: the command of the state before."""
        return along(self.direction, sensed.perturbed)

    def step(self, sensed: Sensed, memory: object, time: float) -> Stepped:
        """Command it on."""
        assert isinstance(memory, float)
        return Stepped(memory, velocity(self.direction, memory))
