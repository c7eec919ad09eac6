"""Calibrates one camera or two from pictures of a board, for ``chamfer calibrate``."""

import argparse
import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from hashlib import sha256
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
import yaml
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.analysis.calibration.board import Board, NotFoundError, parse_board
from chamfer.analysis.calibration.camera_fit import (
    Fit,
    Owner,
    Picture,
    doubts,
    fit_camera,
    fit_pair,
    frame_pose,
    moved,
    pose_vector,
    rms,
    transform,
)
from chamfer.analysis.calibration.hand_eye import HandEye, fit_hand_eye, plot_hand_eye, read_poses
from chamfer.analysis.campaign.progress import TerminalProgress
from chamfer.analysis.command.output_folder import require_writable
from chamfer.analysis.drawing.figure_kit import colour_bar
from chamfer.analysis.drawing.figure_style import dress, new_figure
from chamfer.analysis.report.console import say, table
from chamfer.analysis.report.results import figure_files, json_text, write_folder
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Progress
from chamfer.analysis.track.frame_source import Recording, open_recording, shown_name
from chamfer.models.cameras.camera_file import (
    CalibratedCamera,
    CameraFile,
    FramePose,
    Intrinsics,
    camera_text,
    plain_pose,
)
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]
Size = tuple[int, int]  # pixels, width and height

CAMERA: Final = "camera.yaml"
EYES: Final = ("left", "right")

_FOLDER: Final = "calibrate"
_INTERRUPTED: Final = 130  # exit status
_FARTHEST: Final = 1e4  # m and rad
_TURN: Final = 1e-6  # rad and m, of numerical derivatives


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
    board: Board, files: Sequence[Path], *, names: dict[bytes, str], progress: Progress
) -> tuple[list[Picture], Size]:
    """Detect a board in pictures, and return the detections and the most frequent size.

    The names are of pictures that are not to be used once more, by what is in them.
    """
    found: list[tuple[Picture, Size | None]] = []
    for k, file in enumerate(files):
        name, size = shown_name(file), None
        try:
            (frame,) = Recording(files=(file,), video=False).frames()
            image = cv2.cvtColor(frame.image, cv2.COLOR_RGB2GRAY).astype(np.uint8, copy=False)
            size = image.shape[1], image.shape[0]
            key = sha256(repr(image.shape).encode() + image.tobytes()).digest()
            if key in names:
                raise NotFoundError(f"the same picture as {names[key]}")
            names[key] = name
            seen = Picture(name=name, corners=board.find(image))
        except UserError as error:
            reason = str(error).removeprefix(f"{file}").removeprefix(name).lstrip(": ")
            seen = Picture(name=name, left_out=reason)
        except NotFoundError as error:
            seen = Picture(name=name, left_out=str(error))
        found.append((seen, size))
        progress((k + 1) / len(files), f"picture {k + 1}")
    sizes = Counter(size for _, size in found if size is not None)
    most = sizes.most_common(1)[0][0] if sizes else (0, 0)
    odd = "it is {} x {} pixels, most are {} x {}"
    return [
        seen
        if size is None or size == most
        else replace(seen, corners=None, left_out=odd.format(*size, *most))
        for seen, size in found
    ], most


@dataclass(frozen=True, kw_only=True, eq=False)
class Calibration:
    """Calibrated cameras, and the use of each of their pictures."""

    cameras: CameraFile
    pictures: tuple[tuple[Picture, ...], ...]  # of each camera
    pairs: int  # pictures in which both cameras saw the board
    notes: tuple[str, ...]
    hand_eye: HandEye | None = None  # of a camera in an arm's hand


