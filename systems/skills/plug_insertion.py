"""What the strategies of both connectors share: the approach, the search, and their parameters.

Source: Morrow, Nelson and Khosla, section 4; all numbers are assumed.
"""

from dataclasses import dataclass

from models.validation import ParameterError, require_not_negative, require_positive
from systems.skills.force_primitives import GuardedMove, Hold
from systems.skills.skill import SkillState
from systems.skills.trajectory_primitives import Dither, MoveDx, lissajous


@dataclass(frozen=True, kw_only=True)
class PlugInsertionParams:
    """Parameters of any insertion."""

    approach_speed: float = 0.01  # m/s, of guarded moves
    contact_force: float = 4.0  # N, at which guarded moves end
    approach_limit: float = 0.02  # m, way without contact at which the approach has failed
    maintained: float = 0.008  # m/s, towards the socket, of what keeps contact (stick)
    drop: float  # m, of a plug that drops in
    hold_gain: float = 10.0  # 1/s, with which the search keeps the plug upright
    centring: float = 3.0  # 1/s, with which the search keeps its middle
    search_amplitude: float = 0.0022  # m, of each dither of the search
    search_frequency: float = 0.6  # Hz, of the search's slower dither
    search_repeats: int = 8  # cycles of it until the pattern repeats, N
    verify_amplitude: float  # m or rad, of the last dither, more than the play
    verify_frequency: float = 0.5  # Hz, of the last dither
    verify_threshold: float = 1.0
    # of the correlation C, below it the plug is held; free is pi^2/8
    retries: int = 3  # how often a state is tried again
    retract: float = 0.03  # m, back from the socket after a failure

    def __post_init__(self) -> None:
        require_positive(
            self,
            "approach_speed",
            "contact_force",
            "approach_limit",
            "maintained",
            "drop",
            "hold_gain",
            "search_amplitude",
            "search_frequency",
            "verify_amplitude",
            "verify_frequency",
            "verify_threshold",
            "retract",
        )
        require_not_negative(self, "centring")
        for name in ("search_repeats", "retries"):
            value = getattr(self, name)
            if not (isinstance(value, int) and value >= 1):
                raise ParameterError(name, value, "a whole number >= 1")

    @property
    def search(self) -> tuple[Dither, Dither]:
        """Dithers along x and y that cover a square."""
        first = Dither(
            axis="x",
            amplitude=self.search_amplitude,
            frequency=self.search_frequency,
            centring=self.centring,
        )
        return lissajous(first=first, axis="y", repeats=self.search_repeats)

    @property
    def upright(self) -> Hold:
        """Keeps the plug from tipping while it is searched for."""
        return Hold(axes=("rx", "ry"), gain=self.hold_gain)

    def guarded(self, limit: float) -> GuardedMove:
        """Return a guarded move downwards."""
        return GuardedMove(speed=self.approach_speed, threshold=self.contact_force, limit=limit)

    def approach(self, then: str) -> SkillState:
        """Return the state that goes down to the socket; ways count from where it begins."""
        return SkillState(
            name="approach",
            marks=True,
            run=[self.guarded(self.approach_limit)],
            on={"contact": then},
            timeout=2 * self.approach_limit / self.approach_speed,
        )


def windows(*dithers: Dither, period: float) -> tuple[int, ...]:
    """Return the samples of a cycle of each dither, between which a period passes, s."""
    return tuple(round(1 / (dither.frequency * period)) for dither in dithers)


def up(way: float, duration: float) -> MoveDx:
    """Return the motion away from the socket by a way, m, in a time, s."""
    return MoveDx(displacement=(0.0, 0.0, 0.0, 0.0, 0.0, way), duration=duration)
