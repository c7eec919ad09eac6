"""Places in the cell: crucible, bed, feeder and scanner."""

import math
from dataclasses import dataclass

from chamfer.models.surfaces.composed import Extruded, Intersection, Placed
from chamfer.models.surfaces.planes import RippledPlane
from chamfer.models.surfaces.rounds import Circle, Crucible
from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_numbers,
    require_positive,
)

Point = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class StationLayout:
    """Places in the cell, world frame; the thesis gives none, all are assumed."""

    crucible_centre: tuple[float, float] = (0.5, 0.15)  # m, of the crucible's axis
    crucible_radius: float = 0.15  # m, of its inner wall
    rim_height: float = 0.47  # m, of the top of the crucible's wall
    bed_height: float = 0.36  # m, of the layer of small nuggets on the bottom
    feeder: Point = (0.35, -0.38, 0.36)  # m, on which a nugget stands to be picked up
    scanner: Point = (0.45, -0.25, 0.40)  # m, middle of the scan, of the nugget's lowest point
    scan_length: float = 0.06  # m, over which the nugget passes the scanner, along y

    def __post_init__(self) -> None:
        require_numbers(self, 2, "crucible_centre")
        require_numbers(self, 3, "feeder", "scanner")
        require_positive(self, "crucible_radius", "scan_length")
        require_finite(self, "rim_height", "bed_height")
        if not self.rim_height > self.bed_height:
            raise ParameterError(
                "rim_height", self.rim_height, f"more than bed_height, {self.bed_height:g}"
            )

    def place(self, azimuth: float, radius: float) -> tuple[float, float]:
        """Return the point at an azimuth, rad, and a distance, m, from the crucible's axis."""
        x, y = self.crucible_centre
        return x + radius * math.cos(azimuth), y + radius * math.sin(azimuth)


@dataclass(frozen=True, kw_only=True)
class Station(StationLayout):
    """The cell as built, with the surfaces that are touched."""

    crucible_thickness: float = 0.008  # m, of the crucible's wall; assumed
    feeder_radius: float = 0.06  # m, of the feeder's round tray; assumed

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "crucible_thickness", "feeder_radius")

    def wall(self, *, lean: float = 0.0) -> Surface:
        """Return the crucible's wall, from its rim down, infinitely deep.

        Its axis is off the vertical by ``lean``, rad, the top towards +x.
        """
        x, y = self.crucible_centre
        outer = self.crucible_radius + self.crucible_thickness
        upright = Intersection(
            parts=(
                Crucible(centre=(0.0, 0.0), radius=self.crucible_radius),
                Extruded(curve=Circle(centre=(0.0, 0.0), radius=outer)),
                RippledPlane(point=(0.0, 0.0, self.rim_height - self.bed_height)),
            )
        )
        c, s = math.cos(lean), math.sin(lean)
        axes = ((c, 0.0, s), (0.0, 1.0, 0.0), (-s, 0.0, c))
        return Placed(surface=upright, point=(x, y, self.bed_height), axes=axes)

    def layer(self, place: tuple[float, float], height: float, *, tilt: float = 0.0) -> Surface:
        """Return the layer, a plane inside of the crucible.

        At ``place``, m, it has the height, m; it rises towards +x by ``tilt``, rad.
        """
        x, y = place
        ground = RippledPlane(point=(x, y, height), tilt=tilt)
        inside = Circle(centre=self.crucible_centre, radius=self.crucible_radius)
        return Intersection(parts=(ground, Extruded(curve=inside)))

    def tray(self, height: float) -> Surface:
        """Return the top of the item in the feeder, ``height`` m above its ground."""
        x, y, z = self.feeder
        ends = Circle(centre=(x, y), radius=self.feeder_radius)
        top = RippledPlane(point=(x, y, z + height))
        return Intersection(parts=(top, Extruded(curve=ends)))
