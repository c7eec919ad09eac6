"""The cross-section of a part in a binary image: centroid, principal axes and edges (section 3.1).

The image is thresholded half-way between the part's colour and the background; moments give the
centroid and the principal axes, the soft edge gives how far the part reaches.
"""

import math
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from chamfer.models.peg.peg_and_hole import RED
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.vision.detections import (
    CROSS_SECTION_SIZE,
    CrossSection,
    Status,
    pack_cross_section,
)
from chamfer.systems.vision.part_detector import ImageMeasurement
from chamfer.systems.vision.soft_edges import contrast

Array = NDArray[np.float64]

_ROUND: Final = 1.02  # ratio of the principal axes' lengths; below, they have no direction
_SOFT: Final = 2  # pixels, that the edge reaches beyond the binary image
_AROUND: Final = np.ones((2 * _SOFT + 1, 2 * _SOFT + 1), np.uint8)
_BESIDE: Final = (-1.0, 0.0, 1.0)  # pixels, of the lines on which an edge is measured

_COLOUR: Final = np.array(RED, dtype=float)  # of the cross-section; assumed
_AREA: Final = 200  # pixels, at least


def cross_section(image: Image) -> CrossSection:
    """Find the largest object in an image, shape (height, width, 3), that is not background.

    The background is the image's median.
    """
    background = np.median(image[4::8, 4::8].reshape(-1, 3), axis=0)
    *normal, square = contrast(_COLOUR, background)
    if not square:
        return CrossSection(status=Status.NO_CONTRAST)
    weights = -np.array(normal) / square
    share = image.reshape(-1, 3).astype(np.float32) @ weights.astype(np.float32)
    share = share.reshape(image.shape[:2]) + np.float32(1.0)
    _, labels, stats, _ = cv2.connectedComponentsWithStats(
        (share > 0.5).astype(np.uint8), ltype=cv2.CV_32S
    )
    if len(stats) < 2:
        return CrossSection(status=Status.NO_COLOUR)
    k = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    left, top, width, height, area = stats[k].tolist()
    if area < _AREA:
        return CrossSection(status=Status.NO_COLOUR)
    rows, columns = labels.shape
    if min(left, top) < 2 or left + width > columns - 2 or top + height > rows - 2:
        return CrossSection(status=Status.AT_BORDER)
    # The binary image says where it is; a pixel on its edge counts as much as it shows of it.
    rows_of = slice(max(top - _SOFT, 0), top + height + _SOFT)
    columns_of = slice(max(left - _SOFT, 0), left + width + _SOFT)
    own = cv2.dilate((labels[rows_of, columns_of] == k).view(np.uint8), _AROUND)
    moments = cv2.moments(np.clip(share[rows_of, columns_of], 0.0, 1.0) * own)
    centroid = (
        columns_of.start + moments["m10"] / moments["m00"],
        rows_of.start + moments["m01"] / moments["m00"],
    )
    uu, uv, vv = (moments[name] / moments["m00"] for name in ("mu20", "mu11", "mu02"))
    half, spread = (uu + vv) / 2, math.hypot((uu - vv) / 2, uv)
    long = half + spread >= _ROUND**2 * (half - spread)
    angle = math.atan2(2 * uv, uu - vv) / 2 if long else 0.0
    reach = math.hypot(width, height)
    ahead, back, right, left_edge = (
        _edge(share, centroid, angle + turn, reach)
        for turn in (0.0, math.pi, math.pi / 2, -math.pi / 2)
    )
    return CrossSection(
        status=Status.VALID,
        centroid=centroid,
        angle=angle if long else math.nan,
        edges=(ahead, back, right, left_edge),
    )


def _edge(
    share: NDArray[np.float32], start: tuple[float, float], angle: float, reach: float
) -> float:
    """Return how far it is from a point to where the part's share falls to one half, pixels."""
    step = 0.5
    away = np.arange(0.0, reach, step)
    cos, sin = math.cos(angle), math.sin(angle)
    beside = np.array(_BESIDE)[:, np.newaxis]
    u = (start[0] + cos * away - sin * beside).astype(np.float32)
    v = (start[1] + sin * away + cos * beside).astype(np.float32)
    line = cv2.remap(share, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE).mean(axis=0)
    below = np.nonzero(line < 0.5)[0]
    if not len(below) or below[0] == 0:
        return math.nan
    k = int(below[0])
    inner, outer = float(line[k - 1]), float(line[k])
    return float(away[k - 1]) + step * (inner - 0.5) / (inner - outer)


class CrossSectionDetector(ImageMeasurement):
    """Finds a cross-section in the images of a camera on the gripper.

    .. pydrake_system::

        name: CrossSectionDetector
        input_ports:
        - image
        output_ports:
        - cross_section

    ``cross_section``, shape (8,), is laid out as in :func:`pack_cross_section`.
    """

    def __init__(self) -> None:
        super().__init__("cross_section", CROSS_SECTION_SIZE)

    def measure(self, image: Image | None) -> Array:
        """Return the packed cross-section of an image."""
        if image is None:
            return pack_cross_section(CrossSection(status=Status.NO_IMAGE))
        return pack_cross_section(cross_section(image))