def calibrate(
    seen: Sequence[Sequence[Picture]],
    sizes: Sequence[Size],
    *,
    known: tuple[int, Array] | None = None,
    poses: Mapping[str, Array] | None = None,
) -> Calibration:
    """Calibrate one camera, or two; pictures of the same number were taken at the same time.

    ``known`` is the number of one of the left camera's pictures, and X_WB of the board in it,
    shape (4, 4). ``poses`` are X_WT of the arm that holds the (left) camera, by the names of its
    pictures of one board at rest.

    Raises:
        UserError: If the pictures don't tell what the cameras are, or where in the hand.
    """
    whose = tuple(f"{eye} camera: " for eye in EYES) if len(seen) > 1 else ("",)
    fits = [fit_camera(seen[k], sizes[k], whose=of) for k, of in enumerate(whose)]
    fit = fits[0] if len(fits) == 1 else fit_pair(fits)
    notes = doubts(fit, sizes, whose)
    hand = None if poses is None else fit_hand_eye(fit, [one.name for one in seen[0]], poses)
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
            pose=_right_pose(fit) if others else None,
            world_pose=None if known is None else _world_pose(fit, known, seen[0]),
            hand_eye=None if hand is None else hand.pose,
        ),
        pictures=pictures,
        pairs=fit.pairs,
        notes=notes if hand is None else (*notes, *hand.notes),
        hand_eye=hand,
    )


def _picture(one: Picture, fit: Fit, owner: Owner) -> Picture:
    if owner in fit.left_out:
        return replace(one, left_out=fit.left_out[owner])
    alone, board = fit.alone.get(owner, ""), _board_pose(fit, owner)
    return replace(one, alone=alone, residuals=fit.residuals[owner], board=board)


def _camera(fit: Fit, camera: int, size: Size, pictures: Sequence[Picture]) -> CalibratedCamera:
    values, deviations = map(_named, fit.adjustment.intrinsic(camera))
    return CalibratedCamera(
        width=size[0],
        height=size[1],
        **values,
        reprojection_error=rms(_residuals(pictures)),
        sd=Intrinsics(**deviations),
    )


def _residuals(pictures: Sequence[Picture]) -> Array:
    """Return what remains in all pictures together, pixels, shape (n, 2)."""
    return np.concatenate([one.residuals for one in pictures if one.residuals is not None])


def _named(intrinsic: Array) -> dict[str, Any]:
    fx, fy, cx, cy, *distortion = intrinsic.tolist()
    return {
        "focal_length": (fx, fy),
        "principal_point": (cx, cy),
        "distortion": tuple(distortion),
    }


def _right_pose(fit: Fit) -> FramePose:
    stereo = fit.adjustment.places.stereo
    return _measured(fit, [stereo], lambda pose: np.asarray(np.linalg.inv(transform(pose))))


def _world_pose(fit: Fit, known: tuple[int, Array], seen: Sequence[Picture]) -> FramePose:
    number, X_WB = known
    if (0, number) in fit.left_out:
        raise UserError(
            f"{seen[number].name} can't tell where the camera stands: {fit.left_out[0, number]}"
        )
    return _measured(
        fit, [fit.board((0, number))], lambda pose: X_WB @ np.linalg.inv(transform(pose))
    )


def _board_pose(fit: Fit, owner: Owner) -> FramePose:
    """Return the board's pose in the frame of the camera that saw it."""
    if owner[0] == 0:
        return _measured(fit, [fit.board(owner)], transform)
    where = [fit.adjustment.places.stereo, fit.board(owner)]
    return _measured(fit, where, lambda both: transform(both[:6]) @ transform(both[6:]))


def _measured(fit: Fit, where: Sequence[slice], of: Callable[[Array], Array]) -> FramePose:
    """Return a pose, a function, shape (4, 4), of some parameters, and how well it is known."""
    indices = np.concatenate([np.r_[one] for one in where])
    parameters = fit.adjustment.parameters[indices]
    found = of(parameters)
    columns = [
        (moved(found, of(parameters + turn)) - moved(found, of(parameters - turn))) / 2 / _TURN
        for turn in _TURN * np.eye(len(parameters))
    ]
    sd = fit.adjustment.deviations(indices, np.column_stack(columns))
    return frame_pose(pose_vector(found), frame_pose(sd))


