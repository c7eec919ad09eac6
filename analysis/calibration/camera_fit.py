"""Cameras fitted to the corners that they saw, without the pictures that don't fit."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag
from scipy.spatial.transform import Rotation

from chamfer.analysis.calibration.board import Corners
from chamfer.analysis.scenario.errors import UserError
from chamfer.models.cameras.camera_file import FramePose

Array = NDArray[np.float64]

INTRINSIC: Final = 9  # fx, fy, cx, cy, k1, k2, p1, p2, k3
_DISTORTION: Final = 5  # of them
_POSE: Final = 6  # rotation vector, rad, and translation, m, as OpenCV takes points to a camera
_STEPS: Final = 100
_DONE: Final = 1e-7  # of a standard deviation, largest step at the end
_FIRST: Final = 1e-6  # damping, of the normal matrix scaled to ones on the diagonal
_HARDER: Final = 10.0  # factor of the damping after a step that made it worse


class BoardView(NamedTuple):
    """A board's corners as one camera saw them."""

    camera: int  # 0: left, 1: right
    picture: int  # pictures of one moment share a number, and the board's place
    corners: Corners


class Places(NamedTuple):
    """Where the parameters of an adjustment are.

    In this order: each camera's ``INTRINSIC`` ones, the pose that takes points from the left
    camera's frame to the right one's (two cameras), and for each picture the pose that takes
    points from the board's frame to the left camera's.
    """

    cameras: int

    def intrinsic(self, camera: int) -> slice:
        """Return where a camera's intrinsic parameters are."""
        return slice(camera * INTRINSIC, (camera + 1) * INTRINSIC)

    @property
    def stereo(self) -> slice:
        """Where the pose from the left to the right camera is; empty for one camera."""
        begin = self.cameras * INTRINSIC
        return slice(begin, begin + _POSE * (self.cameras - 1))

    def board(self, picture: int) -> slice:
        """Return where a board's pose is."""
        begin = self.stereo.stop + picture * _POSE
        return slice(begin, begin + _POSE)


@dataclass(frozen=True, kw_only=True, eq=False)
class Adjustment:
    """The best fit, and its uncertainty."""

    places: Places
    parameters: Array  # shape (n,)
    covariances: tuple[Array, Array]  # of independent errors, and the jackknife's, shape (n, n)
    residuals: tuple[Array, ...]  # of each sight, seen minus projected, pixels, shape (n, 2)

    @property
    def noise(self) -> float:
        """Standard deviation of a coordinate, pixels, of all sights together."""
        all_of = np.concatenate(self.residuals).ravel()
        return math.sqrt(all_of @ all_of / max(1, len(all_of) - len(self.parameters)))

    def deviations(self, where: slice | NDArray[np.int64], jacobian: Array) -> Array:
        """Return standard deviations, (m,), of quantities with the derivatives (m, n)."""
        of_both = [jacobian @ one[where][:, where] @ jacobian.T for one in self.covariances]
        return np.asarray(np.sqrt(np.max([np.diag(one) for one in of_both], axis=0)))

    def intrinsic(self, camera: int) -> tuple[Array, Array]:
        """Return a camera's intrinsic parameters and their standard deviations, shape (9,)."""
        where = self.places.intrinsic(camera)
        return self.parameters[where], self.deviations(where, np.eye(INTRINSIC))

    def lens(self, camera: int) -> tuple[Array, Array]:
        """Return a camera's matrix, shape (3, 3), and distortion, shape (5,), as OpenCV does."""
        return _lens(self.parameters[self.places.intrinsic(camera)])


