"""The search for the hole by contact, for errors that cameras and belief leave.

A spiral covers a disc around the place of the first touch. A leaning peg finds a hole that is off
by less than about its radius: see
:class:`chamfer.systems.strategies.face_and_search.TiltSearchParams`, which names the sources.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Literal, NamedTuple, get_args

from chamfer.models.peg.peg_and_hole import PegAndHole
from chamfer.models.validation import (
    ParameterError,
    known,
    require_not_negative,
    require_one_of,
    require_positive,
    require_same,
)
from chamfer.systems.primitives.trajectory_primitives import Spiral

SearchKind = Literal["none", "spiral", "tilt"]
Across = tuple[float, float]  # along y and z of the hole
Offset = tuple[float, float, float, float]  # m, along y and z of the hole, and rad, about them

STILL: Final[Offset] = (0.0, 0.0, 0.0, 0.0)
_TURN: Final = math.pi * (3 - math.sqrt(5))  # rad, the golden angle, between two attempts
_BOTH: Final = ("press", "speed", "drop", "reach")
_READ: Final[Mapping[SearchKind, tuple[str, ...]]] = {
    "none": (),
    "spiral": (*_BOTH, "radius", "pitch", "hold", "widen"),
    "tilt": (*_BOTH, "angle", "back", "wall", "lean_time"),
}


@dataclass(frozen=True, kw_only=True)
class SearchParams:
    """Parameters of the search for the hole while the peg lies on the face beside it.

    Each further attempt is turned by the golden angle. The tracks of a spiral then come to lie
    between those of the attempts before, and a peg leans in another direction.
    """

    kind: SearchKind = "none"
    # spiral: slides around the first touch; tilt: leans, slides to the wall, stands up; none
    press: float = 3.0  # N, that keeps it on the face; assumed
    speed: float = 0.008  # m/s, along the face; assumed
    drop: float | None = None
    # m, that it goes in at the hole; None: derived, the chamfers' height and 0.5 mm
    reach: float | None = None
    # m, along the axis, largest error of the believed face; None: derived
    radius: float | None = None  # m, of the spiral; None: derived, the largest error of the hole
    pitch: float | None = None
    # m, of the spiral; None: derived, half of the capture's width: half is left to uncertainty
    hold: float = 6.0  # N, across, that shows that the hole holds it; assumed
    widen: float = 0.25  # of the radius, growth in each further attempt; assumed
    angle: float = math.radians(10)  # rad, of the lean; assumed
    back: float | None = None
    # m, from the believed hole to the place of the lean; None: derived, more than the error
    wall: float | None = None  # N, across, of the hole's wall; None: derived, more than friction
    lean_time: float = 0.6  # s, of the lean, and of standing up; assumed

    def __post_init__(self) -> None:
        require_one_of(self, "kind", get_args(SearchKind))
        require_positive(self, "press", "speed", "drop", "radius", "pitch", "hold", "back", "wall")
        require_positive(self, "reach", "lean_time")
        require_not_negative(self, "widen")
        if not 0 < self.angle < math.pi / 6:
            raise ParameterError("angle", self.angle, "0 < angle < pi/6 rad")

    def require_read(self) -> None:
        """Refuse parameters that this kind of search does not read."""
        names = [one for one in vars(self) if one != "kind" and one not in _READ[self.kind]]
        require_same(self, SearchParams, "search", *names, why=f"search.kind is {self.kind}")

    def over(
        self, parts: PegAndHole, *, error: float, push: float, reach: float, attempts: int
    ) -> "SearchParams":
        """Return this search with its open fields filled in, and checked.

        Args:
            parts: The believed parts.
            error: Largest error of the hole across, m.
            push: Largest push of the insertion, N.
            reach: Largest error of the face along the axis, m.
            attempts: At most.
        """
        self.require_read()
        if self.kind == "none":
            return self
        derived: dict[str, float] = {
            "drop": parts.chamfer_height + _IN,
            "reach": reach,
            "radius": error,
            "pitch": parts.chamfer_limit,
            "back": max(parts.peg_radius, _FURTHER * error),
            "wall": parts.friction * self.press + _SURE,
        }
        found: dict[str, Any] = {
            name: derived[name] if getattr(self, name) is None else getattr(self, name)
            for name in derived
            if name in _READ[self.kind]
        }
        search = replace(self, **found)
        search._require_sense(parts, error, push, attempts)
        return search

    def _require_sense(self, parts: PegAndHole, error: float, push: float, attempts: int) -> None:
        if self.press > push:
            raise ParameterError("search.press", self.press, f"at most insert.push, {push:g} N")
        capture = 2 * parts.chamfer_limit
        if self.pitch is not None and self.pitch > capture:
            what = "the width in which chamfers and clearance capture the peg"
            raise ParameterError("search.pitch", self.pitch, f"at most {capture:.4g} m, {what}")
        # Where the hole is off by the error, the middle of the tip is to stay on the face.
        face = parts.outer_radius - error
        wider = 1 + self.widen * (attempts - 1)
        for name, most in (("radius", face / wider), ("back", face)):
            value = getattr(self, name)
            if value is not None and value > most:
                allowed = f"at most {most:.4g} m: the face ends at {parts.outer_radius:g} m"
                raise ParameterError(f"search.{name}", value, allowed)


_IN: Final = 0.0005  # m, below the chamfers; assumed
_FURTHER: Final = 1.2  # times the error; assumed
_SURE: Final = 3.0  # N, beyond friction of the peg and of the joints; assumed
_FOLLOWS: Final = 5.0  # rad/s, of the loop that keeps the press; assumed
_YIELDS: Final = 0.1  # s, in which the lead, and what is left of a load across, is followed
_DAMPED: Final = 0.3  # of what a damped load follows in a tick; assumed
_LOST: Final = 0.5  # of the press, below which it does not touch for sure; assumed
_SLIDING: Final = 0.8  # of the press, from which on it slides; assumed
_TURNING: Final = 0.05  # rad/s, about the tip, of a peg that is stuck; assumed
_TURNS: Final = 0.4  # of the largest tilt, from one turn of that to the next; assumed
_WAYS: Final = 3  # in which a peg at its depth is pushed aside
_HOLDS: Final = 2.0  # N, across, of what holds it there; assumed


class SearchMemory(NamedTuple):
    """The memory of a search from tick to tick."""

    began: float = math.inf  # s; infinity: not in this attempt
    spent: float = 0.0  # s, on the spiral
    turned: float = 0.0  # s, about the tip
    lead: Across = (0.0, 0.0)  # m, by which the command is ahead of the peg, against friction
    slid: float = 0.0  # m, of a peg that leans, or that is pushed aside at its depth
    stuck: float = 0.0  # m, deep, where it began to turn about its tip
    about: Across = (0.0, 0.0)  # rad, of the offset, about which it turns
    held: int = 0  # in how many ways, at its depth


class TouchSearch:
    """The motions of a search, for parameters that leave nothing open.

    Loads are those of the peg on the hole, N, along the hole's axes, tared.

    Args:
        params: Of the search.
        axial: Stiffness of the peg's support along the axis, N/m.
        stiffness: The same across.
        drag: Most friction across, of the press and of the arm, N.
        lag: Time constant of an admittance D / K, s, of the peg's support; None: at once.
        damping: Of an admittance, N s/m: a load that is followed faster is one of damping.
        tip: Distance of the leaning peg's rim ahead of the middle of its tip, m.
        turn: Largest tilt of the hole, rad.
    """

    def __init__(
        self,
        params: SearchParams,
        *,
        axial: float,
        stiffness: float,
        drag: float,
        lag: float | None = None,
        damping: float = 0.0,
        tip: float = 0.0,
        turn: float = 0.0,
    ) -> None:
        self.params, self._stiffness = params, stiffness
        self._ahead, self._lag = drag / stiffness, lag
        damped = _DAMPED / damping if damping else math.inf
        self._follow = min(_FOLLOWS / axial, damped)  # m/s, of the feed, for each N that it lacks
        self._aside = min(_FOLLOWS / stiffness, damped)  # m/s, likewise, across
        self.lift = tip + params.press / axial  # m, to lean over freely
        self.leans = params.kind == "tilt"
        self.drop, self.reach = known("drop", params.drop), known("reach", params.reach)
        far = params.back if self.leans else params.radius
        self.reaches = known("back or radius", far)  # m, that the hole may be off
        self.wall = params.wall or math.inf  # N
        self.turns = Spiral(speed=_TURNING, pitch=_TURNS * turn, radius=turn) if turn else None
        self.aside = 3 * _HOLDS / stiffness + params.press / stiffness  # m

    def spiral(self, attempt: int) -> Spiral:
        """Return the spiral of an attempt, counted from 1."""
        params, radius = self.params, self.reaches
        radius *= 1 + params.widen * (attempt - 1)
        return Spiral(speed=params.speed, pitch=known("pitch", params.pitch), radius=radius)

    @property
    def way(self) -> float:
        """The largest slide of a leaning peg's command, m, springs included."""
        return 3 * self.reaches + self.wall / self._stiffness

    def press_rate(self, load: float, fastest: float, times: float = 1.0) -> float:
        """Return the feed's rate that keeps the press, m/s; without contact it is fast."""
        press = times * self.params.press
        lost = max(0.0, 1 - load / (_LOST * press))
        return max(-fastest, min(fastest, self._follow * (press - load) + lost * fastest))

    def lead(
        self, before: Across, load: tuple[float, float, float], period: float, turning: float
    ) -> Across:
        """Return the lead of the command: the deflection of the peg's support.

        Readings of springs are noisy: they are averaged over some ticks, in axes that turn, rad,
        with the spiral.
        """
        if self._lag is None:
            before = turned(before, turning)
        share = min(1.0, period / (self._lag or _YIELDS))
        y, z = (
            was + share * (force / self._stiffness - was)
            for was, force in zip(before, load[1:], strict=True)
        )
        scale = min(1.0, self._ahead / length) if (length := math.hypot(y, z)) else 1.0
        return scale * y, scale * z

    def on_spiral(self, attempt: int, time: float) -> Across:
        """Return the place on the spiral at a time since its start, m."""
        y, z = self.spiral(attempt).place(time)
        return turned((y, z), _TURN * (attempt - 1))

    def along(self, attempt: int) -> Across:
        """Return the unit vector towards which the peg leans and slides."""
        return turned((1.0, 0.0), _TURN * (attempt - 1))

    def leaning(self, attempt: int) -> Offset:
        """Return the offset of a leaning peg at the start of the slide."""
        (y, z), back, angle = self.along(attempt), self.reaches, self.params.angle
        return -back * y, -back * z, angle * z, -angle * y

    def relax(self, load: tuple[float, float, float]) -> Across:
        """Return the rates, m/s, that remove a load across."""
        y, z = (-self._aside * force for force in load[1:])
        scale = min(1.0, self.params.speed / speed) if (speed := math.hypot(y, z)) else 1.0
        return scale * y, scale * z

    def slide(self, attempt: int, load: tuple[float, float, float]) -> Across:
        """Return the rates, m/s, of a leaning peg, as soon as it is pressed."""
        (y, z), speed = self.along(attempt), self.params.speed
        return (speed * y, speed * z) if load[0] >= _SLIDING * self.params.press else (0.0, 0.0)

    def press_to_wall(self, attempt: int, load: tuple[float, float, float]) -> Across:
        """Return the rates, m/s, that keep a load towards the wall and remove the one along it."""
        (y, z), relaxed = self.along(attempt), self.relax(load)
        rate = self._aside * (self.wall - self.pushed(attempt, load))
        rate = max(-self.params.speed, min(self.params.speed, rate))
        across = -z * relaxed[0] + y * relaxed[1]
        return rate * y - across * z, rate * z + across * y

    def proof(self, held: int, load: tuple[float, float, float]) -> tuple[Across, bool]:
        """Return the rates, m/s, of the next test aside, and whether something holds there."""
        y, z = turned((1.0, 0.0), 2 * math.pi / _WAYS * held)
        speed = self.params.speed
        return (speed * y, speed * z), y * load[1] + z * load[2] >= _HOLDS

    def proven(self, held: int) -> bool:
        """Return whether the peg was held in all directions, as in a hole."""
        return held >= _WAYS

    def pushed(self, attempt: int, load: tuple[float, float, float]) -> float:
        """Return the load towards which the peg slides, N."""
        y, z = self.along(attempt)
        return y * load[1] + z * load[2]


def turned(across: Across, angle: float) -> Across:
    """Return a vector turned about the axis, rad."""
    (y, z), c, s = across, math.cos(angle), math.sin(angle)
    return c * y - s * z, s * y + c * z
