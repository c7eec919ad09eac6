"""What a skill is: states that run primitives, and what follows their events (section 4, Fig. 4).

Source: Morrow, Nelson and Khosla. A skill is written as a list of states; each names the
primitives that it runs and what follows each of their events. A state without an answer to an
event, or to the end of its time, fails: a failed skill retracts first, and says why it failed.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, Literal

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

Outcome = Literal["done", "contact", "lost", "hindered", "jammed", "timed out"]

OUTCOMES: Final[tuple[Outcome, ...]] = (*EVENTS, "timed out")
DONE: Final = "done"
RETRACT: Final = "retract"
FAILED: Final = "failed"


@dataclass(frozen=True)
class Retry:
    """What follows an outcome the first few times, and after that; then the skill fails."""

    target: str
    at_most: int = 3
    then: "Retry | None" = None

    def __post_init__(self) -> None:
        require_whole(self, "at_most")


@dataclass(frozen=True, kw_only=True)
class SkillState:
    """A state of a skill."""

    name: str
    run: Sequence[Primitive]  # their velocities add; the first that has an event ends the state
    on: Mapping[Outcome, str | Retry]  # what follows; DONE ends the skill; all else fails
    timeout: float  # s
    grip: Literal["open", "close"] | None = None  # None: as it is
    marks: bool = False  # where it begins for the first time is the skill's mark
    from_mark: bool = False  # ways count from the mark
    looks: bool = False  # whether the cameras are needed
    tares: bool = False  # whether the force sensor takes its zero meanwhile
    damping: tuple[float, ...] | None = None
    # N m s/rad and N s/m, of accommodation: infinity for stiff, 0 for its own; None: its own

    def __post_init__(self) -> None:
        given = self.damping
        if given is not None and not (len(given) == len(STILL) and all(d >= 0 for d in given)):
            raise ParameterError("damping", given, "six numbers >= 0, infinity for stiff")
        object.__setattr__(self, "run", tuple(self.run))

    def expected(self, outcome: Outcome) -> str:
        """Return in words what it waited for, other than an outcome and what is tried again."""
        waited = [
            event
            for event, answer in self.on.items()
            if event not in (outcome, "timed out") and isinstance(answer, str)
        ]
        words = {event: text for one in self.run for event, text in one.expects.items()}
        mark = ", from the mark" if self.from_mark else ""
        told = [f"{event}: {words[event]}{mark}" for event in waited if event in words]
        return "; or ".join(told or waited)


@dataclass(frozen=True, kw_only=True)
class Skill:
    """States, the first of which it begins with, and what it does when it fails."""

    name: str
    states: Sequence[SkillState]
    retract: Sequence[Primitive]
    retract_timeout: float = 5.0  # s
    held: bool = False  # whether the gripper begins closed

    def __post_init__(self) -> None:
        for name in ("states", "retract"):
            object.__setattr__(self, name, tuple(getattr(self, name)))


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
