"""Tips and axes of the red peg and the blue hole part in an image (section 4).

A colour filter finds the parts; their edges, to a small part of a pixel, give the axis and the
tip. Nothing here knows the camera: everything is in pixels, as in the paper, without calibration.
"""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np

from chamfer.models.validation import ParameterError, require_positive
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.vision.detections import Detection, Status
from chamfer.systems.vision.part_appearance import Appearance, Proportions, Range, agree
from chamfer.systems.vision.part_edges import find_axis, find_end, is_the_parts, proportions
from chamfer.systems.vision.part_masks import (
    Blob,
    Colours,
    Mask,
    blobs,
    colour_mask,
    colour_of,
    colours,
)

_SHARED: Final = 0.5  # of the smaller blob, in the other one
_STRICTER: Final = (0, 40, 80)  # of 255, by which a part has to be more saturated, in turn
# Why another mask may still show the part: something of its colour touches it.
_MERGED: Final = (Status.AT_BORDER, Status.NOT_STRAIGHT, Status.WRONG_SIZE, Status.BLURRED)


def detect(image: Image, part: Appearance) -> Detection:
    """Find one part in an image, red, green, blue, shape (height, width, 3).

    The axis in the image is taken to be within about 0.6 rad of the rows. An end with something
    else than background just beyond it counts as occluded, also where the part is in front.
    """
    seen = colours(image)
    mask = colour_mask(seen, part)
    return _find(image, seen, part, mask, np.zeros_like(mask)).detection


def detect_parts(image: Image, peg: Appearance, hole: Appearance) -> tuple[Detection, Detection]:
    """Find the peg and the hole part in an image, shape (height, width, 3).

    The same pixels are never both parts: where they would be, both are refused. Parts of a wrong
    shape are believed where both are too long, or too short, by the same factor: the pixels are
    not as square as believed then. Of one part alone it can't be told from a covered end.
    """
    seen = colours(image)
    masks = colour_mask(seen, peg), colour_mask(seen, hole)
    one, other = _find(image, seen, peg, *masks), _find(image, seen, hole, *masks[::-1])
    statuses = {one.detection.status, other.detection.status}
    if Status.WRONG_SHAPE in statuses and statuses <= {Status.WRONG_SHAPE, Status.VALID}:
        oblong = (
            _find(image, seen, peg.oblong(), *masks),
            _find(image, seen, hole.oblong(), *masks[::-1]),
        )
        shapes = oblong[0].shape, oblong[1].shape
        if shapes[0] and shapes[1] and agree((peg, hole), (shapes[0], shapes[1])):
            one, other = oblong
    if _same(one.blob, other.blob):
        return Detection(status=Status.SHARED), Detection(status=Status.SHARED)
    return one.detection, other.detection


class _Found(NamedTuple):
    detection: Detection
    blob: Blob | None = None  # None: none is large enough
    shape: Proportions | None = None  # of a valid part, where it is checked


def _same(one: Blob | None, other: Blob | None) -> bool:
    """Return whether two blobs have most pixels of the smaller one in common."""
    if one is None or other is None:
        return False
    top, left = max(one.top, other.top), max(one.left, other.left)
    pieces = [blob.own[top - blob.top :, left - blob.left :] for blob in (one, other)]
    rows, columns = (min(piece.shape[i] for piece in pieces) for i in (0, 1))
    if not (rows > 0 and columns > 0):
        return False
    both = pieces[0][:rows, :columns] & pieces[1][:rows, :columns]
    smaller = min(np.count_nonzero(blob.own) for blob in (one, other))
    return bool(np.count_nonzero(both) > _SHARED * smaller)


def _find(image: Image, seen: Colours, part: Appearance, own: Mask, other: Mask) -> _Found:
    """Return the one blob that is the part, or why none is.

    First with all pieces together that a highlight or a thin thing before the part separates, then
    each by itself, and again with stronger colours only: where something of a like colour touches
    the part, one of these masks may show it alone.
    """
    first: _Found | None = None
    for stricter in _STRICTER:
        mask = colour_mask(seen, part, stricter) if stricter else own
        for bridged in (True, False):
            found = _in_mask(image, mask, part, other, bridged=bridged)
            first = first or found
            if found.detection.status not in _MERGED:
                return first if found.detection.status.lost else found
    assert first is not None
    return first


