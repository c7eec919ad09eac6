"""Cameras and boards adjusted together to the corners seen, with their standard deviations.

The sum of squares of all distances between seen and projected corners, each divided by its
camera's noise, is made least over both cameras' intrinsic parameters, the right camera's place
and all boards' places (Gauss-Newton; the derivatives are OpenCV's).

Standard deviations are the larger ones of two. One is that of ``cv2.calibrateCameraExtended``:
the inverse of the normal matrix times the mean square, per degree of freedom, of what remains. It
is right where corners' errors don't depend on each other. On photographs they do (a board that is
not flat, a lens that is not quite the model), and it is too small two to four times; so the other
is the jackknife's: how much the cameras change as one picture or another is left out.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.linalg import block_diag

Array = NDArray[np.float64]

INTRINSIC: Final = 9  # fx, fy, cx, cy, k1, k2, p1, p2, k3
_DISTORTION: Final = 5  # of them
_POSE: Final = 6  # rotation vector, rad, and translation, m, as OpenCV takes points to a camera
_STEPS: Final = 100
_DONE: Final = 1e-7  # of a standard deviation, largest step at the end
_FIRST: Final = 1e-6  # damping, of the normal matrix scaled to ones on the diagonal
_HARDER: Final = 10.0  # factor of the damping after a step that made it worse


@dataclass(frozen=True, kw_only=True, eq=False)
class Sight:
    """A board's corners as one camera saw them."""

    camera: int  # 0: left, 1: right
    picture: int  # pictures of one moment share a number, and the board's place
    points: Array  # shape (n, 2), m, x and y in the board's frame
    pixels: Array  # shape (n, 2)


@dataclass(frozen=True)
class Places:
    """Where the parameters of an adjustment are.

    In this order: each camera's ``INTRINSIC`` ones, the pose that takes points from the left
    camera's frame to the right one's (two cameras), and for each picture the pose that takes
    points from the board's frame to the left camera's.
    """

    cameras: int

    def intrinsic(self, camera: int) -> slice:
        """Return where a camera's intrinsic parameters are."""
        return slice(camera * INTRINSIC, (camera + 1) * INTRINSIC)

    def distortion(self, camera: int) -> slice:
        """Return where a camera's distortion is."""
        end = self.intrinsic(camera).stop
        return slice(end - _DISTORTION, end)

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
    """What fits best, and how well it is known."""

    places: Places
    parameters: Array  # shape (n,)
    covariances: tuple[Array, Array]  # of independent errors, and the jackknife's, shape (n, n)
    residuals: tuple[Array, ...]  # of each sight, seen minus projected, pixels, shape (n, 2)

    @property
    def noise(self) -> float:
        """Standard deviation of a coordinate, pixels, of all sights together."""
        squares = sum(float(np.sum(residual**2)) for residual in self.residuals)
        coordinates = sum(residual.size for residual in self.residuals)
        return math.sqrt(squares / max(1, coordinates - len(self.parameters)))

    def deviations(self, where: slice | NDArray[np.int64], jacobian: Array) -> Array:
        """Return standard deviations of what depends on parameters, shape (m,).

        Args:
            where: The parameters, n of them.
            jacobian: How it moves with them, shape (m, n).
        """
        of_both = [jacobian @ one[where][:, where] @ jacobian.T for one in self.covariances]
        largest: Array = np.sqrt(np.max([np.diag(one) for one in of_both], axis=0))
        return largest

    def intrinsic(self, camera: int) -> tuple[Array, Array]:
        """Return a camera's intrinsic parameters and their standard deviations, shape (9,)."""
        where = self.places.intrinsic(camera)
        return self.parameters[where], self.deviations(where, np.eye(INTRINSIC))

    def lens(self, camera: int) -> tuple[Array, Array]:
        """Return a camera's matrix, shape (3, 3), and distortion, shape (5,), as OpenCV does."""
        return _lens(self.parameters[self.places.intrinsic(camera)])

    def board(self, picture: int) -> Array:
        """Return the pose that takes points from a board to the left camera, shape (6,)."""
        return self.parameters[self.places.board(picture)]


def adjust(
    sights: Sequence[Sight], start: Array, *, places: Places, noise: Sequence[float]
) -> Adjustment:
    """Adjust cameras and boards to what was seen.

    Args:
        sights: What was seen; pictures are numbered from 0 on, without gaps.
        start: Parameters near the best ones, shape (n,).
        places: Of the parameters.
        noise: Standard deviation of a coordinate, up to a common factor, of each camera.

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
    sights: Sequence[Sight], parameters: Array, places: Places, noise: Sequence[float]
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
    sights: Sequence[Sight], parameters: Array, places: Places, noise: Sequence[float]
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
    solved: Array = np.linalg.solve(normal / np.outer(scale, scale), (right.T / scale).T)
    return (solved.T / scale).T


def _linearised(
    sights: Sequence[Sight], parameters: Array, places: Places, noise: Sequence[float]
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
    sight: Sight, parameters: Array, places: Places
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
    points = np.column_stack([sight.points, np.zeros(len(sight.points))])
    rotation, translation = np.split(pose, 2)
    projected, jacobian = cv2.projectPoints(points, rotation, translation, matrix, distortion)
    by_pose, by_camera = jacobian[:, :_POSE], jacobian[:, _POSE : _POSE + INTRINSIC]
    blocks = [by_camera, *(by_pose @ one for one in derivatives)]
    residual = sight.pixels - projected.reshape(-1, 2)
    return residual, np.hstack(blocks), np.concatenate([np.r_[own], *columns])
