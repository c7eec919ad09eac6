"""One camera or two calibrated from where they saw a board's corners."""

from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.analysis.calibration.board import Board, Grey, NotFoundError
from chamfer.analysis.calibration.camera_fit import (
    Fit,
    Owner,
    Seen,
    doubts,
    fit_camera,
    fit_pair,
    rms,
    transform,
)
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Progress
from chamfer.analysis.track.frame_source import Recording, open_recording, shown_name
from chamfer.models.cameras.camera_file import (
    CalibratedCamera,
    CameraFile,
    FramePose,
    IntrinsicDeviations,
    MeasuredPose,
)

Size = tuple[int, int]  # pixels, width and height


@dataclass(frozen=True, kw_only=True)
class BoardPictures:
    """What was seen of a board in the pictures of a camera."""

    seen: tuple[Seen, ...]
    size: Size  # of most pictures; (0, 0) if none can be read
    contents: Mapping[bytes, str]  # names of the pictures by what is in them


def picture_files(paths: Sequence[Path]) -> tuple[Path, ...]:
    """Return the image files, or those of an image folder, in natural order.

    Raises:
        UserError: If there are none.
    """
    recording = open_recording(paths)
    if recording.video:
        raise UserError(f"{recording.files[0]} is a video, allowed: an image folder, image files")
    return recording.files


def see_board(
    board: Board, files: Sequence[Path], *, others: Mapping[bytes, str], progress: Progress
) -> BoardPictures:
    """Look for a board in pictures.

    Args:
        board: The board.
        files: The pictures.
        others: Pictures that are not to be used once more.
        progress: Told after every picture.
    """
    seen: list[Seen] = []
    sizes: list[Size | None] = []
    contents: dict[bytes, str] = {}
    for k, file in enumerate(files):
        name = shown_name(file)
        try:
            image = _grey(file)
        except UserError as error:
            reason = str(error).removeprefix(f"{file}").removeprefix(name).lstrip(": ")
            seen.append(Seen(name=name, reason=reason))
            sizes.append(None)
        else:
            key = sha256(repr(image.shape).encode() + image.tobytes()).digest()
            same = contents.get(key, others.get(key))
            contents.setdefault(key, name)
            seen.append(_look(board, image, name, same))
            sizes.append((image.shape[1], image.shape[0]))
        progress((k + 1) / len(files), f"picture {k + 1}")
    known = [size for size in sizes if size is not None]
    size = Counter(known).most_common(1)[0][0] if known else (0, 0)
    return BoardPictures(
        seen=tuple(_of_size(one, own, size) for one, own in zip(seen, sizes, strict=True)),
        size=size,
        contents=contents,
    )


def _look(board: Board, image: Grey, name: str, same: str | None) -> Seen:
    if same is not None:
        return Seen(name=name, reason=f"the same picture as {same}")
    try:
        return Seen(name=name, corners=board.find(image))
    except NotFoundError as error:
        return Seen(name=name, reason=str(error))


def _of_size(one: Seen, own: Size | None, size: Size) -> Seen:
    if own is None or own == size:
        return one
    reason = "it is {} x {} pixels, most are {} x {}".format(*own, *size)
    return replace(one, corners=None, reason=reason)


def _grey(file: Path) -> Grey:
    (frame,) = Recording(files=(file,), video=False).frames()
    return cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY).astype(np.uint8, copy=False)


Array = NDArray[np.float64]

EYES: Final = ("left", "right")
_TURN: Final = 1e-6  # rad and m, of numerical derivatives


@dataclass(frozen=True, kw_only=True, eq=False)
class Picture:
    """What became of a picture."""

    name: str
    pixels: Array | None  # of the corners, shape (n, 2); None if it was left out
    residuals: Array | None  # seen minus projected, pixels, shape (n, 2)
    board: MeasuredPose | None = None  # in the camera's frame
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
            pose=_stereo_pose(fit) if others else None,
            world_pose=None if known is None else _world_pose(fit, known, seen[0]),
        ),
        pictures=pictures,
        pairs=fit.pairs,
        notes=notes,
    )


def _picture(one: Seen, fit: Fit, owner: Owner) -> Picture:
    if owner in fit.left_out or one.corners is None:
        return Picture(name=one.name, pixels=None, residuals=None, left_out=fit.left_out[owner])
    return Picture(
        name=one.name,
        pixels=one.corners.pixels,
        residuals=fit.adjustment.residuals[fit.owners.index(owner)],
        board=_board_pose(fit, owner),
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


def _stereo_pose(fit: Fit) -> MeasuredPose:
    return _measured(fit, [fit.adjustment.places.stereo], _inverse)


def _world_pose(fit: Fit, known: KnownPlace, seen: Sequence[Seen]) -> MeasuredPose:
    owner = (0, known.picture)
    if owner in fit.left_out:
        raise UserError(
            f"{seen[known.picture].name} can't tell where the camera stands: {fit.left_out[owner]}"
        )
    board = fit.adjustment.places.board(fit.moment(owner))
    return _measured(fit, [board], lambda pose: known.X_WB @ _inverse(pose))


def _board_pose(fit: Fit, owner: Owner) -> MeasuredPose:
    """Return the board's pose in the frame of the camera that saw it."""
    places = fit.adjustment.places
    board = places.board(fit.moment(owner))
    if owner[0] == 0:
        return _measured(fit, [board], transform)
    return _measured(
        fit, [places.stereo, board], lambda both: transform(both[:6]) @ transform(both[6:])
    )


def _inverse(pose: Array) -> Array:
    return np.linalg.inv(transform(pose)).astype(float)


def _measured(fit: Fit, where: Sequence[slice], of: Callable[[Array], Array]) -> MeasuredPose:
    """Return a pose and how well it is known.

    Args:
        fit: Of the cameras.
        where: The parameters on which it depends, n of them.
        of: Makes it, shape (4, 4), of the parameters, shape (n,).
    """
    indices = np.concatenate([np.r_[one] for one in where])
    parameters = fit.adjustment.parameters[indices]
    found = of(parameters)
    columns = [
        (_moved(found, of(parameters + turn)) - _moved(found, of(parameters - turn))) / 2 / _TURN
        for turn in _TURN * np.eye(len(parameters))
    ]
    rotation = Rotation.from_matrix(found[:3, :3]).as_rotvec()
    return MeasuredPose(
        value=_frame_pose(np.concatenate([rotation, found[:3, 3]])),
        sd=_frame_pose(fit.adjustment.deviations(indices, np.column_stack(columns))),
    )


def _moved(found: Array, other: Array) -> Array:
    """Return the small rotation, rad, and the shift, m, from one pose to another, shape (6,)."""
    turned = Rotation.from_matrix(other[:3, :3] @ found[:3, :3].T).as_rotvec()
    return np.concatenate([turned, other[:3, 3] - found[:3, 3]])


def _frame_pose(vector: Array) -> FramePose:
    (a, b, c), (x, y, z) = np.split(vector, 2)
    return FramePose(
        rotation_vector=(float(a), float(b), float(c)),
        translation=(float(x), float(y), float(z)),
    )
