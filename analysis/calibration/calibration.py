"""One camera or two calibrated from where they saw a board's corners."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from analysis.calibration.camera_fit import Fit, Seen, doubts, fit_camera, fit_pair, rms, transform
from analysis.run.errors import UserError
from models.camera_file import (
    CalibratedCamera,
    CameraFile,
    FramePose,
    IntrinsicDeviations,
    MeasuredPose,
)

Array = NDArray[np.float64]

EYES: Final = ("left", "right")
_TURN: Final = 1e-6  # rad and m, of numerical derivatives


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """What became of a picture."""

    name: str
    pixels: Array | None  # of the corners, shape (n, 2); None if it was left out
    residuals: Array | None  # seen minus projected, pixels, shape (n, 2)
    left_out: str = ""  # why
    alone: str = ""  # why it is not used as one of a pair

    @property
    def error(self) -> float | None:
        """Root of the mean square of the distances, pixels."""
        return None if self.residuals is None else rms(self.residuals)


@dataclass(frozen=True, kw_only=True, eq=False)
class KnownPlace:
    """A picture of the left camera with the board at a known place in the world."""

    picture: int  # its number
    X_WB: Array  # of the board's frame in the world, shape (4, 4)


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """Calibrated cameras, and what became of each of their pictures."""

    cameras: CameraFile
    pictures: tuple[tuple[Picture, ...], ...]  # of each camera
    pairs: int  # pictures in which both cameras saw the board
    notes: tuple[str, ...]


def calibrate(
    seen: Sequence[Sequence[Seen]],
    sizes: Sequence[tuple[int, int]],
    *,
    known: KnownPlace | None = None,
) -> Calibration:
    """Calibrate one camera, or two whose pictures were taken in pairs.

    Args:
        seen: Pictures of each camera; those of the same number were taken at the same time.
        sizes: Of each camera's pictures, width and height, pixels.
        known: Where the board was in one of the left camera's pictures.

    Raises:
        UserError: If the pictures don't tell what the cameras are.
    """
    whose = tuple(f"{eye} camera: " for eye in EYES) if len(seen) > 1 else ("",)
    fits = [fit_camera(seen[k], sizes[k], whose=of) for k, of in enumerate(whose)]
    fit = fits[0] if len(fits) == 1 else fit_pair(seen, fits)
    notes = doubts(fit, sizes, whose)
    pictures = tuple(
        tuple(_picture(one, fit, (camera, k)) for k, one in enumerate(of))
        for camera, of in enumerate(seen)
    )
    left, *others = (
        _camera(fit, camera, size, pictures[camera]) for camera, size in enumerate(sizes)
    )
    return Calibration(
        cameras=CameraFile(
            left=left,
            right=others[0] if others else None,
            pose=_inverse(fit, fit.adjustment.places.stereo, np.eye(4)) if others else None,
            world_pose=None if known is None else _world_pose(fit, known, seen[0]),
        ),
        pictures=pictures,
        pairs=fit.pairs,
        notes=notes,
    )


def _picture(one: Seen, fit: Fit, owner: tuple[int, int]) -> Picture:
    if owner in fit.left_out or one.corners is None:
        return Picture(name=one.name, pixels=None, residuals=None, left_out=fit.left_out[owner])
    return Picture(
        name=one.name,
        pixels=one.corners.pixels,
        residuals=fit.adjustment.residuals[fit.owners.index(owner)],
        alone=fit.alone.get(owner, ""),
    )


def _camera(
    fit: Fit, camera: int, size: tuple[int, int], pictures: Sequence[Picture]
) -> CalibratedCamera:
    residuals = [one.residuals for one in pictures if one.residuals is not None]
    values, deviations = map(_named, fit.adjustment.intrinsic(camera))
    return CalibratedCamera(
        width=size[0],
        height=size[1],
        **values,
        reprojection_error=rms(np.concatenate(residuals)),
        sd=IntrinsicDeviations(**deviations),
    )


def _named(intrinsic: Array) -> dict[str, Any]:
    parts = np.split(intrinsic, [2, 4])
    names = ("focal_length", "principal_point", "distortion")
    return {name: tuple(part.tolist()) for name, part in zip(names, parts, strict=True)}


def _world_pose(fit: Fit, known: KnownPlace, seen: Sequence[Seen]) -> MeasuredPose:
    owner = (0, known.picture)
    if owner in fit.left_out:
        raise UserError(
            f"{seen[known.picture].name} can't tell where the camera stands: {fit.left_out[owner]}"
        )
    return _inverse(fit, fit.adjustment.places.board(fit.moment(owner)), known.X_WB)


def _inverse(fit: Fit, where: slice, X: Array) -> MeasuredPose:
    """Return what takes points back, followed by X, shape (4, 4), and how well it is known.

    Args:
        fit: Of the cameras.
        where: The pose among its parameters.
        X: What is known exactly.
    """
    pose = fit.adjustment.parameters[where]
    found = X @ np.linalg.inv(transform(pose))
    columns = [
        (_moved(X, found, pose + turn) - _moved(X, found, pose - turn)) / (2 * _TURN)
        for turn in _TURN * np.eye(len(pose))
    ]
    jacobian = np.column_stack(columns)
    rotation = Rotation.from_matrix(found[:3, :3]).as_rotvec()
    return MeasuredPose(
        value=_frame_pose(np.concatenate([rotation, found[:3, 3]])),
        sd=_frame_pose(fit.adjustment.deviations(where, jacobian)),
    )


def _moved(X: Array, found: Array, pose: Array) -> Array:
    """Return the small rotation, rad, and the shift, m, from one pose to another, shape (6,)."""
    other = X @ np.linalg.inv(transform(pose))
    turned = Rotation.from_matrix(other[:3, :3] @ found[:3, :3].T).as_rotvec()
    return np.concatenate([turned, other[:3, 3] - found[:3, 3]])


def _frame_pose(vector: Array) -> FramePose:
    (a, b, c), (x, y, z) = np.split(vector, 2)
    return FramePose(
        rotation_vector=(float(a), float(b), float(c)),
        translation=(float(x), float(y), float(z)),
    )
