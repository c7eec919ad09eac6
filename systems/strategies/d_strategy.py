"""The strategy that inserts a D connector (Fig. 5).

Source: Morrow, Nelson and Khosla. The paper's text gives the three phases and the primitives; the
figure's transitions and all numbers are reconstructed.

The plug first touches the face beside the opening, where it can't drop in. With the narrow edge of
its rim on the face it is laid level along its long axis. Its height there is the mark, from which
all depths count. About the short axis it stays as it was grasped until it lies at the bottom. That
reveals the tilt, and with it the height of the edge beside its middle.
"""

import math
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Final

from chamfer.models.validation import require_not_negative
from chamfer.systems.primitives.force_primitives import Hold, Level, Obstructed, Stick
from chamfer.systems.primitives.position_primitives import Centre, Way
from chamfer.systems.primitives.seating import Press
from chamfer.systems.primitives.skill import DONE, Retry, SkillState
from chamfer.systems.primitives.trajectory_primitives import Axis, Dither
from chamfer.systems.strategies.face_and_search import (
    UNTURNED,
    Answers,
    PlugInsertionParams,
    cycles,
    pull_test,
    settled,
    straightened,
    up,
)

if TYPE_CHECKING:  # it brings Drake along
    from chamfer.models.connectors.d_connector import DConnector

_ACROSS: Final[tuple[Axis, ...]] = ("x", "y")
_LYING: Final = (math.inf, 0.0, math.inf, math.inf, math.inf, 0.0)  # only ry and z give way


