"""The end face of a part in an image, and whether it is the part's own."""

import math
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.vision.edge_fit import fit_end
from chamfer.systems.vision.part_appearance import Appearance, Proportions
from chamfer.systems.vision.part_axis import Axis
from chamfer.systems.vision.part_masks import Blob, Mask, Starts, row_ends
from chamfer.systems.vision.soft_edges import (
    blur,
    end_background,
    mean_share,
    moved,
    soft_edges,
    window,
)

Array = NDArray[np.float64]

# Standard deviations of the blur that corners reach: of the end face with a chamfer beside it,
# and of the part with nothing beside it.
_FACE: Final = 1.8
_SIDE: Final = 2.5
_CLEAR: Final = 0.61  # of the end face's radius, that the blur of its corners has to leave
_FIT: Final = 0.8  # of the points of its edge that have to lie on it
_CUT: Final = 0.45  # share of the part in a chamfer's place from which there is no chamfer
_PIXELS: Final = 1.2  # by which a length may be off, beside the limits of its ratio
_FREE: Final = 0.6  # of an end's edge that the other part does not hide, which has to be seen


class End(NamedTuple):
    """What was measured of the end face."""

    tip: tuple[float, float]  # pixels, its middle
    along: float  # pixels, of it, from the axis' point, out of the part
    bulge: float  # pixels, by which its edge is ahead of it
    background: Array  # red, green and blue, beyond


def find_end(
    image: Image, blob: Blob, colour: Array, part: Appearance, axis: Axis, other: Mask | None
) -> End | None:
    """Return the end face, or None where too little of its edge is in sight.

    The edge is seen as half an ellipse as narrow as the face is turned away from the camera: its
    ends, not its outermost point, are level with the middle of the face. A square face has a
    straight edge: that of the nearer or of the farther side.

    Args:
        image: Red, green, blue, shape (height, width, 3).
        blob: The part's pixels.
        colour: Red, green and blue of the part.
        part: What is looked for.
        axis: Of the blob.
        other: Which pixels have the colour of a part that may be before it.
    """
    radius = axis.half_width * part.end_ratio
    blurred = min(radius - _FACE * axis.blur, axis.half_width - _SIDE * axis.blur)
    reach = min(part.band * radius, blurred)
    starts = _rows(blob, axis, part.front, reach)
    n = len(starts)
    if n < 3 or reach < _CLEAR * radius:
        return None
    step = (part.front, 0)
    wide, place = blur(image, starts, step, colour, part.window[1] + 1)
    starts = moved(starts, step, place)
    outside = axis.outside if math.isnan(wide) else max(window(wide), part.window[0])
    if outside > part.window[1]:
        return None
    background, kept = end_background(image, starts, step, outside, axis.background)
    soft = soft_edges(image, kept, step, colour, background, outside + 1, outside)
    along, across = _along_and_across(starts, soft, axis, part.front)
    across /= radius
    good = np.isfinite(along) & (np.abs(across) < 1)
    count = int(np.count_nonzero(good))
    least = max(part.seen * n, 4.0)
    if count < _FREE * n:
        least = max(least, _FREE * (n - _hidden(starts, part, outside, other)))
    if count < least:
        return None
    level, bulge, rms, points = fit_end(across[good], along[good], part.flat)
    if rms > part.straight or points < max(least, _FIT * count):
        return None
    return End(axis.at(part.front * level, 0.0), level, bulge, background.mean(axis=0))


def _hidden(starts: Starts, part: Appearance, outside: int, other: Mask | None) -> int:
    """Return how many lines across an end lead to the other part, or close by."""
    if other is None:
        return 0
    u = starts[:, 0] + part.front * outside
    inside = (starts[:, 0] >= 0) & (u >= 0) & (u < other.shape[1])
    there = np.zeros(len(starts), np.uint8)
    there[inside] = other[starts[inside, 1], u[inside]] > 0
    return int(np.count_nonzero(cv2.dilate(there, np.ones((2 * outside + 1, 1), np.uint8))))


def proportions(image: Image, blob: Blob, part: Appearance, axis: Axis, end: End) -> Proportions:
    """Return how long a part is for its width, as if it were not turned towards the camera."""
    far = blob.left if part.front > 0 else blob.left + blob.own.shape[1] - 1
    aspect = _length(blob, part, axis, end) / (2 * axis.half_width)
    return Proportions(aspect, axis.half_width, 2 < far < image.shape[1] - 3)


def is_the_parts(
    image: Image,
    colour: Array,
    part: Appearance,
    axis: Axis,
    end: End,
    seen: Proportions | None,
) -> bool:
    """Return whether an end is the part's own, as far as can be told.

    It is not if something of the background's colour covers the end: then the part is shorter
    than it should be, or it has no chamfer where one should be.
    """
    if part.aspect is not None and seen is not None:
        slack = _PIXELS / (2 * axis.half_width)
        low, high = part.aspect
        if seen.aspect > high + slack or (seen.whole and seen.aspect < low - slack):
            return False
    if part.end_angle is None or part.end_ratio == 1:
        return True
    radius = axis.half_width * part.end_ratio
    height = (axis.half_width - radius) * math.tan(part.end_angle)
    ahead = end.along + end.bulge  # what covers an end has no bulge
    for side in (-1.0, 1.0):
        corners = ((0.0, radius), (0.0, axis.half_width), (-height, axis.half_width))
        triangle = [
            axis.at(part.front * (ahead + along), side * across) for along, across in corners
        ]
        if mean_share(image, np.array(triangle), colour, end.background) > _CUT:
            return False
    return True


def _length(blob: Blob, part: Appearance, axis: Axis, end: End) -> float:
    """Return how long the blob is, as if its axis were at right angles to the line of sight.

    Both ends bulge by as much as the axis is turned away from that. The far one is measured in
    the mask, to about half a pixel.
    """
    starts = _rows(blob, axis, -part.front, part.band * axis.half_width)
    if len(starts) < 3:
        return math.nan
    half_a_pixel = np.full(len(starts), 0.5)
    behind, across = _along_and_across(starts, half_a_pixel, axis, -part.front)
    across /= axis.half_width
    inside = (np.abs(across) < 1) & (starts[:, 0] >= 0)
    level, bulge, _, _ = fit_end(across[inside], behind[inside], part.flat)
    turned = min((end.bulge / part.end_ratio + bulge) / (2 * axis.half_width), 0.9)
    return (end.along + level) / math.sqrt(1 - turned**2)


def _rows(blob: Blob, axis: Axis, front: int, reach: float) -> Starts:
    """Return a blob's foremost pixels, column and row, as far from its axis as ``reach``."""
    end = blob.left + (blob.own.shape[1] - 1 if front > 0 else 0)
    middle, half = axis.v + math.tan(axis.angle) * (end - axis.u), reach * math.cos(axis.angle)
    first, last = math.ceil(middle - half), math.floor(middle + half)
    return row_ends(blob.own, blob.left, blob.top, front, first, last, axis.half_width)


def _along_and_across(
    starts: Starts, beyond: Array, axis: Axis, front: int
) -> tuple[Array, Array]:
    """Return how far points are ahead of the axis' point, and aside of it, pixels.

    Args:
        starts: Columns and rows, shape (n, 2).
        beyond: Pixels along the row, to the front, shape (n,).
        axis: The axis.
        front: 1: to the right; -1: to the left.
    """
    cos, sin = math.cos(axis.angle), math.sin(axis.angle)
    u, v = starts[:, 0] + front * beyond - axis.u, starts[:, 1] - axis.v
    return front * (cos * u + sin * v), cos * v - sin * u
