"""Frames to a table of where the peg and the hole part are, and an overlay video."""

import math
import signal
import threading
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from types import FrameType
from typing import Any, Final

from chamfer.analysis.report.check_text import number
from chamfer.analysis.report.console import table
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Progress
from chamfer.analysis.scenario.scenario_io import unstructure
from chamfer.analysis.track.detection_overlay import REASONS, Caption
from chamfer.analysis.track.frame_source import CameraError, Frame, FrameSource, Recording
from chamfer.analysis.track.part_finder import PartTracker, Sighting
from chamfer.analysis.track.track_files import FrameFolder, TrackFiles
from chamfer.analysis.track.track_table import Rows, Track
from chamfer.models.validation import ParameterError
from chamfer.systems.vision.continuity import ContinuityParams
from chamfer.systems.vision.part_appearance import HOLE_PART, PEG, Appearance
from chamfer.systems.vision.part_detection import Status

_SIGNALS: Final = (signal.SIGINT, signal.SIGTERM)


@contextmanager
def stop_request() -> Iterator[Callable[[], bool]]:
    """Give a function that says whether the block has been asked to stop.

    The first Ctrl-C, or request to terminate, only asks; a second one interrupts the block where
    it is. A signal that the process ignores stays ignored.
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


IMAGE_RATE: Final = 80.0  # Hz, section 4; images don't say how fast they were taken

_RATES: Final = (1e-4, 1e6)  # Hz, from a picture in three hours to the fastest cameras


@dataclass(frozen=True, kw_only=True)
class TrackScenario:
    """What to look for in frames."""

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
        """Return a recording's frames/s; NaN for a video that doesn't say."""
        rate = self.rate or (recording.rate if recording.video else IMAGE_RATE)
        return math.nan if rate is None else rate


class SynchronisedFrames:
    """Frames of one source, or of two taken together.

    Args:
        of: The sources, the left camera's first.
        rate: Frames/s, or NaN.
        limit: The most moments; None: as many as there are.
    """

    def __init__(self, of: Sequence[FrameSource], rate: float, limit: int | None = None) -> None:
        self._of = of
        self.rate = rate
        self._known = [one.number for one in of if one.number is not None]
        self.number = min([*self._known, *([] if limit is None else [limit])], default=None)
        self._limit = limit

    @property
    def announced(self) -> int | None:
        """How many frames a video says it has, if all of them are to be looked at."""
        if self._limit is not None:
            return None
        return min((one.announced for one in self._of if one.announced is not None), default=None)

    @property
    def unpaired(self) -> int:
        """How many frames of the longer of two recordings have no partner, as far as is known."""
        return max(self._known, default=0) - min(self._known, default=0)

    @property
    def timed(self) -> bool:
        """Whether it says when its frames were taken, or how fast."""
        return self._of[0].timed

    @property
    def live(self) -> bool:
        """Whether a camera takes the frames now."""
        return self._of[0].live

    @property
    def ends(self) -> bool:
        """Whether it ends by itself."""
        return not self.live or self._limit is not None

    @property
    def missed(self) -> int:
        """How many frames came while others were looked at."""
        return sum(one.missed for one in self._of)

    def moments(self, stopped: Callable[[], bool]) -> Iterator[tuple[Frame, ...]]:
        """Yield the frames of each moment, one of each camera."""
        streams = [one.frames(stopped) for one in self._of]
        for count, frames in enumerate(zip(*streams, strict=False), 1):
            yield frames
            if count == self._limit:
                return

    def time(self, number: int, frame: Frame) -> float:
        """Return when a frame was taken, s after the first one, or NaN."""
        return number / self.rate if frame.time is None else frame.time


def write_track(
    out: Path,
    source: SynchronisedFrames,
    tracker: PartTracker,
    *,
    video: bool,
    saved: FrameFolder | None = None,
    replaces: Callable[[], None] = lambda: None,
    stopped: Callable[[], bool] = lambda: False,
    progress: Progress,
) -> tuple[Track, list[Path]]:
    """Find the parts in every frame, and write the tables and, if asked for, the overlay video.

    The columns are ``frame``, from 0, ``time``, s, and those of the tracker. What was found
    until then is written whatever ends it before the last frame.

    Args:
        out: The folder of all results.
        source: Where the frames come from.
        tracker: Finds the parts in them.
        video: Whether to write the overlay.
        saved: Where to keep the frames; None: nowhere.
        replaces: Called before the files of an earlier run are replaced, if there are any.
        stopped: Whether to end.
        progress: Told after every frame.

    Returns:
        What was found, and the files; none if there was no frame.

    Raises:
        UserError: If the first frame can't be read.
        CameraError: If a live camera sends no frame at all.
    """
    rows, size = Rows(tracker.columns), (0, 0)
    fault: Exception | None = None
    with TrackFiles(out, video=video) as files:
        files.begin(rows.header(), source.rate, live=source.live)
        try:
            for k, frames in enumerate(source.moments(stopped)):
                if stopped():
                    break
                time = source.time(k, frames[0])
                if saved is not None:
                    saved.save(frames[0].name, frames[0].image)
                found = tracker.find([frame.image for frame in frames], time)
                files.add_line(rows.add(frames[0].name, time, found.values))
                if files.overlay is not None:
                    files.overlay.show(found, [Caption(k, time, frame.name) for frame in frames])
                size = (frames[0].image.shape[1], frames[0].image.shape[0])
                progress((k + 1) / source.number if source.number else math.nan, _doing(k, found))
        except (UserError, CameraError, OSError) as error:
            if not len(rows):
                raise
            fault = error
        track = Track(
            table=rows.table(),
            size=size,
            rate=source.rate,
            # Ctrl-C is how a live camera ends, unless it is to end by itself.
            interrupted=stopped() and len(rows) != source.number and source.ends,
            fault=fault,
            missed=source.missed,
        )
        return track, files.finish(track.table, replaces) if len(rows) else []


def _doing(number: int, found: Sighting) -> str:
    seen = found.seen[0]
    peg, hole = REASONS[seen.peg.status], REASONS[seen.hole.status]
    return f"frame {number + 1}, peg {peg}, hole part {hole}"


def document(
    source: SynchronisedFrames, scenario: TrackScenario, found: Track, paths: Sequence[Path]
) -> dict[str, Any]:
    """Return what was found as a document for JSON."""
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
        "rate": None if math.isnan(found.rate) else found.rate,
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
