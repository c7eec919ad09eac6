"""Cameras fitted to the corners that they saw, without the pictures that don't fit."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.analysis.calibration.adjustment import Adjustment, Places, Sight, adjust
from chamfer.analysis.calibration.board import Corners
from chamfer.analysis.scenario.errors import UserError

Array = NDArray[np.float64]
Owner = tuple[int, int]  # camera, 0 left and 1 right, and number among its pictures

LEAST_PICTURES: Final = 3  # of a camera that show the board, and of pairs
_BEYOND: Final = 3.0  # times the median of the pictures' errors: an outlier
_APART: Final = 30.0  # likewise, of a pair as another one predicts it
_LEAST_NOISE: Final = 1e-9  # pixels, so that exact corners can be weighed
_NOT_KNOWN: Final = 0.05  # of the focal length, standard deviation
_HARDLY_KNOWN: Final = 0.01
_BENT: Final = 2.0  # pixels, standard deviation of what the distortion does at pictures' corners
_UNLIKE: Final = "both together don't fit the other pairs"
_TILT: Final = "tilt the board by 20 to 40 degrees, each time to another side"


@dataclass(frozen=True, kw_only=True, eq=False)
class Seen:
    """A picture and the board's corners in it, or why there are none."""

    name: str
    corners: Corners | None = None
    reason: str = ""


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """What fits best, and what became of the pictures."""

    adjustment: Adjustment
    sights: tuple[Sight, ...]
    owners: tuple[Owner, ...]  # of each sight
    left_out: Mapping[Owner, str]  # why
    alone: Mapping[Owner, str]  # why a picture is not used as one of a pair
    pairs: int

    @property
    def errors(self) -> Array:
        """Root of the mean square of the distances in each sight, pixels."""
        return np.array([rms(residual) for residual in self.adjustment.residuals])

    def moment(self, owner: Owner) -> int:
        """Return under which number the board's pose in a picture is."""
        return self.sights[self.owners.index(owner)].picture


def rms(residuals: Array) -> float:
    """Return the root of the mean square of distances, of vectors of shape (n, 2)."""
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=-1))))


def transform(pose: Array) -> Array:
    """Return a rotation vector and a translation, shape (6,), as a matrix, shape (4, 4)."""
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_rotvec(pose[:3]).as_matrix()
    matrix[:3, 3] = pose[3:]
    return matrix


def fit_camera(seen: Sequence[Seen], size: tuple[int, int], *, whose: str = "") -> Fit:
    """Fit one camera to its pictures.

    The picture that fits worst is left out as long as it is far worse than most are.

    Args:
        seen: Its pictures.
        size: Of the pictures, width and height, pixels.
        whose: Put in front of what is said.

    Raises:
        UserError: If the pictures don't tell what the camera is.
    """
    left_out = {(0, k): one.reason for k, one in enumerate(seen) if one.corners is None}
    kept = [k for k, one in enumerate(seen) if one.corners is not None]
    while True:
        _require_enough(len(kept), seen, left_out, whose)
        sights = tuple(_sight(seen[k], 0, j) for j, k in enumerate(kept))
        fit = Fit(
            adjustment=_adjusted(sights, size, whose),
            sights=sights,
            owners=tuple((0, k) for k in kept),
            left_out=left_out,
            alone={},
            pairs=0,
        )
        worst, median = int(fit.errors.argmax()), float(np.median(fit.errors))
        if not fit.errors[worst] > _BEYOND * median:
            return fit
        left_out[0, kept.pop(worst)] = (
            f"an outlier: its error of {fit.errors[worst]:.2g} pixels is more than "
            f"{_BEYOND:g} times the median, {median:.2g}"
        )


