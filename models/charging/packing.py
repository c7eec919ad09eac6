"""The packing plan: which nugget goes where, and what lies below it by then."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

from models.charging.nugget import Nugget, nugget_of
from models.charging.station import Station
from models.validation import ParameterError, require_finite, require_one_of, require_positive

Kind = Literal["wall", "crown", "bulk"]

_CLEAR: Final = 0.01  # m, of a crown nugget from the wall


@dataclass(frozen=True, kw_only=True)
class PlanItem:
    """One nugget, or one load of the bulk filler, and its place."""

    kind: Kind = "wall"
    mass: float = 0.085  # kg, of the nugget, or of what fills the filler; 14 to 185 g in app. C
    azimuth: float = 0.0  # rad, of its place about the crucible's axis
    radius: float | None = None
    # m, of its middle from the crucible's axis; None: at the wall, a crown nugget 1 cm from it,
    # bulk on the axis
    size: float = 1.0  # true lengths over those of an ellipsoid of its mass
    scanned_size: float | None = None  # what the scanner takes for that; None: the truth

    def __post_init__(self) -> None:
        require_one_of(self, "kind", ("wall", "crown", "bulk"))
        require_positive(self, "mass", "size")
        require_finite(self, "azimuth")
        if self.radius is not None:
            require_finite(self, "radius")
            if self.radius < 0:
                raise ParameterError("radius", self.radius, "a finite number >= 0")
            if self.kind == "wall":
                raise ParameterError("radius", self.radius, "None for wall: it lies at the wall")
        if self.scanned_size is not None:
            require_positive(self, "scanned_size")

    @property
    def true_nugget(self) -> Nugget:
        """The nugget as it is."""
        return nugget_of(self.mass, size=self.size)

    @property
    def believed_nugget(self) -> Nugget:
        """The nugget as the scanner shows it."""
        size = self.size if self.scanned_size is None else self.scanned_size
        return nugget_of(self.mass, size=size)


@dataclass(frozen=True, kw_only=True)
class Place:
    """Where an item goes: of the nugget's middle, in the world."""

    position: tuple[float, float]  # m, x and y
    azimuth: float  # rad, the way to the wall
    layer: float  # m, height of what lies below


def places(plan: Sequence[PlanItem], station: Station, *, believed: bool) -> tuple[Place, ...]:
    """Return where each item of a plan goes, and how high what it is laid on is by then.

    An item lies on the bed, or on the highest of the wall and crown nuggets that were laid before
    it and whose outline, seen from above as a circle, holds the middle of its own.

    Args:
        plan: In the order of laying.
        station: As it is, or as it is believed to be.
        believed: Whether nuggets are as the scanner shows them.

    Raises:
        ParameterError: If a nugget does not fit into the crucible.
    """
    found: list[Place] = []
    outlines: list[tuple[tuple[float, float], float, float]] = []
    for index, item in enumerate(plan):
        nugget = item.believed_nugget if believed else item.true_nugget
        at_wall = station.crucible_radius - nugget.reach
        radius = item.radius
        if radius is None:
            # The plan is made with what the scanner shows; at the wall, the wall is what stops.
            crown = station.crucible_radius - item.believed_nugget.reach - _CLEAR
            radius = {"wall": at_wall, "crown": crown, "bulk": 0.0}[item.kind]
        if not 0 <= radius <= at_wall + 1e-12:
            name = f"plan[{index}].radius"
            raise ParameterError(name, radius, f"0 to {at_wall:g} m, inside the crucible")
        position = station.place(item.azimuth, radius)
        below = [top for middle, reach, top in outlines if math.dist(middle, position) < reach]
        layer = max(below, default=station.bed_height)
        found.append(Place(position=position, azimuth=item.azimuth, layer=layer))
        if item.kind != "bulk":
            outlines.append((position, nugget.reach, layer + nugget.height))
    return tuple(found)
