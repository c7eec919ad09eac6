"""Primitives that go to a place, keep a dither in its place, and measure a displacement.

They measure by encoders and the wrist's believed stiffness. Displacements count from the place at
which the primitive began, or from the skill's mark.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from operator import mul
from typing import ClassVar, Final, NamedTuple

import numpy as np

from chamfer.models.rotation import rotation_matrix
from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_not_negative,
    require_numbers,
    require_positive,
)
from chamfer.systems.primitives.force_primitives import Directed, along, out_of_line
from chamfer.systems.primitives.primitive import (
    FASTEST,
    STILL,
    TICK,
    Event,
    Observation,
    Primitive,
    Stepped,
    Vector,
)
from chamfer.systems.primitives.trajectory_primitives import Dither
from chamfer.systems.statechart.chart import TIME_TOLERANCE

_LINEAR: Final = slice(3, 6)
_DOWN: Final = 5  # place of the force along z in a wrench
_SURE: Final = 3.0  # standard deviations
_GAIN: Final = 6.0  # 1/s, with which the end of a way is approached


@dataclass(frozen=True, kw_only=True)
class Place(Primitive):
    """Goes straight to a place, given relative to the place of its start.

    Under damping control, anything that holds the tool is pulled with at most D times the speed. A
    speed that grows slowly is a force that grows until the tool comes free. Events: ``done`` at
    the place; ``contact`` when the force against the way reaches the threshold.
    """

    offset: tuple[float, float, float] = (0.0, 0.0, 0.0)  # m, along x, y and z
    speed: float = 0.02  # m/s, at most; assumed
    tolerance: float = 0.0002  # m, more than the noise of the measurement; assumed
    acceleration: float = math.inf  # m/s^2, growth of the allowed speed
    threshold: float = math.inf  # N, against the way; infinity: none

    WORD: ClassVar[str] = "place"

    def __post_init__(self) -> None:
        require_positive(self, "tolerance")
        require_positive(self, "speed", most=FASTEST, unit="m/s")
        require_numbers(self, 3, "offset")
        for name in ("acceleration", "threshold"):
            if not getattr(self, name) > 0:
                raise ParameterError(name, getattr(self, name), "a number > 0, infinity for none")

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, each with the earliest time, s."""
        found: dict[Event, float] = {"done": 0.0}
        return found if self.threshold == math.inf else {**found, "contact": 0.0}

    def begin(self, sensed: Observation) -> Vector:
        """Remember the goal."""
        return tuple(
            place + way for place, way in zip(sensed.carriage[_LINEAR], self.offset, strict=True)
        )

    def step(self, sensed: Observation, memory: Vector, time: float) -> Stepped:
        """Go on, the slower the closer."""
        left = [goal - here for goal, here in zip(memory, sensed.carriage[_LINEAR], strict=True)]
        distance = math.hypot(*left)
        if distance <= self.tolerance:
            # Every state lasts a tick, also this one where it begins at its end.
            return Stepped(memory, STILL, "done" if time > 0 else None)
        if -sum(map(mul, sensed.wrench[_LINEAR], left)) >= self.threshold * distance:
            return Stepped(memory, STILL, "contact")
        speed = min(self.speed, self.acceleration * max(time, TICK))
        rate = min(_GAIN, speed / distance)
        return Stepped(memory, (0.0, 0.0, 0.0, *(rate * way for way in left)))


@dataclass(frozen=True, kw_only=True)
class Centre(Primitive):
    """Removes the drift that contact adds to a dither, so that its middle stays; it has no event.

    Contact that gives way more to one side than to the other moves a dither.
    """

    dither: Dither  # that runs in the same state
    gain: float = 3.0  # 1/s; assumed
    offset: float = 0.0  # m or rad, of the middle from the place of the start

    def __post_init__(self) -> None:
        require_positive(self, "gain")
        require_finite(self, "offset")

    @property
    def label(self) -> str:
        """The name in a chart."""
        return f"centre {self.dither.axis}"

    def begin(self, sensed: Observation) -> float:
        """Remember the place of the middle."""
        return sensed.carriage[self.dither.index] + self.offset

    def step(self, sensed: Observation, memory: float, time: float) -> Stepped:
        """Go back to the place that the dither alone would have."""
        index = self.dither.index
        velocity = [0.0] * len(STILL)
        if not self.dither.done(time):
            added = sensed.carriage[index] - memory - self.dither.displacement(time)
            velocity[index] = -self.gain * added
        return Stepped(memory, tuple(velocity))


class _Averaged(NamedTuple):
    """The memory of a displacement measurement."""

    start: Vector  # carriage, rad above m
    sum: float = 0.0  # m or rad, of the ways of all samples
    samples: int = 0


