"""Both parts in space, from the frames of two calibrated cameras."""

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.track.part_finder import COLUMNS, PartFinder, Sighting
from chamfer.analysis.track.track_table import PARTS
from chamfer.models.cameras.camera import Camera
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.vision.part_detection import Detection, Status
from chamfer.systems.vision.two_plane_stereo import PartInSpace, locate, metric_error, planes_angle

Array = NDArray[np.float64]

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