def run(arguments: argparse.Namespace) -> int:
    """Run the command, and return its exit status."""
    try:
        board = parse_board(arguments.board)
    except ParameterError as error:
        raise UserError(f"--{error}") from error
    known = _known_place(arguments)
    if not board.directed and (arguments.right or known or arguments.poses):
        raise UserError(
            f"--board is {arguments.board!r}, allowed with two cameras, a known place or poses: "
            "one of the two numbers odd and the other even, so that its ends differ"
        )
    files = [picture_files(paths) for paths in (arguments.files, arguments.right) if paths]
    if len(files) == 2 and len(files[0]) != len(files[1]):
        raise UserError(
            f"--right is {len(files[1])} pictures, allowed: {len(files[0])}, as of the left camera"
        )
    poses = read_poses(arguments.poses, files[0]) if arguments.poses else None
    require_writable(arguments.out, [_FOLDER])
    folder = arguments.out / _FOLDER
    try:
        with TerminalProgress(_FOLDER) as progress:
            found = _found(board, files, known, poses, progress)
        if (folder / CAMERA).exists():
            say(f"files in {folder} are replaced")
        hand = {} if found.hand_eye is None else {"hand-eye": plot_hand_eye(found.hand_eye)}
        figures = figure_files({"residuals": plot_residuals(found), **hand})
        write_folder(folder, {**figures, CAMERA: camera_text(found.cameras)})
    except KeyboardInterrupt:
        say("interrupted, nothing was written")
        return _INTERRUPTED
    except OSError as error:
        raise UserError(f"{arguments.out} can't be written: {error.strerror or error}") from error
    paths = [folder / name for name in (CAMERA, *sorted(figures))]
    document = _document(found, paths)
    print(json_text(document) if arguments.json else _text(document), end="")
    return 0


def _known_place(arguments: argparse.Namespace) -> tuple[Path, Array] | None:
    """Return the picture of the known place, and X_WB."""
    if (arguments.board_picture is None) != (arguments.board_pose is None):
        has, lacks = ("picture", "pose") if arguments.board_pose is None else ("pose", "picture")
        raise UserError(f"--board-{has} is given without --board-{lacks}, allowed: both")
    if arguments.board_pose is None:
        return None
    try:
        numbers = [float(text) for text in arguments.board_pose.split(",")]
    except ValueError:
        numbers = []
    if len(numbers) != 6 or not all(abs(one) <= _FARTHEST for one in numbers):
        raise UserError(
            f"--board-pose is {arguments.board_pose!r}, allowed: six numbers, "
            "x,y,z,roll,pitch,yaw, m and rad"
        )
    turn = Rotation.from_euler("xyz", numbers[3:]).as_rotvec()
    (picture,) = picture_files([arguments.board_picture])[:1]
    return picture, transform(np.append(turn, numbers[:3]))


def _found(
    board: Board,
    files: Sequence[Sequence[Path]],
    known: tuple[Path, Array] | None,
    poses: Mapping[str, Array] | None,
    progress: Progress,
) -> Calibration:
    left = list(files[0])
    place = None
    if known is not None:
        picture, X_WB = known
        same = [k for k, file in enumerate(left) if file.resolve() == picture.resolve()]
        left += [] if same else [picture]
        place = (same[0] if same else len(left) - 1), X_WB
    pictures = []
    names: dict[bytes, str] = {}
    each = [left, *files[1:]]
    for k, of in enumerate(each):

        def told(fraction: float, doing: str = "", k: int = k) -> None:
            progress((k + fraction) / len(each), doing)

        pictures.append(see_board(board, of, names=names, progress=told))
        names = {key: f"the left camera's {name}" for key, name in names.items()}
    seen, sizes = zip(*pictures, strict=True)
    return calibrate(seen, sizes, known=place, poses=poses)


