"""Common parts of the strategies: touch the face first, lay a plug flat, search for the mate.

Source: Morrow, Nelson and Khosla, section 4, for the search by two dithers, the tare of the
sensor, and the way out. The first contact with the face, the alignment by contact and the search
by a tilted peg are not in the paper; their primitives are. All numbers are assumed.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any, ClassVar, Final

from chamfer.models.validation import (
    ParameterError,
    require_all_positive,
    require_numbers,
    require_whole,
)
from chamfer.systems.primitives.force_primitives import GuardedMove, Hold, Stick
from chamfer.systems.primitives.position_primitives import Centre, Place, Way
from chamfer.systems.primitives.primitive import TICK, Primitive
from chamfer.systems.primitives.seating import Seat
from chamfer.systems.primitives.skill import Outcome, Retry, Skill, SkillState
from chamfer.systems.primitives.trajectory_primitives import Axis, Dither, MoveDx, lissajous

if TYPE_CHECKING:  # it brings Drake along
    from chamfer.models.connectors.connector import Connector

Answers = Mapping[Outcome, str | Retry]

# Damping of accommodation, 0 for its own. Where nothing is touched nothing has to give way, so
# that neither bias nor noise moves the tool; on the face it is laid down; gives way to forces
# alone; goes its way along the face in spite of friction.
STIFF: Final = (math.inf,) * 6
_LYING: Final = (0.0,) * 6
UNTURNED: Final = (math.inf, math.inf, math.inf, 0.0, 0.0, 0.0)
ALONG: Final = (math.inf, math.inf, math.inf, 1500.0, 1500.0, 0.0)


@dataclass(frozen=True, kw_only=True)
class FaceFeelingParams:
    """Parameters of any insertion that first touches the face."""

    tare_time: float = 0.5  # s, of the tare of the force sensor
    approach_speed: float = 0.01  # m/s, of guarded moves
    contact_force: float = 4.0  # N, at which guarded moves end
    approach_limit: float = 0.02  # m, way without contact at which the approach has failed
    beside: float
    # m, along y, of the place where the plug touches the face, from where it goes in
    clearance: float = 0.0025  # m, over the face, of motions along it
    maintained: float = 0.006  # m/s, towards the socket, that keeps contact (stick)
    limit_share: float = 2.5
    # of the believed mating force, end of a push that moves nothing: jammed; no cap
    free_share: float = 0.68
    # of the believed mating force, push whether or not anything moves: 1.36 times the true one if
    # that is half of what is believed
    tilted: tuple[float, float] = (0.09, 0.09)
    # rad, about x and y since it lay on the face, of a plug that has jammed out of line
    straighten_gain: float = 5.0
    # 1/s, with which it is turned back to its pose on the face, and held there during the pull: a
    # sensor origin that is off by 3 mm makes 0.1 N m of 40 N
    retries: int = 3  # how often a state is tried again
    out_speed: float = 0.1  # m/s, of a plug that is pulled out: D times it overcomes the retention
    out_acceleration: float = 0.05
    # m/s^2, of that speed: the pull grows by D times it in a second, until the plug comes off
    retract: float = 0.03  # m, back from the socket after a failure

    NAME: ClassVar[str]  # of the skill
    MAY_BE_ZERO: ClassVar[tuple[str, ...]] = ()  # all other floats are positive

    def __post_init__(self) -> None:
        require_all_positive(self, *self.MAY_BE_ZERO)
        if not self.limit_share >= 1:
            allowed = "a number >= 1: with less than its mating force nothing mates"
            raise ParameterError("limit_share", self.limit_share, allowed)
        if not self.free_share <= self.limit_share:
            allowed = f"at most limit_share, {self.limit_share:g}"
            raise ParameterError("free_share", self.free_share, allowed)
        require_numbers(self, 2, "tilted")
        require_whole(self, "retries")

    def make_skill(
        self, connector: "Connector", *, period: float = TICK, before: Sequence[SkillState] = ()
    ) -> Skill:
        """Return the skill, for a believed connector.

        The ticks are ``period`` apart, s. The states ``before`` grasp and transport the plug; the
        last one leads to ``tare``. Without them the plug is held from the start.
        """
        states = (*before, *self.states(connector, period))
        return Skill(
            name=self.NAME, states=states, retract=[self.out, self.upright], held=not before
        )

    def states(self, connector: Any, period: float) -> tuple[SkillState, ...]:
        """Return the states from ``tare`` on."""
        raise NotImplementedError

    @property
    def again(self) -> Retry:
        """Next state of a failure that is tried again from the face."""
        return Retry("out", self.retries)

    @property
    def hold(self) -> Stick:
        """Keeps contact in any case."""
        return Stick(speed=self.maintained, threshold=math.inf)

    def guarded(self, limit: float) -> GuardedMove:
        """Return a guarded move downwards."""
        return GuardedMove(speed=self.approach_speed, threshold=self.contact_force, limit=limit)

    def seat(self, force: float, *, stands: float = math.inf, **fields: Any) -> Seat:
        """Return a push by a believed mating force, N, within what the part ``stands``, N."""
        given = {"tilt": self.tilted, **fields}
        limit = min(self.limit_share * force, stands)
        return Seat(limit=limit, free=self.free_share * force, **given)

    @property
    def upright(self) -> Hold:
        """Turns back, softly, to the pose of its start or of the mark."""
        return Hold(axes=("rx", "ry"), gain=self.straighten_gain)

    def feel_face(
        self, *lie: Primitive, timeout: float, damping: tuple[float, ...], then: str
    ) -> tuple[SkillState, ...]:
        """Return the states from ``tare`` on that touch the face beside the opening.

        The plug can't drop in there: its height on the face, with the maintained force, is the
        mark. The states end over the opening, with a new tare of the force sensor. ``lie`` runs
        while the plug lies on the face, until it is done, at most for the timeout, s; the damping
        is that of accommodation on the face. A plug that tips over is lifted, turned back, and
        laid down again.
        """
        tips = any("lost" in one.events for one in lie)
        found: Answers = {"done": "above"}
        again = SkillState(
            name="feel again",
            from_mark=True,
            run=[Place(), Hold(axes=("rx", "ry", "rz"))],
            on={"done": "touch"},
            timeout=3.0,
            damping=STIFF,
        )
        way = (0.0, 0.0, 0.0, 0.0, self.beside, 0.0)
        return (
            tare("tare", self.tare_time, "beside"),
            moved("beside", MoveDx(displacement=way, duration=0.5), "touch"),
            SkillState(
                name="touch",
                marks=tips,
                run=[self.guarded(self.approach_limit)],
                on={"contact": "lie"},
                timeout=2 * self.approach_limit / self.approach_speed,
                damping=damping,
            ),
            SkillState(
                name="lie",
                run=[self.hold, *lie],
                on={**found, "lost": Retry("feel again", 1)} if tips else found,
                timeout=timeout,
                damping=damping,
            ),
            *([again] if tips else []),
            SkillState(
                name="above",
                marks=True,
                from_mark=True,
                run=[self._above],
                on={"done": "tare again"},
                timeout=3.0,
                damping=STIFF,
            ),
            SkillState(
                name="out",
                from_mark=True,
                run=[self.pulled(self._above), self.upright],
                on={"done": "tare again"},
                timeout=3.0,
            ),
            tare("tare again", self.tare_time, then),
        )

    @property
    def _above(self) -> Place:
        """Goes over the opening, from the mark."""
        return Place(offset=(0.0, -self.beside, self.clearance))

    def at_least(self, name: str, depth: Way, on: Answers, *, timeout: float = 1.0) -> SkillState:
        """Return the state that checks that a plug at rest is that deep, from the mark."""
        return SkillState(
            name=name, from_mark=True, run=[self.hold, depth], on=on, timeout=timeout
        )

    @property
    def out(self) -> Place:
        """Pulls the plug out of the socket, and away from it."""
        return self.pulled(Place(offset=(0.0, 0.0, self.retract)))

    def pulled(self, place: Place) -> Place:
        """Return the move to a place with no more force than is needed to come off."""
        return replace(place, speed=self.out_speed, acceleration=self.out_acceleration)


@dataclass(frozen=True, kw_only=True)
class PlugInsertionParams(FaceFeelingParams):
    """Parameters of an insertion with the paper's search by two dithers."""

    drop: float  # m, of a plug that drops in
    search_press: float = 0.006  # m/s, towards the socket during the search
    hold_gain: float = 10.0  # 1/s, with which the search holds the plug upright
    centring: float = 5.0  # 1/s, with which the search holds its middle
    search_amplitude: float = 0.0022  # m, of each dither of the search
    search_frequency: float = 0.6  # Hz, of the search's slower dither
    search_repeats: int = 8  # cycles of it until the pattern repeats, N

    def __post_init__(self) -> None:
        super().__post_init__()
        require_whole(self, "search_repeats")

    @property
    def search(self) -> tuple[Dither, Dither]:
        """Dithers along x and y that cover a square."""
        first = Dither(axis="x", amplitude=self.search_amplitude, frequency=self.search_frequency)
        return lissajous(first=first, axis="y", repeats=self.search_repeats)

    @property
    def searching(self) -> tuple[Primitive, ...]:
        """The dithers of the search around the believed opening, counted from the mark.

        They are centred; the plug is held upright, and pressed on until it drops in.
        """
        x, y = self.search
        return (
            Stick(speed=self.search_press, threshold=self.drop),
            x,
            y,
            Centre(dither=x, gain=self.centring),
            Centre(dither=y, gain=self.centring, offset=-self.beside),
            Hold(axes=("rx", "ry"), gain=self.hold_gain),
        )


