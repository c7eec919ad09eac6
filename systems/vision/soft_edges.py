"""Edges of a coloured part to a small part of a pixel.

A pixel on an edge shows part and background mixed by area. What it has left of the background
gives the area, whatever the part's brightness there: on a line of pixels across the edge the
areas sum up to where the edge is.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from systems.compiled import compiled

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]

INSIDE: Final = 4  # pixels of the part that are summed, with the last one of the mask
OUTSIDE: Final = 3  # pixels of the background that are summed


class Mixture(NamedTuple):
    """How much of a part a pixel shows: ``weights @ rgb + constant``.

    0 on the background, 1 on the part in light or shade.
    """

    weights: Array  # of red, green and blue, shape (3,)
    constant: float
    background: Array  # red, green and blue, shape (3,)


def mixture(part: Array, background: Array) -> Mixture | None:
    """Return the mixture of a part's colour and a background.

    Args:
        part: Red, green and blue of the part; its brightness does not matter.
        background: Red, green and blue of the background.

    Returns:
        None where the background is too dark or too alike to tell them apart.
    """
    # Of what is at right angles to the part's colour, so that its shade does not matter, the
    # direction in which there is most of the background.
    normal = background - part * (part @ background) / (part @ part)
    contrast = float(normal @ background)
    if not contrast > _LEAST_CONTRAST**2:
        return None
    return Mixture(-normal / contrast, 1.0, background)


_LEAST_CONTRAST: Final = 40.0  # grey levels, of the background across the part's colour
_ALIKE: Final = 40.0  # grey levels, up to which a pixel is taken for background
_FILLED: Final = 0.75  # share of a pixel from which it is taken for the part


@compiled
def soft_edges(
    image: Pixels,
    starts: NDArray[np.int64],
    step: tuple[int, int],
    weights: Array,
    constant: float,
    background: Array,
) -> Array:
    """Return how far the part reaches beyond the middle of the last pixel of its mask.

    Args:
        image: Red, green, blue, shape (height, width, 3 or 4).
        starts: Column and row of the last pixel in the mask, shape (n, 2).
        step: Column and row from one pixel to the next, out of the part.
        weights: Of a :class:`Mixture`.
        constant: Of a :class:`Mixture`.
        background: Of a :class:`Mixture`.

    Returns:
        Pixels along the step, shape (n,); NaN where the line does not lead from the part to the
        background within the image.
    """
    height, width = image.shape[:2]
    result = np.full(len(starts), math.nan)
    for k in range(len(starts)):
        total = 0.0
        good = True
        for i in range(1 - INSIDE, OUTSIDE + 1):
            u, v = starts[k, 0] + i * step[0], starts[k, 1] + i * step[1]
            if not (0 <= u < width and 0 <= v < height):
                good = False
                break
            share = constant
            for c in range(3):
                value = float(image[v, u, c])
                share += weights[c] * value
                if i >= OUTSIDE - 1 and abs(value - background[c]) > _ALIKE:
                    good = False
            if i <= 2 - INSIDE and share < _FILLED:
                good = False
            total += share
        if good:
            result[k] = total - INSIDE + 0.5
    return result


class Line(NamedTuple):
    """A straight line through points of an edge: ``v = intercept + slope u``."""

    intercept: float  # pixels
    slope: float
    rms: float  # pixels, of the points that fit
    points: int  # number of those


def fit_line(u: Array, v: Array) -> Line:
    """Fit a line, leaving out what does not lie on it; NaN elements of v are not there.

    Returns:
        The line; without points it is no line.
    """
    basis = np.ones((len(u), 2))
    basis[:, 1] = u - u[0]
    (start, slope), rms, points = robust_fit(basis, v)
    return Line(float(start - slope * u[0]), float(slope), rms, points)


@compiled
def robust_fit(basis: Array, y: Array) -> tuple[Array, float, int]:
    """Solve ``basis @ x = y`` by least squares with Tukey's weights.

    Args:
        basis: Shape (n, m).
        y: Shape (n,); NaN elements are not there.

    Returns:
        x, shape (m,); the rms of the residuals that count; their number.
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
    for a in range(len(there)):
        if weight[a] > 0:
            square += residual[a] ** 2
            count += 1
    return x, math.sqrt(square / max(count, 1)), count


_ROUNDS: Final = 5
_STRAIGHT: Final = 0.2  # pixels; residuals below are never left out
