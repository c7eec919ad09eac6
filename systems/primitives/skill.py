"""A skill: states that run primitives, and the next state for each event (section 4, Fig. 4).

Source: Morrow, Nelson and Khosla. A skill is a list of states. Each names the primitives that it
runs and the next state for each of their events. ``tilted`` is a kind of jam: without an entry of
its own it uses that of ``jammed``. A state without an entry for an event, or for the end of its
time, fails. A failed skill retracts first, and reports the reason.
"""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final, Literal

from chamfer.models.validation import ParameterError, require_whole
from chamfer.systems.primitives.force_primitives import GuardedMove, Hold, Level, Obstructed, Stick
from chamfer.systems.primitives.position_primitives import Centre, Held, Place, Way
from chamfer.systems.primitives.primitive import EVENTS, STILL, Primitive
from chamfer.systems.primitives.seating import Press, Seat
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx, Spiral
from chamfer.systems.primitives.vision_primitives import (
    FixedPointRotation,
    VisGrasp,
    VisRotation,
    VisTranslation,
)

Outcome = Literal["done", "contact", "lost", "hindered", "jammed", "tilted", "timed out"]

OUTCOMES: Final[tuple[Outcome, ...]] = (*EVENTS, "timed out")
DONE: Final = "done"
RETRACT: Final = "retract"
FAILED: Final = "failed"


@dataclass(frozen=True)
class Retry:
    """The next state of an outcome for the first few times, and after that; then the skill fails.

    Each try changes the state that has the entry. In its primitives, the fields with the names of
    ``factors`` are multiplied by them each time.
    """

    target: str
    at_most: int = 3
    then: "Retry | None" = None
    factors: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        require_whole(self, "at_most")
        for name, factor in self.factors.items():
            if not 0 < factor < math.inf or factor == 1:
                allowed = "a finite number > 0 other than 1, which does nothing"
                raise ParameterError(f"factors.{name}", factor, allowed)

    @property
    def chain(self) -> "tuple[Retry, ...]":
        """This retry, and those that follow it."""
        return (self, *(self.then.chain if self.then else ()))


@dataclass(frozen=True, kw_only=True)
class SkillState:
    """A state of a skill."""

    name: str
    run: Sequence[Primitive]  # their velocities add; the first that has an event ends the state
    on: Mapping[Outcome, str | Retry]
    # next state of each outcome; DONE ends the skill; every other outcome fails
    timeout: float  # s
    grip: Literal["open", "close"] | None = None  # None: unchanged
    marks: bool = False  # whether the place of its first begin becomes the skill's mark
    from_mark: bool = False  # whether displacements count from the mark
    looks: bool = False  # whether the cameras are needed
    tares: bool = False  # whether the force sensor is tared meanwhile
    damping: tuple[float, ...] | None = None
    # N m s/rad and N s/m, of accommodation: infinity for stiff, 0 for its own; None: its own

    def __post_init__(self) -> None:
        given = self.damping
        if given is not None and not (len(given) == len(STILL) and all(d >= 0 for d in given)):
            raise ParameterError("damping", given, "six numbers >= 0, infinity for stiff")
        object.__setattr__(self, "run", tuple(self.run))

    def run_again(self, tried: Callable[[Outcome], int]) -> tuple[Primitive, ...]:
        """Return the primitives, after the given number of tries for each outcome."""
        run = tuple(self.run)
        for outcome, answer in self.on.items():
            left = tried(outcome) if isinstance(answer, Retry) else 0
            for retry in answer.chain if isinstance(answer, Retry) else ():
                times = min(left, retry.at_most)
                left -= times
                for name, factor in retry.factors.items():
                    run = tuple(scaled(one, name, factor**times) for one in run)
        return run

    def expected(self, outcome: Outcome) -> str:
        """Return in words the events that it waited for, other than an outcome and the retries."""
        waited = [
            event
            for event, answer in self.on.items()
            if event not in (outcome, "timed out") and isinstance(answer, str)
        ]
        words: dict[str, str] = {}
        for one in self.run:
            words |= _expected(one)
        mark = ", from the mark" if self.from_mark else ""
        told = [f"{event}: {words[event]}{mark}" for event in waited if event in words]
        return "; or ".join(told or waited)


@dataclass(frozen=True, kw_only=True)
class Skill:
    """States, of which the first is the start, and the retract of a failure."""

    name: str
    states: Sequence[SkillState]
    retract: Sequence[Primitive]
    retract_timeout: float = 5.0  # s
    held: bool = False  # whether the gripper begins closed

    def __post_init__(self) -> None:
        for name in ("states", "retract"):
            object.__setattr__(self, name, tuple(getattr(self, name)))


def _expected(primitive: Primitive) -> dict[str, str]:
    """Return in words the conditions of a primitive's events, where it has them."""

    def words(size: float) -> str:
        turns = "r" in getattr(primitive, "direction", "")
        return f"{math.degrees(size):.3g} degrees" if turns else f"{1e3 * size:.3g} mm"

    match primitive:
        case GuardedMove(direction=way, threshold=force, limit=limit):
            unit = "N m" if "r" in way else "N"
            return {"contact": f"{force:.3g} {unit} within {words(limit)} along {way}"}
        case Stick(direction=way, threshold=threshold) if threshold < math.inf:
            return {"lost": f"more than {words(threshold)} along {way}"}
        case Seat(distance=distance):
            return {"done": f"a stop after at least {words(distance)}"}
        case Way(direction=way, least=least, most=most):
            bound = f", at most {words(most)}" if most < math.inf else ""
            return {"done": f"at least {words(least)}{bound} along {way}"}
    return {}


def scaled(primitive: Primitive, name: str, factor: float) -> Primitive:
    """Return a primitive with a field, and that of the primitives in it, times a factor."""
    changes: dict[str, Any] = {}
    for one in fields(primitive):  # type: ignore[arg-type]
        value = getattr(primitive, one.name)
        if isinstance(value, Primitive):
            changes[one.name] = scaled(value, name, factor)
        elif one.name == name and isinstance(value, float):
            changes[name] = factor * value
        elif one.name == name and isinstance(value, tuple):
            changes[name] = tuple(factor * each for each in value)
    return replace(primitive, **changes) if changes else primitive  # type: ignore[type-var]


# All primitives by name, as a skill in a file names them.
PRIMITIVES: Final[Mapping[str, type[Primitive]]] = {
    one.__name__: one
    for one in (
        Centre,
        Dither,
        FixedPointRotation,
        GuardedMove,
        Held,
        Obstructed,
        Hold,
        Level,
        MoveDx,
        Place,
        Press,
        Seat,
        Spiral,
        Stick,
        VisGrasp,
        VisRotation,
        VisTranslation,
        Way,
    )
}
