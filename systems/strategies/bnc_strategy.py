"""The strategy that inserts a BNC connector (Fig. 6).

Source: Morrow, Nelson and Khosla. The paper's text gives the three phases and the primitives; the
figure's transitions and all numbers are reconstructed.

That it is mated is known by what only a locked sleeve can do: it stopped at the studs' channel as
at an end stop, turned by a quarter, came up into the detents by itself as the push was released,
and neither turns nor comes off any more.
"""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final, Literal, get_args

from chamfer.models.validation import require_one_of
from chamfer.systems.primitives.force_primitives import Obstructed, Stick
from chamfer.systems.primitives.position_primitives import Way
from chamfer.systems.primitives.seating import Press, Seat
from chamfer.systems.primitives.skill import DONE, Retry, SkillState
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx
from chamfer.systems.strategies.face_and_search import PlugInsertionParams, cycles, pull_test

if TYPE_CHECKING:  # it brings Drake along
    from chamfer.models.connectors.bnc_connector import BncConnector

Turn = Literal["-rz", "+rz"]

_RESTING: Final = (math.inf, math.inf, math.inf, math.inf, math.inf, 0.0)  # damping


@dataclass(frozen=True, kw_only=True)
class BncConnectorSkillParams(PlugInsertionParams):
    """Parameters of the insertion; all of them are assumed."""

    drop: float = 0.001  # m, of a sleeve over the barrel, or with its slots over the studs
    stud_limit: float = 0.005  # m, of the push to the studs; beyond they are in the slots
    beside: float = 0.006  # m, along y, of where the face is felt
    out_speed: float = 0.03  # m/s, of a sleeve that is pulled off
    face_time: float = 0.3  # s, in which the sleeve comes to rest on the face
    face: float = 0.0007  # m, by which depths from the face, felt tilted, are unsure
    end: float = 0.0005  # m, before the turning depth, from which on a stop counts as the end
    search_press: float = 0.007  # m/s, towards the socket, while it is searched for
    search_frequency: float = 0.3  # Hz, of the search's slower dither
    search_repeats: int = 6  # cycles of it until the pattern repeats, N
    search_amplitude: float = 0.0026  # m, of each dither of the search
    wider: float = 1.3  # by which a second search is, and slower, where the first found nothing
    sweep_amplitude: float = math.pi / 2  # rad, of the turn that searches for the slots
    sweep_frequency: float = 0.05  # Hz, of the turn that searches for the slots
    turn: Turn = "-rz"  # that locks, about the tool's z
    turn_speed: float = 0.25  # rad/s, of the turn that locks; its torque at rest is D times it
    turn_torque: float = 0.34  # N m, at which the turn is jammed
    turn_distance: float = 1.2  # rad, least angle of the turn
    pull_speed: float = 0.008  # m/s, of the pull that tests the lock
    pull_force: float = 4.5  # N, that the detents have to hold
    pull_limit: float = 0.0015  # m, way after which the pull has found no hold
    harder: float = 1.1  # of the force with which the spring stops a push, at the end stop
    rise: float = 1.2  # of the force at the end stop over that of the spring before it

    NAME: ClassVar[str] = "BNC connector"

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "turn", get_args(Turn))

    def states(self, connector: "BncConnector", period: float) -> tuple[SkillState, ...]:
        """Return the states from ``tare`` on."""
        stick = Stick(speed=self.maintained, threshold=self.drop)
        again = self.again
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
            rise=self.rise,
            harder=self.harder,
            distance=connector.turning_depth - self.end,
        )
        rim = (0.0, -(connector.bore_radius + connector.lead_in))

        def depth(least: float, *, most: float = math.inf) -> Way:
            return Way(least=least, most=most, beside=rim)

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
        return (
            *self.feel_face(
                MoveDx(duration=self.face_time), timeout=1.0, damping=_RESTING, then="enter"
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
                {"done": "feel", "jammed": again},
            ),
            self.at_least(
                "feel",
                # Deeper than the studs is one whose slots they are in.
                depth(connector.setback + self.drop / 2),
                {"done": "compress", "jammed": "find slots"},
            ),
            SkillState(
                name="find slots",
                run=[stick, sweep],
                on={"lost": "compress", "done": again},
                timeout=2 * sweep.duration,
            ),
            SkillState(
                name="compress",
                from_mark=True,
                run=[compression],
                on={"done": "turn", "jammed": again, "timed out": again},
                timeout=20.0,
            ),
            SkillState(
                name="turn",
                run=[Press(), turned(self.turn)],
                on={"done": "click", "jammed": "turn back"},
                timeout=2 * math.pi / self.turn_speed,
            ),
            SkillState(
                name="click",
                run=[
                    Way(
                        direction="+z",
                        least=0.6 * click,
                        most=click + connector.slot - 2 * connector.stud_radius + 2 * self.face,
                        wait=0.6,
                    )
                ],
                on={"done": "depth", "jammed": unlock},
                timeout=1.5,
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
            # Out of the detents, or of where the turn has jammed: as it was locked, backwards.
            SkillState(
                name="compress again",
                run=[replace(compression, distance=0.6 * click)],
                on={
                    "done": "turn back",
                    "jammed": "turn back",
                    "timed out": Retry("turn back", self.retries),
                },
                timeout=20.0,
            ),
            SkillState(
                name="turn back",
                run=[Press(), turned("+rz" if self.turn == "-rz" else "-rz")],
                on={"done": again, "jammed": again},
                timeout=2 * math.pi / self.turn_speed,
            ),
        )
