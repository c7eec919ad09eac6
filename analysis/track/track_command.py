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
        description="Finds the peg and the hole part in recorded frames or in those of a live "
        "camera. Writes what it finds to OUT/track: detections.csv, the same as "
        "detections.parquet, and overlay.webm, which browsers play. Tips (tip_u, tip_v), points "
        "on the axes and the errors along and across the hole's axis are in pixels, u to the "
        "right and v down, (0, 0) in the middle of the first pixel; angles are in rad, times in "
        "s. What is not found is empty, with the reason beside it. The parts have to lie along "
        "the image's rows, within about 0.6 rad, on a bright background. Ctrl-C ends it; what "
        "was found until then is kept.",
        epilog="What to look for is a scenario: --set peg.hue=10 (0 to 255 once around the "
        "colours: 0 red, 85 green, 171 blue), hole.hue_width, hole.saturation and hole.value (at "
        "least), peg.front=-1 (its tip is the left end), peg.end_ratio (of the end's radius to "
        "the sides'), peg.area and peg.length (in pixels, at least), peg.half_width and "
        "peg.aspect (least and most).",
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
        help="a live camera instead, by its number or path: 0 for /dev/video0; its frames have "
        "times of their own",
    )
    parser.add_argument(
        "--save-frames",
        action="store_true",
        help="keep the camera's frames in OUT/track/frames as PNG, which track takes as FILES",
    )
    parser.add_argument(
        "--camera-model",
        type=Path,
        metavar="FILE",
        help="camera.yaml of chamfer calibrate: images are straightened, pixels are those of the "
        "camera without distortion, made square by the larger focal length",
    )
    parser.add_argument(
        "--right",
        nargs="+",
        type=Path,
        default=[],
        metavar="FILES",
        help="the right camera's recording, frame by frame with FILES, for a camera model of two: "
        "adds right_... and, in the left camera's frame, in m and rad, tips (peg_x, peg_y, "
        "peg_z), axes and the alignment error (metric_...)",
    )
    parser.add_argument(
        "--learn",
        type=Path,
        metavar="PICTURE",
        help="instead, learn what the parts look like and write it to OUT/track/parts.yaml, which "
        "--scenario takes; the parts are parallel to the image, their tips apart",
    )
    for part in ("peg", "hole"):
        parser.add_argument(
            f"--{part}-box",
            metavar="X,Y,W,H",
            help=f"box around the {part} in PICTURE: upper left corner and size, pixels",
        )
    parser.add_argument("--frames", metavar="N", help="end after N frames")
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
