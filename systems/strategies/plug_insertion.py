"""What the strategies of the paper's two connectors share: the search by two dithers.

Source: Morrow, Nelson and Khosla, section 4; all numbers are assumed.
"""

from dataclasses import dataclass

from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.primitives.force_primitives import Hold, Stick
from chamfer.systems.primitives.position_primitives import Centre
from chamfer.systems.primitives.primitive import Primitive
from chamfer.systems.primitives.trajectory_primitives import Dither, MoveDx, lissajous
from chamfer.systems.strategies.face_feeling import FaceFeelingParams


@dataclass(frozen=True, kw_only=True)
class PlugInsertionParams(FaceFeelingParams):
    """Parameters of an insertion that searches by two dithers."""

    drop: float  # m, of a plug that drops in
    search_press: float = 0.006  # m/s, towards the socket, while it is searched for
    hold_gain: float = 10.0  # 1/s, with which the search keeps the plug upright
    centring: float = 5.0  # 1/s, with which the search keeps its middle
    search_amplitude: float = 0.0022  # m, of each dither of the search
    search_frequency: float = 0.6  # Hz, of the search's slower dither
    search_repeats: int = 8  # cycles of it until the pattern repeats, N

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "drop", "search_press", "hold_gain", "centring")
        require_positive(self, "search_amplitude", "search_frequency")
        if not (isinstance(self.search_repeats, int) and self.search_repeats >= 1):
            raise ParameterError("search_repeats", self.search_repeats, "a whole number >= 1")

    @property
    def search(self) -> tuple[Dither, Dither]:
        """Dithers along x and y that cover a square."""
        first = Dither(axis="x", amplitude=self.search_amplitude, frequency=self.search_frequency)
        return lissajous(first=first, axis="y", repeats=self.search_repeats)

    @property
    def searching(self) -> tuple[Primitive, ...]:
        """The dithers of the search about where the plug is to go in, from the mark on.

        They are centred, the plug is kept upright, and pressed on until it drops in.
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


def windows(*dithers: Dither, period: float) -> tuple[int, ...]:
    """Return the samples of a cycle of each dither, between which a period passes, s."""
    return tuple(round(1 / (dither.frequency * period)) for dither in dithers)


def up(way: float, duration: float) -> MoveDx:
    """Return the motion away from the socket by a way, m, in a time, s."""
    return MoveDx(displacement=(0.0, 0.0, 0.0, 0.0, 0.0, way), duration=duration)
