"""The command ``chamfer calibrate``: pictures of a board in, a camera file and a report out."""

import argparse
from pathlib import Path
from typing import Any

from chamfer.analysis.scenario.experiment import Catalogue


def add_calibrate(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command; the options of the folder and JSON are left to be added."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "calibrate",
        help="calibrate one camera, a stereo pair or a camera in a hand from pictures of a board",
        description="Finds a board in pictures and calibrates the camera, or the two cameras, "
        "that "
        "took them. Writes OUT/calibrate/camera.yaml with focal length and principal "
        "point in pixels, from (0, 0) in the middle of the first pixel. It also has "
        "OpenCV's distortion k1, k2, p1, p2, k3, and standard deviations under sd. For "
        "two cameras it has the pose of the right one in the left one's frame, in rad and"
        " m. Figures of the residuals of every corner are residuals.svg and "
        "residuals.png. The command leaves out a picture, with the reason, if it shows no "
        "board, has another size or an error above three times the median, or is a duplicate.",
        epilog="A camera's frame has z along the optical axis, x to the right and y down. The "
        "board's frame has z into the board, x along its rows and y down. Its origin is "
        "the first inner corner of a chessboard, or the outer corner of a ChArUco board's"
        " first square. The chessboard's square outside the origin is black. The square "
        "at the far end is white if one of the two numbers is odd and the other even; two"
        " cameras or a known place need such a board. With --board-pose, camera.yaml also"
        " has the left camera's world_pose. --json also has the board's pose in the "
        "camera's frame for each picture.",
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
        help="pictures of a second camera, as many and in the same order; the two pictures of "
        "a pair were taken at the same time. If only one camera sees the board, the "
        "picture counts for that camera",
    )
    parser.add_argument(
        "--board",
        required=True,
        metavar="BOARD",
        help="chessboard:9x6:25mm (inner corners per row and per column, side of a square), or"
        " charuco:8x6:30mm:22mm:DICT_5X5_100. The latter has squares per row and per "
        "column, side of a square, side of a marker and OpenCV's dictionary; lengths are "
        "in mm, cm or m",
    )
    parser.add_argument(
        "--board-picture",
        type=Path,
        metavar="FILE",
        help="a picture of the left camera that shows the board at a known pose",
    )
    parser.add_argument(
        "--board-pose",
        metavar="x,y,z,roll,pitch,yaw",
        help="pose of the board's frame in the world, m and rad; yaw about Z after pitch about"
        " Y after roll about X. Write --board-pose=-1,... if it begins with a minus",
    )
    parser.add_argument(
        "--poses",
        type=Path,
        metavar="CSV",
        help="poses of the arm that held the (left) camera in front of a fixed board, as a CSV"
        " file with the header file,x,y,z,qw,qx,qy,qz. Each row has a picture's file name"
        " and the tool's pose in the arm's base, m and unit quaternion. The output then "
        "has hand_eye, the camera's pose in the tool, and hand-eye.png shows the "
        "residuals",
    )
    parser.set_defaults(command=_calibrate)
    return parser


def _calibrate(arguments: argparse.Namespace, _: Catalogue) -> int:
    from chamfer.analysis.calibration.calibration import run

    return run(arguments)