def _document(found: Calibration, paths: Sequence[Path]) -> dict[str, Any]:
    return {
        "camera": yaml.safe_load(camera_text(found.cameras)),
        "pictures": {
            eye: [
                {
                    "name": one.name,
                    "error": one.error,
                    "left_out": one.left_out or None,
                    "alone": one.alone or None,
                    "board": None if one.board is None else plain_pose(one.board),
                }
                for one in of
            ]
            for eye, of in zip(EYES, found.pictures, strict=False)
        },
        "pairs": found.pairs,
        "notes": list(found.notes),
        "files": [str(path) for path in paths],
    }


def _text(document: dict[str, Any]) -> str:
    camera, pictures = document["camera"], document["pictures"]
    lines = []
    for eye, of in pictures.items():
        one = camera if eye == "left" else camera["right"]
        used = sum(picture["error"] is not None for picture in of)
        whose = f"{eye} camera: " if len(pictures) > 1 else ""
        lines.append(
            f"{whose}{used} of {len(of)} pictures, {one['width']} x {one['height']} pixels, "
            f"reprojection error {one['reprojection_error']:.3f} pixels"
        )
        rows = [("", "", "standard deviation", "")]
        rows += _rows(one, one["sd"], "focal_length", ("fx", "fy"), "pixels")
        rows += _rows(one, one["sd"], "principal_point", ("cx", "cy"), "pixels")
        rows += _rows(one, one["sd"], "distortion", ("k1", "k2", "p1", "p2", "k3"), "")
        lines += [f"  {line}" for line in table(rows, right=(1, 2))]
        lines += [f"  {line}" for line in table([_row(picture) for picture in of], right=(1,))]
    whose = "the left camera" if len(pictures) > 1 else "the camera"
    for name, said in (
        ("pose", f"the right camera in the left one's frame, from {document['pairs']} pairs"),
        ("world_pose", f"{whose} in the world"),
        ("hand_eye", f"{whose} in the arm's tool"),
    ):
        if name in camera:
            sd = camera["sd"][name]
            rows = [("", "", "standard deviation", "")]
            rows += _rows(camera[name], sd, "rotation_vector", ("rx", "ry", "rz"), "rad")
            rows += _rows(camera[name], sd, "translation", ("x", "y", "z"), "m")
            lines += [said, *(f"  {line}" for line in table(rows, right=(1, 2)))]
    return "\n".join([*lines, *document["notes"], *document["files"], ""])


def _rows(
    values: dict[str, Any],
    sd: dict[str, Any],
    key: str,
    names: Sequence[str],
    unit: str,
) -> list[tuple[str, str, str, str]]:
    """Return rows of a name, a value with as many digits as are known, its deviation, a unit."""
    rows = []
    for name, value, deviation in zip(names, values[key], sd[key], strict=True):
        digits = 1 - math.floor(math.log10(deviation)) if deviation > 0 else 6
        digits = min(max(digits, 0), 9)
        rows.append((name, f"{value:.{digits}f}", f"{deviation:.{digits}f}", unit))
    return rows


def _row(picture: dict[str, Any]) -> tuple[str, str, str]:
    if picture["left_out"]:
        return picture["name"], "", f"left out: {picture['left_out']}"
    alone = f"  for this camera alone: {picture['alone']}" if picture["alone"] else ""
    return picture["name"], f"{picture['error']:.3f}", f"pixels{alone}"


_USED, _OUT = "#1b4f9c", "#b00020"
_CELLS: Final = (16, 12)  # of the picture, in which corners are counted
_LONG: Final = 0.05  # of the picture's width, an arrow of a long residual
_NAMED: Final = 40  # pictures, at most, that are called by their names


