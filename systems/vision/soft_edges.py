"""Edges of a coloured part to a small part of a pixel.

A pixel on an edge shows part and background mixed by area. What it has left of the background
gives the area, whatever the part's brightness there: on a line of pixels across the edge the
areas sum up to where the edge is. The background is the one beside that very edge, which may lie
in a shadow or be of wood, and as many pixels are summed as the edge is blurred.

In all that follows ``image`` is red, green, blue, shape (height, width, 3 or 4); ``starts``, shape
(n, 2), are column and row of the last pixel of the part's mask on n lines across an edge, the
column -1 where there is none; ``step`` is column and row from one pixel to the next, out of the
part; ``part``, ``background``, ``common`` and ``beside`` are colours, red, green and blue.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.compiled import compiled

Array = NDArray[np.float64]
Pixels = NDArray[np.uint8]
EdgeStarts = NDArray[np.int64]  # column and row of pixels at an edge, shape (n, 2)
Step = tuple[int, int]
Normal = tuple[float, float, float, float]  # red, green and blue, and its square

_LEAST_CONTRAST: Final = 40.0  # grey levels, of the background across the part's colour
ALIKE: Final = 40.0  # grey levels, up to which a pixel is taken for its edge's background
_FILLED: Final = 0.75  # share of a pixel from which it is taken for the part
_SIDE_BLOCK: Final = 8  # lines across a long edge that have a background in common
_END_BLOCK: Final = 3  # likewise across an end
NEAR: Final = (5, 7)  # pixels from an edge, where the background is looked for at first
_LEAST_WEIGHT: Final = 1.0  # pixels, of a triangle's pixels together
_LINES: Final = 24  # across an edge, about as many of which its blur is measured
_LOW, _HIGH = 0.25, 0.75  # shares between which the blur of an edge is measured
_SHADE: Final = (0.5, 1.6)  # brightness of a background beyond the end, of the one beside


@compiled
def moved(starts: EdgeStarts, step: Step, middle: float) -> EdgeStarts:
    """Return starts at the last pixel that shows more of the part than not.

    A mask ends there, but where the part's colour gives way to another one long before. The middle
    is that of :func:`blur`.
    """
    count = 0 if math.isnan(middle) else round(middle - 0.5)
    there = starts.copy()
    for k in range(len(starts) if count else 0):
        if starts[k, 0] >= 0:
            there[k, 0] += count * step[0]
            there[k, 1] += count * step[1]
    return there


@compiled
def window(width: float) -> int:
    """Return how many pixels of the background an edge needs that is blurred.

    Over ``width`` pixels the share falls from three quarters to a quarter: of a normal blur 1.35
    standard deviations. Two and a half of them are summed, and a pixel.
    """
    return int(1.0 + 1.9 * width)


@compiled
def contrast(part: Array, background: Array) -> Normal:
    """Return the component of a background normal to a part's colour, and its square.

    The part's shade does not matter to it: no shade of the part has any of it.

    Returns:
        Red, green and blue; grey levels squared, 0 where the background is too dark or too alike.
    """
    both = part[0] * background[0] + part[1] * background[1] + part[2] * background[2]
    alone = part[0] * part[0] + part[1] * part[1] + part[2] * part[2]
    factor = both / alone if alone > 0.0 else 0.0
    red = background[0] - factor * part[0]
    green = background[1] - factor * part[1]
    blue = background[2] - factor * part[2]
    square = red * background[0] + green * background[1] + blue * background[2]
    return red, green, blue, square if square > _LEAST_CONTRAST**2 else 0.0


@compiled
def colour_beyond(
    image: Pixels, starts: EdgeStarts, step: Step, first: int, last: int
) -> tuple[Array, float, int]:
    """Return the mean colour of pixels beyond an edge, without outliers.

    Looked at are the pixels from ``first`` to ``last`` beyond the starts.

    Returns:
        Red, green and blue, shape (3,); the standard deviation of a pixel's channel; how many
        pixels there are.
    """
    height, width = image.shape[:2]
    mean, square, count = np.zeros(3), 0.0, 0
    for attempt in range(3):
        total, square, count = np.zeros(3), 0.0, 0
        for k in range(len(starts)):
            if starts[k, 0] < 0:
                continue
            for i in range(first, last + 1):
                u, v = starts[k, 0] + i * step[0], starts[k, 1] + i * step[1]
                if not (0 <= u < width and 0 <= v < height):
                    continue
                far, sum_of = False, 0.0
                for c in range(3):
                    off = float(image[v, u, c]) - mean[c]
                    sum_of += off * off
                    if attempt and abs(off) > 1.5 * ALIKE:
                        far = True
                if not far:
                    square += sum_of
                    count += 1
                    for c in range(3):
                        total[c] += image[v, u, c]
        if count == 0:
            break
        mean = total / count
    return mean, math.sqrt(square / (3 * max(count, 1))), count


@compiled
def _share(colour: Pixels, of_part: Normal, of_background: Normal) -> float:
    """Return how much of the part a pixel shows, in light or shade; NaN if it is black."""
    a, b = 0.0, 0.0
    for c in range(3):
        a += of_part[c] * colour[c]
        b += of_background[c] * colour[c]
    a, b = max(a / of_part[3], 0.0), max(b / of_background[3], 0.0)
    return a / (a + b) if a + b > 0.0 else math.nan


@compiled
def blur(
    image: Pixels, starts: EdgeStarts, step: Step, part: Array, reach: int
) -> tuple[float, float]:
    """Return over how many pixels an edge goes from part to background, and where; else NaN.

    A shadow is no blur. Up to ``reach`` pixels to either side of the starts are looked at.

    Returns:
        From three quarters of the part to a quarter, pixels, in the mean of some lines; where
        the middle between these is, pixels beyond the start.
    """
    some = starts[:: max(1, len(starts) // _LINES)]
    background, _, count = colour_beyond(image, some, step, NEAR[0], NEAR[1])
    if count == 0:
        return math.nan, math.nan
    of_background, of_part = contrast(part, background), contrast(background, part)
    if of_background[3] == 0.0 or of_part[3] == 0.0:
        return math.nan, math.nan
    height, width = image.shape[:2]
    before, high, low = math.nan, math.nan, math.nan
    for i in range(-reach, reach + 1):
        total, count = 0.0, 0
        for k in range(len(some)):
            u, v = some[k, 0] + i * step[0], some[k, 1] + i * step[1]
            if some[k, 0] < 0 or not (0 <= u < width and 0 <= v < height):
                continue
            seen = _share(image[v, u], of_part, of_background)
            if not math.isnan(seen):
                total += seen
                count += 1
        share = total / count if count > 0 else math.nan
        if before >= _HIGH > share:
            high, low = i - (_HIGH - share) / (before - share), math.nan
        if before >= _LOW > share and not low < i:
            low = i - (_LOW - share) / (before - share)
        before = share
    return low - high, (low + high) / 2


@compiled
def backgrounds_beyond(
    image: Pixels, starts: EdgeStarts, step: Step, first: int, last: int, block: int, common: Array
) -> Array:
    """Return the background beyond an edge where it is, for each line across it.

    Background are the pixels from ``first`` to ``last`` beyond the starts. ``block`` lines are
    taken together and their mean is used as far as it differs from the common colour by more than
    chance; between the blocks' middles it changes evenly.

    Returns:
        Red, green and blue, shape (n, 3).
    """
    n = len(starts)
    blocks = max(1, n // block)
    means = np.empty((blocks, 3))
    for j in range(blocks):
        part_of = starts[j * n // blocks : (j + 1) * n // blocks]
        mean, spread, count = colour_beyond(image, part_of, step, first, last)
        means[j] = shrunk(mean, spread, count, common) if count > 0 else common
    backgrounds = np.empty((n, 3))
    for k in range(n):
        place = (k + 0.5) * blocks / n - 0.5
        j = min(max(math.floor(place), 0), max(blocks - 2, 0))
        share = min(max(place - j, 0.0), 1.0)
        after = min(j + 1, blocks - 1)
        backgrounds[k] = (1 - share) * means[j] + share * means[after]
    return backgrounds


@compiled
def shrunk(mean: Array, spread: float, count: int, common: Array) -> Array:
    """Return a mean as far as it differs from a common one by more than chance (James, Stein)."""
    difference = mean - common
    square = np.sum(difference * difference)
    chance = 12.0 * spread * spread / count  # four times what three channels have
    return common + difference * max(0.0, 1.0 - chance / max(square, 1e-9))


@compiled
def end_background(
    image: Pixels, starts: EdgeStarts, step: Step, outside: int, beside: Array
) -> tuple[Array, EdgeStarts]:
    """Return the background beyond an end, for each line across it, and where it is one.

    Background is what has the colour of the one beside the part, in light or shade, in the last
    two of the ``outside`` pixels of the edge.

    Returns:
        Red, green and blue, shape (n, 3); the starts, with the column -1 where something else
        than background is beyond.
    """
    height, width = image.shape[:2]
    size = np.sum(beside * beside)
    kept = starts.copy()
    for k in range(len(starts)):
        for i in range(outside - 1, outside + 1):
            u, v = starts[k, 0] + i * step[0], starts[k, 1] + i * step[1]
            if starts[k, 0] < 0 or not (0 <= u < width and 0 <= v < height):
                kept[k, 0] = -1
                break
            shade = 0.0
            for c in range(3):
                shade += image[v, u, c] * beside[c] / size
            off = 0.0
            for c in range(3):
                off += (image[v, u, c] - shade * beside[c]) ** 2
            if not _SHADE[0] < shade < _SHADE[1] or off > 1.25 * ALIKE**2:
                kept[k, 0] = -1
    mean, spread, count = colour_beyond(image, kept, step, outside, outside)
    common = shrunk(mean, spread, count, beside) if count > 0 else beside
    return backgrounds_beyond(image, kept, step, outside, outside, _END_BLOCK, common), kept


@compiled
def soft_edges(
    image: Pixels,
    starts: EdgeStarts,
    step: Step,
    part: Array,
    backgrounds: Array,
    inside: int,
    outside: int,
) -> Array:
    """Return how far the part reaches beyond the middle of the last pixel of its mask.

    Summed are ``inside`` pixels of the part, with the last one of its mask, and ``outside`` pixels
    of the backgrounds, shape (n, 3). The part's brightness does not matter.

    Returns:
        Pixels along the step, shape (n,); NaN where the line does not lead from the part to the
        background within the image.
    """
    height, width = image.shape[:2]
    result = np.full(len(starts), math.nan)
    for k in range(len(starts)):
        if starts[k, 0] < 0:
            continue
        normal = contrast(part, backgrounds[k])
        if normal[3] == 0.0:
            continue
        total = 0.0
        good = True
        for i in range(1 - inside, outside + 1):
            u, v = starts[k, 0] + i * step[0], starts[k, 1] + i * step[1]
            if not (0 <= u < width and 0 <= v < height):
                good = False
                break
            share = 1.0
            for c in range(3):
                value = float(image[v, u, c])
                share -= normal[c] * value / normal[3]
                if i >= outside - 1 and abs(value - backgrounds[k, c]) > ALIKE:
                    good = False
            if i <= 2 - inside and share < _FILLED:
                good = False
            total += share
        if good:
            result[k] = total - inside + 0.5
    return result


@compiled
def mean_share(image: Pixels, triangle: Array, part: Array, background: Array) -> float:
    """Return how much of the part is seen within a triangle, NaN where that is too small.

    A pixel counts by how far it is from the sides of the triangle, pixels, shape (3, 2), since on
    them a pixel may show either.
    """
    height, width = image.shape[:2]
    of_background, of_part = contrast(part, background), contrast(background, part)
    if of_background[3] == 0.0 or of_part[3] == 0.0:
        return math.nan
    total, weights = 0.0, 0.0
    left_end, right_end = triangle[:, 0].min(), triangle[:, 0].max()
    upper_end, lower_end = triangle[:, 1].min(), triangle[:, 1].max()
    for v in range(max(math.ceil(upper_end), 0), min(math.floor(lower_end), height - 1) + 1):
        for u in range(max(math.ceil(left_end), 0), min(math.floor(right_end), width - 1) + 1):
            least, most = math.inf, -math.inf
            for k in range(3):
                u0, v0 = triangle[k]
                u1, v1 = triangle[(k + 1) % 3]
                aside = (u1 - u0) * (v - v0) - (v1 - v0) * (u - u0)
                aside /= math.hypot(u1 - u0, v1 - v0)
                least, most = min(least, aside), max(most, aside)
            weight = max(least, -most)  # the corners may go around either way
            if weight <= 0.0:
                continue
            seen = _share(image[v, u], of_part, of_background)
            if not math.isnan(seen):
                total += weight * seen
                weights += weight
    return total / weights if weights >= _LEAST_WEIGHT else math.nan


@compiled
def edge_beyond(
    image: Pixels, starts: EdgeStarts, step: Step, part: Array, outside: int
) -> tuple[Array, Array]:
    """Return how far a long edge is beyond its starts, as :func:`soft_edges`, and what is beside.

    Returns:
        Pixels along the step, shape (n,); red, green and blue of the background, shape (3,).
    """
    common, _, _ = colour_beyond(image, starts, step, outside, outside + 1)
    beside = backgrounds_beyond(image, starts, step, outside, outside + 1, _SIDE_BLOCK, common)
    return soft_edges(image, starts, step, part, beside, outside + 1, outside), common
