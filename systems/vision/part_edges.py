"""The axis and the end face of a part in an image, from lines and half ellipses in its edges."""

import math
from typing import Final, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.compiled import compiled
from chamfer.systems.vision.part_appearance import Appearance, Proportions
from chamfer.systems.vision.part_masks import Blob, Mask, outline, row_ends
from chamfer.systems.vision.soft_edges import (
    NEAR,
    EdgeStarts,
    Step,
    blur,
    colour_beyond,
    contrast,
    edge_beyond,
    end_background,
    mean_share,
    moved,
    soft_edges,
    window,
)

Array = NDArray[np.float64]


class Line(NamedTuple):
    """A straight line through points of an edge: ``v = intercept + slope u``."""

    intercept: float  # pixels
    slope: float
    rms: float  # pixels, of the points that fit
    points: int  # number of those
    bend: float  # pixels, of the middle third of the points that fit from the others


@compiled
def robust_fit(basis: Array, y: Array) -> tuple[Array, float, int, float]:
    """Solve ``basis @ x = y``, shape (n, m), by least squares with Tukey's weights.

    NaN elements of y are not there.

    Returns:
        x, shape (m,); the rms of the residuals that count; their number; by how much those in the
        middle third differ from the others in the mean.
    """
    m = basis.shape[1]
    there = np.nonzero(np.isfinite(y))[0]
    weight = np.ones(len(there))
    residual = np.empty(len(there))
    x = np.zeros(m)
    for _ in range(_ROUNDS):
        normal = 1e-9 * np.eye(m)
        right = np.zeros(m)
        for a in range(len(there)):
            k = there[a]
            for i in range(m):
                share = weight[a] * basis[k, i]
                right[i] += share * y[k]
                for j in range(m):
                    normal[i, j] += share * basis[k, j]
        x[:] = np.linalg.solve(normal, right)
        for a in range(len(there)):
            residual[a] = y[there[a]]
            for i in range(m):
                residual[a] -= basis[there[a], i] * x[i]
        reach = _STRAIGHT
        if len(there) > 0:
            reach = max(reach, 6.0 * np.median(np.abs(residual)))
        for a in range(len(there)):
            part = residual[a] / reach
            weight[a] = (1 - part * part) ** 2 if abs(part) < 1 else 0.0
    square, count = 0.0, 0
    middle, middles, others, rest = 0.0, 0, 0.0, 0
    for a in range(len(there)):
        if weight[a] > 0:
            square += residual[a] ** 2
            count += 1
            if len(y) <= 3 * there[a] < 2 * len(y):
                middle += residual[a]
                middles += 1
            else:
                others += residual[a]
                rest += 1
    bend = middle / max(middles, 1) - others / max(rest, 1)
    return x, math.sqrt(square / max(count, 1)), count, abs(bend)


_ROUNDS: Final = 5
_STRAIGHT: Final = 0.2  # pixels; residuals below are never left out


@compiled
def fit_line(u: Array, v: Array) -> tuple[float, float, float, int, float]:
    """Fit a :class:`Line`, leaving out what does not lie on it; NaN in v is no point."""
    basis = np.ones((len(u), 2))
    basis[:, 1] = u - u[0]
    x, rms, points, bend = robust_fit(basis, v)
    return x[0] - x[1] * u[0], x[1], rms, points, bend


@compiled
def fit_end(across: Array, along: Array, flat: bool = False) -> tuple[float, float, float, int]:
    """Fit an end's edge: half an ellipse, its ends level with the middle of the face.

    Points of the edge are across relative to the face's radius, between -1 and 1, and along in
    pixels out of the part, both of shape (n,). A square face has a flat edge, a line.

    Returns:
        Where the middle of the face is and by how much the ellipse is ahead of it, pixels; the rms
        of the residuals that count, pixels; their number.
    """
    n = len(across)
    basis, y = np.zeros((n + 1, 3)), np.zeros(n + 1)
    for k in range(n):
        basis[k, 0], basis[k, 1] = 1.0, across[k]
        basis[k, 2], y[k] = math.sqrt(1.0 - across[k] * across[k]), along[k]
    basis[n, 2] = _BULGE
    if not flat:
        x, rms, points, _ = robust_fit(basis, y)
        if x[2] >= 0.0:
            return x[0], x[2], rms, points
    x, rms, points, _ = robust_fit(basis[:, :2].copy(), y)
    return x[0], 0.0, rms, points


_BULGE: Final = 0.05  # weight of the expectation that the end's edge is straight


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

    starts: EdgeStarts  # columns and rows of where to look for the edge
    step: Step  # out of the part
    rough: Line


def find_axis(image: Image, blob: Blob, colour: Array, part: Appearance) -> Axis | Flaw:
    """Return the axis of a blob, whose mean colour is given, or why it has none."""
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

    The mask of the ``other`` part says where that may be before it.
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


def _hidden(starts: EdgeStarts, part: Appearance, outside: int, other: Mask | None) -> int:
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


def _rows(blob: Blob, axis: Axis, front: int, reach: float) -> EdgeStarts:
    """Return a blob's foremost pixels, column and row, as far from its axis as ``reach``."""
    end = blob.left + (blob.own.shape[1] - 1 if front > 0 else 0)
    middle, half = axis.v + math.tan(axis.angle) * (end - axis.u), reach * math.cos(axis.angle)
    first, last = math.ceil(middle - half), math.floor(middle + half)
    return row_ends(blob.own, blob.left, blob.top, front, first, last, axis.half_width)


def _along_and_across(
    starts: EdgeStarts, beyond: Array, axis: Axis, front: int
) -> tuple[Array, Array]:
    """Return how far points are ahead of the axis' point, and aside of it, pixels.

    They are ``beyond`` the starts by so many pixels along the row, to the front: 1, to the right,
    or -1, to the left.
    """
    cos, sin = math.cos(axis.angle), math.sin(axis.angle)
    u, v = starts[:, 0] + front * beyond - axis.u, starts[:, 1] - axis.v
    return front * (cos * u + sin * v), cos * v - sin * u
