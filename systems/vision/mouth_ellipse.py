"""The ellipse that a circle's image is, from the edge of a picture along its normals.

An ellipse is five numbers, pixels, shape (5,): its centre u and v, and uu, uv, vv of the symmetric
matrix P that makes it of the unit circle, ``centre + P (cos t, sin t)``. Pixels are those of a
straightened image, :meth:`chamfer.models.cameras.camera.Camera.straight`; the edges are looked for
where the lens shows them.
"""

import math
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from chamfer.models.cameras.camera import Camera
from chamfer.systems.compiled import compiled

Array = NDArray[np.float64]
Grey = NDArray[np.float32]

ELLIPSE_SIZE: Final = 5
SMOOTHED: Final = 0.8  # pixels, standard deviation of the blur of the image that is measured
_STEP: Final = 0.5  # pixels, along a normal
_SPACING: Final = 2.0  # pixels along the ellipse, from one normal to the next
_NORMALS: Final = (48, 180)
_SHRUNK: Final = SMOOTHED**2 / 2  # pixels squared, of a blurred disc's steepest edge, times radius
_CORRELATED: Final = 2.5
# at least, of the variance: neighbours share pixels of the smoothed image
_BLOCK: Final = 8  # neighbours of an edge that are compared with as many others
_FITS: Final = 10
_WHITE: Final = 253  # grey levels, from where on a channel is clipped
_CLIPPED: Final = 0.15  # share of clipped pixels about one that tells nothing
_BESIDE: Final = 4.0  # pixels, from an edge, where it is over
_STEEPEST: Final = 1.5  # pixels, of an edge's step over its slope: as sharp as a lens can be
_DARKER: Final = 0.7  # of the outside, that a hole is at most
_DARK: Final = 0.2  # of an edge's step, that the inside of a hole may be brighter beside it
FLOOR: Final = 0.045  # pixels, of each of the five numbers: pixels are areas, edges are neighbours


def circle_ellipses(circles: Array) -> Array:
    """Return the images of circles, shape (..., 5); NaN of one that is not all ahead.

    ``circles``, shape (..., 3, 3): as columns two radii at right angles and the centre, before
    the camera, m, times its matrix K, which has square pixels.
    """
    dual = (circles * np.array([1.0, 1.0, -1.0])) @ circles.swapaxes(-1, -2)
    ahead = circles[..., 2, 2] > np.hypot(circles[..., 2, 0], circles[..., 2, 1])
    dual = dual / np.where(ahead, dual[..., 2, 2], math.nan)[..., np.newaxis, np.newaxis]
    u, v = dual[..., 0, 2], dual[..., 1, 2]
    uu, uv, vv = u * u - dual[..., 0, 0], u * v - dual[..., 0, 1], v * v - dual[..., 1, 1]
    area = np.sqrt(np.maximum(uu * vv - uv * uv, 0.0))
    trace = np.sqrt(uu + vv + 2 * area)  # of the matrix' root
    return np.stack([u, v, (uu + area) / trace, uv / trace, (vv + area) / trace], axis=-1)


def matrix_of(ellipse: Array) -> Array:
    """Return the matrix P, pixels, shape (2, 2)."""
    _, _, uu, uv, vv = ellipse
    return np.array([[uu, uv], [uv, vv]])


def around(ellipse: Array, turns: Array) -> tuple[Array, Array]:
    """Return points of an ellipse and the normals out of it, each of shape (n, 2)."""
    circle = np.column_stack([np.cos(turns), np.sin(turns)])
    P = matrix_of(ellipse)
    normals = circle @ np.linalg.inv(P)
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    return ellipse[:2] + circle @ P, normals


def away(ellipse: Array, points: Array) -> Array:
    """Return about how far outside of an ellipse points are, pixels, shape (n,)."""
    inverse = np.linalg.inv(matrix_of(ellipse))
    circle = (points - ellipse[:2]) @ inverse
    far = np.linalg.norm(circle, axis=1)
    return np.asarray((far - 1) * far / np.maximum(np.linalg.norm(circle @ inverse, axis=1), 1e-9))


def turns_of(ellipse: Array) -> Array:
    """Return where normals are, rad, as many as the ellipse is long, shape (n,)."""
    least, most = _NORMALS
    count = int(np.clip(2 * math.pi * math.sqrt(ellipse[2] * ellipse[4]) / _SPACING, least, most))
    return np.linspace(0.0, 2 * math.pi, count, endpoint=False)


