"""Frames to a table of where the peg and the hole part are, and an overlay video."""

import argparse
import math
import re
import signal
import threading
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any, Final

import numpy as np

from chamfer.analysis.campaign.progress import TerminalProgress
from chamfer.analysis.command.output_folder import require_writable
from chamfer.analysis.command.running import read_scenario
from chamfer.analysis.report.check_text import number
from chamfer.analysis.report.console import say, table
from chamfer.analysis.report.results import json_text
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Progress, Table
from chamfer.analysis.scenario.scenario_io import make_scenario, unstructure
from chamfer.analysis.track.detection_overlay import REASONS
from chamfer.analysis.track.frame_source import (
    CameraError,
    Frame,
    LiveCamera,
    Recording,
    device_path,
    open_recording,
    require_paired,
)
from chamfer.analysis.track.learning import learn_parts
from chamfer.analysis.track.part_finder import PartFinder, Sighting, read_cameras
from chamfer.analysis.track.track_files import FOLDER, FRAMES, STATUS, FrameFolder, TrackFiles
from chamfer.models.cameras.camera import Camera
from chamfer.models.validation import ParameterError
from chamfer.systems.vision.detections import Status
from chamfer.systems.vision.part_appearance import HOLE_PART, PEG, Appearance
from chamfer.systems.vision.part_detection import ContinuityParams

IMAGE_RATE: Final = 80.0  # Hz, section 4; images don't say how fast they were taken

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)
_RATES: Final = (1e-4, 1e6)  # Hz, from a picture in three hours to the fastest cameras
_INTERRUPTED: Final = 130  # exit statuses
_ERROR: Final = 1
_NOT_LEARNED: Final = (
    *("files", "device", "save_frames", "camera_model", "right", "frames", "rate", "no_video"),
    *("scenario", "settings"),
)


@contextmanager
def stop_request() -> Iterator[Callable[[], bool]]:
    """Give a function that returns whether the block has to stop.

    The first Ctrl-C, or request to terminate, asks; a second one interrupts. A signal that the
    process ignores stays ignored.
    """
    asked = False
    before: dict[int, Any] = {}

    def ask(number: int, frame: FrameType | None) -> None:
        nonlocal asked
        if asked:
            raise KeyboardInterrupt
        asked = True

    if threading.current_thread() is threading.main_thread():
        before = {
            number: signal.signal(number, ask)
            for number in _SIGNALS
            if signal.getsignal(number) is not signal.SIG_IGN
        }
    try:
        yield lambda: asked
    finally:
        for number, handler in before.items():
            signal.signal(number, handler)


@dataclass(frozen=True, kw_only=True)
class TrackScenario:
    """The parts to find in frames."""

    peg: Appearance = PEG
    hole: Appearance = HOLE_PART
    rate: float | None = None  # frames/s; None: as the video says, 80 for images (section 4)
    continuity: ContinuityParams = field(default_factory=ContinuityParams)
    # what jumps is refused, but in images without a given rate, which may be of any time

    def __post_init__(self) -> None:
        low, high = _RATES
        if self.rate is not None and not low <= self.rate <= high:
            raise ParameterError("rate", self.rate, f"a number from {low:g} to {high:g}, or null")

    def rate_of(self, recording: Recording) -> float:
        """Return a recording's frames/s; NaN for a video without a rate."""
        rate = self.rate or (recording.rate if recording.video else IMAGE_RATE)
        return math.nan if rate is None else rate


class SynchronisedFrames:
    """Frames of one source, or of two taken together, the left camera's first.

    The rate is in frames/s, or NaN; the limit is the most moments, None: as many as there are.
    """

    def __init__(
        self, of: Sequence[Recording | LiveCamera], rate: float, limit: int | None = None
    ) -> None:
        self._of = of
        self._limit = limit
        self.rate = rate
        self.live = of[0].live  # whether a camera takes the frames now
        # Whether it says when its frames were taken, or how fast.
        self.timed = self.live or of[0].rate is not None
        self.ends = not self.live or limit is not None  # by itself
        known = [one.number for one in of if one.number is not None]
        # Frames of the longer of two recordings without a partner, as far as is known.
        self.unpaired = max(known, default=0) - min(known, default=0)
        self.number = min([*known, *([] if limit is None else [limit])], default=None)
        # How many frames a video says it has, if all of them are to be looked at.
        announced = [one.announced for one in of if one.announced is not None and limit is None]
        self.announced = min(announced, default=None)

    @property
    def missed(self) -> int:
        """Number of frames that arrived while others were processed."""
        return sum(one.missed for one in self._of)

    def moments(self, stopped: Callable[[], bool]) -> Iterator[tuple[Frame, ...]]:
        """Yield the frames of each moment, one of each camera."""
        streams = [one.frames(stopped) for one in self._of]
        for count, frames in enumerate(zip(*streams, strict=False), 1):
            yield frames
            if count == self._limit:
                return