def adjust(
    sights: Sequence[BoardView], start: Array, *, places: Places, noise: Sequence[float]
) -> Adjustment:
    """Fit cameras and boards to the detections, from parameters near the best, shape (n,).

    Pictures are numbered from 0 on, without gaps. The noise is the standard deviation of a
    coordinate, up to a common factor, of each camera.

    Raises:
        numpy.linalg.LinAlgError: If the corners don't say what the parameters are.
    """
    parameters, damping = start.astype(float), 0.0
    cost, normal, slope = _linearised(sights, parameters, places, noise)
    for _ in range(_STEPS):
        step = _solved(normal + damping * np.diag(np.diag(normal)), slope)
        tried = _linearised(sights, parameters + step, places, noise)
        small = math.sqrt(step @ normal @ step) <= _DONE * math.sqrt(cost)
        if tried[0] <= cost:
            parameters, damping = parameters + step, damping / _HARDER
            cost, normal, slope = tried
        elif not small:
            damping = max(_FIRST, _HARDER * damping)
        if small:
            break
    return Adjustment(
        places=places,
        parameters=parameters,
        covariances=_covariances(sights, parameters, places, noise),
        residuals=tuple(_seen(sight, parameters, places)[0] for sight in sights),
    )


def _covariances(
    sights: Sequence[BoardView], parameters: Array, places: Places, noise: Sequence[float]
) -> tuple[Array, Array]:
    """Return the covariance of independent errors and the jackknife's, both shape (n, n)."""
    common = places.stereo.stop  # parameters of the cameras; each board has its own
    number = 1 + max(sight.picture for sight in sights)
    normals, slopes = np.zeros((number, common, common)), np.zeros((number, common))
    with_cameras, alone = np.zeros((number, _POSE, common)), np.zeros((number, _POSE, _POSE))
    squares, coordinates = 0.0, 0
    for k in range(number):
        residual, by_camera, by_board = _of_picture(
            [sight for sight in sights if sight.picture == k], parameters, places, noise
        )
        # What moves the cameras while the board's own place makes the best of it.
        with_cameras[k] = -np.linalg.lstsq(by_board, by_camera)[0]
        by_camera = by_camera + by_board @ with_cameras[k]
        normals[k], slopes[k] = by_camera.T @ by_camera, by_camera.T @ residual
        alone[k] = np.linalg.inv(by_board.T @ by_board)
        squares, coordinates = squares + float(residual @ residual), coordinates + len(residual)
    variance = squares / max(1, coordinates - len(parameters))
    normal = normals.sum(axis=0)
    # The first step towards what fits best without a picture.
    changes = np.stack(
        [_solved(normal - one, slope) for one, slope in zip(normals, slopes, strict=True)]
    )
    every = np.vstack([np.eye(common), *with_cameras])
    boards = block_diag(np.zeros((common, common)), *(variance * alone))
    independent = variance * _solved(normal, np.eye(common))
    jackknife = (number - 1) / number * changes.T @ changes
    return every @ independent @ every.T + boards, every @ jackknife @ every.T + boards


def _of_picture(
    sights: Sequence[BoardView], parameters: Array, places: Places, noise: Sequence[float]
) -> tuple[Array, Array, Array]:
    """Return what remains, (m,), and its derivatives by cameras and board, (m, n) and (m, 6)."""
    common = places.stereo.stop
    residuals, jacobians = [], []
    for sight in sights:
        residual, part, columns = _seen(sight, parameters, places)
        own = columns >= common
        columns[own] = np.arange(common, common + _POSE)
        jacobian = np.zeros((residual.size, common + _POSE))
        jacobian[:, columns] = part / noise[sight.camera]
        residuals.append(residual.ravel() / noise[sight.camera])
        jacobians.append(jacobian)
    by_camera, by_board = np.hsplit(np.vstack(jacobians), [common])
    return np.concatenate(residuals), by_camera, by_board


def _solved(normal: Array, right: Array) -> Array:
    """Solve equations whose unknowns have sizes of their own.

    Raises:
        numpy.linalg.LinAlgError: If there is no solution.
    """
    if not (np.diag(normal) > 0).all():
        raise np.linalg.LinAlgError("nothing is said of an unknown")
    scale = np.sqrt(np.diag(normal))
    solved = np.linalg.solve(normal / np.outer(scale, scale), (right.T / scale).T)
    return np.asarray((solved.T / scale).T)