class Picture(NamedTuple):
    """A grey picture, smoothed, NaN where it is clipped, and the camera that took it."""

    grey: Grey  # shape (height, width)
    camera: Camera  # as it is believed to be
    straight: Camera  # the same, straightened
    noise: float  # grey levels a pixel, standard deviation of a slope of the smoothed picture

    @classmethod
    def of(cls, image: NDArray[Any], camera: Camera) -> "Picture":
        """Return the picture of an image, grey or of three channels."""
        grey = np.asarray(image, np.float32)
        if grey.ndim == 3:
            grey = cv2.transform(grey[..., :3], np.full((1, 3), 1 / 3)).astype(np.float32)
        # The least of what neighbours on a line differ by is noise (Immerkaer, 1996).
        rough = np.abs(grey[::2, 2:] - 2 * grey[::2, 1:-1] + grey[::2, :-2])
        noise = float(np.median(rough)) / 0.6745 / math.sqrt(6)
        smooth = cv2.GaussianBlur(grey, (0, 0), SMOOTHED, borderType=cv2.BORDER_REPLICATE)
        full = np.asarray(image).reshape(*grey.shape, -1).max(axis=2) >= _WHITE
        if full.any():
            # An edge is moved where a channel is clipped.
            share = cv2.GaussianBlur(full.astype(np.float32), (0, 0), 1.5)
            smooth[share > _CLIPPED] = math.nan
        # A derivative of a normal blur: 1 / (sqrt(8 pi) s^2) of white noise.
        slope = noise / (math.sqrt(8 * math.pi) * SMOOTHED**2)
        return cls(np.asarray(smooth, np.float32), camera, camera.straight(), slope)

    def along(self, points: Array) -> Array:
        """Return grey levels at pixels of the straightened image, shape (..., 2); NaN outside."""
        seen = self.straight.shown_by(self.camera, points) if self._bends else points
        height, width = self.grey.shape
        u, v = seen[..., 0].astype(np.float32), seen[..., 1].astype(np.float32)
        inside = (u >= 0) & (v >= 0) & (u <= width - 1) & (v <= height - 1)
        read = cv2.remap(self.grey, u, v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE)
        return np.where(inside, read, math.nan)

    @property
    def _bends(self) -> bool:
        return self.camera != self.straight


class Edge(NamedTuple):
    """Positions of the edge along the normals of an ellipse."""

    turns: Array  # rad, shape (n,)
    offsets: Array  # pixels, out of the ellipse, NaN where there is none, shape (n,)


def inside_level(picture: Picture, ellipse: Array) -> float:
    """Return the grey level of most of what is inside of an ellipse; NaN of none."""
    turns = np.linspace(0.0, 2 * math.pi, 16, endpoint=False)
    circle = np.column_stack([np.cos(turns), np.sin(turns)]) @ matrix_of(ellipse)
    rows = [ellipse[:2] + share * circle for share in (0.2, 0.4, 0.6, 0.8)]
    levels = picture.along(np.concatenate(rows)[:, np.newaxis])
    known = levels[np.isfinite(levels)]
    return float(np.median(known)) if len(known) else math.nan


def measure(
    picture: Picture,
    ellipse: Array,
    reach: Array,
    least: float,
    dark: float | None = None,
) -> Edge:
    """Return the steepest edge along each normal, to a small part of a pixel.

    Args:
        picture: Where it is looked for.
        ellipse: shape (5,).
        reach: pixels, how far on either side, shape (n,), of the normals of :func:`turns_of`;
            where it is 0 nothing is looked for.
        least: grey levels a pixel, of an edge.
        dark: grey level of a hole, as which all edges are inside, and brighter outside; None: they
            may be either way.
    """
    turns = turns_of(ellipse)
    points, normals = around(ellipse, turns)
    half = math.ceil((float(reach.max()) + _BESIDE) / _STEP) + 2
    steps = _STEP * np.arange(-half, half + 1)
    where = points[:, np.newaxis] + steps[:, np.newaxis] * normals[:, np.newaxis]
    levels = picture.along(where)
    slopes = np.zeros_like(levels)
    slopes[:, 1:-1] = (levels[:, 2:] - levels[:, :-2]) / (2 * _STEP)
    signed = np.abs(slopes) if dark is None else slopes
    # Edges end, and are none, where a picture ends.
    tried = np.where(np.abs(steps) <= reach[:, np.newaxis], np.nan_to_num(signed), -1.0)
    best = tried[:, 1:-1].argmax(axis=1) + 1
    rows = np.arange(len(turns))
    before, here, after = (signed[rows, best + k] for k in (-1, 0, 1))
    bend = before - 2 * here + after
    with np.errstate(invalid="ignore", divide="ignore"):
        between = 0.5 * (before - after) / bend
    good = (bend < 0) & (np.abs(between) <= 1) & (here >= least) & (reach > 0)
    if dark is not None:
        beside = round(_BESIDE / _STEP)
        inner, outer = (levels[rows, np.clip(best + k, 0, 2 * half)] for k in (-beside, beside))
        good &= inner - dark < _DARK * (outer - dark)
        good &= outer - inner > _STEEPEST * here  # a line has both sides alike
        good &= inner < _DARKER * outer
    offsets = np.where(good, steps[best] + _STEP * between, math.nan)
    return Edge(turns, offsets)