@dataclass(frozen=True, kw_only=True)
class Track:
    """The detections in frames."""

    table: Table  # a row per frame
    size: tuple[int, int]  # pixels, width and height
    interrupted: bool = False  # before the last frame
    fault: Exception | None = None  # why it ended before the last frame without being asked to
    missed: int = 0  # frames of a live camera that came while others were looked at
    replaced: bool = False  # whether there were files of an earlier run

    @property
    def frames(self) -> int:
        """Number of frames."""
        return len(self.table["frame"])

    @property
    def both_valid(self) -> int:
        """In how many frames tip and axis of both parts were found, by each camera."""
        columns = [self.table[name] for name in self.table if name.endswith(STATUS)]
        return int(np.all(np.array(columns) == Status.VALID, axis=0).sum())

    def counts(self) -> dict[str, dict[str, int]]:
        """Return how many frames have each status that occurs, by part and camera."""
        return {
            name.removesuffix(STATUS): {
                Status(status).name: count
                for status, count in sorted(Counter(column.tolist()).items())
            }
            for name, column in self.table.items()
            if name.endswith(STATUS)
        }


def write_track(
    out: Path,
    source: SynchronisedFrames,
    finder: PartFinder,
    *,
    video: bool,
    saved: FrameFolder | None = None,
    stopped: Callable[[], bool] = lambda: False,
    progress: Progress,
) -> tuple[Track, list[Path]]:
    """Find the parts in every frame, and write the tables and optionally the overlay video.

    The columns are ``frame``, from 0, ``time``, s, and those of the finder. What was found until
    then is written whatever ends it before the last frame. There are no files without a frame.

    Raises:
        UserError: If the first frame can't be read.
        CameraError: If a live camera sends no frame at all.
    """
    size = (0, 0)
    fault: Exception | None = None
    with TrackFiles(out, finder.columns) as files:
        if video:
            files.add_overlay(source.rate, live=source.live)
        try:
            for k, frames in enumerate(source.moments(stopped)):
                if stopped():
                    break
                first = frames[0]
                time = k / source.rate if first.time is None else first.time
                if saved is not None:
                    saved.save(first.name, first.image)
                found = finder.find([frame.image for frame in frames], time)
                files.add(frames, time, found)
                size = (first.image.shape[1], first.image.shape[0])
                progress((k + 1) / source.number if source.number else math.nan, _doing(k, found))
        except (UserError, CameraError, OSError) as error:
            if not len(files):
                raise
            fault = error
        paths = files.finish() if len(files) else []
        track = Track(
            table=files.table(),
            size=size,
            # Ctrl-C is how a live camera ends, unless it is to end by itself.
            interrupted=stopped() and len(files) != source.number and source.ends,
            fault=fault,
            missed=source.missed,
            replaced=files.replaced,
        )
        return track, paths


def _doing(number: int, found: Sighting) -> str:
    seen = found.seen[0]
    peg, hole = REASONS[seen.peg.status], REASONS[seen.hole.status]
    return f"frame {number + 1}, peg {peg}, hole part {hole}"


def track(arguments: argparse.Namespace) -> int:
    """Run the command, and return its exit status."""
    try:
        return _find(arguments) if arguments.learn is None else _learn(arguments)
    except CameraError as error:
        say(str(error))
        return _ERROR
    except KeyboardInterrupt:
        say("interrupted, nothing was written")
        return _INTERRUPTED


def _learn(arguments: argparse.Namespace) -> int:
    for option in ("peg_box", "hole_box"):
        if getattr(arguments, option) is None:
            raise UserError(f"--learn is given without --{option.replace('_', '-')}")
    names = {"files": "FILES", "settings": "--set"}
    for option in _NOT_LEARNED:
        if getattr(arguments, option):
            name = names.get(option, f"--{option.replace('_', '-')}")
            raise UserError(f"{name} and --learn are given, allowed: one of them")
    said = learn_parts(arguments.learn, arguments.peg_box, arguments.hole_box, out=arguments.out)
    print(json_text(said) if arguments.json else "\n".join([*said["files"], ""]), end="")
    return 0


