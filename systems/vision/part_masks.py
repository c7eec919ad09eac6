"""Pixels of an image with a part's colour, and their connected regions."""

from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.compiled import compiled
from chamfer.systems.vision.part_appearance import Appearance
from chamfer.systems.vision.soft_edges import EdgeStarts

Array = NDArray[np.float64]
Mask = NDArray[np.uint8]
Own = NDArray[np.bool_]

_LABELS: Final = 65535  # that 16 bits hold
_GREY: Final = 1.1  # ratio of a background's channels, up to which it is taken for grey
_LEAST_GAIN: Final = 0.33  # of a channel, relative to another
_CLOSED: Final = (0.5, 0.65)  # of the half width, gaps that are bridged along rows and columns
_GAPS: Final = (9, 11)  # pixels, likewise, of parts of unknown size; odd: closing is symmetric
_FULL: Final = 0.4  # share of a blob that has its colour, at least, gaps with it
_SPECKS: Final = 0.2  # of a part's least area, which are no piece of it
_MOST_BLOBS: Final = 4  # that are looked at


class Blob(NamedTuple):
    """Pixels of one colour that belong together."""

    own: Own  # whether they are of the blob, shape (height, width)
    left: int  # column of the first one
    top: int  # row of the first one

    def touches(self, image: Image, front: int) -> bool:
        """Return whether it is cut off by an image's border above, below, or at its front."""
        height, width = image.shape[:2]
        rows, columns = self.own.shape
        end = self.left + columns if front > 0 else width - self.left
        return self.top < 2 or self.top + rows > height - 2 or end > width - 2


@compiled
def outline(blob: Blob) -> tuple[Array, Array]:
    """Return a blob's first and last row in each column, NaN where it has none."""
    own, _, top = blob
    rows, columns = own.shape
    first, last = np.full(columns, np.nan), np.full(columns, np.nan)
    for j in range(columns):
        for i in range(rows):
            if own[i, j]:
                first[j] = top + i
                break
        for i in range(rows - 1, -1, -1):
            if own[i, j]:
                last[j] = top + i
                break
    return first, last


@compiled
def row_ends(blob: Blob, front: int, first: int, last: int, most: float) -> EdgeStarts:
    """Return the foremost pixel of a blob in each row of the image from first to last.

    It is the one on the right (front 1) or on the left (-1). A row that a highlight crosses seems
    to end there, more than ``most`` pixels away from the median of all.

    Returns:
        Column and row, shape (n, 2), of the rows that the blob has; the column is -1 where there
        is none.
    """
    own, left, top = blob
    rows, columns = own.shape
    first, last = max(first, top), min(last, top + rows - 1)
    ends = np.full((max(last - first + 1, 0), 2), -1)
    for k in range(len(ends)):
        ends[k, 1] = first + k
        for i in range(columns):
            j = columns - 1 - i if front > 0 else i
            if own[first + k - top, j]:
                ends[k, 0] = left + j
                break
    if len(ends) > 0:
        middle = np.median(ends[:, 0])
        for k in range(len(ends)):
            if abs(ends[k, 0] - middle) > most:
                ends[k, 0] = -1
    return ends


class Colours(NamedTuple):
    """An image's colours as inputs of a colour filter."""

    hsv: Image  # hue, saturation and value
    neutral: Image  # likewise, if the background were grey; the same where it is


def colours(image: Image) -> Colours:
    """Return an image's colours.

    The background's colour is the median. Where it is not grey, by the light's colour, the
    camera's white balance or its own, a pixel has a part's colour only if it has so also
    relative to the background: skin is red, but a red part before it is redder.
    """
    hsv = cv2.cvtColor(image, cv2.COLOR_RGB2HSV_FULL).astype(np.uint8, copy=False)
    sample = image[4::8, 4::8].reshape(-1, 3)
    if not len(sample):
        return Colours(hsv, hsv)
    background = np.maximum(median(sample), 1.0)
    if background.max() <= _GREY * background.min():
        return Colours(hsv, hsv)
    gains = np.maximum(background.min() / background, _LEAST_GAIN)
    levels = np.rint(np.arange(256)[:, np.newaxis] * gains).astype(np.uint8)
    grey = cv2.LUT(image, levels[np.newaxis])
    return Colours(hsv, cv2.cvtColor(grey, cv2.COLOR_RGB2HSV_FULL).astype(np.uint8, copy=False))


