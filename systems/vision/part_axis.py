"""The axis of a part in an image: the middle between its two long straight edges."""

import math
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.vision.edge_fit import Line, fit_line
from chamfer.systems.vision.part_appearance import Appearance
from chamfer.systems.vision.part_masks import Blob, outline
from chamfer.systems.vision.soft_edges import (
    NEAR,
    Starts,
    Step,
    blur,
    colour_beyond,
    contrast,
    edge_beyond,
    moved,
    window,
)

Array = NDArray[np.float64]
Flaw = Literal["NOT_STRAIGHT", "NO_CONTRAST", "BLURRED"]  # as in Status

_SEEN: Final = 0.65  # of the columns between the ends, in which an edge has to be on its line
_LONG: Final = 0.4  # least length of the straight edges, relative to the width
_PARALLEL: Final = 0.1  # largest difference of the slopes of the two edges
_RAGGED: Final = 1.5  # pixels, largest rms of a straight edge of a mask
_ROUGH: Final = 2  # largest rms of a straight edge, relative to how much it may bend
_MIDDLE: Final = (0.15, 0.85)  # of a blob's columns, without its ends


class Axis(NamedTuple):
    """The middle between the two long edges of a part."""

    u: float  # pixels, of a point on it, in the middle of what was seen
    v: float
    angle: float  # rad
    half_width: float  # pixels
    outside: int  # pixels beyond the edges that were measured
    blur: float  # pixels, standard deviation
    background: Array  # red, green and blue beside the part, the mean of both sides

    def at(self, along: float, across: float) -> tuple[float, float]:
        """Return the pixel so far along the axis from its point, and to the right of it."""
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        return self.u + along * cos - across * sin, self.v + along * sin + across * cos


class _Side(NamedTuple):
    """One of the long edges as the mask has it."""

    starts: Starts  # columns and rows of where to look for the edge
    step: Step  # out of the part
    rough: Line


def find_axis(image: Image, blob: Blob, colour: Array, part: Appearance) -> Axis | Flaw:
    """Return a blob's axis, or why it has none.

    Args:
        image: Red, green, blue, shape (height, width, 3).
        blob: The part's pixels.
        colour: Red, green and blue of the part.
        part: What is looked for.
    """
    width = blob.own.shape[1]
    u = np.arange(blob.left, blob.left + width, dtype=float)
    begin, stop = (round(share * width) for share in _MIDDLE)
    if stop - begin < part.length:
        return "NOT_STRAIGHT"
    middle = slice(begin, stop)
    upper, lower = outline(blob.own, blob.top)
    sides = (
        _side(u, upper, (0, -1), middle, part.window[0]),
        _side(u, lower, (0, 1), middle, part.window[0]),
    )
    reach = part.window[1] + 1
    blurs = [blur(image, side.starts[middle], side.step, colour, reach) for side in sides]
    known = [wide for wide, _ in blurs if not math.isnan(wide)]
    # Both are as blurred: what else is beside one of them is no blur.
    outside = max(window(min(known)), part.window[0]) if known else reach
    if outside > part.window[1]:
        return _why_not(image, sides, middle, colour)
    edges, beside = [], np.zeros(3)
    for side, (_, place) in zip(sides, blurs, strict=True):
        starts = moved(side.starts, side.step, place)
        soft, background = edge_beyond(image, starts, side.step, colour, outside)
        edges.append(starts[:, 1] + side.step[1] * soft)
        beside += background / 2
    if not contrast(colour, beside)[3]:
        return "NO_CONTRAST"

    # All of the edges that are straight: without the ends, as far as they are aslant.
    upper_line, lower_line = (side.rough for side in sides)
    slope = (upper_line.slope + lower_line.slope) / 2
    half = (lower_line.intercept - upper_line.intercept) / 2
    half += (lower_line.slope - upper_line.slope) / 2 * u[width // 2]
    half *= math.cos(math.atan(slope))
    end = math.ceil(half * abs(slope)) + outside + 1
    chamfer = math.ceil(half * (1 - part.end_ratio))
    begin, stop = (end, chamfer + end)[:: part.front]
    stop = width - stop
    if stop - begin < part.length:
        return "NOT_STRAIGHT"
    here = u[begin:stop]
    lines = [Line(*fit_line(here, edge[begin:stop])) for edge in edges]
    if min(line.points for line in lines) < part.length:
        return "NOT_STRAIGHT"
    slope = (lines[0].slope + lines[1].slope) / 2
    intercept = (lines[0].intercept + lines[1].intercept) / 2
    angle = math.atan(slope)
    u0 = float(here[np.isfinite(edges[0][begin:stop])].mean())
    half = lines[1].intercept - lines[0].intercept
    half = (half + (lines[1].slope - lines[0].slope) * u0) / 2 * math.cos(angle)
    if not _straight(lines, stop - begin, half, part):
        return "NOT_STRAIGHT"
    return Axis(u0, intercept + slope * u0, angle, half, outside, min(known) / 1.35, beside)


def _side(u: Array, edge: Array, step: Step, middle: slice, near: int) -> _Side:
    """Return where to look for an edge: at the mask's, or on its line where that is elsewhere."""
    rough = Line(*fit_line(u[middle], edge[middle]))
    line = rough.intercept + rough.slope * u
    found = np.where(np.abs(edge - line) <= near, edge, np.rint(line))
    starts = np.empty((len(u), 2), np.int64)
    starts[:, 0], starts[:, 1] = u, found
    return _Side(starts, step, rough)


def _why_not(image: Image, sides: tuple[_Side, _Side], middle: slice, colour: Array) -> Flaw:
    """Return why the edges' blur is not known, or is more than can be measured."""
    if max(side.rough.rms for side in sides) > _RAGGED:
        return "NOT_STRAIGHT"
    for side in sides:
        beyond, _, count = colour_beyond(image, side.starts[middle], side.step, *NEAR)
        if not (count and contrast(colour, beyond)[3] and contrast(beyond, colour)[3]):
            return "NO_CONTRAST"
    return "BLURRED"


def _straight(lines: list[Line], columns: int, half_width: float, part: Appearance) -> bool:
    return (
        min(line.points for line in lines) >= max(_LONG * 2 * half_width, _SEEN * columns)
        and max(line.bend for line in lines) <= part.straight
        and max(line.rms for line in lines) <= _ROUGH * part.straight
        and abs(lines[1].slope - lines[0].slope) < _PARALLEL
    )
