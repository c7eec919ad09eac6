"""Tips and axes of the red peg and the blue hole part in an image (section 4).

A colour filter finds the parts; their edges, to a small part of a pixel, give the axis and the
tip. Nothing here knows the camera: everything is in pixels, as in the paper, without calibration.
"""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from systems.vision.camera_image import Image
from systems.vision.part_appearance import Appearance, Range
from systems.vision.soft_edges import INSIDE, Mixture, fit_line, mixture, robust_fit, soft_edges

Array = NDArray[np.float64]
Mask = NDArray[np.uint8]


class Status(IntEnum):
    """What was found of a part, or why it was not."""

    VALID = 0  # tip and axis
    OCCLUDED = 1  # the axis; no background is seen beyond the end, which may not be the part's
    NO_IMAGE = 2  # no frame arrived
    NO_COLOUR = 3  # not enough pixels of the part's colour together
    AT_BORDER = 4  # the image ends before the part does
    NOT_STRAIGHT = 5  # without two long straight edges
    NO_CONTRAST = 6  # the background is too dark or too alike to measure edges
    WRONG_SIZE = 7  # wider or narrower than the part can be
    WRONG_SHAPE = 8  # longer or shorter than the part, or with another end
    SHARED = 9  # its pixels are taken for the other part's, too
    AMBIGUOUS = 10  # more than one thing looks like the part
    JUMPED = 11  # too far from where the part was a moment ago
    BLURRED = 12  # its edges are wider than the window in which they are measured

    @property
    def lost(self) -> bool:
        """Whether nothing is known of the part."""
        return self > Status.OCCLUDED


@dataclass(frozen=True, kw_only=True)
class Detection:
    """Where a part is in an image; NaN for what was not found.

    Pixel coordinates u to the right, v down, (0, 0) in the middle of the first pixel.
    """

    status: Status
    tip: tuple[float, float] = (math.nan, math.nan)  # pixels, the middle of the end face
    angle: float = math.nan  # rad, of the frame's x axis, from u to v
    point: tuple[float, float] = (math.nan, math.nan)  # pixels, on the axis, in what was seen


_LABELS: Final = 65535  # that 16 bits hold
_STRAIGHT: Final = 0.4  # pixels, rms of a straight edge
_LONG: Final = 0.4  # least length of the straight edges, relative to the width
_PARALLEL: Final = 0.1  # largest difference of the slopes of the two edges
_BULGE: Final = 0.05  # weight of the expectation that the end's edge is straight


def detect(image: Image, part: Appearance) -> Detection:
    """Find one part in an image.

    The axis in the image is taken to be within about 0.6 rad of the rows. An end with something
    else than background within 3 pixels counts as occluded, also where the part is in front.

    Args:
        image: Red, green, blue, shape (height, width, 3).
        part: What to look for.
    """
    return _find(image, *_prepared(image), part).detection


def detect_parts(image: Image, peg: Appearance, hole: Appearance) -> tuple[Detection, Detection]:
    """Find the peg and the hole part in an image, shape (height, width, 3).

    The same pixels are never both parts: where they would be, both are refused.
    """
    hsv, background = _prepared(image)
    found = [_find(image, hsv, background, part) for part in (peg, hole)]
    if all(one.blob is not None for one in found) and found[0].blob == found[1].blob:
        return Detection(status=Status.SHARED), Detection(status=Status.SHARED)
    return found[0].detection, found[1].detection


class _Found(NamedTuple):
    detection: Detection
    blob: tuple[int, int, int, int] | None = None  # left, top, width and height, pixels


def _prepared(image: Image) -> tuple[Image, Array]:
    """Return hue, saturation and value, and the background's colour: the median."""
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV_FULL).astype(np.uint8, copy=False)
    return hsv, _median(image[4::8, 4::8].reshape(-1, 3))