@compiled
def median(values: NDArray[np.uint8]) -> Array:
    """Return the median of colours, shape (n, 3), channel by channel."""
    counts = np.zeros((3, 256), np.int64)
    for k in range(len(values)):
        for c in range(3):
            counts[c, values[k, c]] += 1
    middle = np.empty(3)
    for c in range(3):
        below, level = counts[c, 0], 0
        while below <= len(values) // 2:
            level += 1
            below += counts[c, level]
        middle[c] = level
    return middle


@compiled
def colour_of(image: Image, blob: Blob) -> Array:
    """Return the median colour of a blob, of one pixel in eight if it is large enough."""
    own, left, top = blob
    for down, right in ((4, 2), (1, 1)):
        rows, columns = np.nonzero(own[::down, ::right])
        if len(rows) > 0:
            break
    values = np.empty((len(rows), 3), np.uint8)
    for k in range(len(rows)):
        values[k] = image[top + down * rows[k], left + right * columns[k]]
    return median(values)


def colour_mask(seen: Colours, part: Appearance, stricter: int = 0) -> Mask:
    """Return which pixels have a part's colour, 255 or 0, shape (height, width).

    They have to be more saturated than the part by ``stricter``, of 255.
    """
    least = min(part.saturation + stricter, 255)
    low, width = (part.hue - part.hue_width) % 256, 2 * part.hue_width
    return _coloured(seen.hsv, seen.neutral, low, width, least, part.value)


@compiled
def _coloured(hsv: Image, neutral: Image, low: int, width: int, least: int, value: int) -> Mask:
    """Return 255 where the hue is up to ``width`` beyond ``low``, once around if it has to be."""
    mask = np.empty(hsv.shape[:2], np.uint8)
    pixels, grey, found = hsv.ravel(), neutral.ravel(), mask.ravel()
    first, reach, strong, bright = np.uint8(low), np.uint8(width), np.uint8(least), np.uint8(value)
    for k in range(len(found)):
        beyond = np.uint8(pixels[3 * k] - first)
        coloured = (
            (beyond <= reach) & (pixels[3 * k + 1] >= strong) & (pixels[3 * k + 2] >= bright)
        )
        found[k] = 255 if coloured & (grey[3 * k + 1] >= strong) else 0
    return mask


def blobs(mask: Mask, part: Appearance, *, bridged: bool) -> list[Blob]:
    """Return the blobs of a mask that may be the part, the largest first.

    Bridged, pieces belong together that a highlight or a thin thing before the part separates.
    """
    left, top, width, height = cv2.boundingRect(mask)
    if not width:
        return []
    own = mask[top : top + height, left : left + width]
    labels, stats = _pieces(own)
    areas = stats[:, cv2.CC_STAT_AREA]
    alone = not bridged or len(areas) == 1 or areas.max() >= areas.sum() - _SPECKS * part.area
    if not alone:
        labels, stats = _pieces(_closed(own, part))
        areas = stats[:, cv2.CC_STAT_AREA]
    found = []
    for k in np.argsort(-areas, kind="stable")[:_MOST_BLOBS].tolist():
        if areas[k] < part.area:
            break
        x, y, w, h = stats[k, :4].tolist()
        box = np.s_[y : y + h, x : x + w]
        piece = labels[box] == k + 1
        if not alone:
            piece &= own[box] > 0
            if np.count_nonzero(piece) < max(part.area, _FULL * areas[k]):
                continue
        found.append(Blob(piece, left + x, top + y))
    return found


def _pieces(mask: cv2.typing.MatLike) -> tuple[NDArray[Any], NDArray[Any]]:
    """Return the labels of a mask's connected pieces, from 1, and OpenCV's statistics of each."""
    height, width = mask.shape
    # In a large image noise can make more components than 16 bits count; not in a small one.
    few = ((height + 1) // 2) * ((width + 1) // 2) < _LABELS
    ltype = cv2.CV_16U if few else cv2.CV_32S
    _, labels, stats, _ = cv2.connectedComponentsWithStats(mask, ltype=ltype)
    return labels, stats[1:]


def _closed(mask: cv2.typing.MatLike, part: Appearance) -> cv2.typing.MatLike:
    """Return a mask with its gaps filled."""
    columns, rows = _GAPS
    if part.half_width is not None:
        half = (part.half_width[0] * part.half_width[1]) ** 0.5
        columns, rows = (2 * round(share * half / 2) + 1 for share in _CLOSED)
    # With borders as wide as the gaps, that nothing is filled there.
    padded = cv2.copyMakeBorder(mask, rows, rows, columns, columns, cv2.BORDER_CONSTANT, value=0)
    brush = np.ones((rows, columns), np.uint8)
    return cv2.morphologyEx(padded, cv2.MORPH_CLOSE, brush)[rows:-rows, columns:-columns]