def fit_pair(seen: Sequence[Sequence[Seen]], fits: Sequence[Fit]) -> Fit:
    """Fit two cameras together to all of their pictures.

    Pairs that don't fit the others are taken apart; both of their pictures are still used, each
    for its own camera.

    Args:
        seen: Pictures of each camera; those of the same number were taken at the same time.
        fits: Of each camera alone.

    Raises:
        UserError: If too few pairs tell where the cameras stand to each other.
    """
    X_LB, X_RB = (
        {k: transform(fit.adjustment.board(j)) for j, (_, k) in enumerate(fit.owners)}
        for fit in fits
    )
    paired = sorted(X_LB.keys() & X_RB.keys())
    both = len(paired)
    alone: dict[Owner, str] = {
        **{(0, k): "without the right camera's" for k in X_LB.keys() - X_RB.keys()},
        **{(1, k): "without the left camera's" for k in X_RB.keys() - X_LB.keys()},
    }
    median = float(np.median(np.concatenate([fit.errors for fit in fits])))
    if both >= LEAST_PICTURES:
        X_RL, apart = _agreed(seen[1], X_LB, X_RB, paired, fits[1])
        for k in [k for k in paired if apart[k] > _APART * median]:
            paired.remove(k)
            alone |= dict.fromkeys([(0, k), (1, k)], _UNLIKE)
    while len(paired) >= LEAST_PICTURES:
        fit = _together(seen, fits, X_LB, X_RB, X_RL, paired, alone)
        errors = {k: _pair_error(fit, k) for k in paired}
        worst = max(paired, key=errors.__getitem__)
        if not errors[worst] > _BEYOND * median:
            return fit
        paired.remove(worst)
        alone |= dict.fromkeys([(0, worst), (1, worst)], _UNLIKE)
    if both < LEAST_PICTURES:
        said = f"both cameras see the board in {both} of {len(seen[0])} pairs of pictures"
    else:
        said = (
            f"of {both} pairs of pictures {len(paired)} agree on how the cameras stand: are both "
            "in the same order, and of the same moments?"
        )
    raise UserError(f"{said}, allowed: at least {LEAST_PICTURES}")


def doubts(fit: Fit, sizes: Sequence[tuple[int, int]], whose: Sequence[str]) -> tuple[str, ...]:
    """Return what is to be said of what is hardly known.

    Args:
        fit: Of all cameras.
        sizes: Of their pictures, width and height, pixels.
        whose: Put in front of what is said of each.

    Raises:
        UserError: If one is not known.
    """
    said = []
    for camera, of in enumerate(whose):
        values, deviations = fit.adjustment.intrinsic(camera)
        share = float(np.max(deviations[:2] / np.abs(values[:2])))
        if not (share <= _NOT_KNOWN and (values[:2] > 0).all()):
            raise UserError(
                f"{of}the pictures don't tell the focal length: {values[0]:.4g} pixels with a "
                f"standard deviation of {100 * share:.2g} %, allowed: at most "
                f"{100 * _NOT_KNOWN:g} %; {_TILT}"
            )
        if share > _HARDLY_KNOWN:
            said.append(f"{of}the focal length is known to {100 * share:.1f} % only, {_TILT}")
        bent = _bent(fit, camera, sizes[camera])
        if not bent <= _BENT:
            said.append(
                f"{of}in the picture's corners the distortion is known to {bent:.2g} pixels only, "
                "hold the board there too"
            )
    return tuple(said)


def _bent(fit: Fit, camera: int, size: tuple[int, int]) -> float:
    """Return how well it is known at most where pictures' corners are seen, pixels."""
    corners = [[u, v] for u in (0.0, size[0] - 1.0) for v in (0.0, size[1] - 1.0)]
    matrix, distortion = fit.adjustment.lens(camera)
    unbent = cv2.undistortPoints(np.array(corners), matrix, distortion)
    ahead = np.column_stack([np.reshape(unbent, (-1, 2)), np.ones(len(corners))])
    _, jacobian = cv2.projectPoints(ahead, np.zeros(3), np.zeros(3), matrix, distortion)
    where = fit.adjustment.places.distortion(camera)
    return float(fit.adjustment.deviations(where, np.array(jacobian, float)[:, -5:]).max())


def _require_enough(
    count: int, seen: Sequence[Seen], left_out: Mapping[Owner, str], whose: str
) -> None:
    if count >= LEAST_PICTURES:
        return
    why = next((f" ({seen[k].name}: {reason})" for (_, k), reason in left_out.items()), "")
    raise UserError(
        f"{whose}{count} of {len(seen)} pictures show the board{why}, "
        f"allowed: at least {LEAST_PICTURES}"
    )


def _sight(one: Seen, camera: int, picture: int) -> Sight:
    if one.corners is None:
        raise ValueError(f"{one.name} shows no board")
    points, pixels = one.corners.points, one.corners.pixels
    return Sight(camera=camera, picture=picture, points=points, pixels=pixels)


