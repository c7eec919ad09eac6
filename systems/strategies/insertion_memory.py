"""What the insertion's chart reads and remembers."""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, Literal, NamedTuple, get_args

from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_one_of,
    require_positive,
)
from chamfer.systems.strategies.insertion_decision import (
    DecisionParams,
    InsertionRegion,
    MeasuredErrors,
    measured_errors,
)

Compensation = Literal["running", "frozen"]
Vector3 = tuple[float, float, float]
Frame = tuple[float, ...]

_MOST_ATTEMPTS: Final = 100


class Trouble(IntEnum):
    """What stopped an attempt, as far as the chart can tell."""

    NONE = 0
    WEDGED = 1  # in the bore, held when the push was taken away
    JAMMED = 2  # in the bore, held by the push alone
    AT_MOUTH = 3  # pushed as hard as it may, not beyond the chamfers
    BEFORE_MOUTH = 4  # it did not get to the mouth
    SHORT = 5  # the feed ended before the depth
    BESIDE = 6  # on its way to miss the mouth
    HELD = 7  # it can't be pulled out of the hole
    NOT_ALIGNED = 8  # the errors did not become small enough in time


WORDS: Final = {
    Trouble.NONE: "",
    Trouble.WEDGED: "wedged",
    Trouble.JAMMED: "jammed",
    Trouble.AT_MOUTH: "stuck at the mouth, the peg does not enter: too thick, or on an edge",
    Trouble.BEFORE_MOUTH: "the arm did not get to the mouth",
    Trouble.SHORT: "not deep enough at the end of the feed",
    Trouble.BESIDE: "on its way to miss the mouth",
    Trouble.HELD: "held in the hole, could not be pulled out",
    Trouble.NOT_ALIGNED: "not aligned in time",
}


@dataclass(frozen=True, kw_only=True)
class InsertParams:
    """How the peg is inserted, and when it is enough.

    Forces are those of the arm's own springs, by command and encoders, tared where the peg
    begins to advance; the joints' dry friction makes them unsure by 1 N, in the worst of 50 runs
    by 1.7 N.
    """

    compensation: Compensation = "running"
    # running: errors are compensated during the advance too; frozen: as section 5 proposes
    freeze_depth: float | None = None
    # m, of the tip below the mouth, from which on a running one is frozen; None: never
    pause: float = 0.0  # s, from the decision to the advance
    speed: float | None = None
    # m/s, of the feed; None: derived, 0.02, assumed, or as much slower as the play asks for
    depth: float | None = None
    # m, commanded, of the tip below the mouth; None: derived, to where the bore ends
    feed: float | None = None  # m, most; None: derived, until the push can be reached at the mouth
    push: float = 8.0  # N, along the axis, with which the peg is stuck; assumed
    pull: float = 12.0  # N, likewise, with which it is pulled out at most; assumed
    force_limit: float = 15.0  # N, in any direction, with which all stops; assumed
    hold_force: float = 2.0  # N, in any direction, beyond which nothing is compensated; assumed
    bottom_force: float = 2.0  # N, along the axis, that tells the bottom where one is; assumed
    held_force: float = 1.5  # N, of a pull, beyond the arms' own friction: wedged; assumed
    rest: float = 0.2  # s, before it is said where the peg is; assumed
    attempts: int = 3  # before it gives up; assumed

    def __post_init__(self) -> None:
        require_one_of(self, "compensation", get_args(Compensation))
        given = [name for name in ("speed", "depth", "feed") if getattr(self, name) is not None]
        require_positive(
            self,
            *given,
            "push",
            "pull",
            "force_limit",
            "hold_force",
            "bottom_force",
            "held_force",
        )
        require_not_negative(self, "rest", "pause")
        if self.freeze_depth is not None and not (
            self.compensation == "running" and math.isfinite(self.freeze_depth)
        ):
            allowed = "a finite number if insert.compensation is running, else null"
            raise ParameterError("freeze_depth", self.freeze_depth, allowed)
        for name in ("push", "pull"):
            if not (value := getattr(self, name)) < self.force_limit:
                allowed = f"less than force_limit, {self.force_limit:g} N"
                raise ParameterError(name, value, allowed)
        if not 1 <= self.attempts <= _MOST_ATTEMPTS:
            raise ParameterError("attempts", self.attempts, f"1 to {_MOST_ATTEMPTS}")


