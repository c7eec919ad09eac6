"""Recorded frames to a table of where the peg and the hole part are, and an overlay video."""

import math
import os
import tempfile
from array import array
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np

from analysis.run.experiment import Progress, Table
from analysis.run.traces import write_table
from analysis.track.detection_overlay import Caption, VideoFile, draw
from analysis.track.recorded_frames import Recording
from models.validation import ParameterError
from systems.vision.part_appearance import HOLE_PART, PEG, Appearance
from systems.vision.part_detection import Status, detect_parts
from systems.vision.part_detector import alignment_error, pack_detections

IMAGE_RATE: Final = 80.0  # Hz, section 4; images don't say how fast they were taken
CSV, PARQUET, VIDEO = "detections.csv", "detections.parquet", "overlay.mp4"
PARTS: Final = ("peg", "hole")

_RATES: Final = (1e-4, 1e6)  # Hz, from a picture in three hours to the fastest cameras
_FORMULA: Final = ("=", "+", "-", "@", "\t", "\r")  # with what spreadsheets begin one
_QUANTITIES: Final = ("status", "tip_u", "tip_v", "angle", "point_u", "point_v")
_COLUMNS: Final = (
    *(f"{part}_{quantity}" for part in PARTS for quantity in _QUANTITIES),
    *(f"error_{quantity}" for quantity in ("along", "across", "angle")),
)


@dataclass(frozen=True, kw_only=True)
class TrackScenario:
    """What to look for in recorded frames."""

    peg: Appearance = PEG
    hole: Appearance = HOLE_PART
    rate: float | None = None  # frames/s; None: as the video says, 80 for images (section 4)

    def __post_init__(self) -> None:
        low, high = _RATES
        if self.rate is not None and not low <= self.rate <= high:
            raise ParameterError("rate", self.rate, f"a number from {low:g} to {high:g}, or null")

    def rate_of(self, recording: Recording) -> float:
        """Return a recording's frames/s; NaN for a video that doesn't say."""
        rate = self.rate or (recording.rate if recording.video else IMAGE_RATE)
        return math.nan if rate is None else rate


@dataclass(frozen=True, kw_only=True)
class Track:
    """What was found in a recording."""

    table: Table  # a row per frame, as in :func:`track`
    names: tuple[str, ...]  # of the frames' files
    size: tuple[int, int]  # pixels, width and height
    rate: float  # frames/s, or NaN

    def counts(self) -> dict[str, dict[str, int]]:
        """Return how many frames have each status that occurs, by part."""
        return {
            part: {
                status.name: number
                for status, number in sorted(Counter(self.statuses(part)).items())
            }
            for part in PARTS
        }

    def statuses(self, part: str) -> list[Status]:
        """Return a part's status in every frame."""
        return [Status(value) for value in self.table[f"{part}_status"].tolist()]


def track(
    recording: Recording,
    scenario: TrackScenario,
    *,
    overlay: Path | None = None,
    progress: Progress,
) -> Track:
    """Find the parts in every frame.

    The table's columns: ``frame``, from 0; ``time``, s; for ``peg`` and ``hole`` each
    ``_status`` (the number of a :class:`Status`), ``_tip_u`` and ``_tip_v``, pixels, ``_angle``,
    rad, ``_point_u`` and ``_point_v``, pixels; ``error_along`` and ``error_across``, pixels, and
    ``error_angle``, rad, of :func:`systems.vision.part_detector.alignment_error`. What was not
    found is NaN.

    Args:
        recording: The frames.
        scenario: What to look for.
        overlay: Where to write a video of the frames with what was found; None: nowhere.
        progress: Told after every frame.

    Raises:
        UserError: If a frame can't be read.
    """
    rate = scenario.rate_of(recording)
    number = recording.announced if recording.video else len(recording.files)
    names, rows, size = [], array("d"), (0, 0)
    with ExitStack() as stack:
        shown = IMAGE_RATE if math.isnan(rate) else rate
        video = None if overlay is None else stack.enter_context(VideoFile(overlay, shown))
        for k, (name, image) in enumerate(recording.frames()):
            peg, hole = detect_parts(image, scenario.peg, scenario.hole)
            error = alignment_error(peg, hole)
            if video is not None:
                caption = Caption(k, k / rate, name)
                video.write(draw(image, peg, hole, error, caption))
            names.append(name)
            rows.extend([*pack_detections(peg, hole), *error])
            size = (image.shape[1], image.shape[0])
            progress((k + 1) / number if number else 0.0, f"frame {k + 1}")
    return Track(table=_table(rows, rate), names=tuple(names), size=size, rate=rate)


def write_track(
    out: Path, recording: Recording, scenario: TrackScenario, *, video: bool, progress: Progress
) -> tuple[Track, list[Path]]:
    """Track a recording and write the tables and, if asked for, the overlay video.

    All files are made in a hidden folder and moved into ``out/track`` at the end, where they
    replace those of an earlier recording.

    Returns:
        What was found, and the files.
    """
    with tempfile.TemporaryDirectory(prefix=".unfinished-", dir=out) as name:
        staging = Path(name)
        overlay = staging / VIDEO if video else None
        found = track(recording, scenario, overlay=overlay, progress=progress)
        with (staging / CSV).open("w", encoding="utf-8", newline="\n") as file:
            file.writelines(csv_lines(found))
        write_table(staging / PARQUET, found.table)
        folder = out / "track"
        folder.mkdir(exist_ok=True)
        (folder / VIDEO).unlink(missing_ok=True)
        paths = [folder / path.name for path in sorted(staging.iterdir())]
        for path in paths:
            os.replace(staging / path.name, path)
    return found, paths


def csv_lines(found: Track) -> Iterator[str]:
    """Yield the table as lines of comma-separated values, for people.

    A column ``file`` is added, a status is a name, and what was not found is empty. A file whose
    name a spreadsheet would take for a formula has an apostrophe in front of it.
    """
    frame, *others = found.table
    yield f"{','.join([frame, 'file', *others])}\n"
    writers = [_writer(name) for name in others]
    rows = zip(*(found.table[name] for name in others), strict=True)
    for k, (name, row) in enumerate(zip(found.names, rows, strict=True)):
        cells = (write(value.item()) for write, value in zip(writers, row, strict=True))
        yield f"{k},{_quoted(name)},{','.join(cells)}\n"


def _writer(column: str) -> Callable[[float], str]:
    if column.endswith("_status"):
        return lambda value: Status(int(value)).name
    digits = 6 if column == "time" or column.endswith("_angle") else 4
    return lambda value: "" if math.isnan(value) else f"{value:z.{digits}f}"


def _quoted(text: str) -> str:
    text = f"'{text}" if text.startswith(_FORMULA) else text
    return '"{}"'.format(text.replace('"', '""')) if set(text) & set(',"\r\n') else text


def _table(rows: "array[float]", rate: float) -> Table:
    values = np.array(rows).reshape(-1, len(_COLUMNS))
    columns = {
        name: column.astype(np.int64) if name.endswith("_status") else column
        for name, column in zip(_COLUMNS, values.T, strict=True)
    }
    frame = np.arange(len(values))
    return {"frame": frame, "time": frame / rate, **columns}
