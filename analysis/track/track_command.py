"""The command ``chamfer track``: frames in, detections and an overlay video out."""

import argparse
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from chamfer.analysis.scenario.experiment import Catalogue

if TYPE_CHECKING:
    from collections.abc import Sequence

    from chamfer.analysis.track.part_finder import PartTracker
    from chamfer.analysis.track.track_table import Track
    from chamfer.analysis.track.tracking import SynchronisedFrames, TrackScenario
    from chamfer.models.cameras.camera import Camera

_INTERRUPTED: Final = 130  # exit statuses
_ERROR: Final = 1
_NOT_LEARNED: Final = (
    *("files", "device", "save_frames", "camera_model", "right", "frames", "rate", "no_video"),
    *("scenario", "settings"),
)


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
    parser.add_argument("--frames", metavar="N", type=_count, help="end after N frames")
    parser.add_argument(
        "--rate",
        metavar="HZ",
        help="frames per second, as --set rate=HZ (default: the video's own; 80 for images)",
    )
    parser.add_argument("--no-video", action="store_true", help="write no overlay video")
    parser.set_defaults(command=_track)
    return parser


def _count(text: str) -> int:
    import re

    from chamfer.analysis.scenario.errors import UserError

    if not re.fullmatch("[0-9]{1,9}", text) or int(text) < 1:
        raise UserError(f"--frames is {text!r}, allowed: a whole number from 1 to 999999999")
    return int(text)


def _track(arguments: argparse.Namespace, _: Catalogue) -> int:
    from chamfer.analysis.report.console import say
    from chamfer.analysis.track.frame_source import CameraError

    try:
        return _run(arguments)
    except CameraError as error:
        say(str(error))
        return _ERROR
    except KeyboardInterrupt:
        say("interrupted, nothing was written")
        return _INTERRUPTED


def _run(arguments: argparse.Namespace) -> int:
    boxes = arguments.peg_box, arguments.hole_box
    if arguments.learn is not None:
        return _learn(arguments)
    if any(box is not None for box in boxes):
        from chamfer.analysis.scenario.errors import UserError

        raise UserError("boxes are given without --learn")
    return _find(arguments)


def _learn(arguments: argparse.Namespace) -> int:
    from chamfer.analysis.report.results import json_text
    from chamfer.analysis.scenario.errors import UserError
    from chamfer.analysis.track.learning import learn_parts

    for option in ("peg_box", "hole_box"):
        if getattr(arguments, option) is None:
            raise UserError(f"--learn is given without --{option.replace('_', '-')}")
    for option in _NOT_LEARNED:
        if getattr(arguments, option):
            name = "FILES" if option == "files" else f"--{option.replace('_', '-')}"
            name = "--set" if option == "settings" else name
            raise UserError(f"{name} and --learn are given, allowed: one of them")
    said = learn_parts(arguments.learn, arguments.peg_box, arguments.hole_box, out=arguments.out)
    if arguments.json:
        print(json_text(said), end="")
    else:
        print(*said["files"], sep="\n")
    return 0


def _find(arguments: argparse.Namespace) -> int:
    from chamfer.analysis.campaign.progress import TerminalProgress
    from chamfer.analysis.command.output_folder import require_writable
    from chamfer.analysis.report.console import say
    from chamfer.analysis.scenario.errors import UserError
    from chamfer.analysis.track.track_files import FOLDER, FRAMES, FrameFolder
    from chamfer.analysis.track.tracking import stop_request, write_track

    scenario = _scenario(arguments)
    cameras = _cameras(arguments)
    folder = arguments.out / FOLDER
    try:
        with ExitStack() as stack:
            source = _source(arguments, scenario, cameras, stack)
            tracker = _tracker(scenario, cameras, source)
            require_writable(arguments.out, [FOLDER])
            saved = None
            if arguments.save_frames:
                saved = stack.enter_context(FrameFolder(folder / FRAMES))
            stopped = stack.enter_context(stop_request())
            if not source.ends:
                say(f"frames of {arguments.device} as they come, Ctrl-C ends it")
            with TerminalProgress("track") as progress:

                def warn() -> None:
                    with progress.aside():
                        say(f"what is in {folder} is replaced")

                found, paths = write_track(
                    arguments.out,
                    source,
                    tracker,
                    video=not arguments.no_video,
                    saved=saved,
                    replaces=warn,
                    stopped=stopped,
                    progress=progress,
                )
    except OSError as error:
        reason = error.strerror or str(error)
        raise UserError(f"{arguments.out} can't be written: {reason}") from error
    if saved is not None:
        paths.append(folder / FRAMES)
    return _end(arguments, source, scenario, found, paths)


