"""Where things stand in the cell: crucible, bed, feeder and scanner."""

import math
from dataclasses import dataclass

from models.surfaces.rounds import Crucible
from models.validation import ParameterError, require_finite, require_numbers, require_positive

Point = tuple[float, float, float]


@dataclass(frozen=True, kw_only=True)
class Station:
    """The cell about the Adept, world frame; the thesis gives no sizes: assumed."""

    crucible_centre: tuple[float, float] = (0.5, 0.15)  # m, of the crucible's axis
    crucible_radius: float = 0.15  # m, of its inner wall
    rim_height: float = 0.47  # m
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

    @property
    def wall(self) -> Crucible:
        """The crucible's inside."""
        return Crucible(centre=self.crucible_centre, radius=self.crucible_radius)

    def place(self, azimuth: float, radius: float) -> tuple[float, float]:
        """Return the point at an azimuth, rad, and a distance, m, from the crucible's axis."""
        x, y = self.crucible_centre
        return x + radius * math.cos(azimuth), y + radius * math.sin(azimuth)