def tare(name: str, time: float, then: str) -> SkillState:
    """Return the state that tares the force sensor for a time, s."""
    return replace(moved(name, MoveDx(duration=time), then), tares=True)


def moved(name: str, motion: MoveDx, then: str) -> SkillState:
    """Return the state of a motion in free space."""
    return SkillState(
        name=name, run=[motion], on={"done": then}, timeout=2 * motion.duration, damping=STIFF
    )


def straightened(
    of: FaceFeelingParams, *, amplitude: float, back_off: float, then: str
) -> tuple[SkillState, ...]:
    """Return the states from ``loosen`` on that straighten a tilted plug.

    It is moved back by a way, m, rocked by an amplitude, rad, and turned back to its pose on the
    face.
    """
    rocks = Dither(kind="rotary", axis="x", amplitude=amplitude, cycles=2.0)
    return (
        SkillState(name="loosen", run=[up(back_off, 0.2)], on={"done": "straighten"}, timeout=1.0),
        SkillState(
            name="straighten",
            from_mark=True,
            run=[of.hold, rocks, replace(rocks, axis="y"), of.upright],
            on={"done": then},
            timeout=4.0,
        ),
    )


def pull_test(
    on: Answers, *, speed: float, force: float, limit: float, timeout: float = 3.0
) -> SkillState:
    """Return the state of a retention test: ``contact`` at a force, N, if the plug is held."""
    pull = GuardedMove(direction="+z", speed=speed, threshold=force, limit=limit)
    return SkillState(name="pull", run=[pull], on=on, timeout=timeout)


