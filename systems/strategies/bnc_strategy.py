"""The strategy that inserts a BNC connector (Fig. 6).

Source: Morrow, Nelson and Khosla. The paper's text gives the three phases and the primitives; the
figure's transitions and all numbers are reconstructed.

Only a locked sleeve behaves as follows, which confirms that it is mated. It stopped at the studs'
channel as at an end stop, turned by a quarter, and rose into the detents by itself when the push
was released. After that it neither turns nor comes off.
"""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final, Literal, get_args

from chamfer.models.validation import require_one_of, require_whole
from chamfer.systems.primitives.force_primitives import GuardedMove, Hold, Obstructed, Stick
from chamfer.systems.primitives.position_primitives import Place, Way
from chamfer.systems.primitives.seating import Press, Seat
from chamfer.systems.primitives.skill import DONE, Retry, SkillState
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx
from chamfer.systems.strategies.face_and_search import (
    PlugInsertionParams,
    cycles,
    pull_test,
    settled,
    shaking,
)

if TYPE_CHECKING:  # it brings Drake along
    from chamfer.models.connectors.bnc_connector import BncConnector

Turn = Literal["-rz", "+rz"]

_LEVEL: Final = (0.0, 0.0, 0.0, 0.0, 0.0, math.inf)  # damping, as the next
_LONG: Final = 20.0  # s, that a push may take
_RESTING: Final = (math.inf, math.inf, math.inf, math.inf, math.inf, 0.0)  # damping