@dataclass(frozen=True, kw_only=True)
class DConnectorSkillParams(PlugInsertionParams):
    """Parameters of the insertion; all of them are assumed."""

    limit_share: float = 3.0  # enough for a connector that needs more than 2.5 times
    drop: float = 0.0013
    # m, below the face, of a shell in the opening; one that hooks in and tilts is less deep
    beside: float = 0.0047  # m, with the edge over its middle
    tilted: tuple[float, float] = (0.09, 0.03)  # rad, because about x it lay as it was grasped
    level_limit: float = 0.1  # rad, about x and y, largest error of the grasp
    level_time: float = 20.0  # s, for the plug to lie down on the socket's face
    search_press: float = 0.012  # m/s, towards the socket during the search
    search_frequency: float = 0.45  # Hz, of the search's slower dither
    search_repeats: int = 6  # cycles of it until the pattern repeats, N
    wider: float = 1.45  # factor of the rotary search in width and number of cycles
    search_threshold: float = 0.8  # of the correlation C; below it the search ends; free is pi^2/8
    twist_amplitude: float = 0.06  # rad, of the rotary search's turn about z
    twist_frequency: float = 0.12  # Hz, of the rotary search's turn about z
    turn_gain: float = 0.2  # 1/s, with which both searches hold the middle of the turn
    settle_amplitude: float = 0.02  # rad, about x and y, of dithers that settle or straighten it
    settle_cycles: float = 1.0  # of the dithers that settle the plug
    entry: float = 0.0008
    # m, apparent error of the pins' first touch, as the tilt about x is still unknown
    short: float = 0.00025  # m, that a mated plug may appear short of the mated depth
    stop_stiffness: float = 2.2e4
    # N/m, least stiffness of an end stop: as soft it appears with 45 % less stiffness of the wrist
    # than believed
    lay_press: float = 0.01
    # m/s, beyond the push at the end stop, while a tilted plug lies down at the bottom
    lay_time: float = 3.0  # s, for that
    back_off: float = 0.00075  # m, up, of a plug that has jammed
    push_dither: float = 0.0001  # m, along x while it pushes
    through_share: float = 1.02
    # of the believed mating force, push where the tines begin to spread
    pull_speed: float = 0.005  # m/s, of the pull that tests the retention
    pull_force: float = 2.5  # N, that the contacts have to hold
    pull_limit: float = 0.0005  # m, pull after which the contacts don't hold
    verify_amplitude: float = 0.0012  # m, of the last dither, more than the shells' clearance
    verify_frequency: float = 0.7  # Hz, of the last dither: slow enough for a soft arm
    verify_threshold: float = 1.1
    # of the correlation C; below it the socket holds the plug; free is pi^2/8

    NAME: ClassVar[str] = "D connector"
    MAY_BE_ZERO: ClassVar = ("twist_amplitude", "settle_amplitude", "push_dither")

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, *self.MAY_BE_ZERO)

    def states(self, connector: "DConnector", period: float) -> tuple[SkillState, ...]:
        """Return the states from ``tare`` on."""
        # Its narrow edge, which touches first.
        rim = (0.0, -(connector.plug_section.height / 2 + connector.lead_in))
        mated = connector.mated_depth - self.short
        again = self.again
        duration = self.search[0].duration
        wide = replace(
            self,
            search_amplitude=self.wider * self.search_amplitude,
            search_repeats=round(self.wider * self.search_repeats),
        )
        twist = Dither(
            kind="rotary",
            axis="z",
            amplitude=self.twist_amplitude,
            frequency=self.twist_frequency,
            cycles=1000.0,
        )

        def depth(least: float) -> Way:
            return Way(least=least, beside=rim)

        def watched(dithers: tuple[Dither, ...], threshold: float) -> Obstructed:
            return Obstructed(cycle=cycles(*dithers, period=period), threshold=threshold)

        def held(name: str, frequency: float, on: Answers) -> SkillState:
            dithers = tuple(
                Dither(axis=axis, amplitude=self.verify_amplitude, frequency=frequency, cycles=3.0)
                for axis in _ACROSS
            )
            return SkillState(
                name=name,
                run=[self.hold, *dithers, watched(dithers, self.verify_threshold)],
                on=on,
                damping=UNTURNED,  # or a wrist far above the tip gives way by turning
                timeout=2 * dithers[0].duration,
            )

        laid = Level(limit=self.level_limit)
        felt = self.feel_face(
            replace(laid, axes=("ry",)),
            timeout=self.level_time,
            damping=_LYING,
            then="search",
        )
        out = next(state for state in felt if state.name == "out")
        return (
            *felt,
            SkillState(
                name="search",
                from_mark=True,
                run=[
                    *self.searching,
                    Hold(axes=("rz",), gain=self.turn_gain),
                    watched(self.search, self.search_threshold),
                ],
                on={"lost": "settle", "hindered": "settle", "done": "rotary search"},
                timeout=2 * duration,
            ),
            SkillState(
                name="rotary search",
                from_mark=True,
                run=[*wide.searching, twist, Centre(dither=twist, gain=self.turn_gain)],
                on={"lost": "settle", "done": again},
                timeout=2 * wide.search[0].duration,
            ),
            settled(self.hold, self.settle_amplitude, self.settle_cycles, then="feel"),
            self.at_least(
                "feel",
                replace(depth(connector.pin_depth - self.entry), tilt=self.tilted),
                {"done": "push", "jammed": Retry("over", self.retries)},
            ),
            # What was no opening for the one search is none for it again.
            replace(out, name="over", on={"done": "rotary search"}),
            SkillState(
                name="push",
                from_mark=True,
                run=[
                    self.seat(
                        connector.mating_force,
                        stands=connector.largest_force,
                        # The tines' lead-in, by a way that a wrist that is not sure may falsify.
                        steep=(
                            connector.pin_depth - self.entry,
                            connector.pin_depth + self.entry,
                        ),
                        through=self.through_share * connector.mating_force,
                        stiffness=self.stop_stiffness,
                        # Where the contacts have spread. What the wrist gives by as they are
                        # overcome, which is not sure, may be missing in the way.
                        distance=(3 * connector.pin_depth + connector.mated_depth) / 4,
                    ),
                    Dither(axis="x", amplitude=self.push_dither, frequency=6.25, cycles=1000.0),
                    self.upright,
                ],
                on={
                    "done": "lay",
                    "jammed": Retry("back off", 1, then=again),
                    "tilted": Retry("loosen", 1, then=again),
                },
                timeout=30.0,
            ),
            # What is not in line yet lies down at the bottom, or on what is in the way.
            SkillState(
                name="lay",
                run=[Press(), Stick(speed=self.lay_press, threshold=math.inf), laid],
                on={"done": "rest", "lost": "rest", "timed out": "rest"},
                timeout=self.lay_time,
            ),
            self.at_least("rest", depth(mated), {"done": "verify", "jammed": Retry("free", 1)}),
            SkillState(
                name="back off",
                run=[up(self.back_off, 0.2)],
                on={"done": "free"},
                timeout=1.0,
            ),
            SkillState(
                name="free",
                run=[
                    self.hold,
                    *(
                        Dither(axis=axis, amplitude=self.search_amplitude / 4, cycles=2.0)
                        for axis in _ACROSS
                    ),
                ],
                on={"done": "push"},
                timeout=4.0,
            ),
            *straightened(
                self, amplitude=self.settle_amplitude, back_off=self.back_off, then="push"
            ),
            held("verify", self.verify_frequency, {"hindered": "pull", "done": "verify slowly"}),
            # Springs far above the tip let even one that is held go along.
            held("verify slowly", self.verify_frequency / 2, {"hindered": "pull"}),
            pull_test(
                {"contact": DONE},
                speed=self.pull_speed,
                force=self.pull_force,
                limit=self.pull_limit,
                timeout=2.0,
            ),
        )
