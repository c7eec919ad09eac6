"""The command ``chamfer track``: frames in, detections and an overlay video out."""

import argparse
from pathlib import Path
from typing import Any

from chamfer.analysis.scenario.experiment import Catalogue


def add_track(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command; the options of the scenario, the folder and JSON are left to be added."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "track",
        help="find the parts in a real camera's pictures",
        description="Finds the peg and the hole part in recorded frames or in the frames of a "
        "live "
        "camera. Writes OUT/track: detections.csv, the same table as detections.parquet, "
        "and overlay.webm, which browsers play. Tips (tip_u, tip_v), points on the axes "
        "and the errors along and across the hole's axis are in pixels. Pixels count from"
        " (0, 0) in the middle of the first one, u to the right and v down. Angles are in"
        " rad, times in s. A value that is not found is empty, and a column says why. The"
        " parts have to lie along the image's rows, within about 0.6 rad, on a bright "
        "background. Ctrl-C ends the command and keeps the detections so far.",
        epilog="A scenario describes the parts. Colours are 0 to 255 around the colour circle, "
        "such as --set peg.hue=10: 0 is red, 85 green, 171 blue. Minima are "
        "hole.hue_width, hole.saturation, hole.value and, in pixels, peg.area and "
        "peg.length. With --set peg.front=-1 the tip is the left end. The radius of the "
        "end over that of the sides is peg.end_ratio. The fields peg.half_width and "
        "peg.aspect have a minimum and a maximum.",
        allow_abbrev=False,
    )
    parser.add_argument(
        "files",
        nargs="*",
        type=Path,
        metavar="FILES",
        help="an image folder, image files (both in natural order, frame2 before frame10) or "
        "one video file",
    )
    parser.add_argument(
        "--device",
        metavar="N",
        help="a live camera instead, by number or path: 0 for /dev/video0; its frames have "
        "their own times",
    )
    parser.add_argument(
        "--save-frames",
        action="store_true",
        help="keep the camera's frames as PNG in OUT/track/frames, which track accepts as FILES",
    )
    parser.add_argument(
        "--camera-model",
        type=Path,
        metavar="FILE",
        help="camera.yaml of chamfer calibrate: images are undistorted; pixels are those of a "
        "camera without distortion, square by the larger focal length",
    )
    parser.add_argument(
        "--right",
        nargs="+",
        type=Path,
        default=[],
        metavar="FILES",
        help="the right camera's recording, frame by frame with FILES, for a stereo camera "
        "model. Adds right_... and, in the left camera's frame, in m and rad: tips "
        "(peg_x, peg_y, peg_z), axes and the alignment error (metric_...)",
    )
    parser.add_argument(
        "--learn",
        type=Path,
        metavar="PICTURE",
        help="learn the appearance of the parts instead and write OUT/track/parts.yaml, which "
        "--scenario accepts; the parts are parallel to the image, with their tips apart",
    )
    for part in ("peg", "hole"):
        parser.add_argument(
            f"--{part}-box",
            metavar="X,Y,W,H",
            help=f"box around the {part} in PICTURE: upper left corner and size, pixels",
        )
    parser.add_argument("--frames", metavar="N", help="stop after N frames")
    parser.add_argument(
        "--rate",
        metavar="HZ",
        help="frames per second, as --set rate=HZ (default: the video's own; 80 for images)",
    )
    parser.add_argument("--no-video", action="store_true", help="write no overlay video")
    parser.set_defaults(command=_track)
    return parser


def _track(arguments: argparse.Namespace, _: Catalogue) -> int:
    from chamfer.analysis.track.tracking import track

    return track(arguments)
