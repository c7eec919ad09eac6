"""How wide a part's end is, from its outline in a picture.

The end of a solid of revolution that is turned out of the image plane is seen as an ellipse,
which looks like a chamfer; but a chamfer begins with a width, and an ellipse without one. Both
are fitted, and a chamfer is believed if it fits better by far.
"""

import math
from collections.abc import Callable
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

Array = NDArray[np.float64]

_LEAST: Final = 0.4  # ratio of the end's radius to the sides'
_WHOLE: Final = 0.98  # ratio from which there is no chamfer to speak of
_BETTER: Final = 0.5  # of the squares that a chamfer has to leave, at most
_BEFORE: Final = 4  # pixels before the end that are compared
_BEHIND: Final = 1.0  # of the sides' radii behind the end, likewise
_FINE: Final = 0.25  # pixels, from one point of an outline to the next
_ROUND: Final = 24  # points of a quarter of an ellipse


def end_shape(
    share: Array, point: tuple[float, float], angle: float, front: int
) -> tuple[float, float | None]:
    """Return the radius of a part's end face relative to that of its sides, and its chamfer.

    The chamfer is its angle from the end face, rad; None: there is none.

    Args:
        share: How much of each pixel shows the part, 0 to 1, shape (height, width).
        point: Of the part's axis, u and v, pixels, where the part has its full width.
        angle: Of the axis, rad, from u to v.
        front: 1 if the end is on the right, -1 if it is on the left.
    """
    widths = _widths(share, point, angle, front)
    radius = float(np.median(widths[widths > widths.max() / 2]))
    end = int(np.flatnonzero(widths > radius / 2)[-1])
    at = np.arange(-_BEFORE, round(_BEHIND * radius) + 1)
    columns = end - at
    inside = (columns >= 0) & (columns < len(widths))
    at, measured = at[inside].astype(float), widths[columns[inside]] / radius

    def misfit(x: Array) -> Array:
        shift, blur, turn, size, taper, *chamfer = x
        ratio, height = chamfer or (1.0, 0.0)
        seen = _seen(at + shift, radius, blur, ratio, turn, height)
        return np.asarray(seen * (size + taper * at / radius) - measured)

    plain = _fitted(misfit, [[0.0, 1.0, turn, 1.0, 0.0] for turn in _TURNS])
    ends = [[0.0, 1.0, turn, 1.0, 0.0, ratio, 0.2] for turn in _TURNS for ratio in (0.6, 0.85)]
    square, found = _fitted(misfit, ends)
    ratio, height = found[5:].tolist()
    if ratio > _WHOLE or not square < _BETTER * plain[0]:
        return 1.0, None
    return ratio, math.atan2(height, 1 - ratio)


_ENOUGH: Final = 1e-3  # relative change of a fit that is not worth another step
_STEP: Final = 1e-3  # relative, of the fits' differences: outlines have corners
_TURNS: Final = (0.03, 0.3)  # rad, from which the fits start
_LOW: Final = (-2.0, 0.4, 0.0, 0.9, -0.1, _LEAST, 0.02)
_HIGH: Final = (2.0, 4.0, 0.6, 1.1, 0.1, 1.0, 0.8)
# of shift and blur, pixels, turn, rad, width and its growth along the axis, ratio and height


def _fitted(misfit: Callable[[Array], Array], starts: list[list[float]]) -> tuple[float, Array]:
    """Return the least square of all starts and where it is."""
    count = len(starts[0])
    bounds = (_LOW[:count], _HIGH[:count])
    steps = [_STEP] * count
    found = [
        least_squares(misfit, start, bounds=bounds, diff_step=steps, ftol=_ENOUGH, xtol=_ENOUGH)
        for start in starts
    ]
    best = min(found, key=lambda one: float(one.cost))
    return float(best.cost), best.x


def _widths(share: Array, point: tuple[float, float], angle: float, front: int) -> Array:
    """Return half the width in each pixel along the axis, from a point to beyond the end."""
    height, width = share.shape
    reach = math.ceil(math.hypot(height, width))
    cos, sin = front * math.cos(angle), front * math.sin(angle)
    # From (along the axis, across it) to the image, with the axis in the middle row.
    to_image = np.array([[cos, -sin, 0.0], [sin, cos, 0.0]])
    to_image[:, 2] = np.array(point) - to_image[:, 1] * reach
    turned = cv2.warpAffine(
        share.astype(np.float32),
        to_image,
        (reach, 2 * reach),
        flags=cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP,
        borderValue=0.0,
    )
    widths: Array = turned.sum(axis=0).astype(float) / 2
    return widths


def _seen(
    at: Array, radius: float, blur: float, ratio: float, turn: float, height: float
) -> Array:
    """Return half widths over the radius as a blurred picture shows them.

    Args:
        at: Where, pixels behind the foremost point.
        radius: Of the sides, pixels.
        blur: Standard deviation, pixels.
        ratio: Of the end's radius to the sides'.
        turn: Out of the image plane, rad.
        height: Of the chamfer, along the axis, over the radius.
    """
    reach = math.ceil(4 * blur / _FINE)
    fine = np.arange(at.min() / _FINE - reach, at.max() / _FINE + reach + 1) * _FINE
    exact = np.interp(fine, *_outline(radius, ratio, turn, height), left=0.0)
    kernel = np.exp(-0.5 * (np.arange(-reach, reach + 1) * _FINE / blur) ** 2)
    seen = np.convolve(exact, kernel / kernel.sum(), mode="same")
    return np.interp(at, fine, seen)


def _outline(radius: float, ratio: float, turn: float, height: float) -> tuple[Array, Array]:
    """Return points of an outline: pixels from its foremost point, half widths over the radius."""
    theta = np.linspace(0.0, math.pi / 2, _ROUND)
    sin, cos = math.sin(turn), math.cos(turn)
    end = np.column_stack([-ratio * sin * np.cos(theta), ratio * np.sin(theta)])
    sides = np.column_stack([height * cos - sin * np.cos(theta), np.sin(theta)])
    corners = np.array([[10.0, 1.0], [10.0, -1.0], [end[0, 0], -ratio]])
    points = np.concatenate([end, sides, corners]).astype(np.float32)
    hull = cv2.convexHull(points)[:, 0, :].astype(float)
    upper = hull[hull[:, 1] >= 0]
    upper = upper[np.lexsort((upper[:, 1], upper[:, 0]))]
    # Short of the foremost point nothing is seen: two points there make the jump.
    return (upper[:, 0] - upper[0, 0]) * radius, upper[:, 1]
