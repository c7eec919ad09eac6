"""Both parts in the frames of a camera, one after the other."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Protocol

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track.track_table import PARTS
from chamfer.models.cameras.camera import Camera
from chamfer.models.cameras.camera_file import CalibratedCamera, FramePose, read_camera
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.vision.continuity import ContinuityParams, LastSeen, follow
from chamfer.systems.vision.part_appearance import Appearance
from chamfer.systems.vision.part_detection import Detection, Status, detect_parts
from chamfer.systems.vision.part_detector import Undistortion, alignment_error, pack_detections
from chamfer.systems.vision.two_plane_stereo import PartInSpace, locate, metric_error, planes_angle

Array = NDArray[np.float64]

_QUANTITIES: Final = ("status", "tip_u", "tip_v", "angle", "point_u", "point_v")
COLUMNS: Final = (
    *(f"{part}_{quantity}" for part in PARTS for quantity in _QUANTITIES),
    *(f"error_{quantity}" for quantity in ("along", "across", "angle")),
)


@dataclass(frozen=True, kw_only=True)
class SeenParts:
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

    seen: tuple[SeenParts, ...]  # by each camera
    values: list[float]  # of the columns
    note: str = ""  # a line for the overlay


class PartTracker(Protocol):
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

    def look(self, image: Image, time: float) -> SeenParts:
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
        return SeenParts(image=image, peg=peg, hole=hole)

    def _followed(self, which: int, found: Detection, time: float) -> Detection:
        """Return what is believed of a part after what was seen of it before."""
        if self._continuity is None:
            return found
        self._last[which], believed = follow(self._last[which], found, time, self._continuity)
        return believed


_FLAT: Final = 0.1  # rad, between the planes through an axis and each of the cameras
_OF_A_PART: Final = ("x", "y", "z", "axis_x", "axis_y", "axis_z", "disagreement")
_OF_BOTH: Final = ("along", "down", "ahead", "turn_x", "turn_y", "turn_z")


class MetricFinder:
    """Finds the parts in the frames of two cameras, and where they are in space.

    To the columns of the left camera come those of the right one, ``right_...``, and in the left
    camera's frame (x to the right, y down, z ahead): of each part the tip, ``_x``, ``_y``,
    ``_z``, m, the axis as a unit vector, ``_axis_x`` and so on, and ``_disagreement``, m, how far
    apart the cameras' tips are, where both see it; the error of
    :func:`chamfer.systems.vision.two_plane_stereo.metric_error`, ``metric_along``, ``metric_down``
    and ``metric_ahead``, m, and ``metric_turn_x`` and so on, rad.

    Nothing is known in space where the planes through an axis and the cameras are nearly one, or
    where the cameras don't agree on which of a part's ends is the tip.

    Args:
        cameras: The left and the right one.
        finders: Of each of them.
    """

    columns = (
        *COLUMNS,
        *(f"right_{name}" for name in COLUMNS),
        *(f"{part}_{quantity}" for part in PARTS for quantity in _OF_A_PART),
        *(f"metric_{quantity}" for quantity in _OF_BOTH),
    )

    def __init__(self, cameras: Sequence[Camera], finders: Sequence[PartFinder]) -> None:
        # Detections are in images that have been straightened.
        self._cameras = tuple(camera.straight() for camera in cameras)
        self._finders = tuple(finders)

    def find(self, images: Sequence[Image], time: float) -> Sighting:
        """Return what is found in the next image of each camera, taken at a time, s."""
        seen = tuple(
            finder.look(image, time) for finder, image in zip(self._finders, images, strict=True)
        )
        peg = self._located([one.peg for one in seen])
        hole = self._located([one.hole for one in seen])
        error = metric_error(peg, hole)
        in_space = [
            value
            for part, detections in ((peg, [s.peg for s in seen]), (hole, [s.hole for s in seen]))
            for value in (*part.tip, *part.direction, self._disagreement(part, detections))
        ]
        values = [value for one in seen for value in one.values]
        return Sighting(seen=seen, values=[*values, *in_space, *error.tolist()], note=_note(error))

    def _located(self, detections: Sequence[Detection]) -> PartInSpace:
        found = locate(self._cameras, detections)
        if found.status.lost:
            return found
        ways = [
            camera.point_jacobian(np.array(seen.point), 1.0) @ np.array(found.direction)
            for camera, seen in zip(self._cameras, detections, strict=True)
        ]
        agree = all(
            way @ [math.cos(seen.angle), math.sin(seen.angle)] > 0
            for way, seen in zip(ways, detections, strict=True)
        )
        if agree and planes_angle(self._cameras, detections) > _FLAT:
            return found
        return PartInSpace(status=found.status)

    def _disagreement(self, part: PartInSpace, detections: Sequence[Detection]) -> float:
        """Return how far apart the tips are that each of the cameras sees, m, or NaN."""
        if math.isnan(part.tip[0]) or any(one.status != Status.VALID for one in detections):
            return math.nan
        left, right = detections
        hidden = [replace(one, status=Status.OCCLUDED) for one in detections]
        tips = [
            locate(self._cameras, pair).tip for pair in ((left, hidden[1]), (hidden[0], right))
        ]
        return math.dist(*tips)


def _note(error: Array) -> str:
    along, down, ahead = 1e3 * error[:3]
    turn = float(np.linalg.norm(error[3:]))
    if math.isnan(turn):
        return "in space: -"
    gap = "-" if math.isnan(along) else f"{along:+.2f} mm"
    return (
        f"in space: along {gap}, down {down:+.2f} mm, ahead {ahead:+.2f} mm, turn {turn:.4f} rad"
    )


_LEFT = FramePose(rotation_vector=(0.0, 0.0, 0.0), translation=(0.0, 0.0, 0.0))


def read_cameras(path: Path, number: int) -> tuple[Camera, ...]:
    """Return the left camera of a file, or both, in the left one's frame.

    Args:
        path: Of the file.
        number: Of the cameras that are needed, 1 or 2.

    Raises:
        UserError: If the file can't be read, or has only one camera of the two.
    """
    try:
        file = read_camera(path)
        cameras = [_placed(file.left, _LEFT)]
        if number == 2:
            if file.right is None or file.pose is None:
                raise UserError(
                    f"{path} holds one camera, allowed with --right: a file of two, with right "
                    "and pose"
                )
            cameras.append(_placed(file.right, file.pose.value))
    except ParameterError as error:
        raise UserError(str(error)) from error
    return tuple(cameras)


def _placed(camera: CalibratedCamera, pose: FramePose) -> Camera:
    return Camera(
        width=camera.width,
        height=camera.height,
        focal=camera.focal_length,
        centre=camera.principal_point,
        R_WC=pose.rotation,
        p_WC=np.array(pose.translation),
        distortion=camera.distortion,
    )
