"""Tips and axes of the parts in space, from the detections of two calibrated cameras.

The axis in an image and the camera's centre span a plane; the planes of two cameras meet in the
axis in space.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.cameras.camera import Camera
from chamfer.models.validation import ParameterError
from chamfer.systems.vision.detections import DETECTIONS_SIZE, Detection, Status, unpack_detections

Array = NDArray[np.float64]

PARTS_SIZE: Final = 14  # seven of the peg, then seven of the hole part
METRIC_ERROR_SIZE: Final = 6

_STEP: Final = 100.0  # pixels along an axis in the image, to span its plane
_UNKNOWN: Final = (math.nan, math.nan, math.nan)


@dataclass(frozen=True, kw_only=True)
class PartInSpace:
    """Pose of a part in the world; NaN for values that were not found."""

    status: Status  # of the worse of the two detections; VALID if one of them has the tip
    tip: tuple[float, float, float] = _UNKNOWN  # m, the middle of the end face
    direction: tuple[float, float, float] = _UNKNOWN  # unit, the frame's x axis
    point: tuple[float, float, float] = _UNKNOWN  # m, anywhere on the axis


def locate(cameras: Sequence[Camera], detections: Sequence[Detection]) -> PartInSpace:
    """Return the pose of a part that two cameras see from different directions."""
    worse = max(detection.status for detection in detections)
    if worse.lost:
        return PartInSpace(status=worse)
    normals, ways = _planes(cameras, detections)
    direction = np.cross(normals[0], normals[1])
    direction /= np.linalg.norm(direction)
    direction *= math.copysign(1.0, float(direction @ (ways[0] + ways[1])))
    offsets = [normal @ camera.p_WC for normal, camera in zip(normals, cameras, strict=True)]
    origin = np.linalg.solve(np.array([*normals, direction]), np.array([*offsets, 0.0]))

    tips = []
    for camera, seen in zip(cameras, detections, strict=True):
        if seen.status == Status.VALID:
            ray = camera.ray(np.array(seen.tip))
            # The point of the axis that is nearest to the ray.
            across = ray - direction * (ray @ direction)
            gap = camera.p_WC - origin
            along = direction @ gap - (direction @ ray) * (across @ gap) / (across @ across)
            tips.append(origin + along * direction)
    return PartInSpace(
        status=Status.VALID if tips else worse,
        tip=tuple(np.mean(tips, axis=0).tolist()) if tips else _UNKNOWN,
        direction=tuple(direction.tolist()),
        point=tuple(origin.tolist()),
    )


def planes_angle(cameras: Sequence[Camera], detections: Sequence[Detection]) -> float:
    """Return the angle between the planes through a part's axis and two cameras, rad, 0 to pi/2.

    Where it is small, the axis in space is hardly known: errors grow with its inverse.
    """
    first, second = _planes(cameras, detections)[0]
    return math.atan2(float(np.linalg.norm(np.cross(first, second))), abs(float(first @ second)))


def _planes(
    cameras: Sequence[Camera], detections: Sequence[Detection]
) -> tuple[list[Array], list[Array]]:
    """Return the planes' normals, and the way along the axis as each camera sees it."""
    normals, ways = [], []
    for camera, seen in zip(cameras, detections, strict=True):
        step = _STEP * np.array([math.cos(seen.angle), math.sin(seen.angle)])
        first, last = camera.ray(np.array([seen.point - step / 2, seen.point + step / 2]))
        normal = np.cross(first, last)
        normals.append(normal / np.linalg.norm(normal))
        ways.append(last - first)
    return normals, ways


def metric_error(peg: PartInSpace, hole: PartInSpace) -> Array:
    """Return how the peg would have to move to stand with its tip in the mouth, shape (6,).

    Desired minus actual, as in an image: along the hole's axis, then across it the world's Y and Z
    of the way to the axis, m; the rotation vector that turns the peg's axis into the hole's, rad,
    world frame. What is not known is NaN.

    Where the peg's tip is hidden but its axis is seen, the way along is not known, and across it
    the way is measured where the axis passes the mouth.
    """
    between = np.subtract(hole.tip, peg.tip)
    along = np.dot(between, hole.direction)
    way = between - along * np.array(hole.direction)
    if peg.status == Status.OCCLUDED:
        between = np.subtract(hole.tip, peg.point)
        until = np.dot(between, hole.direction) / np.dot(peg.direction, hole.direction)
        way = between - until * np.array(peg.direction)
        along = math.nan
    way[0] = along
    normal = np.cross(peg.direction, hole.direction)
    sine, cosine = float(np.linalg.norm(normal)), float(np.dot(peg.direction, hole.direction))
    turn = normal * (math.atan2(sine, cosine) / sine if sine > 0 else 1.0)
    return np.concatenate([way, turn])


class TwoPlaneStereo(LeafSystem):
    """Combines the detections of two cameras into poses in m: the metric option.

    .. pydrake_system::

        name: TwoPlaneStereo
        input_ports:
        - detections_xz
        - detections_xy
        output_ports:
        - parts
        - alignment_error

    The inputs are the detections of two
    :class:`~chamfer.systems.vision.part_detector.PartDetector`. ``parts``, shape (14,), has
    the status, the tip, m, and the direction of the x axis, world frame, of the peg, then of the
    hole part. ``alignment_error``, shape (6,), is that of :func:`metric_error`. Unknown elements
    are NaN.

    Raises:
        ParameterError: If the cameras look in the same direction within 0.1 rad.
    """

    def __init__(self, camera_xz: Camera, camera_xy: Camera) -> None:
        super().__init__()
        self._cameras = (camera_xz, camera_xy)
        between = np.linalg.norm(np.cross(camera_xz.R_WC[:, 2], camera_xy.R_WC[:, 2]))
        if not between > 0.1:
            allowed = "not along the other camera's optical axis"
            raise ParameterError("camera_xy", camera_xy.R_WC[:, 2].tolist(), allowed)
        self._inputs = [
            self.DeclareVectorInputPort(name, DETECTIONS_SIZE)
            for name in ("detections_xz", "detections_xy")
        ]
        depends = {port.ticket() for port in self._inputs}
        self.DeclareVectorOutputPort("parts", PARTS_SIZE, self._calc_parts, depends)
        self.DeclareVectorOutputPort(
            "alignment_error", METRIC_ERROR_SIZE, self._calc_error, depends
        )

    def _locate(self, context: Context) -> tuple[PartInSpace, PartInSpace]:
        pegs, holes = zip(
            *(unpack_detections(port.Eval(context)) for port in self._inputs), strict=True
        )
        return locate(self._cameras, pegs), locate(self._cameras, holes)

    def _calc_parts(self, context: Context, output: BasicVector) -> None:
        parts = self._locate(context)
        output.SetFromVector(
            [value for part in parts for value in (part.status, *part.tip, *part.direction)]
        )

    def _calc_error(self, context: Context, output: BasicVector) -> None:
        output.SetFromVector(metric_error(*self._locate(context)))
