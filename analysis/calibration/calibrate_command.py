"""The command ``chamfer calibrate``: pictures of a board in, a camera file and a report out."""

import argparse
import math
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from chamfer.analysis.scenario.experiment import Catalogue

if TYPE_CHECKING:
    from chamfer.analysis.calibration.board import Board
    from chamfer.analysis.calibration.calibration import Calibration
    from chamfer.analysis.scenario.experiment import Progress

CAMERA: Final = "camera.yaml"
_FOLDER: Final = "calibrate"
_INTERRUPTED: Final = 130  # exit status
_FARTHEST: Final = 1e4  # m and rad


def add_calibrate(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command; the options of the folder and JSON are left to be added."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "calibrate",
        help="calibrate one camera or two from pictures of a board",
        description="Finds a board in pictures and calibrates the camera that took them, or two. "
        "Writes OUT/calibrate/camera.yaml (focal length and principal point in pixels, (0, 0) in "
        "the middle of the first pixel, distortion k1, k2, p1, p2, k3 as OpenCV has it, standard "
        "deviations under sd; of two cameras the pose of the right one in the left one's frame, "
        "in rad and m) and what remains in every corner as residuals.svg and residuals.png. "
        "Pictures without the board, of another size, given twice or with an error of more than "
        "three times the median are left out, and it is said why.",
        epilog="A camera's frame has z along the optical axis, x to the right and y down. The "
        "board's frame has z into the board, x along its rows and y down, and its origin in the "
        "first inner corner of a chessboard (outside of which the square is black; the one at "
        "the far end is white if one of the two numbers is odd and the other even, as two "
        "cameras or a known place need it) or in the outer corner of a ChArUco board's first "
        "square. With --board-pose camera.yaml has the left camera's world_pose too; --json has "
        "the board's pose in the camera's frame for each picture too.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "files",
        nargs="+",
        type=Path,
        metavar="FILES",
        help="an image folder or image files, in natural order, frame2 before frame10",
    )
    parser.add_argument(
        "--right",
        nargs="+",
        type=Path,
        metavar="FILES",
        help="pictures of a second camera, as many and in the same order: those of a pair were "
        "taken at the same time. Where only one camera sees the board, it is used for that camera",
    )
    parser.add_argument(
        "--board",
        required=True,
        metavar="BOARD",
        help="chessboard:9x6:25mm (inner corners in a row and in a column, side of a square) or "
        "charuco:8x6:30mm:22mm:DICT_5X5_100 (squares in a row and in a column, side of a square, "
        "side of a marker, OpenCV's dictionary); lengths in mm, cm or m",
    )
    parser.add_argument(
        "--board-picture",
        type=Path,
        metavar="FILE",
        help="a picture of the left camera in which the board is at a known place",
    )
    parser.add_argument(
        "--board-pose",
        metavar="x,y,z,roll,pitch,yaw",
        help="the place of the board's frame in the world, m and rad, yaw about Z after pitch "
        "about Y after roll about X; --board-pose=-1,... if it begins with a minus",
    )
    parser.set_defaults(command=_calibrate)
    return parser


def _calibrate(arguments: argparse.Namespace, _: Catalogue) -> int:
    from chamfer.analysis.calibration.board import parse_board
    from chamfer.analysis.calibration.calibration import picture_files
    from chamfer.analysis.campaign.progress import TerminalProgress
    from chamfer.analysis.command.output_folder import require_writable
    from chamfer.analysis.report.console import say
    from chamfer.analysis.report.results import json_text
    from chamfer.analysis.scenario.errors import UserError
    from chamfer.models.validation import ParameterError

    try:
        board = parse_board(arguments.board)
    except ParameterError as error:
        raise UserError(f"--{error}") from error
    known = _known_place(arguments)
    if not board.directed and (arguments.right or known):
        raise UserError(
            f"--board is {arguments.board!r}, allowed with two cameras or a known place: one of "
            "the two numbers odd and the other even, so that its ends can be told apart"
        )
    files = [picture_files(paths) for paths in (arguments.files, arguments.right) if paths]
    if len(files) == 2 and len(files[0]) != len(files[1]):
        raise UserError(
            f"--right is {len(files[1])} pictures, allowed: {len(files[0])}, as of the left camera"
        )
    require_writable(arguments.out, [_FOLDER])
    folder = arguments.out / _FOLDER
    try:
        with TerminalProgress(_FOLDER) as progress:
            found = _found(board, files, known, progress)
        if (folder / CAMERA).exists():
            say(f"what is in {folder} is replaced")
        paths = _write(folder, found)
    except KeyboardInterrupt:
        say("interrupted, nothing was written")
        return _INTERRUPTED
    except OSError as error:
        reason = error.strerror or str(error)
        raise UserError(f"{arguments.out} can't be written: {reason}") from error
    document = _document(found, paths)
    print(json_text(document) if arguments.json else _text(document), end="")
    return 0


def _known_place(arguments: argparse.Namespace) -> "tuple[Path, Any] | None":
    """Return the picture of the known place, and X_WB, shape (4, 4)."""
    import numpy as np
    from scipy.spatial.transform import Rotation

    from chamfer.analysis.calibration.calibration import picture_files
    from chamfer.analysis.scenario.errors import UserError

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
    X_WB = np.eye(4)
    X_WB[:3, :3] = Rotation.from_euler("xyz", numbers[3:]).as_matrix()
    X_WB[:3, 3] = numbers[:3]
    (picture,) = picture_files([arguments.board_picture])[:1]
    return picture, X_WB


def _found(
    board: "Board",
    files: Sequence[Sequence[Path]],
    known: "tuple[Path, Any] | None",
    progress: "Progress",
) -> "Calibration":
    from chamfer.analysis.calibration.calibration import KnownPlace, calibrate, see_board

    left = list(files[0])
    place = None
    if known is not None:
        same = [k for k, file in enumerate(left) if file.resolve() == known[0].resolve()]
        left += [] if same else [known[0]]
        place = KnownPlace(picture=same[0] if same else len(left) - 1, X_WB=known[1])
    pictures = []
    contents: dict[bytes, str] = {}
    each = [left, *files[1:]]
    for k, of in enumerate(each):

        def told(fraction: float, doing: str = "", k: int = k) -> None:
            progress((k + fraction) / len(each), doing)

        pictures.append(see_board(board, of, others=contents, progress=told))
        named = pictures[-1].contents.items()
        contents |= {key: f"the left camera's {name}" for key, name in named}
    return calibrate([one.seen for one in pictures], [one.size for one in pictures], known=place)


def _write(folder: Path, found: "Calibration") -> list[Path]:
    from chamfer.analysis.calibration.calibration_figures import plot_residuals
    from chamfer.analysis.report.results import save_figures, write_whole
    from chamfer.models.cameras.camera_file import camera_text

    figures = {"residuals": plot_residuals(found)}

    def fill(staging: Path) -> None:
        save_figures(staging, figures)
        (staging / CAMERA).write_text(camera_text(found.cameras), encoding="utf-8")

    write_whole(folder, fill, last=CAMERA)
    return [folder / name for name in (CAMERA, "residuals.png", "residuals.svg")]


def _document(found: "Calibration", paths: Sequence[Path]) -> dict[str, Any]:
    import yaml

    from chamfer.analysis.calibration.calibration import EYES
    from chamfer.models.cameras.camera_file import camera_text, plain_pose

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
    from chamfer.analysis.report.console import table

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