def plot_residuals(found: Calibration) -> Figure:
    """Draw a row for each camera: residuals, coverage and the error of each picture."""
    cameras = [found.cameras.left, *([found.cameras.right] if found.cameras.right else [])]
    most = max(map(len, found.pictures))
    heights = [3.4, max(2.4, 0.18 * min(most, _NAMED) + 0.9)] * len(cameras)
    errors_of = ", ".join(f"{one.reprojection_error:.3f} px" for one in cameras)
    figure = new_figure(
        height=sum(heights),
        caption=f"RMS reprojection error: {errors_of}. Residuals and coverage of the picture, and "
        "the error of each picture.",
    )
    grid = figure.add_gridspec(len(heights), 2, height_ratios=heights)
    panels = [
        [
            figure.add_subplot(grid[row, place])
            for row, place in ((i, 0), (i, 1), (i + 1, slice(2)))
        ]
        for i in range(0, len(heights), 2)
    ]
    whose = [""] if len(cameras) == 1 else ["Left camera: ", "Right camera: "]
    rows = zip(panels, cameras, found.pictures, whose, strict=True)
    for (residuals, coverage, errors), camera, pictures, name in rows:
        used = [one.corners.pixels for one in pictures if one.corners and not one.left_out]
        _arrows(residuals, camera, np.concatenate(used), _residuals(pictures), name)
        _coverage(coverage, camera, np.concatenate(used))
        for axes in (residuals, coverage):
            axes.set_xlim(-0.5, camera.width - 0.5)
            axes.set_ylim(camera.height - 0.5, -0.5)
            axes.set_aspect("equal")
        _errors(errors, pictures)
    return figure


def _arrows(
    axes: Axes, camera: CalibratedCamera, pixels: Array, residuals: Array, whose: str
) -> None:
    long = float(np.quantile(np.linalg.norm(residuals, axis=1), 0.95)) or 1e-9
    shown = float(f"{long:.1g}")
    arrows = axes.quiver(
        *pixels.T,
        *residuals.T,
        angles="xy",
        scale_units="xy",
        scale=long / (_LONG * camera.width),
        width=0.0018,
        color=_USED,
    )
    axes.quiverkey(
        arrows, 0.93, 0.04, shown, f"{shown:g} px", labelpos="W", fontproperties={"size": 8}
    )
    axes.plot(*camera.principal_point, "+", color=_OUT, markersize=10)
    title = f"{whose}Residuals, rms {camera.reprojection_error:.3f} px"
    dress(axes, title=title, x="u / pixels", y="v / pixels")


def _coverage(axes: Axes, camera: CalibratedCamera, pixels: Array) -> None:
    u = np.linspace(-0.5, camera.width - 0.5, _CELLS[0] + 1)
    v = np.linspace(-0.5, camera.height - 0.5, _CELLS[1] + 1)
    counts, _, _ = np.histogram2d(pixels[:, 0], pixels[:, 1], bins=[u, v])
    shown = np.where(counts > 0, counts, np.nan)
    mesh = axes.pcolormesh(u, v, shown.T, cmap="Blues", vmin=0)
    colour_bar(axes, mesh, "corners / cell", shrink=0.8)
    covered = 100 * float(np.mean(counts > 0))
    dress(axes, title=f"Corners in {covered:.0f} % of the cells", x="u / pixels", y="v / pixels")


def _errors(axes: Axes, pictures: tuple[Picture, ...]) -> None:
    places = np.arange(len(pictures))
    axes.barh(places, [one.error or 0.0 for one in pictures], color=_USED, height=0.7)
    for place, one in enumerate(pictures):
        if one.left_out:
            axes.text(0, place, " left out", color=_OUT, fontsize=8, va="center")
    dress(axes, title="Error of each picture", x="rms / pixels", y="")
    if len(pictures) <= _NAMED:
        axes.set_yticks(places, [_short(one.name) for one in pictures], fontsize=8)
    else:
        axes.set_ylabel("picture / number", fontsize=9)
    axes.set_ylim(len(pictures) - 0.4, -0.6)


def _short(name: str) -> str:
    """Return a name as a label: no longer than a label may be, and nothing in it is a formula."""
    return (name if len(name) <= 24 else f"...{name[-21:]}").replace("$", r"\$")