def _linearised(
    sights: Sequence[BoardView], parameters: Array, places: Places, noise: Sequence[float]
) -> tuple[float, Array, Array]:
    """Return the sum of squares, the normal matrix and its right side."""
    size = len(parameters)
    cost, normal, slope = 0.0, np.zeros((size, size)), np.zeros(size)
    for sight in sights:
        residual, jacobian, columns = _seen(sight, parameters, places)
        weight = noise[sight.camera] ** -2
        cost += weight * float(np.sum(residual**2))
        normal[np.ix_(columns, columns)] += weight * jacobian.T @ jacobian
        slope[columns] += weight * jacobian.T @ residual.ravel()
    return cost, normal, slope


def _lens(intrinsic: Array) -> tuple[Array, Array]:
    fx, fy, cx, cy = intrinsic[:-_DISTORTION]
    return np.array([[fx, 0.0, cx], [0.0, fy, cy], [0.0, 0.0, 1.0]]), intrinsic[-_DISTORTION:]


def _seen(
    sight: BoardView, parameters: Array, places: Places
) -> tuple[Array, Array, NDArray[np.int64]]:
    """Return what remains, shape (n, 2), and how the projections move with which parameters."""
    own, board = places.intrinsic(sight.camera), places.board(sight.picture)
    matrix, distortion = _lens(parameters[own])
    pose, derivatives, columns = parameters[board], [np.eye(_POSE)], [np.r_[board]]
    if sight.camera:
        halves = (*np.split(pose, 2), *np.split(parameters[places.stereo], 2))
        rotation, translation, *by = map(np.asarray, cv2.composeRT(*halves))
        pose = np.concatenate([rotation.ravel(), translation.ravel()])
        composed = np.vstack([np.hstack(by[:4]), np.hstack(by[4:])])  # by the halves in turn
        derivatives = np.hsplit(composed, 2)
        columns.append(np.r_[places.stereo])
    points = _in_space(sight.corners.points)
    rotation, translation = np.split(pose, 2)
    projected, jacobian = cv2.projectPoints(points, rotation, translation, matrix, distortion)
    by_pose, by_camera = jacobian[:, :_POSE], jacobian[:, _POSE : _POSE + INTRINSIC]
    blocks = [by_camera, *(by_pose @ one for one in derivatives)]
    residual = sight.corners.pixels - projected.reshape(-1, 2)
    return residual, np.hstack(blocks), np.concatenate([np.r_[own], *columns])


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
class Picture:
    """A picture, the board's corners in it, and its use."""

    name: str
    corners: Corners | None = None
    left_out: str = ""  # why
    alone: str = ""  # why it is not used as one of a pair
    residuals: Array | None = None  # seen minus projected, pixels, shape (n, 2)
    board: FramePose | None = None  # in the camera's frame

    @property
    def error(self) -> float | None:
        """Root of the mean square of the distances, pixels."""
        return None if self.residuals is None else rms(self.residuals)


@dataclass(frozen=True, kw_only=True, eq=False)
class Fit:
    """The best fit, and the use of each picture."""

    adjustment: Adjustment
    sights: Mapping[Owner, BoardView]
    left_out: Mapping[Owner, str]  # why
    alone: Mapping[Owner, str] = field(default_factory=dict)  # why it is not one of a pair

    @property
    def pairs(self) -> int:
        """How many pictures are used together with one of the other camera."""
        return len(self.sights) - len({one.picture for one in self.sights.values()})

    @property
    def residuals(self) -> dict[Owner, Array]:
        """The residuals of each picture, seen minus projected, pixels, shape (n, 2)."""
        return dict(zip(self.sights, self.adjustment.residuals, strict=True))

    @property
    def errors(self) -> Array:
        """Root of the mean square of the distances in each sight, pixels."""
        return np.array([rms(residual) for residual in self.adjustment.residuals])

    def board(self, owner: Owner) -> slice:
        """Return where the parameters of the board's pose in a picture are."""
        return self.adjustment.places.board(self.sights[owner].picture)