def settled(hold: Stick, amplitude: float, cycles: float, then: str) -> SkillState:
    """Return the state that settles a plug by small turns about x and y, rad."""
    turns = [Dither(kind="rotary", axis="x", amplitude=amplitude, cycles=cycles)]
    turns.append(replace(turns[0], axis="y"))
    return SkillState(name="settle", run=[hold, *turns], on={"done": then}, timeout=2 * cycles)


def shaking(axis: Axis, amplitude: float, frequency: float, *, longer_than: float) -> Dither:
    """Return small turns, rad, that remove friction from a push and don't end within a time, s."""
    lasts = 2 * longer_than * frequency
    return Dither(kind="rotary", axis=axis, amplitude=amplitude, frequency=frequency, cycles=lasts)


def cycles(*dithers: Dither, period: float) -> tuple[float, ...]:
    """Return the cycle time of each dither, s, in whole periods."""
    return tuple(round(1 / (dither.frequency * period)) * period for dither in dithers)


def up(way: float, duration: float) -> MoveDx:
    """Return the motion away from the socket by a way, m, in a time, s."""
    return MoveDx(displacement=(0.0, 0.0, 0.0, 0.0, 0.0, way), duration=duration)


@dataclass(frozen=True, kw_only=True)
class TouchParams(FaceFeelingParams):
    """Parameters of an insertion that begins with an alignment by contact.

    A tilted plug beside a hole that it nearly fills tips into the hole. It therefore lies down on
    the face beside the hole, until accommodation has laid it flat. From there on nothing turns it
    until it has found its socket.
    """

    maintained: float = 0.008  # m/s, towards the face, that keeps contact
    tilted: tuple[float, float] = (0.03, 0.03)  # rad, since it lay flat on the face
    lie_time: float = 4.0  # s, for the plug to lie down on the face
    straighten_amplitude: float = 0.02  # rad, of the dithers about x and y that straighten it
    back_off: float = 0.00075  # m, up, of a plug that has jammed out of line
    entered: float = 0.001  # m, below the face, of a plug that went into its socket at once
    drop: float  # m, of a plug that has found its socket
    push_speed: float  # m/s, of the push at first; D times it is its force at rest
    end: float = 0.001  # m, before the mated depth, from which on a stop counts as the end
    short: float = 0.00025  # m, largest apparent lack of depth of a mated plug

    def laid_flat(self, *, then: str) -> tuple[SkillState, ...]:
        """Return the states from ``tare`` on until the plug is flat, above its socket."""
        lies = MoveDx(duration=self.lie_time)
        return self.feel_face(lies, timeout=2 * self.lie_time, damping=_LYING, then=then)

    def straightened(self, then: str) -> tuple[SkillState, ...]:
        """Return the states from ``loosen`` on that straighten a tilted plug."""
        amplitude, back_off = self.straighten_amplitude, self.back_off
        return straightened(self, amplitude=amplitude, back_off=back_off, then=then)

    def at_depth(self, depth: float, then: str) -> SkillState:
        """Return the state that checks the depth of a plug at rest, m."""
        on: Answers = {"done": then, "jammed": self.again}
        return self.at_least("depth", Way(least=depth - self.short), on, timeout=2.0)

    def touched(self, *, search: str, found: str) -> tuple[SkillState, ...]:
        """Return the states from ``tare`` on until the plug is on the face over its socket.

        ``search`` follows there; ``found`` follows if the plug has gone into its socket at once.
        """
        return (
            *self.laid_flat(then="down"),
            SkillState(
                name="down",
                from_mark=True,
                run=[self.guarded(self.entered)],
                on={"contact": search, "lost": found},
                damping=UNTURNED,
                timeout=2.0,
            ),
        )