class Fit(NamedTuple):
    """An ellipse through most of an edge."""

    ellipse: Array  # shape (5,)
    covariance: Array  # shape (5, 5)
    spread: float  # pixels, standard deviation of the edge about it
    good: NDArray[np.bool_]  # which normals have the edge on it, shape (n,)


def fit(edge: Edge, ellipse: Array, most: float) -> Fit | None:
    """Return the ellipse that most of an edge is on (Geman and McClure), beside another one.

    Nothing is returned where fewer than twelve normals are within ``most``, pixels, of it.
    """
    known = np.isfinite(edge.offsets)
    if known.sum() < 2 * ELLIPSE_SIZE + 2:
        return None
    circle = np.column_stack([np.cos(edge.turns), np.sin(edge.turns)])
    _, normals = around(ellipse, edge.turns)
    (n, m), (c, s) = normals.T, circle.T
    columns = np.column_stack([n, m, n * c, n * s + m * c, m * s])
    A, d = columns[known], edge.offsets[known]
    change = _robust(A, d, most)
    left = edge.offsets - columns @ change
    near = _deviation(left[np.abs(left) < most]) if (np.abs(left) < most).any() else math.inf
    good = np.abs(left) < min(most, 3.0 * max(near, 0.1))
    if good.sum() < 2 * ELLIPSE_SIZE + 2:
        return None
    A = columns[good]
    spread = math.sqrt(float(np.sum(left[good] ** 2)) / (good.sum() - ELLIPSE_SIZE))
    # What is left of neighbours in common counts as that of one.
    rest = left[good]
    blocks = np.add.reduceat(rest, np.arange(0, len(rest), _BLOCK))
    alike = max(_CORRELATED, float(np.sum(blocks**2)) / max(float(np.sum(rest**2)), 1e-12))
    covariance = alike * max(spread, 0.02) ** 2 * np.linalg.inv(A.T @ A)
    covariance += FLOOR**2 * np.eye(ELLIPSE_SIZE)
    change[[2, 4]] += _SHRUNK / math.sqrt(ellipse[2] * ellipse[4])
    return Fit(ellipse + change, covariance, spread, good)


@compiled
def _robust(A: Array, d: Array, most: float) -> Array:
    """Return the change, shape (5,), with which ``A @ change`` is most of d, shape (n,)."""
    # A size to begin with, from the median, which half of the edge can't move.
    change = np.zeros(A.shape[1])
    change[2] = change[4] = np.median(d)
    scale = max(most, 1.5 * _deviation(d - A @ change))
    for _ in range(_FITS):
        left = d - A @ change
        scale = max(min(scale, 2.0 * _deviation(left)), 0.12)
        weights = 1 / (1 + (left / scale) ** 2) ** 2
        normal = 1e-9 * np.eye(A.shape[1])
        right = np.zeros(A.shape[1])
        for k in range(len(d)):
            for i in range(A.shape[1]):
                right[i] += weights[k] * A[k, i] * d[k]
                for j in range(A.shape[1]):
                    normal[i, j] += weights[k] * A[k, i] * A[k, j]
        change[:] = np.linalg.solve(normal, right)
    return change


@compiled
def _deviation(values: Array) -> float:
    return 1.4826 * float(np.median(np.abs(values)))