def _adjusted(sights: Sequence[Sight], size: tuple[int, int], whose: str) -> Adjustment:
    points = [_in_space(sight.points).astype(np.float32) for sight in sights]
    pixels = [sight.pixels.astype(np.float32) for sight in sights]
    try:
        _, matrix, distortion, rotations, translations = cv2.calibrateCamera(
            points, pixels, size, np.eye(3), np.zeros(5)
        )
        (fx, _, cx), (_, fy, cy), _ = np.asarray(matrix)
        poses = [
            np.ravel(part) for pair in zip(rotations, translations, strict=True) for part in pair
        ]
        start = np.concatenate([[fx, fy, cx, cy], np.ravel(distortion), *poses])
        return adjust(sights, start, places=Places(1), noise=[1.0])
    except (cv2.error, np.linalg.LinAlgError) as error:
        raise UserError(f"{whose}the pictures don't tell what the camera is; {_TILT}") from error


def _agreed(
    seen: Sequence[Seen],
    X_LB: Mapping[int, Array],
    X_RB: Mapping[int, Array],
    paired: Sequence[int],
    right: Fit,
) -> tuple[Array, dict[int, float]]:
    """Return the pair's pose by which the others are predicted best, and their errors, pixels."""
    best: tuple[float, Array, dict[int, float]] | None = None
    for k in paired:
        X_RL = X_RB[k] @ np.linalg.inv(X_LB[k])
        errors = {j: _predicted(right, _sight(seen[j], 1, 0), X_RL @ X_LB[j]) for j in paired}
        median = float(np.median(list(errors.values())))
        if best is None or median < best[0]:
            best = median, X_RL, errors
    if best is None:
        raise ValueError("there are no pairs")
    return best[1:]


def _predicted(right: Fit, sight: Sight, X_RB: Array) -> float:
    """Return a sight's error with the board at a place, pixels."""
    matrix, distortion = right.adjustment.lens(0)
    rotation = Rotation.from_matrix(X_RB[:3, :3]).as_rotvec()
    projected, _ = cv2.projectPoints(
        _in_space(sight.points), rotation, X_RB[:3, 3], matrix, distortion
    )
    return rms(sight.pixels - np.reshape(projected, (-1, 2)))


def _together(
    seen: Sequence[Sequence[Seen]],
    fits: Sequence[Fit],
    X_LB: Mapping[int, Array],
    X_RB: Mapping[int, Array],
    X_RL: Array,
    paired: Sequence[int],
    alone: Mapping[Owner, str],
) -> Fit:
    X_LR = np.linalg.inv(X_RL)
    owners: list[Owner] = [(0, k) for k in X_LB]
    moments = {owner: number for number, owner in enumerate(owners)}
    boards = list(X_LB.values())
    for k, X in X_RB.items():
        owners.append((1, k))
        if k in paired:
            moments[1, k] = moments[0, k]
        else:
            moments[1, k] = len(boards)
            boards.append(X_LR @ X)
    sights = tuple(_sight(seen[c][k], c, moments[c, k]) for c, k in owners)
    intrinsic = [fit.adjustment.intrinsic(0)[0] for fit in fits]
    start = np.concatenate([*intrinsic, *(_as_vector(X) for X in (X_RL, *boards))])
    noise = [max(_LEAST_NOISE, fit.adjustment.noise) for fit in fits]
    return Fit(
        adjustment=adjust(sights, start, places=Places(2), noise=noise),
        sights=sights,
        owners=tuple(owners),
        left_out={
            (camera, k): reason
            for camera, fit in enumerate(fits)
            for (_, k), reason in fit.left_out.items()
        },
        alone=dict(alone),
        pairs=len(paired),
    )


def _pair_error(fit: Fit, number: int) -> float:
    both = [fit.adjustment.residuals[fit.owners.index((camera, number))] for camera in (0, 1)]
    return rms(np.concatenate(both))


def _as_vector(X: Array) -> Array:
    return np.concatenate([Rotation.from_matrix(X[:3, :3]).as_rotvec(), X[:3, 3]])


def _in_space(points: Array) -> Array:
    return np.column_stack([points, np.zeros(len(points))])