@dataclass(frozen=True, kw_only=True)
class TiltSearchParams:
    """Parameters of the search by a tilted peg.

    A leaning peg has one lowest point of its rim. For that point the opening is the whole hole,
    not the clearance: it is in the hole even if the axis is off by much of the radius. The peg
    slides that way until the point meets the wall, which gives the place along that axis. A dither
    across lets it go to the middle of the wall, which gives the place along the other axis. Then
    the peg is set upright, pressed to the wall and down all the while.

    Earlier work: Bruyninckx, Dutre and De Schutter, "Peg-on-hole", ICRA 1995; Chhatpar and
    Branicky, "Search strategies for peg-in-hole assemblies with position uncertainty", IROS 2001.
    """

    angle: float = math.radians(12)  # rad, about x
    back: float = 0.004  # m, from the believed hole: more than the error of the peg
    lean_time: float = 0.6  # s, of the lean, in free space
    speed: float = 0.008  # m/s, along the face, towards the lowest point
    threshold: float = 8.0  # N, along the face, of a wall; more than friction
    press: float = 0.005  # m/s, against the wall, that keeps contact
    amplitude: float = 0.0016  # m, of the dither across
    cycles: float = 2.0  # of that dither
    frequency: float = 1.0  # Hz, of that dither
    stand_time: float = 1.5  # s, in which the peg is set upright

    def __post_init__(self) -> None:
        require_all_positive(self)
        if not 0 < self.angle < math.pi / 6:
            raise ParameterError("angle", self.angle, "0 < angle < pi/6 rad")

    @property
    def dither(self) -> Dither:
        """The dither across the direction of the slide."""
        return Dither(
            axis="x", amplitude=self.amplitude, frequency=self.frequency, cycles=self.cycles
        )

    def states(self, touch: TouchParams, radius: float, *, found: str) -> tuple[SkillState, ...]:
        """Return the states from ``lean`` on, which begins over the hole, in free space.

        ``found`` follows for a peg in the hole, whose radius is in m.
        """
        again = touch.again
        low = radius * math.sin(self.angle)  # of the rim, below its middle
        lean = (self.angle, 0.0, 0.0, 0.0, self.back, low)
        wall = Stick(direction="-y", speed=self.press, threshold=math.inf)
        return (
            moved("lean", MoveDx(displacement=lean, duration=self.lean_time), "lower"),
            SkillState(
                name="lower",
                from_mark=True,
                run=[touch.guarded(low)],
                on={"contact": "slide", "lost": again},
                damping=UNTURNED,
                timeout=2 * (touch.clearance + 2 * low) / touch.approach_speed,
            ),
            SkillState(
                name="slide",
                run=[
                    touch.hold,
                    GuardedMove(
                        direction="-y",
                        speed=self.speed,
                        threshold=self.threshold,
                        limit=3 * self.back,
                    ),
                ],
                on={"contact": "across", "lost": again},
                damping=ALONG,
                timeout=6 * self.back / self.speed,
            ),
            SkillState(
                name="across",
                run=[touch.hold, wall, self.dither],
                on={"done": "stand"},
                damping=ALONG,
                timeout=2 * self.dither.duration,
            ),
            SkillState(
                name="stand",
                run=[
                    touch.hold,
                    wall,
                    MoveDx(
                        displacement=(-self.angle, 0.0, 0.0, 0.0, 0.0, 0.0),
                        duration=self.stand_time,
                    ),
                ],
                on={"done": "sink"},
                damping=ALONG,
                timeout=2 * self.stand_time,
            ),
            SkillState(
                name="sink",
                from_mark=True,
                run=[touch.hold, Way(least=touch.entered)],
                on={"done": found, "jammed": again},
                damping=UNTURNED,
                timeout=2.0,
            ),
        )
