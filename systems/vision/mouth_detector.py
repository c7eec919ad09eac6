"""Finds the mouth of a hole of known size in a picture, with its uncertainty.

The rim of the bore is dark inside. Edges vote for where the middle of a mouth is that is about as
large, and seen about as obliquely, as expected; about the best places ellipses are fitted to the
edges along their normals. What is found has to be one mouth: most of each rim, all around, of the
size and the obliqueness that the other rim and the expectation leave. Else it is said why not.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum
from typing import Any, Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from chamfer.models.cameras.camera import Camera
from chamfer.models.validation import require_positive
from chamfer.systems.vision.mouth_ellipse import (
    Fit,
    Picture,
    around,
    away,
    fit,
    inside_level,
    matrix_of,
    measure,
    turns_of,
)
from chamfer.systems.vision.mouth_pose import (
    HolePose,
    Look,
    Rim,
    SeenRim,
    hole_pose,
    seen_ellipse,
)

Array = NDArray[np.float64]


class MouthStatus(IntEnum):
    """The detection of a mouth, or the reason why it was not found."""

    FOUND = 0
    NOT_SEEN = 1  # no edges of about that shape
    COVERED = 2  # too little of a rim, or all on one side
    BLURRED = 3  # edges too far from an ellipse
    OTHER_SIZE = 4  # the rims are none of one mouth, or not where, or as, it can be
    AMBIGUOUS = 5  # two that could be it


@dataclass(frozen=True, kw_only=True)
class MouthParams:
    """The limits of a valid mouth."""

    reach: float = 0.012  # m, how far from where it is expected; assumed
    most_tilt: float = 0.15  # rad, how far it may lean from what is expected; assumed

    def __post_init__(self) -> None:
        require_positive(self, "reach", "most_tilt")


class Mouth(NamedTuple):
    """The detection of a mouth."""

    status: MouthStatus
    seen: tuple[SeenRim, ...] = ()  # the bore's rim, and the chamfer's; empty unless found
    pose: HolePose | None = None  # in the frame in which it was expected, without the hand's part


_PARAMS: Final = MouthParams()
_SCALES: Final = np.arange(0.86, 1.15, 0.04)  # of the expected size, that are voted for
_BIN: Final = 4  # pixels, of the votes
_STEEP: Final = 6.0  # standard deviations of the noise, of an edge
_VOTES: Final = 0.15  # share of a rim's edge without which it is none
_RIVAL: Final = 0.35  # of the most votes, without which a place is none beside it
_PLACES: Final = 6  # that are looked at
_APART: Final = (2.8, 3.6)  # pixels, of bore's and chamfer's rim from the other, undisturbed by it
_NEAR: Final = 0.55  # of the way to the other rim that an edge is looked for
_REACHES: Final = (8.0, 4.0, 3.0)  # pixels, in which an edge is looked for
_ROUNDS: Final = 7
_SETTLED: Final = 0.5  # pixels, from where on a fit is as good as its linearisation
_OUTLIER: Final = 0.8  # pixels, from where on an edge is another one
_NEARBY: Final = 0.12  # likewise, from where an ellipse would be fitted to the same
_SAME: Final = 0.05  # of the radius: what is as near is the same mouth


class _Asked(NamedTuple):
    """The requirements for a rim."""

    share: float  # of it, seen
    gap: float  # rad, the most without any of it


# A rim without a chamfer's is confirmed by nothing else.
_ALONE: Final = _Asked(0.75, 1.3)
_DOUBT: Final = 2.0  # of its variance, likewise: shadows beside it are seen in nothing else
_OF_TWO: Final = (_Asked(0.5, 2.8), _Asked(0.35, 3.4))  # the bore's, the chamfer's
_SPREAD: Final = 0.3  # pixels, standard deviation of an edge about its ellipse, at most
_SURPRISE: Final = 30.0  # chi square, of five, of two rims that are of one mouth
_SLOPE: Final = 3.0  # grey levels a pixel, of an edge in the smoothed picture, at least


def detect_mouth(
    image: NDArray[Any],
    camera: Camera,
    expected: RigidTransform,
    rims: Sequence[Rim],
    params: MouthParams = _PARAMS,
) -> Mouth:
    """Return the mouth of a hole in a picture.

    Args:
        image: Grey, shape (height, width), or red, green and blue.
        camera: As it is believed to be, in any frame.
        expected: X_WM, about where the hole is in that frame, its x axis into the hole.
        rims: Of the mouth, :func:`chamfer.systems.vision.mouth_pose.rims`: that of the bore first.
        params: What counts.
    """
    picture = Picture.of(image, camera)
    least = max(_SLOPE, _STEEP * picture.noise)
    bore = seen_ellipse(picture.straight, expected, rims[0])
    if not np.isfinite(bore).all():
        return Mouth(MouthStatus.NOT_SEEN)
    found: list[Mouth] = []
    worst = MouthStatus.NOT_SEEN
    for place, scale in _places(picture, bore, least, _pixels(picture, expected, params.reach)):
        start = _shifted(picture.straight, expected, place, scale, rims[0])
        if any(
            _same(seen_ellipse(picture.straight, start, rims[0]), one, _NEARBY) for one in found
        ):
            continue
        mouth = _mouth_at(picture, expected, start, rims, params, least)
        if mouth.status != MouthStatus.FOUND:
            worst = max(worst, mouth.status)
        elif not any(_same(mouth.seen[0].ellipse, one, _SAME) for one in found):
            found.append(mouth)
    if len(found) > 1:
        return Mouth(MouthStatus.AMBIGUOUS)
    return found[0] if found else Mouth(worst)


def _pixels(picture: Picture, expected: RigidTransform, reach: float) -> float:
    """Return how many pixels a length, m, covers at the mouth."""
    camera = picture.straight
    depth = float((expected.translation() - camera.p_WC) @ camera.R_WC[:, 2])
    return reach * camera.focal[0] / depth


def _same(ellipse: Array, other: Mouth, share: float) -> bool:
    of = other.seen[0].ellipse
    return bool(np.abs(ellipse - of).max() < max(1.0, share * of[2]))


def _shifted(
    camera: Camera, expected: RigidTransform, place: Array, scale: float, rim: Rim
) -> RigidTransform:
    """Return the expected pose where a rim's middle is seen at a place, pixels, and as large."""
    p = expected @ np.array([rim.depth, 0.0, 0.0])
    depth = float((p - camera.p_WC) @ camera.R_WC[:, 2]) / scale
    return RigidTransform(
        expected.rotation(), expected.translation() + camera.point(place, depth) - p
    )


