"""The axis and the end face of a part in an image, from lines and half ellipses in its edges."""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.compiled import compiled
from chamfer.systems.vision.detections import Status
from chamfer.systems.vision.part_appearance import Appearance, Looks, Proportions
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
def fit_line(u: Array, v: Array) -> Line:
    """Fit a line without outliers; NaN in v is no point."""
    basis = np.ones((len(u), 2))
    basis[:, 1] = u - u[0]
    x, rms, points, bend = robust_fit(basis, v)
    return Line(x[0] - x[1] * u[0], x[1], rms, points, bend)


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


@compiled
def _at(axis: Axis, along: float, across: float) -> tuple[float, float]:
    """Return the pixel so far along an axis from its point, and to the right of it."""
    cos, sin = math.cos(axis.angle), math.sin(axis.angle)
    return axis.u + along * cos - across * sin, axis.v + along * sin + across * cos


_VALID, _NOT_STRAIGHT, _NO_CONTRAST, _BLURRED = map(
    int, (Status.VALID, Status.NOT_STRAIGHT, Status.NO_CONTRAST, Status.BLURRED)
)
_OUT: Final[tuple[Step, Step]] = ((0, -1), (0, 1))  # of the long edges, upper and lower


@compiled
def find_axis(image: Image, blob: Blob, colour: Array, looks: Looks) -> tuple[Axis, int]:
    """Return the axis of a blob, whose mean colour is given, and if it is one or why not."""
    width, (least, most) = blob.own.shape[1], looks.window
    no = Axis(0.0, 0.0, 0.0, 0.0, 0, 0.0, np.zeros(3))
    u = blob.left + np.arange(width).astype(np.float64)
    begin, stop = round(_MIDDLE[0] * width), round(_MIDDLE[1] * width)
    if stop - begin < looks.length:
        return no, _NOT_STRAIGHT
    masks = outline(blob)
    lines = [fit_line(u[begin:stop], mask[begin:stop]) for mask in masks]
    starts = [_starts(u, masks[k], lines[k], least) for k in range(2)]
    wide, places = math.nan, np.empty(2)
    for k in range(2):
        blurred, places[k] = blur(image, starts[k][begin:stop], _OUT[k], colour, most + 1)
        wide = np.fmin(wide, blurred)
    # Both are as blurred: what else is beside one of them is no blur.
    outside = most + 1 if math.isnan(wide) else max(window(wide), least)
    if outside > most:
        if max(lines[0].rms, lines[1].rms) > _RAGGED:
            return no, _NOT_STRAIGHT
        for k in range(2):
            beyond, _, count = colour_beyond(image, starts[k][begin:stop], _OUT[k], *NEAR)
            both = contrast(colour, beyond)[3], contrast(beyond, colour)[3]
            if count == 0 or min(both) == 0.0:
                return no, _NO_CONTRAST
        return no, _BLURRED
    edges, beside = np.empty((2, width)), np.zeros(3)
    for k in range(2):
        start = moved(starts[k], _OUT[k], places[k])
        soft, background = edge_beyond(image, start, _OUT[k], colour, outside)
        edges[k] = start[:, 1] + _OUT[k][1] * soft
        beside += background / 2
    if contrast(colour, beside)[3] == 0.0:
        return no, _NO_CONTRAST

    # All of the edges that are straight: without the ends, as far as they are aslant.
    slope = (lines[0].slope + lines[1].slope) / 2
    half = (lines[1].intercept - lines[0].intercept) / 2
    half += (lines[1].slope - lines[0].slope) / 2 * u[width // 2]
    half *= math.cos(math.atan(slope))
    end = math.ceil(half * abs(slope)) + outside + 1
    chamfer = math.ceil(half * (1 - looks.end_ratio))
    begin = end + (chamfer if looks.front < 0 else 0)
    stop = width - end - (chamfer if looks.front > 0 else 0)
    if stop - begin < looks.length:
        return no, _NOT_STRAIGHT
    lines = [fit_line(u[begin:stop], edges[k, begin:stop]) for k in range(2)]
    points = min(lines[0].points, lines[1].points)
    if points < looks.length:
        return no, _NOT_STRAIGHT
    slope = (lines[0].slope + lines[1].slope) / 2
    intercept = (lines[0].intercept + lines[1].intercept) / 2
    angle = math.atan(slope)
    u0 = u[begin:stop][np.isfinite(edges[0, begin:stop])].mean()
    half = lines[1].intercept - lines[0].intercept
    half = (half + (lines[1].slope - lines[0].slope) * u0) / 2 * math.cos(angle)
    if not (
        points >= max(_LONG * 2 * half, _SEEN * (stop - begin))
        and max(lines[0].bend, lines[1].bend) <= looks.straight
        and max(lines[0].rms, lines[1].rms) <= _ROUGH * looks.straight
        and abs(lines[1].slope - lines[0].slope) < _PARALLEL
    ):
        return no, _NOT_STRAIGHT
    return Axis(u0, intercept + slope * u0, angle, half, outside, wide / 1.35, beside), _VALID


@compiled
def _starts(u: Array, edge: Array, line: Line, near: int) -> EdgeStarts:
    """Return where to look for an edge: at the mask's, or on its line where that is elsewhere."""
    starts = np.empty((len(u), 2), np.int64)
    for k in range(len(u)):
        on_line = line.intercept + line.slope * u[k]
        starts[k, 0] = u[k]
        starts[k, 1] = edge[k] if abs(edge[k] - on_line) <= near else np.rint(on_line)
    return starts


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
    """The measurements of the end face."""

    tip: tuple[float, float]  # pixels, its middle
    along: float  # pixels, of it, from the axis' point, out of the part
    bulge: float  # pixels, by which its edge is ahead of it
    background: Array  # red, green and blue, beyond


@compiled
def find_end(
    image: Image, blob: Blob, colour: Array, looks: Looks, axis: Axis, other: Mask
) -> tuple[End, bool]:
    """Return the end face, and whether it is one: enough of its edge is in sight.

    The edge is seen as half an ellipse as narrow as the face is turned away from the camera: its
    ends, not its outermost point, are level with the middle of the face. A square face has a
    straight edge: that of the nearer or of the farther side.

    The mask of the ``other`` part says where that may be before it.
    """
    no, (narrow, most) = (End((0.0, 0.0), 0.0, 0.0, np.zeros(3)), False), looks.window
    radius = axis.half_width * looks.end_ratio
    blurred = min(radius - _FACE * axis.blur, axis.half_width - _SIDE * axis.blur)
    reach = min(looks.band * radius, blurred)
    starts = _rows(blob, axis, looks.front, reach)
    n = len(starts)
    if n < 3 or reach < _CLEAR * radius:
        return no
    step = (looks.front, 0)
    wide, place = blur(image, starts, step, colour, most + 1)
    starts = moved(starts, step, place)
    outside = axis.outside if math.isnan(wide) else max(window(wide), narrow)
    if outside > most:
        return no
    background, kept = end_background(image, starts, step, outside, axis.background)
    soft = soft_edges(image, kept, step, colour, background, outside + 1, outside)
    along, across = _along_and_across(starts, soft, axis, looks.front)
    across /= radius
    good = np.isfinite(along) & (np.abs(across) < 1)
    count = int(np.count_nonzero(good))
    least = max(looks.seen * n, 4.0)
    if count < _FREE * n:
        least = max(least, _FREE * (n - _hidden(starts, looks.front, outside, other)))
    if count < least:
        return no
    level, bulge, rms, points = fit_end(across[good], along[good], looks.flat)
    if rms > looks.straight or points < max(least, _FIT * count):
        return no
    tip = _at(axis, looks.front * level, 0.0)
    return End(tip, level, bulge, background.sum(axis=0) / n), True


@compiled
def _hidden(starts: EdgeStarts, front: int, outside: int, other: Mask) -> int:
    """Return how many lines across an end lead to the other part, or close by."""
    there, close = np.zeros(len(starts), np.bool_), 0
    for k in range(len(starts)):
        u = starts[k, 0] + front * outside
        if starts[k, 0] >= 0 and 0 <= u < other.shape[1]:
            there[k] = other[starts[k, 1], u] > 0
    for k in range(len(starts)):
        close += int(there[max(k - outside, 0) : k + outside + 1].any())
    return close


@compiled
def proportions(image: Image, blob: Blob, looks: Looks, axis: Axis, end: End) -> Proportions:
    """Return how long a part is for its width, as if it were not turned towards the camera.

    Both ends bulge by as much as the axis is turned away from that. The far one is measured in
    the mask, to about half a pixel.
    """
    starts, length = _rows(blob, axis, -looks.front, looks.band * axis.half_width), math.nan
    if len(starts) >= 3:
        half_a_pixel = np.full(len(starts), 0.5)
        behind, across = _along_and_across(starts, half_a_pixel, axis, -looks.front)
        across /= axis.half_width
        inside = (np.abs(across) < 1) & (starts[:, 0] >= 0)
        level, bulge, _, _ = fit_end(across[inside], behind[inside], looks.flat)
        turned = min((end.bulge / looks.end_ratio + bulge) / (2 * axis.half_width), 0.9)
        length = (end.along + level) / math.sqrt(1 - turned**2)
    far = blob.left if looks.front > 0 else blob.left + blob.own.shape[1] - 1
    aspect = length / (2 * axis.half_width)
    return Proportions(aspect, axis.half_width, 2 < far < image.shape[1] - 3)


def is_the_parts(
    image: Image,
    colour: Array,
    part: Appearance,
    axis: Axis,
    end: End,
    seen: Proportions | None,
) -> bool:
    """Return whether an end is the part's own, as far as the image shows.

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
            _at(axis, part.front * (ahead + along), side * across) for along, across in corners
        ]
        if mean_share(image, np.array(triangle), colour, end.background) > _CUT:
            return False
    return True


@compiled
def _rows(blob: Blob, axis: Axis, front: int, reach: float) -> EdgeStarts:
    """Return a blob's foremost pixels, column and row, as far from its axis as ``reach``."""
    end = blob.left + (blob.own.shape[1] - 1 if front > 0 else 0)
    middle, half = axis.v + math.tan(axis.angle) * (end - axis.u), reach * math.cos(axis.angle)
    first, last = math.ceil(middle - half), math.floor(middle + half)
    return row_ends(blob, front, first, last, axis.half_width)


@compiled
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
