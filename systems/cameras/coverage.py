"""Convex polygons and the pixels that they cover, exactly."""

import math
from typing import Any

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.compiled import compiled

Array = NDArray[np.float64]
Window = NDArray[np.floating[Any]]


@compiled
def _left_of(z: float) -> float:
    """Integrate what of a pixel of width 1 is to the right of an edge, over the edge's place."""
    if z <= 0.0:
        return 0.0
    return 0.5 * z * z if z < 1.0 else z - 0.5


@compiled
def coverage(polygon: Array, left: int, top: int, width: int, height: int) -> Array:
    """Return the share of each pixel's area that is inside of a polygon, shape (height, width).

    Every edge adds, in each row that it crosses, the area to its right with the sign of its
    direction; the sum along the row is the area inside. Nothing is sampled. The polygon has
    corners u and v, pixels, shape (n, 2), in either direction, without crossings; pixel (0, 0)
    reaches from -0.5 to 0.5. The first pixel wanted is in column ``left`` and row ``top``.
    """
    result = np.zeros((height, width))
    n = len(polygon)
    for i in range(n):
        x0, y0 = polygon[i, 0] + 0.5 - left, polygon[i, 1] + 0.5 - top
        x1, y1 = polygon[(i + 1) % n, 0] + 0.5 - left, polygon[(i + 1) % n, 1] + 0.5 - top
        sign = 1.0
        if y0 > y1:
            x0, y0, x1, y1, sign = x1, y1, x0, y0, -1.0
        if y0 == y1:
            continue
        slope = (x1 - x0) / (y1 - y0)
        for row in range(max(0, math.floor(y0)), min(height, math.ceil(y1))):
            ya, yb = max(y0, float(row)), min(y1, row + 1.0)
            area = sign * (yb - ya)
            xa, xb = x0 + (ya - y0) * slope, x0 + (yb - y0) * slope
            low, high = min(xa, xb), max(xa, xb)
            before = 0.0
            first = max(0, math.floor(low))
            for column in range(first, min(width, max(first + 1, math.floor(high) + 2))):
                if high - low > 1e-9:
                    right = _left_of(column + 1 - low) - _left_of(column + 1 - high)
                    right *= area / (high - low)
                else:
                    right = area * min(1.0, max(0.0, column + 1 - low))
                result[row, column] += right - before
                before = right
    for row in range(height):
        total = 0.0
        for column in range(width):
            total += result[row, column]
            result[row, column] = min(1.0, abs(total))
    return result


@compiled
def paint(window: Window, polygon: Array, colour: Array, opaque: bool) -> None:
    """Draw a polygon, as for :func:`coverage`, on a window, shape (height, width, channels).

    Its edges have the share of each pixel that they cover. Opaque, the colour, shape (channels,),
    replaces what was there, else it is added to it.
    """
    height, width, channels = window.shape
    left = min(width, max(0, math.floor(polygon[:, 0].min())))
    top = min(height, max(0, math.floor(polygon[:, 1].min())))
    right = min(width, max(0, math.ceil(polygon[:, 0].max()) + 1))
    bottom = min(height, max(0, math.ceil(polygon[:, 1].max()) + 1))
    share = coverage(polygon, left, top, right - left, bottom - top)
    for row in range(bottom - top):
        for column in range(right - left):
            part, u, v = share[row, column], left + column, top + row
            if part > 0.0:
                rest = 1.0 - part if opaque else 1.0
                for k in range(channels):
                    window[v, u, k] = rest * window[v, u, k] + part * colour[k]


@compiled
def intersection(one: Array, other: Array) -> Array:
    """Return the corners of the intersection of two convex polygons (Sutherland and Hodgman).

    Both are of shape (n, 2), in either direction, and so is what is returned; n may be 0.
    """
    n = len(other)
    twice = 0.0
    for i in range(n):
        j = (i + 1) % n
        twice += other[i, 0] * other[j, 1] - other[j, 0] * other[i, 1]
    sign = 1.0 if twice > 0 else -1.0
    current = one.copy()
    for i in range(n):
        ax, ay = other[i, 0], other[i, 1]
        dx, dy = other[(i + 1) % n, 0] - ax, other[(i + 1) % n, 1] - ay
        kept = np.empty((len(current) + 2, 2))
        count = 0
        for k in range(len(current)):
            px, py = current[k, 0], current[k, 1]
            qx, qy = current[(k + 1) % len(current), 0], current[(k + 1) % len(current), 1]
            p = sign * (dx * (py - ay) - dy * (px - ax))
            q = sign * (dx * (qy - ay) - dy * (qx - ax))
            if p >= 0:
                kept[count, 0], kept[count, 1] = px, py
                count += 1
            if (p > 0 and q < 0) or (p < 0 and q > 0):
                kept[count, 0] = px + (qx - px) * p / (p - q)
                kept[count, 1] = py + (qy - py) * p / (p - q)
                count += 1
        current = kept[:count].copy()
    return current
