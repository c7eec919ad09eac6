"""The command ``chamfer track``: recorded frames in, detections and an overlay video out."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from analysis.run.registry import Sources

if TYPE_CHECKING:
    from analysis.track.recorded_frames import Recording
    from analysis.track.tracking import Track, TrackScenario

_INTERRUPTED: Final = 130  # exit status


def add_track(commands: "argparse._SubParsersAction[Any]") -> argparse.ArgumentParser:
    """Add the command; the options of the scenario, the folder and JSON are left to be added."""
    parser: argparse.ArgumentParser = commands.add_parser(
        "track",
        help="find the parts in a real camera's pictures",
        description="Finds the peg and the hole part in recorded frames. Writes what it finds to "
        "OUT/track: detections.csv, the same as detections.parquet, and overlay.mp4. Tips (tip_u, "
        "tip_v), points on the axes and the errors along and across the hole's axis are in "
        "pixels, u to the right and v down, (0, 0) in the middle of the first pixel; angles are "
        "in rad, times in s. The parts have to lie along the image's rows, within about 0.6 rad, "
        "on a bright background.",
        epilog="What to look for is a scenario: --set peg.hue=10 (0 to 255 once around the "
        "colours: 0 red, 85 green, 171 blue), hole.hue_width, hole.saturation and hole.value (at "
        "least), peg.front=-1 (its tip is the left end), peg.end_ratio (of the end's radius to "
        "the sides'), peg.area and peg.length (in pixels, at least).",
        allow_abbrev=False,
    )
    parser.add_argument(
        "files",
        nargs="+",
        type=Path,
        metavar="FILES",
        help="an image folder, image files (both in natural order, frame2 before frame10) or "
        "one video file",
    )
    parser.add_argument(
        "--rate",
        metavar="HZ",
        help="frames per second, as --set rate=HZ (default: the video's own; 80 for images)",
    )
    parser.add_argument("--no-video", action="store_true", help="write no overlay video")
    parser.set_defaults(command=_track)
    return parser


def _track(arguments: argparse.Namespace, _: Sources) -> int:
    from analysis.run.console import say
    from analysis.run.errors import UserError
    from analysis.run.output_folder import require_writable
    from analysis.run.progress import TerminalProgress
    from analysis.run.results import json_text
    from analysis.run.scenario_file import read_scenario
    from analysis.run.scenario_io import make_scenario
    from analysis.track.recorded_frames import open_recording
    from analysis.track.tracking import CSV, TrackScenario, write_track

    settings = [*arguments.settings]
    if arguments.rate is not None:
        settings.append(f"rate={arguments.rate}")
    file = arguments.scenario
    given = None if file is None else read_scenario(file, "track")
    scenario = make_scenario(TrackScenario(), given=given, settings=settings)
    recording = open_recording(arguments.files)
    require_writable(arguments.out, ["track"])
    folder = arguments.out / "track"
    if (folder / CSV).exists():
        say(f"what is in {folder} is replaced")
    try:
        with TerminalProgress("track") as progress:
            found, paths = write_track(
                arguments.out,
                recording,
                scenario,
                video=not arguments.no_video,
                progress=progress,
            )
    except KeyboardInterrupt:
        say("interrupted, nothing was written")
        return _INTERRUPTED
    except OSError as error:
        reason = error.strerror or str(error)
        raise UserError(f"{arguments.out} can't be written: {reason}") from error
    document = _document(recording, scenario, found, paths)
    print(json_text(document) if arguments.json else _text(document), end="")
    return 0


def _document(
    recording: "Recording", scenario: "TrackScenario", found: "Track", paths: list[Path]
) -> dict[str, Any]:
    import math

    from analysis.run.scenario_io import unstructure

    frames = len(found.names)
    width, height = found.size
    return {
        "frames": frames,
        "announced_frames": recording.announced,
        "width": width,
        "height": height,
        "rate": None if math.isnan(found.rate) else found.rate,
        "statuses": found.counts(),
        "scenario": unstructure(scenario),
        "files": [str(path) for path in paths],
    }


def _text(document: dict[str, Any]) -> str:
    from analysis.run.check_text import number
    from analysis.run.console import table
    from analysis.track.detection_overlay import REASONS
    from systems.vision.part_detection import Status

    frames, announced = document["frames"], document["announced_frames"]
    rate = f", {number(document['rate'])} frames/s" if document["rate"] else ""
    lines = [
        f"{frames} frame{'s' * (frames != 1)}, "
        f"{document['width']} x {document['height']} pixels{rate}"
    ]
    if announced is not None and announced > frames:
        lines.append(f"  the video announces {announced} frames, the others can't be decoded")
    rows = [
        (name, str(document["statuses"][part][status]), REASONS[Status[status]])
        for part, name in (("peg", "peg"), ("hole", "hole part"))
        for status in document["statuses"][part]
    ]
    lines += [f"  {line}" for line in table(rows, right=(1,))]
    return "\n".join([*lines, *document["files"], ""])