def rms(residuals: Array) -> float:
    """Return the root of the mean square of distances, of vectors of shape (n, 2)."""
    return float(np.sqrt(np.mean(np.sum(residuals**2, axis=-1))))


def transform(poses: Array) -> Array:
    """Return rotation vectors and translations, shape (..., 6), as matrices, shape (..., 4, 4)."""
    matrices = np.tile(np.eye(4), (*poses.shape[:-1], 1, 1))
    matrices[..., :3, :3] = Rotation.from_rotvec(poses[..., :3]).as_matrix()
    matrices[..., :3, 3] = poses[..., 3:]
    return matrices


def pose_vector(X: Array) -> Array:
    """Return matrices, shape (..., 4, 4), as rotation vectors and translations, (..., 6)."""
    turns = Rotation.from_matrix(X[..., :3, :3]).as_rotvec()
    return np.concatenate([turns, X[..., :3, 3]], axis=-1)


def frame_pose(values: Array, sd: FramePose | None = None) -> FramePose:
    """Return a rotation vector and a translation, shape (6,), as a camera file has them."""
    a, b, c, x, y, z = values.tolist()
    return FramePose(rotation_vector=(a, b, c), translation=(x, y, z), sd=sd)


def moved(found: Array, other: Array) -> Array:
    """Return the small rotation, rad, and the shift, m, from one pose to another, shape (6,)."""
    turned = Rotation.from_matrix(other[:3, :3] @ found[:3, :3].T).as_rotvec()
    return np.concatenate([turned, other[:3, 3] - found[:3, 3]])


def fit_camera(seen: Sequence[Picture], size: tuple[int, int], *, whose: str = "") -> Fit:
    """Fit one camera to its pictures, of a size in pixels.

    The picture that fits worst is left out as long as it is far worse than most are.

    Raises:
        UserError: If the pictures don't tell what the camera is; ``whose`` is put in front.
    """
    left_out = {(0, k): one.left_out for k, one in enumerate(seen) if one.corners is None}
    kept = [(k, one.corners) for k, one in enumerate(seen) if one.corners is not None]
    while True:
        if len(kept) < LEAST_PICTURES:
            why = next((f" ({seen[k].name}: {said})" for (_, k), said in left_out.items()), "")
            raise UserError(
                f"{whose}{len(kept)} of {len(seen)} pictures show the board{why}, "
                f"allowed: at least {LEAST_PICTURES}"
            )
        sights = {(0, k): BoardView(0, j, corners) for j, (k, corners) in enumerate(kept)}
        adjustment = _adjusted(list(sights.values()), size, whose)
        fit = Fit(adjustment=adjustment, sights=sights, left_out=left_out)
        worst, median = int(fit.errors.argmax()), float(np.median(fit.errors))
        if not fit.errors[worst] > _BEYOND * median:
            return fit
        left_out[0, kept.pop(worst)[0]] = (
            f"an outlier: its error of {fit.errors[worst]:.2g} pixels is more than "
            f"{_BEYOND:g} times the median, {median:.2g}"
        )