def _median(colours: Image) -> Array:
    ranked = np.partition(colours, len(colours) // 2, axis=0)
    middle: Array = ranked[len(colours) // 2].astype(np.float64)
    return middle


def _find(image: Image, hsv: Image, background: Array, part: Appearance) -> _Found:
    low, high = part.hue - part.hue_width, part.hue + part.hue_width
    mask = cv2.inRange(hsv, (max(low, 0), part.saturation, part.value), (high, 255, 255))
    if low < 0 or high > 255:  # the hues left of 0 are those left of 256
        first, last = (256 + low, 255) if low < 0 else (0, high - 256)
        rest = cv2.inRange(hsv, (first, part.saturation, part.value), (last, 255, 255))
        mask = cv2.bitwise_or(mask, rest)
    left, top, width, height = cv2.boundingRect(mask)
    largest, area = _largest(mask[top : top + height, left : left + width])
    if area < part.area:
        return _Found(Detection(status=Status.NO_COLOUR))
    x, y, width, height = cv2.boundingRect(largest)
    own, left, top = largest[y : y + height, x : x + width].view(np.bool_), left + x, top + y
    blob = (left, top, width, height)
    h, w = mask.shape
    end = left + width if part.front > 0 else w - left
    if top < 2 or top + height > h - 2 or end > w - 2:
        return _Found(Detection(status=Status.AT_BORDER), blob)
    box = image[top : top + height, left : left + width]
    colours = box[::4, ::2][own[::4, ::2]]
    mix = mixture(_median(colours if len(colours) else box[own]), background)
    if mix is None:
        return _Found(Detection(status=Status.NO_CONTRAST), blob)
    axis = _axis(image, own, left, top, mix, part)
    if axis is None:
        return _Found(Detection(status=Status.NOT_STRAIGHT), blob)
    if not within(axis.half_width, part.half_width):
        return _Found(Detection(status=Status.WRONG_SIZE), blob)
    tip = _tip(image, own, left, top, mix, part, axis)
    seen = Detection(
        status=Status.OCCLUDED if tip is None else Status.VALID,
        tip=(math.nan, math.nan) if tip is None else tip,
        angle=axis.angle,
        point=(axis.u, axis.v),
    )
    far = left if part.front > 0 else left + width - 1
    if tip is not None and 2 < far < w - 3:
        aspect = abs(tip[0] - far) / math.cos(axis.angle) / (2 * axis.half_width)
        if not within(aspect, part.aspect):
            return _Found(Detection(status=Status.WRONG_SHAPE), blob)
    return _Found(seen, blob)


def within(value: float, limits: Range | None) -> bool:
    """Return whether a value is within limits, or there are none."""
    return limits is None or limits[0] <= value <= limits[1]


def _largest(mask: cv2.typing.MatLike) -> tuple[Mask, int]:
    """Return the largest connected part of a mask, 0 and 1, and its number of pixels."""
    if not mask.size:
        return np.zeros((0, 0), np.uint8), 0
    height, width = mask.shape
    # In a large image noise can make more components than 16 bits count; not in a small one.
    few = ((height + 1) // 2) * ((width + 1) // 2) < _LABELS
    ltype = cv2.CV_16U if few else cv2.CV_32S
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, ltype=ltype)
    k = 1 + int(stats[1:, cv2.CC_STAT_AREA].argmax())
    return (labels == k).view(np.uint8), int(stats[k, cv2.CC_STAT_AREA])


class _Axis(NamedTuple):
    """The middle between the two long edges of a part."""

    u: float  # pixels, of a point on it, in the middle of what was seen
    v: float
    angle: float  # rad
    half_width: float  # pixels


def _axis(
    image: Image, own: NDArray[np.bool_], left: int, top: int, mix: Mixture, part: Appearance
) -> _Axis | None:
    height, width = own.shape
    columns = left + np.arange(width)
    first = top + own.argmax(axis=0)
    last = top + height - 1 - own[::-1].argmax(axis=0)
    upper = first - soft_edges(image, np.column_stack([columns, first]), (0, -1), *mix)
    lower = last + soft_edges(image, np.column_stack([columns, last]), (0, 1), *mix)

    # Once without the ends, roughly; then with all of the edges that are straight.
    begin, stop = round(0.15 * width), round(0.85 * width)
    for attempt in range(2):
        if stop - begin < part.length:
            return None
        u = columns[begin:stop].astype(float)
        lines = [fit_line(u, edge[begin:stop]) for edge in (upper, lower)]
        if min(line.points for line in lines) < part.length:
            return None
        slope = (lines[0].slope + lines[1].slope) / 2
        middle = (lines[0].intercept + lines[1].intercept) / 2
        angle = math.atan(slope)
        u0 = float(u[np.isfinite(upper[begin:stop])].mean())
        half = lines[1].intercept - lines[0].intercept
        half = (half + (lines[1].slope - lines[0].slope) * u0) / 2 * math.cos(angle)
        if attempt == 0:
            end = math.ceil(half * abs(slope)) + INSIDE
            chamfer = math.ceil(half * (1 - part.end_ratio))
            begin, stop = (end, chamfer + end)[:: part.front]
            stop = width - stop
    if min(line.points for line in lines) < _LONG * 2 * half:
        return None
    if max(line.rms for line in lines) > _STRAIGHT:
        return None
    if not abs(lines[1].slope - lines[0].slope) < _PARALLEL:
        return None
    return _Axis(u0, middle + slope * u0, angle, half)


def _tip(
    image: Image,
    own: NDArray[np.bool_],
    left: int,
    top: int,
    mix: Mixture,
    part: Appearance,
    axis: _Axis,
) -> tuple[float, float] | None:
    """Return the middle of the end face, or None where too little of its edge is in sight.

    The edge is seen as half an ellipse as narrow as the face is turned away from the camera: its
    ends, not its outermost point, are level with the middle of the face.
    """
    height, width = own.shape
    cos, sin = math.cos(axis.angle), math.sin(axis.angle)
    radius = axis.half_width * part.end_ratio
    end = left + (width - 1 if part.front > 0 else 0)
    middle = axis.v + math.tan(axis.angle) * (end - axis.u)
    reach = part.band * radius * cos
    first, last = math.ceil(middle - reach) - top, math.floor(middle + reach) - top
    rows = np.arange(max(first, 0), min(last, height - 1) + 1)
    if len(rows) < 3:
        return None
    mask = own[rows, :: -part.front]
    ends = end - part.front * mask.argmax(axis=1)
    starts = np.column_stack([ends, top + rows])
    u = ends + part.front * soft_edges(image, starts, (part.front, 0), *mix) - axis.u
    v = top + rows - axis.v
    along, across = part.front * (cos * u + sin * v), (cos * v - sin * u) / radius
    good = np.isfinite(u) & (np.abs(across) < 1)
    if good.sum() < max(part.seen * len(rows), 4):
        return None
    t, n = across[good], int(good.sum())
    basis, y = np.zeros((n + 1, 3)), np.zeros(n + 1)
    basis[:n, 0], basis[:n, 1], basis[:n, 2], y[:n] = 1.0, t, np.sqrt(1 - t * t), along[good]
    basis[n, 2] = _BULGE
    solution, rms, points = robust_fit(basis, y)
    if solution[2] < 0:
        solution, rms, points = robust_fit(np.ascontiguousarray(basis[:, :2]), y)
    if rms > _STRAIGHT or points < part.seen * len(rows):
        return None
    s = part.front * float(solution[0])
    return axis.u + cos * s, axis.v + sin * s