@dataclass(frozen=True, kw_only=True)
class BncConnectorSkillParams(PlugInsertionParams):
    """Parameters of the insertion; all of them are assumed."""

    drop: float = 0.001  # m, of a sleeve over the barrel, or with its slots over the studs
    stud_limit: float = 0.005  # m, of the push to the studs; beyond it the studs are in the slots
    beside: float = 0.006  # m, of the sleeve
    limit_share: float = 3.4  # a push that only the wrist makes appear to move ends there
    free_share: float = 0.5  # the spring gives way from its first touch on
    out_force: float = 6.5  # N, that takes off a sleeve that is not locked
    unlock_share: float = 1.25
    # of the believed mating force, push on a sleeve to be unlocked, moved or not: the spring lifts
    # a sleeve in its detents with most of its force
    face_time: float = 0.3  # s, in which the sleeve comes to rest on the face
    face: float = 0.0007
    # m, uncertainty of depths from the face, which the sleeve touched with a tilt
    end: float = 0.0005  # m, before the turning depth, from which on a stop counts as the end
    shake_amplitude: float = 0.025
    # rad, about z, of the dither that removes the friction of the bore from the push; within the
    # slots
    shake_frequency: float = 4.0  # Hz, of that dither
    settle_amplitude: float = 0.03  # rad, about x and y, of the dithers that straighten a sleeve
    settle_cycles: float = 2.0  # of these dithers
    settles: int = 2  # times that a jammed push is tried again after them
    search_press: float = 0.007  # m/s, towards the socket during the search
    search_frequency: float = 0.3  # Hz, of the search's slower dither
    search_repeats: int = 6  # cycles of it until the pattern repeats, N
    search_amplitude: float = 0.0026  # m, of each dither of the search
    wider: float = 1.3
    # factor of the second search in width and time, after the first found nothing
    sweep_amplitude: float = math.pi / 2  # rad, of the turn that searches for the slots
    sweep_frequency: float = 0.05  # Hz, of the turn that searches for the slots
    turn: Turn = "-rz"  # that locks, about the tool's z
    turn_speed: float = 0.25  # rad/s, of the turn that locks; its torque at rest is D times it
    turn_torque: float = 0.34  # N m, at which the turn is jammed
    turn_distance: float = 1.2  # rad, least angle of the turn
    rise_time: float = 0.8  # s, in which a released sleeve rises into the detents
    back_torque: float = 0.08
    # N m, that a sleeve in its detents withstands when it is turned back
    back_speed: float = 0.15  # rad/s, of that turn
    back_limit: float = 0.25  # rad, turn back after which the detents don't hold
    pull_speed: float = 0.008  # m/s, of the pull that tests the lock
    pull_force: float = 4.5  # N, that the detents have to hold
    pull_limit: float = 0.0015  # m, pull after which the detents don't hold
    harder: float = 1.1  # times the force with which the spring stops a push, at the end stop
    rise: float = 1.2  # ratio of the force at the end stop to that of the spring before it
    stop_stiffness: float = 2.2e4
    # N/m, least stiffness of the end stop, as it appears with a wrist that is much softer than
    # believed
    surely: float = 1.2  # times the compliance of that stiffness: a spring gives way by more
    turn_press: float = 0.85  # of the command at the end stop, push of the turn

    NAME: ClassVar[str] = "BNC connector"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "turn", get_args(Turn))
        require_whole(self, "settles")

    def pulled(self, place: Place) -> Place:
        """Return the way to a place that ends where the sleeve is still held."""
        return replace(super().pulled(place), threshold=self.out_force)

    def states(self, connector: "BncConnector", period: float) -> tuple[SkillState, ...]:
        """Return the states from ``tare`` on."""
        stick = Stick(speed=self.maintained, threshold=self.drop)
        again = Retry("off", self.retries)
        back: Turn = "+rz" if self.turn == "-rz" else "-rz"
        unlock = "compress again"  # always, so that what fails in the end comes off the barrel
        wide = replace(
            self,
            search_amplitude=self.wider * self.search_amplitude,
            search_frequency=self.search_frequency / self.wider,
        )
        sweep = Dither(
            kind="rotary",
            axis="z",
            amplitude=self.sweep_amplitude,
            frequency=self.sweep_frequency,
            cycles=1.0,
        )
        compression = self.seat(
            connector.mating_force,
            stands=connector.largest_force,
            rise=self.rise,
            harder=self.harder,
            stiffness=self.stop_stiffness,
            sure=self.surely,
            distance=connector.turning_depth - self.end,
        )
        shakes = shaking("z", self.shake_amplitude, self.shake_frequency, longer_than=_LONG)
        rim = (0.0, -(connector.bore_radius + connector.lead_in))

        def depth(least: float, *, most: float = math.inf) -> Way:
            return Way(least=least, most=most, beside=rim)

        def rocked(name: str, then: str) -> SkillState:
            cycles = self.settle_cycles
            return replace(settled(self.hold, self.settle_amplitude, cycles, then), name=name)

        def turned(direction: Turn) -> Seat:
            return Seat(
                direction=direction,
                speed=self.turn_speed,
                fastest=2 * self.turn_speed,
                still=self.turn_speed / 50,
                stiffness=30.0,  # N m/rad, of the end stop at least, with a wrist of 20 N m/rad
                limit=self.turn_torque,
                distance=self.turn_distance,
            )

        def searches(name: str, of: BncConnectorSkillParams, otherwise: str | Retry) -> SkillState:
            return SkillState(
                name=name,
                from_mark=True,
                run=[*of.searching, Obstructed(cycle=cycles(*of.search, period=period))],
                on={"lost": "to the studs", "hindered": "to the studs", "done": otherwise},
                timeout=2 * of.search[0].duration,
            )

        click = connector.turning_depth - connector.mated_depth
        lifted = self.unlock_share * connector.mating_force
        return (
            *self.feel_face(
                MoveDx(duration=self.face_time),
                timeout=1.0,
                damping=_RESTING,
                then="enter",
            ),
            searches("enter", self, "enter wide"),
            searches("enter wide", wide, again),
            SkillState(
                name="to the studs",
                run=[self.guarded(self.stud_limit)],
                on={"contact": "at the studs", "lost": "at the studs"},
                timeout=5.0,
            ),
            self.at_least(
                "at the studs",
                depth(connector.setback - self.drop),
                {"done": "feel", "jammed": Retry("straighten", self.settles, again)},
            ),
            rocked("straighten", then="to the studs"),
            self.at_least(
                "feel",
                # Deeper than the studs is one whose slots they are in.
                depth(connector.setback + self.drop / 2),
                {"done": "compress", "jammed": "upright"},
            ),
            rocked("upright", then="find slots"),
            SkillState(
                name="find slots",
                # A moment that is read wrongly would make it lean, turn by turn.
                run=[stick, sweep, Hold(axes=("rx", "ry"), gain=self.hold_gain)],
                on={"lost": "compress", "done": again},
                timeout=2 * sweep.duration,
            ),
            SkillState(
                name="compress",
                from_mark=True,
                run=[compression, shakes],
                on={
                    "done": "turn",
                    "jammed": Retry("settle", self.settles, again),
                    "tilted": Retry("settle", self.settles, again),
                    "timed out": again,
                },
                timeout=_LONG,
            ),
            # A sleeve that leans wedges itself on the barrel, the harder the push the firmer.
            rocked("settle", then="compress"),
            SkillState(
                name="turn",
                run=[Press(share=self.turn_press), turned(self.turn)],
                on={"done": "click", "jammed": "turn back"},
                timeout=2 * math.pi / self.turn_speed,
            ),
            SkillState(
                name="click",
                run=[MoveDx(duration=self.rise_time)],
                on={"done": "turns back"},
                timeout=2 * self.rise_time,
            ),
            SkillState(
                name="turns back",
                run=[
                    GuardedMove(
                        direction=back,
                        speed=self.back_speed,
                        threshold=self.back_torque,
                        limit=self.back_limit,
                    )
                ],
                on={"contact": "depth", "lost": unlock},
                timeout=2 * self.back_limit / self.back_speed,
                damping=_LEVEL,  # the studs' round sides would lift it out
            ),
            SkillState(
                name="depth",
                from_mark=True,
                run=[
                    depth(
                        connector.mated_depth - self.face, most=connector.mated_depth + self.face
                    )
                ],
                on={"done": "pull", "jammed": unlock},
                timeout=1.0,
            ),
            pull_test(
                {"contact": DONE, "lost": unlock},
                speed=self.pull_speed,
                force=self.pull_force,
                limit=self.pull_limit,
            ),
            # Straight off the barrel, first: aside it would only rub.
            SkillState(
                name="off",
                run=[self.pulled(Place(offset=(0.0, 0.0, connector.overlap)))],
                on={"done": "out", "contact": Retry(unlock, self.retries)},
                timeout=4.0,
            ),
            # Out of the detents, or of where the turn has jammed: as it was locked, backwards.
            SkillState(
                name="compress again",
                run=[replace(compression, distance=0.6 * click, free=lifted, tilt=None)],
                on={
                    "done": "turn back",
                    "jammed": "turn back",
                    "timed out": Retry("turn back", self.retries),
                },
                timeout=_LONG,
            ),
            SkillState(
                name="turn back",
                run=[Press(share=self.turn_press), turned(back)],
                on={"done": again, "jammed": again},
                timeout=2 * math.pi / self.turn_speed,
            ),
        )
