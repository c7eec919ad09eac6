"""The command ``chamfer calibrate``: pictures of a board in, a camera file and a report out."""

import argparse
from pathlib import Path
from typing import Any

from chamfer.analysis.scenario.experiment import Catalogue


def add_calibrate(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command; the options of the folder and JSON are left to be added."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "calibrate",
        help="calibrate one camera, or two, or one in a hand, from pictures of a board",
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
    parser.add_argument(
        "--poses",
        type=Path,
        metavar="CSV",
        help="poses of the arm that held the (left) camera before a board at rest: a CSV file "
        "with the header file,x,y,z,qw,qx,qy,qz and a row a picture, its file's name, the tool's "
        "place in the arm's base, m, and unit quaternion. camera.yaml then has hand_eye, the "
        "camera's place in the tool, and hand-eye.png shows what remains",
    )
    parser.set_defaults(command=_calibrate)
    return parser


def _calibrate(arguments: argparse.Namespace, _: Catalogue) -> int:
    from chamfer.analysis.calibration.calibration import run

    return run(arguments)