@dataclass(frozen=True, kw_only=True)
class Way(Directed):
    """Measures, at rest, the displacement since its start.

    It waits, then takes the mean. Events: ``tilted`` if it has turned by more than ``tilt``, else
    ``done`` if the mean is between the bounds, else ``jammed``.

    Counted from the mark, with the same force as there, the uncertainty of the wrist's stiffness
    cancels. If a plug touched the face with a point beside its tip and is now in line, its turn
    since then gives the height of that point.
    """

    least: float = 0.001  # m or rad, of the displacement that is done
    most: float = math.inf  # m or rad, of the displacement that is done
    beside: tuple[float, float] = (0.0, 0.0)
    # m, along x and y: from the tip to the point that touched
    tilt: tuple[float, float] | None = None
    # rad, about x and y, largest that is no tilt; None: any
    wait: float = 0.2  # s, until the motion has settled; assumed
    time: float = 0.2  # s, of the mean; assumed

    WORD: ClassVar[str] = "way"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite(self, "least")
        require_positive(self, "wait", "time")
        if not self.most > self.least:
            raise ParameterError("most", self.most, f"a number > least, {self.least:g}")
        require_numbers(self, 2, "beside")
        if self.tilt is not None:
            require_numbers(self, 2, "tilt")

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, each with the earliest time, s."""
        names: tuple[Event, ...] = ("done", "jammed", *(() if self.tilt is None else ("tilted",)))
        return dict.fromkeys(names, self.wait + self.time)

    def begin(self, sensed: Observation) -> _Averaged:
        """Remember the place of the start."""
        return _Averaged(sensed.carriage)

    def step(self, sensed: Observation, memory: _Averaged, time: float) -> Stepped:
        """Wait, measure, and return the event."""
        if time < self.wait - TIME_TOLERANCE:
            return Stepped(memory)
        way = self._way(memory.start, sensed.carriage)
        taken = _Averaged(memory.start, memory.sum + way, memory.samples + 1)
        if time < self.wait + self.time - TIME_TOLERANCE:
            return Stepped(taken)
        mean = taken.sum / taken.samples
        if self.tilt is not None and out_of_line(memory.start, sensed.carriage, self.tilt):
            return Stepped(taken, STILL, "tilted")
        return Stepped(taken, STILL, "done" if self.least <= mean <= self.most else "jammed")

    def _way(self, start: Vector, now: Vector) -> float:
        x, y = self.beside
        then, upright = (  # as :func:`chamfer.models.arms.wrist.tip_pose` has it
            np.linalg.multi_dot([*map(rotation_matrix, np.diag(one[:3]))]) for one in (start, now)
        )
        axis = then @ upright[2]  # of the plug where it began, which is Z now
        height = -(axis[0] * x + axis[1] * y) / axis[2]
        moved = [here - there for here, there in zip(now, start, strict=True)]
        moved[5] -= height
        return along(self.direction, tuple(moved))


class _Weighed(NamedTuple):
    """Readings of the force downwards."""

    sum: float = 0.0  # N
    readings: int = 0


@dataclass(frozen=True, kw_only=True)
class Held(Primitive):
    """Checks the grip by the gripper's part sensor, and by the weight at the wrist.

    Events: ``lost`` as soon as the sensor reports no part, and at the end if less than half of the
    part's weight is measured; ``done`` if a part was held for the time. All come after the fingers
    had time to close, or the wrist to come to rest.

    A gripper without a sensor counts as one that holds. So does a weight below the noise, if half
    of it is less than three standard deviations of a mean. The zero has as many readings, and is
    taken right before the fingers close.
    """

    wait: float = 0.0  # s, for the fingers to close
    time: float = 0.1  # s, after that; infinity: monitors only
    weight: float = 0.0  # N, believed, of the part; 0: it isn't weighed

    WORD: ClassVar[str] = "held"

    def __post_init__(self) -> None:
        require_not_negative(self, "wait", "weight")
        if not self.time > 0:
            raise ParameterError("time", self.time, "a number > 0, infinity to watch")
        if self.weight and self.time == math.inf:
            raise ParameterError("time", self.time, "a finite number, for a part that is weighed")

    @property
    def events(self) -> Mapping[Event, float]:
        """The events that it can have, each with the earliest time, s."""
        lost: dict[Event, float] = {"lost": self.wait}
        return lost if self.time == math.inf else {"done": self.wait + self.time, **lost}

    def begin(self, sensed: Observation) -> _Weighed:
        """Start without any reading of the weight."""
        return _Weighed()

    def step(self, sensed: Observation, memory: _Weighed, time: float) -> Stepped:
        """Read the gripper's sensor and the weight."""
        closed = time - self.wait + TIME_TOLERANCE
        if closed < 0:
            return Stepped(memory)
        if sensed.holding is not None and sensed.holding[0] < 0.5:
            return Stepped(memory, STILL, "lost")
        weighed = _Weighed(memory.sum - sensed.wrench[_DOWN], memory.readings + 1)
        if closed < self.time:
            return Stepped(weighed)
        if not self.weight or sensed.spread is None:
            return Stepped(weighed, STILL, "done")
        hidden = _SURE * sensed.spread[_DOWN] * math.sqrt(2 / weighed.readings)
        light = weighed.sum / weighed.readings < self.weight / 2
        return Stepped(weighed, STILL, "lost" if light and hidden <= self.weight / 2 else "done")
