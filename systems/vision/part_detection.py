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

from models.peg_and_hole import Colour, ColouredParts
from models.validation import ParameterError, require_one_of
from systems.vision.camera_image import Image
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


@dataclass(frozen=True, kw_only=True)
class Appearance:
    """What to look for."""

    hue: int  # 0 to 255 once around the colours: 0 red, 85 green, 171 blue
    front: int  # 1: the tip is the right end; -1: the left one
    end_ratio: float = 1.0  # radius of the end face, relative to the sides
    band: float = 0.9  # share of the end face's width at which its edge is measured
    seen: float = 0.6  # share of that edge that has to be in sight
    hue_width: int = 20  # to either side, of 256
    saturation: int = 90  # of 255, at least
    value: int = 40  # of 255, at least
    area: int = 400  # pixels, at least
    length: int = 15  # pixels of straight edges, at least

    def __post_init__(self) -> None:
        require_one_of(self, "front", (1, -1))
        for name, low, high in _LEVELS:
            value = getattr(self, name)
            if not low <= value <= high:
                raise ParameterError(name, value, f"a whole number from {low} to {high}")
        for name in ("end_ratio", "band", "seen"):
            if not 0 < getattr(self, name) <= 1:
                raise ParameterError(name, getattr(self, name), "a number > 0 and <= 1")
        for name in ("area", "length"):
            if not getattr(self, name) >= 2:
                raise ParameterError(name, getattr(self, name), "a whole number >= 2")


_LEVELS: Final = (
    ("hue", 0, 255),
    ("hue_width", 0, 127),
    ("saturation", 0, 255),
    ("value", 1, 255),
)


def appearances(parts: ColouredParts) -> tuple[Appearance, Appearance]:
    """Return what to look for of the peg and of the hole part.

    Raises:
        ParameterError: If a colour filter can't tell the parts from each other, or one of them
            from a grey background.
    """
    peg = parts.peg
    found = (
        Appearance(hue=_hue(parts, "peg_colour"), front=1, end_ratio=1 - peg.chamfer / peg.radius),
        # The peg hides most of the mouth's edge when it is in the hole.
        Appearance(hue=_hue(parts, "hole_colour"), front=-1, seen=0.1),
    )
    apart = abs(found[0].hue - found[1].hue)
    if min(apart, 256 - apart) <= found[0].hue_width + found[1].hue_width:
        allowed = f"a hue that differs more from the peg's, {parts.peg_colour}"
        raise ParameterError("hole_colour", parts.hole_colour, allowed)
    return found


def _hue(parts: ColouredParts, name: str) -> int:
    colour: Colour = getattr(parts, name)
    pixel = np.array([[colour]], np.uint8)
    hue, saturation, value = cv2.cvtColor(pixel, cv2.COLOR_RGB2HSV_FULL)[0, 0].tolist()
    if not (saturation > Appearance.saturation and value > Appearance.value):
        allowed = f"brighter than {Appearance.value} of 255, with more than "
        raise ParameterError(name, colour, f"{allowed}{Appearance.saturation} of 255 saturation")
    return int(hue)


PEG, HOLE_PART = appearances(ColouredParts())

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
    return _find(image, *_prepared(image), part)


def detect_parts(image: Image, peg: Appearance, hole: Appearance) -> tuple[Detection, Detection]:
    """Find the peg and the hole part in an image, shape (height, width, 3)."""
    hsv, background = _prepared(image)
    return _find(image, hsv, background, peg), _find(image, hsv, background, hole)


def _prepared(image: Image) -> tuple[Image, Array]:
    """Return hue, saturation and value, and the background's colour: the median."""
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV_FULL).astype(np.uint8, copy=False)
    return hsv, _median(image[4::8, 4::8].reshape(-1, 3))


def _median(colours: Image) -> Array:
    ranked = np.partition(colours, len(colours) // 2, axis=0)
    middle: Array = ranked[len(colours) // 2].astype(np.float64)
    return middle


def _find(image: Image, hsv: Image, background: Array, part: Appearance) -> Detection:
    low, high = part.hue - part.hue_width, part.hue + part.hue_width
    mask = cv2.inRange(hsv, (max(low, 0), part.saturation, part.value), (high, 255, 255))
    if low < 0 or high > 255:  # the hues left of 0 are those left of 256
        first, last = (256 + low, 255) if low < 0 else (0, high - 256)
        rest = cv2.inRange(hsv, (first, part.saturation, part.value), (last, 255, 255))
        mask = cv2.bitwise_or(mask, rest)
    left, top, width, height = cv2.boundingRect(mask)
    largest, area = _largest(mask[top : top + height, left : left + width])
    if area < part.area:
        return Detection(status=Status.NO_COLOUR)
    x, y, width, height = cv2.boundingRect(largest)
    own, left, top = largest[y : y + height, x : x + width].view(np.bool_), left + x, top + y
    h, w = mask.shape
    end = left + width if part.front > 0 else w - left
    if top < 2 or top + height > h - 2 or end > w - 2:
        return Detection(status=Status.AT_BORDER)
    box = image[top : top + height, left : left + width]
    colours = box[::4, ::2][own[::4, ::2]]
    mix = mixture(_median(colours if len(colours) else box[own]), background)
    if mix is None:
        return Detection(status=Status.NO_CONTRAST)
    axis = _axis(image, own, left, top, mix, part)
    if axis is None:
        return Detection(status=Status.NOT_STRAIGHT)
    tip = _tip(image, own, left, top, mix, part, axis)
    return Detection(
        status=Status.OCCLUDED if tip is None else Status.VALID,
        tip=(math.nan, math.nan) if tip is None else tip,
        angle=axis.angle,
        point=(axis.u, axis.v),
    )


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