def _places(
    picture: Picture, ellipse: Array, least: float, reach: float
) -> list[tuple[Array, float]]:
    """Return where, straightened pixels, and how large, relatively, mouths may be, best first."""
    grey, camera = picture.grey, picture.camera
    du = cv2.Sobel(grey, cv2.CV_32F, 1, 0, scale=1 / 8)
    dv = cv2.Sobel(grey, cv2.CV_32F, 0, 1, scale=1 / 8)
    size = cv2.magnitude(du, dv)
    # The steepest of their neighbours along a row or a column.
    wide = cv2.dilate(size, np.ones((1, 3), np.uint8))
    high = cv2.dilate(size, np.ones((3, 1), np.uint8))
    v, u = np.nonzero((size >= least) & ((size >= wide) | (size >= high)))
    if not len(u):
        return []
    n = np.column_stack([du[v, u], dv[v, u]]) / size[v, u][:, np.newaxis]
    P = matrix_of(ellipse)
    offset = n @ (P @ P)
    offset = offset / np.sqrt(np.sum(offset * n, axis=1))[:, np.newaxis]
    width, height = camera.width // _BIN + 1, camera.height // _BIN + 1
    middle = camera.straight().shown_by(camera, ellipse[:2])
    points = np.column_stack([u, v]).astype(float)
    expected_votes = len(turns_of(ellipse)) * 2.0
    votes = np.zeros((len(_SCALES), height, width), np.float32)
    for level, scale in enumerate(_SCALES):
        at = np.rint((points - scale * offset) / _BIN).astype(int)
        inside = (at >= 0).all(axis=1) & (at[:, 0] < width) & (at[:, 1] < height)
        flat = at[inside, 1] * width + at[inside, 0]
        counts = np.bincount(flat, minlength=width * height).reshape(height, width)
        votes[level] = cv2.boxFilter(counts.astype(np.float32), -1, (3, 3), normalize=False)
    rows, columns = np.mgrid[:height, :width] * float(_BIN)
    votes[:, np.hypot(columns - middle[0], rows - middle[1]) > reach + _BIN] = 0
    least_votes = max(_VOTES * expected_votes, _RIVAL * float(votes.max()))
    found = []
    apart = max(2, int(0.1 * ellipse[2] / _BIN))
    for _ in range(_PLACES):
        k, row, column = map(int, np.unravel_index(int(votes.argmax()), votes.shape))
        if votes[k, row, column] < least_votes:
            break
        place = camera.shown_by(picture.straight, _BIN * np.array([column, row], float))
        found.append((place, float(_SCALES[k])))
        near = slice(max(k - 1, 0), k + 2)
        votes[
            near,
            max(row - apart, 0) : row + apart + 1,
            max(column - apart, 0) : column + apart + 1,
        ] = 0
    return found