def _in_mask(image: Image, mask: Mask, part: Appearance, other: Mask, *, bridged: bool) -> _Found:
    found = [_looked_at(image, blob, part, other) for blob in blobs(mask, part, bridged=bridged)]
    if not found:
        return _Found(Detection(status=Status.NO_COLOUR))
    for status in (Status.VALID, Status.OCCLUDED):
        like = [one for one in found if one.detection.status == status]
        if len(like) > 1:
            return _Found(Detection(status=Status.AMBIGUOUS), like[0].blob)
        if like:
            return like[0]
    return found[0]  # why the largest is not it


def _looked_at(image: Image, blob: Blob, part: Appearance, other: Mask) -> _Found:
    """Return where a part is if it is this blob."""
    found = _measured(image, blob, part, other)
    if found.detection.status != Status.VALID and blob.touches(image, part.front):
        return _Found(Detection(status=Status.AT_BORDER), blob)
    return found


def _measured(image: Image, blob: Blob, part: Appearance, other: Mask) -> _Found:
    colour = colour_of(image, blob)
    axis, status = find_axis(image, blob, colour, part.looks)
    if status != Status.VALID:
        return _Found(Detection(status=Status(status)), blob)
    if not _within(axis.half_width, part.half_width):
        return _Found(Detection(status=Status.WRONG_SIZE), blob)
    end, is_seen = find_end(image, blob, colour, part.looks, axis, other)
    point = (axis.u, axis.v)
    if not is_seen:
        return _Found(Detection(status=Status.OCCLUDED, angle=axis.angle, point=point), blob)
    shape = None if part.aspect is None else proportions(image, blob, part.looks, axis, end)
    if not is_the_parts(image, colour, part, axis, end, shape):
        return _Found(Detection(status=Status.WRONG_SHAPE), blob)
    valid = Detection(status=Status.VALID, tip=end.tip, angle=axis.angle, point=point)
    return _Found(valid, blob, shape)


def _within(value: float, limits: Range | None) -> bool:
    return limits is None or limits[0] <= value <= limits[1]


@dataclass(frozen=True, kw_only=True)
class ContinuityParams:
    """Largest rates of change of a detection: parts don't jump."""

    speed: float = 2000.0  # pixels/s, at most; 1 m/s at 0.5 mm a pixel, assumed
    turning: float = 10.0  # rad/s, at most, of an axis in the image; assumed
    most_jumps: int = 2  # refused jumps in a row; the next one is accepted; assumed

    def __post_init__(self) -> None:
        require_positive(self, "speed", "turning")
        if not 0 <= self.most_jumps <= 1000:
            raise ParameterError("most_jumps", self.most_jumps, "a whole number from 0 to 1000")

    def jumps(self, moved: float, turned: float, seconds: float) -> bool:
        """Return whether a change, pixels and rad, is too large for its time."""
        return moved > self.speed * seconds or abs(turned) > self.turning * seconds


class LastSeen(NamedTuple):
    """The remembered appearance of a part."""

    detection: Detection | None = None  # that was last believed; None: none yet
    time: float = -math.inf  # s, of that
    refused: int = 0  # in a row since then, for being too far off


def follow(
    last: LastSeen, found: Detection, time: float, params: ContinuityParams
) -> tuple[LastSeen, Detection]:
    """Return the new memory of a part, and its accepted detection, or a jump.

    What is elsewhere than the part can have got to at the image's time, s, is refused, but not for
    good: if it stays, it was the last belief that was wrong.
    """
    if found.status.lost:
        return last, found
    before = last.detection
    if before is not None and last.refused < params.most_jumps:
        turned = math.remainder(found.angle - before.angle, math.tau)
        if before.status == found.status == Status.VALID:
            moved = math.dist(before.tip, found.tip)
        else:  # across its axis
            du, dv = np.subtract(found.point, before.point)
            moved = abs(float(math.cos(before.angle) * dv - math.sin(before.angle) * du))
        if params.jumps(moved, turned, time - last.time):
            refused = LastSeen(before, last.time, last.refused + 1)
            return refused, Detection(status=Status.JUMPED)
    return LastSeen(found, time), found
