"""The strategy that inserts a round peg: alignment by contact, a search, and a push to the bottom.

It is not in the paper; its primitives are. The peg is laid flat on the face beside the hole, where
it can't tip in, and is carried back over the hole without turning. It searches for the hole along
the face, by the paper's two dithers, along a spiral, or with a leaning peg.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, ClassVar, Literal, get_args

from chamfer.models.validation import require_one_of, require_whole
from chamfer.systems.primitives.force_primitives import Stick
from chamfer.systems.primitives.primitive import Primitive
from chamfer.systems.primitives.skill import DONE, Retry, SkillState
from chamfer.systems.primitives.trajectory_primitives import Dither, Spiral, lissajous
from chamfer.systems.strategies.face_and_search import ALONG, TiltSearchParams, TouchParams

if TYPE_CHECKING:  # it brings Drake along
    from chamfer.models.connectors.round_peg import RoundPeg

Search = Literal["dithers", "spiral", "tilt"]


@dataclass(frozen=True, kw_only=True)
class PegInHoleSkillParams(TouchParams):
    """Parameters of the insertion; all of them are assumed."""

    beside: float = 0.017  # m, at which even a peg with an error has the hole on one side alone
    search: Search = "dithers"  # along two sines, as in the paper, along a spiral, or tilted
    amplitude: float = 0.0035  # m, of each dither of the search
    frequency: float = 0.6  # Hz, of the search's slower dither
    repeats: int = 11  # cycles of it until the pattern repeats, N
    spiral: Spiral = Spiral(pitch=0.0007, radius=0.0045, speed=0.006)
    # m, m and m/s, in place of the dithers
    tilt: TiltSearchParams = TiltSearchParams()  # of the peg, in place of the dithers
    drop: float = 0.0008  # m, of a peg that has found the hole
    limit_share: float = 1.25  # the seating force instead of the mating force
    out_speed: float = 0.04  # m/s, less than for the push
    push_speed: float = 0.011  # m/s, of the push at first; D times it is its force at rest

    NAME: ClassVar[str] = "peg in a hole"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "search", get_args(Search))
        require_whole(self, "repeats")

    def to_hole(self, radius: float) -> tuple[SkillState, ...]:
        """Return the states from ``tare`` on, until a peg in the hole leads to ``insert``."""
        if self.search == "tilt":
            leaning = self.tilt.states(self, radius, found="insert")
            return (*self.laid_flat(then="lean"), *leaning)
        return (*self.touched(search="search", found="insert"), self.along_face(found="insert"))

    def along_face(self, *, found: str) -> SkillState:
        """Return the state that searches for the hole along the face, beginning over it."""
        motions, time = self._along
        return SkillState(
            name="search",
            run=[Stick(speed=self.maintained, threshold=self.drop), *motions],
            on={"lost": found, "done": self.again},
            damping=ALONG,
            timeout=2 * time,
        )

    @property
    def _along(self) -> tuple[tuple[Primitive, ...], float]:
        """Return the motions of a search along the face, and their duration, s."""
        if self.search == "spiral":
            return (self.spiral,), self.spiral.duration
        first = Dither(axis="x", amplitude=self.amplitude, frequency=self.frequency)
        return lissajous(
            first=first, axis="y", repeats=self.repeats
        ), self.repeats / self.frequency

    def states(self, connector: "RoundPeg", period: float) -> tuple[SkillState, ...]:
        """Return the states from ``tare`` on."""
        depth = connector.mated_depth
        return (
            *self.to_hole(connector.peg_radius),
            *self.pushed(connector.mating_force, depth, then="depth"),
            self.at_depth(depth, DONE),
        )

    def pushed(self, force: float, depth: float, *, then: str) -> tuple[SkillState, ...]:
        """Return the states that push to a depth, m, with a needed force of that size, N."""
        insert = SkillState(
            name="insert",
            from_mark=True,
            run=[self.seat(force, speed=self.push_speed, distance=depth - self.end)],
            on={
                "done": then,
                "jammed": self.again,
                "tilted": Retry("loosen", 1, then=self.again),
                "timed out": self.again,
            },
            timeout=5.0 + 2 * depth / self.push_speed,
        )
        return insert, *self.straightened("insert")