def fit_pair(fits: Sequence[Fit]) -> Fit:
    """Fit two cameras, of which each has been fitted, together to all of their pictures.

    Pairs that don't fit the others are taken apart; both of their pictures are still used, each
    for its own camera. Pictures of the same number were taken at the same time.

    Raises:
        UserError: If too few pairs tell where the cameras stand to each other.
    """
    X_LB, X_RB = (
        {k: transform(fit.adjustment.parameters[fit.board((0, k))]) for _, k in fit.sights}
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
        X_RL, apart = _agreed(fits[1], X_LB, X_RB, paired)
        for k in [k for k in paired if apart[k] > _APART * median]:
            paired.remove(k)
            alone |= dict.fromkeys([(0, k), (1, k)], _UNLIKE)
    while len(paired) >= LEAST_PICTURES:
        fit = _together(fits, X_LB, X_RB, X_RL, paired, alone)
        left = fit.residuals
        errors = {k: rms(np.concatenate([left[0, k], left[1, k]])) for k in paired}
        worst = max(paired, key=errors.__getitem__)
        if not errors[worst] > _BEYOND * median:
            return fit
        paired.remove(worst)
        alone |= dict.fromkeys([(0, worst), (1, worst)], _UNLIKE)
    if both < LEAST_PICTURES:
        number = len(fits[0].sights) + len(fits[0].left_out)
        said = f"both cameras see the board in {both} of {number} pairs of pictures"
    else:
        said = (
            f"of {both} pairs of pictures {len(paired)} agree on how the cameras stand: are both "
            "in the same order, and of the same moments?"
        )
    raise UserError(f"{said}, allowed: at least {LEAST_PICTURES}")


def doubts(fit: Fit, sizes: Sequence[tuple[int, int]], whose: Sequence[str]) -> tuple[str, ...]:
    """Return warnings of poorly determined parameters of cameras with given picture sizes.

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
    end = fit.adjustment.places.intrinsic(camera).stop
    distorted = np.array(jacobian, float)[:, -_DISTORTION:]
    return float(fit.adjustment.deviations(slice(end - _DISTORTION, end), distorted).max())


def _adjusted(sights: Sequence[BoardView], size: tuple[int, int], whose: str) -> Adjustment:
    points = [_in_space(sight.corners.points).astype(np.float32) for sight in sights]
    pixels = [sight.corners.pixels.astype(np.float32) for sight in sights]
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
    right: Fit, X_LB: Mapping[int, Array], X_RB: Mapping[int, Array], paired: Sequence[int]
) -> tuple[Array, dict[int, float]]:
    """Return the pair's pose by which the others are predicted best, and their errors, pixels."""
    poses = [X_RB[k] @ np.linalg.inv(X_LB[k]) for k in paired]
    matrix, distortion = right.adjustment.lens(0)

    def error(k: int, X_RL: Array) -> float:
        corners, pose = right.sights[0, k].corners, pose_vector(X_RL @ X_LB[k])
        points = _in_space(corners.points)
        projected, _ = cv2.projectPoints(points, pose[:3], pose[3:], matrix, distortion)
        return rms(corners.pixels - np.reshape(projected, (-1, 2)))

    errors = [{k: error(k, X_RL) for k in paired} for X_RL in poses]
    best = int(np.argmin([np.median(list(one.values())) for one in errors]))
    return poses[best], errors[best]


def _together(
    fits: Sequence[Fit],
    X_LB: Mapping[int, Array],
    X_RB: Mapping[int, Array],
    X_RL: Array,
    paired: Sequence[int],
    alone: Mapping[Owner, str],
) -> Fit:
    left, right = fits
    sights = dict(left.sights)
    boards = list(X_LB.values())
    for k, X in X_RB.items():
        picture = sights[0, k].picture if k in paired else len(boards)
        if k not in paired:
            boards.append(np.linalg.inv(X_RL) @ X)
        sights[1, k] = BoardView(1, picture, right.sights[0, k].corners)
    intrinsic = [fit.adjustment.intrinsic(0)[0] for fit in fits]
    start = np.concatenate([*intrinsic, *map(pose_vector, (X_RL, *boards))])
    noise = [max(_LEAST_NOISE, fit.adjustment.noise) for fit in fits]
    return Fit(
        adjustment=adjust(list(sights.values()), start, places=Places(2), noise=noise),
        sights=sights,
        left_out={
            (camera, k): reason
            for camera, fit in enumerate(fits)
            for (_, k), reason in fit.left_out.items()
        },
        alone=dict(alone),
    )


def _in_space(points: Array) -> Array:
    return np.pad(points, ((0, 0), (0, 1)))
