"""Both parts in the frames of a camera, one after the other."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track.track_table import PARTS
from chamfer.models.cameras.camera import Camera
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.vision.continuity import ContinuityParams, LastSeen, follow
from chamfer.systems.vision.part_appearance import Appearance
from chamfer.systems.vision.part_detection import Detection, detect_parts
from chamfer.systems.vision.part_detector import alignment_error, pack_detections
from chamfer.systems.vision.undistortion import Undistortion

Array = NDArray[np.float64]

_QUANTITIES: Final = ("status", "tip_u", "tip_v", "angle", "point_u", "point_v")
COLUMNS: Final = (
    *(f"{part}_{quantity}" for part in PARTS for quantity in _QUANTITIES),
    *(f"error_{quantity}" for quantity in ("along", "across", "angle")),
)


@dataclass(frozen=True, kw_only=True)
class Seen:
    """What was found in one frame of one camera."""

    image: Image  # in which it was found
    peg: Detection
    hole: Detection

    @property
    def error(self) -> Array:
        """Of :func:`chamfer.systems.vision.part_detector.alignment_error`, shape (3,)."""
        return alignment_error(self.peg, self.hole)

    @property
    def values(self) -> list[float]:
        """Of :data:`COLUMNS`."""
        return [*pack_detections(self.peg, self.hole).tolist(), *self.error.tolist()]


@dataclass(frozen=True, kw_only=True)
class Sighting:
    """What was found at one moment by one camera or by several."""

    seen: tuple[Seen, ...]  # by each camera
    values: list[float]  # of the columns
    note: str = ""  # a line for the overlay


class Sight(Protocol):
    """Finds the parts in frames that follow each other, of one camera or of several."""

    columns: tuple[str, ...]  # of the table

    def find(self, images: Sequence[Image], time: float) -> Sighting:
        """Return what is found in the next image of each camera, taken at a time, s."""


class PartFinder:
    """Finds the parts in the frames of one camera.

    Args:
        peg: What to look for.
        hole: What to look for.
        camera: As it is calibrated, whose images are straightened; None: they are taken as they
            are.
        continuity: How fast the parts can move; None: when frames were taken is not known.
    """

    columns = COLUMNS

    def __init__(
        self,
        peg: Appearance,
        hole: Appearance,
        camera: Camera | None = None,
        continuity: ContinuityParams | None = None,
    ) -> None:
        self._parts = peg, hole
        self._camera = camera
        self._continuity = continuity
        self._last = [LastSeen(), LastSeen()]
        self._straightened = None if camera is None else Undistortion.of(camera)

    def find(self, images: Sequence[Image], time: float) -> Sighting:
        """Return what is found in the next image, taken at a time, s."""
        seen = self.look(images[0], time)
        return Sighting(seen=(seen,), values=seen.values)

    def look(self, image: Image, time: float) -> Seen:
        """Return what is found in the next image, taken at a time, s.

        Raises:
            UserError: If the image is not of the camera's size.
        """
        height, width = image.shape[:2]
        model = self._camera
        if model is not None and (width, height) != (model.width, model.height):
            raise UserError(
                f"a frame is {width} x {height} pixels, allowed: {model.width} x {model.height} "
                "as the camera model says"
            )
        if self._straightened is not None:
            image = self._straightened(image)
        peg, hole = map(self._followed, (0, 1), detect_parts(image, *self._parts), (time, time))
        return Seen(image=image, peg=peg, hole=hole)

    def _followed(self, which: int, found: Detection, time: float) -> Detection:
        """Return what is believed of a part after what was seen of it before."""
        if self._continuity is None:
            return found
        self._last[which], believed = follow(self._last[which], found, time, self._continuity)
        return believed