def _scenario(arguments: argparse.Namespace) -> "TrackScenario":
    from chamfer.analysis.command.scenario_file import read_scenario
    from chamfer.analysis.scenario.errors import UserError
    from chamfer.analysis.scenario.scenario_io import make_scenario
    from chamfer.analysis.track.tracking import TrackScenario

    settings = [*arguments.settings]
    if arguments.rate is not None:
        settings.append(f"rate={arguments.rate}")
    file = arguments.scenario
    given = None if file is None else read_scenario(file, "track")
    scenario = make_scenario(TrackScenario(), given=given, settings=settings)
    if arguments.device is None:
        if not arguments.files:
            raise UserError("nothing to look at, allowed: FILES or --device")
        if arguments.save_frames:
            raise UserError("--save-frames is given without --device")
    elif arguments.files:
        raise UserError("FILES and --device are given, allowed: one of them")
    elif scenario.rate is not None:
        allowed = "null with --device, whose frames have times"
        raise UserError(f"rate is {scenario.rate:g}, allowed: {allowed}")
    return scenario


def _cameras(arguments: argparse.Namespace) -> "tuple[Camera, ...]":
    """Return the cameras as they are calibrated; none if that is not known."""
    from chamfer.analysis.scenario.errors import UserError
    from chamfer.analysis.track.part_finder import read_cameras

    if arguments.right and arguments.device is not None:
        raise UserError("--right and --device are given, allowed: --right with FILES")
    if arguments.camera_model is None:
        if arguments.right:
            raise UserError("--right is given without --camera-model")
        return ()
    return read_cameras(arguments.camera_model, 2 if arguments.right else 1)


def _tracker(
    scenario: "TrackScenario", cameras: "Sequence[Camera]", source: "SynchronisedFrames"
) -> "PartTracker":
    from chamfer.analysis.track.part_finder import MetricFinder, PartFinder

    known = source.timed or scenario.rate is not None
    continuity = scenario.continuity if known else None
    finders = [
        PartFinder(scenario.peg, scenario.hole, camera, continuity)
        for camera in cameras or (None,)
    ]
    return finders[0] if len(finders) == 1 else MetricFinder(cameras, finders)


def _source(
    arguments: argparse.Namespace,
    scenario: "TrackScenario",
    cameras: "Sequence[Camera]",
    stack: ExitStack,
) -> "SynchronisedFrames":
    import math

    from chamfer.analysis.track.frame_source import (
        LiveCamera,
        device_path,
        open_recording,
        require_paired,
    )
    from chamfer.analysis.track.tracking import SynchronisedFrames

    if arguments.device is None:
        recordings = [open_recording(arguments.files)]
        if arguments.right:
            recordings.append(open_recording(arguments.right))
            require_paired(*recordings, rated=scenario.rate is not None)
        return SynchronisedFrames(recordings, scenario.rate_of(recordings[0]), arguments.frames)
    size = (cameras[0].width, cameras[0].height) if cameras else None
    camera = stack.enter_context(LiveCamera(device_path(arguments.device), size))
    return SynchronisedFrames([camera], camera.rate or math.nan, arguments.frames)


def _end(
    arguments: argparse.Namespace,
    source: "SynchronisedFrames",
    scenario: "TrackScenario",
    found: "Track",
    paths: list[Path],
) -> int:
    """Say what was found and how it ended, and return the exit status."""
    from chamfer.analysis.report.console import say
    from chamfer.analysis.report.results import json_text
    from chamfer.analysis.scenario.errors import UserError
    from chamfer.analysis.track.frame_source import CameraError
    from chamfer.analysis.track.tracking import document, text

    kept = f"what was found in {found.frames} frame{'s' * (found.frames != 1)} is kept"
    if found.frames == 0:
        say("interrupted before the first frame, nothing was written")
        return _INTERRUPTED
    said = document(source, scenario, found, paths)
    print(json_text(said) if arguments.json else text(said), end="")
    if isinstance(found.fault, CameraError):
        say(f"{found.fault}, {kept}")
        return _ERROR
    if isinstance(found.fault, OSError):
        reason = found.fault.strerror or found.fault
        raise UserError(f"{arguments.out} can't be written: {reason}, {kept}")
    if found.fault is not None:
        raise UserError(f"{found.fault}, {kept}")
    if found.interrupted:
        say(f"interrupted, {kept}")
        return _INTERRUPTED
    return 0