def _mouth_at(
    picture: Picture,
    expected: RigidTransform,
    start: RigidTransform,
    rims: Sequence[Rim],
    params: MouthParams,
    least: float,
) -> Mouth:
    """Return the mouth about a pose."""
    camera, X_WM = picture.straight, start
    doubt = _DOUBT if len(rims) == 1 else 1.0
    for step in range(_ROUNDS):
        reach = _REACHES[min(step, len(_REACHES) - 1)]
        ellipses = [seen_ellipse(camera, X_WM, rim) for rim in rims]
        seen: tuple[SeenRim, ...] = ()
        far = 0.0
        # Before it is known where the bore is, the other rim is not looked for.
        for k, rim in enumerate(rims if step else rims[:1]):
            others = [one for i, one in enumerate(ellipses) if i != k]
            fitted = _rim(picture, ellipses[k], others, reach, least, is_bore=k == 0)
            if fitted is None:
                return Mouth(MouthStatus.COVERED if seen else MouthStatus.NOT_SEEN)
            asked = _OF_TWO[k] if len(rims) > 1 else _ALONE
            if (status := _wrong(fitted, asked, step)) is not None:
                return Mouth(status)
            far = max(far, float(np.abs(fitted.ellipse - ellipses[k]).max()))
            seen = (*seen, SeenRim(rim, fitted.ellipse, doubt * fitted.covariance))
        pose = hole_pose([Look(camera, seen)], X_WM)
        if pose is None:
            return Mouth(MouthStatus.OTHER_SIZE)
        X_WM = pose.X_WM
        if reach == _REACHES[-1] and far < _SETTLED:
            break
    else:
        return Mouth(MouthStatus.BLURRED)
    X_EM = expected.InvertAndCompose(X_WM)
    lean = math.acos(min(1.0, max(-1.0, float(X_EM.rotation().matrix()[0, 0]))))
    far = float(np.linalg.norm(X_EM.translation()))
    if pose.surprise > _SURPRISE or lean > params.most_tilt or far > params.reach:
        return Mouth(MouthStatus.OTHER_SIZE)
    return Mouth(MouthStatus.FOUND, seen, pose)


def _rim(
    picture: Picture,
    ellipse: Array,
    others: list[Array],
    reach: float,
    least: float,
    *,
    is_bore: bool,
) -> Fit | None:
    """Return the ellipse of a rim near another one; the edges of other rims are none of it."""
    if not np.isfinite(ellipse).all() or np.linalg.det(matrix_of(ellipse)) <= 1.0:
        return None
    points, _ = around(ellipse, turns_of(ellipse))
    way = np.full(len(points), reach)
    for other in others:
        apart = np.abs(away(other, points))
        way = np.where(apart < _APART[0 if is_bore else 1], 0.0, np.minimum(way, _NEAR * apart))
    dark = inside_level(picture, ellipse) if is_bore else None
    edge = measure(picture, ellipse, way, least if is_bore else 0.5 * least, dark)
    return fit(edge, ellipse, _OUTLIER if reach <= _REACHES[-1] else reach / 3)


def _wrong(fitted: Fit, asked: _Asked, step: int) -> MouthStatus | None:
    """Return what is wrong with a rim that was found, if anything is."""
    good = np.flatnonzero(fitted.good)
    gaps = np.diff(np.append(good, good[0] + len(fitted.good)))
    gap, share = 2 * math.pi * float(gaps.max()) / len(fitted.good), len(good) / len(fitted.good)
    if share < asked.share / 2 or (step and (share < asked.share or gap > asked.gap)):
        return MouthStatus.COVERED
    last = step >= len(_REACHES) - 1
    return MouthStatus.BLURRED if last and fitted.spread > _SPREAD else None