def _find(arguments: argparse.Namespace) -> int:
    if arguments.peg_box is not None or arguments.hole_box is not None:
        raise UserError("boxes are given without --learn")
    scenario = _scenario(arguments)
    limit = _limit(arguments.frames)
    cameras = _cameras(arguments)
    folder = arguments.out / FOLDER
    try:
        with ExitStack() as stack:
            source = _source(arguments, scenario, cameras, limit, stack)
            known = source.timed or scenario.rate is not None
            continuity = scenario.continuity if known else None
            finder = PartFinder(scenario.peg, scenario.hole, cameras, continuity)
            require_writable(arguments.out, [FOLDER])
            saved = None
            if arguments.save_frames:
                saved = stack.enter_context(FrameFolder(folder / FRAMES))
            stopped = stack.enter_context(stop_request())
            if not source.ends:
                say(f"frames of {arguments.device} as they come, Ctrl-C ends it")
            with TerminalProgress("track") as progress:
                found, paths = write_track(
                    arguments.out,
                    source,
                    finder,
                    video=not arguments.no_video,
                    saved=saved,
                    stopped=stopped,
                    progress=progress,
                )
    except OSError as error:
        raise UserError(f"{arguments.out} can't be written: {error.strerror or error}") from error
    if found.replaced:
        say(f"files in {folder} are replaced")
    if saved is not None:
        paths.append(folder / FRAMES)
    if found.frames == 0:
        say("interrupted before the first frame, nothing was written")
        return _INTERRUPTED
    said = document(source, scenario, found, paths)
    print(json_text(said) if arguments.json else text(said), end="")
    kept = f"what was found in {_frames(found.frames)} is kept"
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


def _scenario(arguments: argparse.Namespace) -> TrackScenario:
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


def _limit(text: str | None) -> int | None:
    if text is None:
        return None
    if not re.fullmatch("[0-9]{1,9}", text) or int(text) < 1:
        raise UserError(f"--frames is {text!r}, allowed: a whole number from 1 to 999999999")
    return int(text)


def _cameras(arguments: argparse.Namespace) -> tuple[Camera, ...]:
    """Return the calibrated cameras, or none without a calibration."""
    if arguments.right and arguments.device is not None:
        raise UserError("--right and --device are given, allowed: --right with FILES")
    if arguments.camera_model is None:
        if arguments.right:
            raise UserError("--right is given without --camera-model")
        return ()
    return read_cameras(arguments.camera_model, 2 if arguments.right else 1)


def _source(
    arguments: argparse.Namespace,
    scenario: TrackScenario,
    cameras: Sequence[Camera],
    limit: int | None,
    stack: ExitStack,
) -> SynchronisedFrames:
    if arguments.device is None:
        recordings = [open_recording(arguments.files)]
        if arguments.right:
            recordings.append(open_recording(arguments.right))
            require_paired(*recordings, rated=scenario.rate is not None)
        return SynchronisedFrames(recordings, scenario.rate_of(recordings[0]), limit)
    size = (cameras[0].width, cameras[0].height) if cameras else None
    camera = stack.enter_context(LiveCamera(device_path(arguments.device), size))
    return SynchronisedFrames([camera], camera.rate or math.nan, limit)


def document(
    source: SynchronisedFrames, scenario: TrackScenario, found: Track, paths: Sequence[Path]
) -> dict[str, Any]:
    """Return the detections as a document for JSON."""
    width, height = found.size
    return {
        "frames": found.frames,
        "announced_frames": source.announced,
        "unpaired_frames": source.unpaired,
        "missed_frames": found.missed,
        "interrupted": found.interrupted,
        "fault": None if found.fault is None else str(found.fault),
        "width": width,
        "height": height,
        "rate": None if math.isnan(source.rate) else source.rate,
        "both_valid": found.both_valid,
        "statuses": found.counts(),
        "scenario": unstructure(scenario),
        "files": [str(path) for path in paths],
    }


def text(said: Mapping[str, Any]) -> str:
    """Return the text of a document."""
    frames, announced = said["frames"], said["announced_frames"]
    rate = f", {number(said['rate'])} frames/s" if said["rate"] else ""
    lines = [
        f"{_frames(frames)}, {said['width']} x {said['height']} pixels{rate}, "
        f"both parts valid in {said['both_valid']}"
    ]
    early = said["interrupted"] or said["fault"]
    if announced is not None and announced > frames and not early:
        lines.append(f"  the video announces {announced} frames, the others can't be decoded")
    if said["unpaired_frames"]:
        verb = "has" if said["unpaired_frames"] == 1 else "have"
        lines.append(
            f"  {_frames(said['unpaired_frames'])} of the longer recording {verb} no partner"
        )
    if said["missed_frames"]:
        lines.append(
            f"  {_frames(said['missed_frames'])} came while others were looked at and are lost "
            "(--no-video is faster)"
        )
    rows = [
        (_name(part), str(count), REASONS[Status[status]])
        for part, counts in said["statuses"].items()
        for status, count in counts.items()
    ]
    lines += [f"  {line}" for line in table(rows, right=(1,))]
    return "\n".join([*lines, *said["files"], ""])


def _name(part: str) -> str:
    *right, name = part.split("_")
    return " ".join([*right, {"hole": "hole part"}.get(name, name)])


def _frames(number: int) -> str:
    return f"{number} frame{'s' * (number != 1)}"
