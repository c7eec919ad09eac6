"""Both parts in the frames of one camera or two, one after the other."""

import math
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track.detection_overlay import SeenParts
from chamfer.models.cameras.camera import Camera
from chamfer.models.cameras.camera_file import FramePose, read_camera
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.vision.detections import Detection, Status, pack_detections
from chamfer.systems.vision.part_appearance import Appearance
from chamfer.systems.vision.part_detection import ContinuityParams, LastSeen, detect_parts, follow
from chamfer.systems.vision.part_detector import Undistortion
from chamfer.systems.vision.two_plane_stereo import PartInSpace, locate, metric_error, planes_angle

Array = NDArray[np.float64]

_PARTS: Final = ("peg", "hole")
_QUANTITIES: Final = ("status", "tip_u", "tip_v", "angle", "point_u", "point_v")
_OF_A_PART: Final = ("x", "y", "z", "axis_x", "axis_y", "axis_z", "disagreement")
_OF_BOTH: Final = ("along", "down", "ahead", "turn_x", "turn_y", "turn_z")
COLUMNS: Final = (
    *(f"{part}_{quantity}" for part in _PARTS for quantity in _QUANTITIES),
    *(f"error_{quantity}" for quantity in ("along", "across", "angle")),
)
SPACE_COLUMNS: Final = (
    *(f"{part}_{quantity}" for part in _PARTS for quantity in _OF_A_PART),
    *(f"metric_{quantity}" for quantity in _OF_BOTH),
)
_FLAT: Final = 0.1  # rad, between the planes through an axis and each of the cameras


class Sighting(NamedTuple):
    """The detections at one moment."""

    seen: tuple[SeenParts, ...]  # by each camera
    values: list[float]  # of the columns
    note: str = ""  # a line for the overlay


class PartFinder:
    """Finds the parts in the frames of one camera, or of two and then in space as well.

    To the columns of the left camera come those of the right one, ``right_...``, and those of
    :func:`in_space`.

    Images of one or two cameras, as they are calibrated, are straightened; without, those of one
    camera are taken as they are. Without continuity it is not known when frames were taken.
    """

    def __init__(
        self,
        peg: Appearance,
        hole: Appearance,
        cameras: Sequence[Camera] = (),
        continuity: ContinuityParams | None = None,
    ) -> None:
        self._parts = peg, hole
        self._cameras = tuple(cameras)
        self._straight = [camera.straight() for camera in cameras]
        self._straightened = [Undistortion.of(camera) for camera in cameras] or [None]
        self._continuity = continuity
        self._last: dict[tuple[int, int], LastSeen] = {}
        self.columns: tuple[str, ...] = COLUMNS
        if len(cameras) == 2:
            self.columns += (*(f"right_{name}" for name in COLUMNS), *SPACE_COLUMNS)

    def find(self, images: Sequence[Image], time: float) -> Sighting:
        """Return the detections in the next image of each camera, taken at a time, s.

        Raises:
            UserError: If an image is not of its camera's size.
        """
        seen = tuple(self._look(k, image, time) for k, image in enumerate(images))
        values = [
            value
            for one in seen
            for value in (*pack_detections(one.peg, one.hole).tolist(), *one.error.tolist())
        ]
        if len(seen) == 1:
            return Sighting(seen, values)
        found = in_space(self._straight, seen)
        return Sighting(seen, [*values, *found], _note(np.array(found[-len(_OF_BOTH) :])))

    def _look(self, camera: int, image: Image, time: float) -> SeenParts:
        height, width = image.shape[:2]
        if self._cameras:
            model = self._cameras[camera]
            if (width, height) != (model.width, model.height):
                raise UserError(
                    f"a frame is {width} x {height} pixels, allowed: {model.width} x "
                    f"{model.height} as the camera model says"
                )
        straightened = self._straightened[camera]
        if straightened is not None:
            image = straightened(image)
        found = list(detect_parts(image, *self._parts))
        if self._continuity is not None:
            for which, one in enumerate(found):
                last = self._last.get((camera, which), LastSeen())
                self._last[camera, which], found[which] = follow(last, one, time, self._continuity)
        return SeenParts(image, *found)


def in_space(cameras: Sequence[Camera], seen: Sequence[SeenParts]) -> list[float]:
    """Return where the parts are that two cameras see, in the left camera's frame.

    Of each part the tip, ``_x``, ``_y``, ``_z``, m, the axis as a unit vector, ``_axis_x`` and so
    on, and ``_disagreement``, m, how far apart the cameras' tips are, where both see it; the error
    of :func:`chamfer.systems.vision.two_plane_stereo.metric_error`, ``metric_along``,
    ``metric_down`` and ``metric_ahead``, m, and ``metric_turn_x`` and so on, rad.

    NaN where the planes through an axis and the cameras are nearly one, or where the cameras don't
    agree on which of a part's ends is the tip.
    """
    values, parts = [], []
    for detections in ([one.peg for one in seen], [one.hole for one in seen]):
        part = _located(cameras, detections)
        parts.append(part)
        values += [*part.tip, *part.direction, _disagreement(cameras, part, detections)]
    return [*values, *metric_error(*parts).tolist()]


def _located(cameras: Sequence[Camera], detections: Sequence[Detection]) -> PartInSpace:
    found = locate(cameras, detections)
    if found.status.lost:
        return found
    agree = all(
        camera.point_jacobian(np.array(seen.point), 1.0)
        @ np.array(found.direction)
        @ [math.cos(seen.angle), math.sin(seen.angle)]
        > 0
        for camera, seen in zip(cameras, detections, strict=True)
    )
    if agree and planes_angle(cameras, detections) > _FLAT:
        return found
    return PartInSpace(status=found.status)


def _disagreement(
    cameras: Sequence[Camera], part: PartInSpace, detections: Sequence[Detection]
) -> float:
    """Return how far apart the tips are that each of the cameras sees, m, or NaN."""
    if math.isnan(part.tip[0]) or any(one.status != Status.VALID for one in detections):
        return math.nan
    left, right = detections
    hidden = [replace(one, status=Status.OCCLUDED) for one in detections]
    tips = [locate(cameras, pair).tip for pair in ((left, hidden[1]), (hidden[0], right))]
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
    """Return the left camera of a file, or both (number 2), in the left one's frame.

    Raises:
        UserError: If the file can't be read, or has only one camera of the two.
    """
    try:
        file = read_camera(path)
        cameras = [file.left.placed(_LEFT)]
        if number == 2:
            if file.right is None or file.pose is None:
                raise UserError(
                    f"{path} holds one camera, allowed with --right: a file of two, with right "
                    "and pose"
                )
            cameras.append(file.right.placed(file.pose))
    except ParameterError as error:
        raise UserError(str(error)) from error
    return tuple(cameras)
