"""Push with a force that rises only as far as the measured motion requires.

Under damping control a commanded velocity v is a force of D v where nothing moves, and D (v - w)
where the part moves with w. The ramp raises v only while nothing moves. A part that gives way has
therefore been pushed hardly more than necessary, and the next obstacle meets that force at most.

The required force is unknown. The ramp pushes up to a harmless force in any case; beyond, with
little more than the force at which the part has moved. A lead-in that is much stiffer than the
wrist can't be told from a stop while the force rises. Where such a lead-in may be, the ramp pushes
a little harder, goes back to the force before, and compares the place at the *same* force. The
wrist's deflection cancels there, whatever its stiffness, and friction holds the gained
displacement. The first part of a lead-in moves too little even for that; there the ramp pushes
with a given force.

A part that has jammed is out of line, or meets an obstacle. The wrench does not distinguish the
two: where accommodation turns readily no torque is left of either, and the plug lies flat on an
obstacle. The turn since the part was in line does.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import ClassVar, Final, Literal, NamedTuple

from chamfer.models.validation import ParameterError, require_all_positive, require_finite
from chamfer.systems.primitives.force_primitives import (
    Directed,
    PrimitiveLoad,
    along,
    out_of_line,
    velocity,
)
from chamfer.systems.primitives.primitive import STILL, Event, Observation, Stepped
from chamfer.systems.statechart.chart import TIME_TOLERANCE

# Windows of a look whether it creeps: until the force has settled, and of a mean.
_SETTLING: Final = 3
_LAGGING: Final = 2  # in which the force of a command that fell may still be more than its own
_MEAN: Final = 12
_JUMP: Final = 4.0  # times what is no motion in a window: no creeping any more
_NEARLY: Final = 0.8  # of the force that is allowed, that is felt at least as it has jammed
_SOFTER: Final = 3.2  # times, a lead-in at most that has given way to the force before
_LITTLE: Final = 1.02  # by which a command may be beyond what its force allows

_Phase = Literal["ramp", "before", "harder", "after"]


class _Pushing(NamedTuple):
    """The memory of a ramp; places in m or rad, forces in N or N m against the motion."""

    start: float  # place from which the way counts
    turns: tuple[float, ...]  # rad, about x and y, from which a tilt counts
    speed: float  # commanded now, m/s or rad/s
    proved: float  # force at which it has moved, or that needs no proof
    since: float = 0.0  # s, when the window began
    place: float = 0.0  # sum of the window's samples
    force: float = 0.0  # likewise
    samples: int = 0
    last: tuple[float, float] | None = None  # place and force, means of the window before
    moved: float = 0.0  # way after the first window, and what moved since
    proof: tuple[float, float] | None = None  # place and force at which it moved for sure last
    crept: float = 0.0  # way since then in windows in which it did not seem to move
    sliding: float = 0.0  # least force of the windows in which it moved last
    still: int = 0  # windows in a row in which nothing moved
    rested: float = 0.0  # force in the first of all since it moved for sure
    damping: float = 0.0  # largest measured force over speed while nothing moved
    phase: _Phase = "ramp"
    windows: int = 0  # of the phase
    sum: float = 0.0  # of the places of the phase's windows
    before: float = 0.0  # mean place before it was pushed harder
    low: float = 0.0  # speed commanded then


@dataclass(frozen=True, kw_only=True)
class Seat(Directed):
    """Pushes with a rising force until the end stop, or until more force is not justified.

    Window by window it compares the means of place and force. If the force rises as against a
    stiffness of more than ``stiffness``, nothing moves, and the command grows. If the part moves,
    the command falls to a little more than the force of that motion. The displacement is the one
    at the start plus all motion since, so that the uncertain deflection of the wrist is left out.
    Windows begin at multiples of their length, whichever ticks are missing.

    Events:

    - ``done``, the end stop: nothing moves any more, the displacement is at least ``distance``,
      and the force is ``rise`` times that of the sliding before.
    - ``jammed``: nothing moves, although the push has reached ``free`` and ``share`` of every
      force at which the part has moved, or the limit.
    - ``tilted``, in place of ``jammed``: it has turned by more than ``tilt`` since its start, or
      since the mark.
    """

    speed: float = 0.006  # m/s or rad/s, at first; its force is D times it; assumed
    growth: float = 1.1  # of the speed, per window in which nothing moves; assumed
    fastest: float = 0.3  # m/s or rad/s, largest speed of the growth; assumed
    window: float = 0.08  # s; assumed
    still: float = 4e-5  # m or rad, per window: a smaller displacement is no motion; assumed
    stiffness: float = 3e4
    # N/m or N m/rad, of an end stop at least; it appears as soft as 4.7e4 where the wrist has
    # 30 % less stiffness than the 2e4 N/m that are believed
    rise: float = 1.12  # of the force at the end stop over that of sliding; assumed
    harder: float = 0.0
    # of the force with which it came to rest, that the end stop holds too: more than 1 where a
    # spring opposes the motion, which stops at any depth; 0: not asked
    sure: float = 2.0  # times the largest displacement that is no motion: proves a motion; assumed
    limit: float = 60.0  # N or N m, against the motion: jammed
    free: float | None = None
    # N or N m, up to which it pushes whether or not anything moves; None: the limit
    share: float = 1.35
    # of the force at which it has moved, largest push beyond ``free``; assumed
    steep: tuple[float, float] | None = None
    # m or rad, ways between which a lead-in may be that moves too little to be seen; None: none is
    through: float | None = None
    # N or N m, that it pushes with there whether or not anything moves
    steepest: float = 2.7e6
    # N/m or N m/rad, of such a lead-in at most, at that force; the more it is pushed, the softer
    # it is, at first by the square of the force; assumed
    distance: float = 0.004  # m or rad, least displacement of a seated part
    tilt: tuple[float, float] | None = None
    # rad, about x and y, largest turn that is not tilted: more than the misalignment at the start;
    # None: never tilted

    WORD: ClassVar[str] = "seat"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite(self, "distance")
        require_all_positive(self, "distance", "harder")
        for name in ("growth", "rise", "share", "sure"):
            if not 1 < getattr(self, name) < math.inf:
                raise ParameterError(name, getattr(self, name), "a finite number > 1")
        if not 0 <= self.harder < self.share:
            allowed = f"0 to less than share, {self.share:g}"
            raise ParameterError("harder", self.harder, allowed)
        if not self.rise < self.share:
            allowed = f"less than share, {self.share:g}: the end stop is detected by it"
            raise ParameterError("rise", self.rise, allowed)
        if self.free is not None and not 0 < self.free <= self.limit:
            allowed = f"a number > 0, at most the limit, {self.limit:g}; or none"
            raise ParameterError("free", self.free, allowed)
        if (self.through is None) != (self.steep is None):
            raise ParameterError("through", self.through, "with steep a force, without it none")
        least = self.limit if self.free is None else self.free
        if self.through is not None and not least <= self.through <= self.limit:
            allowed = f"{least:g} to {self.limit:g}, from free to the limit; or none"
            raise ParameterError("through", self.through, allowed)
        if self.steep is not None and not (len(self.steep) == 2 and self.steep[0] < self.steep[1]):
            raise ParameterError("steep", self.steep, "two numbers, least < most; or none")
        if self.tilt is not None and not (len(self.tilt) == 2 and min(self.tilt) > 0):
            raise ParameterError("tilt", self.tilt, "two numbers > 0; or none")

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, each with the earliest time, s."""
        found: dict[Event, float] = {"done": 2 * self.window, "jammed": 2 * self.window}
        return found if self.tilt is None else {**found, "tilted": 2 * self.window}

    @property
    def load(self) -> PrimitiveLoad:
        """The largest speed and force."""
        return PrimitiveLoad(self.direction, self.fastest, self.limit)

    def begin(self, sensed: Observation) -> _Pushing:
        """Remember the place of the start."""
        start = along(self.direction, sensed.carriage)
        proved = self.limit if self.free is None else self.free / self.share
        return _Pushing(start, sensed.carriage[:2], self.speed, proved)

    def step(self, sensed: Observation, memory: _Pushing, time: float) -> Stepped:
        """Push; at the end of a window evaluate the motion."""
        place = along(self.direction, sensed.carriage)
        memory = memory._replace(
            place=memory.place + place,
            force=memory.force - along(self.direction, sensed.wrench),
            samples=memory.samples + 1,
        )
        event: Event | None = None
        if time - memory.since >= self.window - TIME_TOLERANCE:
            memory, event = self._judged(memory, time)
            if event == "jammed" and self.tilt is not None:
                tilted = out_of_line(memory.turns, sensed.carriage, self.tilt)
                event = "tilted" if tilted else event
        speed = velocity(self.direction, memory.speed)
        return Stepped(memory, STILL if event else speed, event)

    def _judged(self, memory: _Pushing, time: float) -> tuple[_Pushing, Event | None]:
        place, force = memory.place / memory.samples, memory.force / memory.samples
        windows = (time - memory.since + TIME_TOLERANCE) // self.window
        since = memory.since + windows * self.window
        fresh = memory._replace(since=since, place=0.0, force=0.0, samples=0, last=(place, force))
        if memory.last is None:
            return fresh._replace(moved=place - memory.start, proof=(place, force)), None
        way, rise = place - memory.last[0], force - memory.last[1]
        # A wrist that is stiffer than believed seems to move as the force falls.
        falling = memory.phase == "after" and memory.windows < _SETTLING
        none = max(self.still, rise / self.stiffness)
        seems = sure = way > self.sure * none
        if memory.phase == "ramp":
            assert memory.proof is not None
            # A spring gives way so slowly that only many windows together show it.
            far, more = place - memory.proof[0], abs(force - memory.proof[1])
            sure = sure or far > self.sure * max(self.still, more / self.stiffness)
            seems = sure or way > none
        if seems and not falling:
            if force >= self.limit:  # nor does it push harder where it seems to move on and on
                return fresh, "jammed"
            if sure:
                fresh = fresh._replace(
                    proved=max(memory.proved, min(force, self.limit)),
                    proof=(place, force),
                    moved=memory.moved + memory.crept,
                    crept=0.0,
                )
            return self._slid(fresh, way, way / (since - memory.since), force, sure), None
        if memory.phase == "ramp":
            fresh = fresh._replace(crept=memory.crept + way)
        fresh = fresh._replace(still=memory.still + 1, rested=memory.rested or force)
        if fresh.still > _LAGGING and not falling:
            fresh = fresh._replace(damping=max(memory.damping, force / memory.speed))
        if memory.phase != "ramp":
            return self._looked(fresh, place)
        stopped = force >= max(self.rise * memory.sliding, self.harder * fresh.rested)
        if memory.moved >= self.distance and stopped:
            return fresh, "done" if fresh.still > 1 else None
        return self._raised(fresh, force)

    def _slid(
        self, memory: _Pushing, way: float, rate: float, force: float, sure: bool
    ) -> _Pushing:
        """Return the memory after a window in which it moved by a way, m, at a rate, m/s."""
        # What is left of the command beside the motion is the force: a little more than that.
        begins = (memory.still > 0 and sure) or memory.sliding == 0
        needed = self.share * (memory.speed - rate)
        return memory._replace(
            speed=min(memory.speed, max(self.speed, needed)),
            moved=memory.moved + way,
            sliding=force if begins else min(force, memory.sliding),
            still=0,
            rested=0.0 if sure else memory.rested,
            phase="ramp",
        )

    def _raised(self, memory: _Pushing, force: float) -> tuple[_Pushing, Event | None]:
        """Return the memory after a window in which nothing moved, as the command grows."""
        looks = False
        if self.steep is not None and self.through is not None:
            looks = self.steep[0] <= memory.moved <= self.steep[1]
            if looks:
                memory = memory._replace(proved=max(memory.proved, self.through / self.share))
        allowed = memory.proved if looks else self._most(memory)
        most = self._speed(memory, allowed)
        if memory.speed < most:
            return memory._replace(speed=min(memory.speed * self.growth, most)), None
        if memory.speed > _LITTLE * most:
            if force >= self._most(memory):
                return memory, "jammed"
            return memory._replace(speed=most), None
        if memory.still <= _LAGGING or force < _NEARLY * allowed:
            return memory, None
        if not looks or self._most(memory) <= memory.proved:
            return memory, "jammed"
        return memory._replace(phase="before", windows=0, sum=0.0), None

    def _looked(self, memory: _Pushing, place: float) -> tuple[_Pushing, Event | None]:
        """Return the memory after a window of the creep test, which pushes harder and back."""
        windows = memory.windows + 1
        counts = windows > _SETTLING
        memory = memory._replace(windows=windows, sum=memory.sum + (place if counts else 0.0))
        begun = memory._replace(windows=0, sum=0.0)
        if memory.phase == "harder":
            back = begun._replace(phase="after", speed=memory.low)
            return (back if counts else memory), None
        if windows < _SETTLING + _MEAN:
            return memory, None
        mean = memory.sum / _MEAN
        if memory.phase == "before":
            high = self._speed(memory, self._most(memory))
            looked = begun._replace(before=mean, low=memory.speed)
            return looked._replace(phase="harder", speed=high), None
        harder, crept = self._most(memory), mean - memory.before
        assert self.through is not None
        softer = min((harder / self.through) ** 2, _SOFTER)
        if crept < softer * (harder - memory.proved) / self.steepest:
            return memory, "jammed"
        # What has jumped needs no more for all that is known.
        proved = memory.proved if crept > _JUMP * self.still else harder
        moved = memory.moved + crept
        return begun._replace(
            phase="ramp", proved=proved, moved=moved, proof=memory.last, crept=0.0
        ), None

    def _most(self, memory: _Pushing) -> float:
        """Return the largest allowed force of the push."""
        return min(self.limit, self.share * memory.proved)

    def _speed(self, memory: _Pushing, force: float) -> float:
        """Return the speed whose force at rest is that."""
        return min(force / memory.damping, self.fastest) if memory.damping > 0 else self.fastest


@dataclass(frozen=True, kw_only=True)
class Press(Directed):
    """Continues with a share of the velocity commanded before its start; it has no event."""

    share: float = 1.0  # of that velocity

    WORD: ClassVar[str] = "press"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_all_positive(self)

    def begin(self, sensed: Observation) -> float:
        """Remember the command of the state before."""
        return self.share * along(self.direction, sensed.perturbed)

    def step(self, sensed: Observation, memory: float, time: float) -> Stepped:
        """Command it further."""
        return Stepped(memory, velocity(self.direction, memory))