@dataclass(frozen=True, kw_only=True)
class ResolvedInsertParams(InsertParams):
    """The same with nothing left open."""

    speed: float
    depth: float
    feed: float


@dataclass(frozen=True, kw_only=True)
class InsertionTaskParams:
    """Parameters of :class:`chamfer.systems.strategies.insertion_task.InsertionTask`."""

    decide: DecisionParams
    insert: ResolvedInsertParams
    region: InsertionRegion
    chamfer_height: float  # m, of both chamfers: above it the peg is at the mouth
    bottom: float = math.inf  # m, of a blind hole, below its mouth
    gap: float = 0.03  # m, from tip to mouth where the peg is aligned
    pixel_size: float = 0.0005  # m
    begin: float = 1.5  # s, from when on the cameras count
    wait: float = 2.5  # s, of decide.kind wait; section 5
    limits: tuple[float, ...] = (math.inf,) * 6  # m and rad, of the compensation
    most_saturated: float = 0.5  # s, that a joint may be at its torque limit; assumed
    period: float = 1 / 80  # s, section 4

    @property
    def target(self) -> float:
        """Depth of the tip that is wanted, m."""
        return min(self.insert.depth, self.bottom)


class InsertionInputs(NamedTuple):
    """What the chart reads; each is measured by something that a real cell has."""

    error: Frame  # pixels and rad, by the cameras
    valid: Frame
    blind: Frame
    diverged: Frame
    compensation: Frame  # m and rad, so far
    force: Vector3  # N, of the arm's springs along the hole's axes
    advance: Frame  # m, of the tip beyond the mouth, by the encoders
    peg_saturated: Frame  # of each joint
    hole_saturated: Frame | None  # None: the hole is no arm's


class InsertionMemory(NamedTuple):
    """What the chart remembers from tick to tick."""

    feed: float = 0.0  # m, at that time
    rate: float = 0.0  # m/s
    time: float = 0.0  # s
    compensates: bool = True
    along: bool = True  # the error along the axis too
    attempts: int = 0
    frames: tuple[Frame, ...] = ()  # the last valid ones
    began: float = 0.0  # s, to align
    saturated_since: float = math.inf  # s
    zero: Vector3 = (0.0, 0.0, 0.0)  # N, tare
    mouth: float = 0.0  # m, advance by the encoders at which the tip is at the mouth
    stopped: float = 0.0  # m, depth at which the attempt was stopped
    came_out: float = 0.0  # m, that it came out as the push was taken away
    pull: float = 0.0  # N, strongest, as it was withdrawn
    trouble: Trouble = Trouble.NONE
    sensed_force: Vector3 = (0.0, 0.0, 0.0)  # N, tared, along the hole's axes
    sensed_depth: float = 0.0  # m, of the tip below the mouth
    errors: MeasuredErrors = MeasuredErrors(0.0, 0.0, 0.0, 0.0)

    def window(self, inputs: InsertionInputs, count: int) -> tuple[Frame, ...]:
        """Return the last valid frames with the present one, none if that is not valid."""
        if not inputs.valid[0] >= 0.5:
            return ()
        return (*self.frames, inputs.error)[-count:]

    def depth(self, inputs: InsertionInputs) -> float:
        """Return the depth of the tip below the mouth, m."""
        return inputs.advance[0] - self.mouth

    def load(self, inputs: InsertionInputs) -> Vector3:
        """Return what the arm pushes with along the hole's axes, N, tared."""
        x, y, z = (force - zero for force, zero in zip(inputs.force, self.zero, strict=True))
        return x, y, z


def errors_across(frames: tuple[Frame, ...], pixel_size: float) -> MeasuredErrors:
    """Return the errors that matter to an insertion, over frames of six axes."""
    return measured_errors([(e[1], e[2], e[4], e[5]) for e in frames], pixel_size)
