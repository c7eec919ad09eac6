"""The files of tracking: tables, the overlay video, the frames of a live camera."""

import csv
import fcntl
import math
import os
import tempfile
from array import array
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Final, Self

import cv2
import numpy as np

from chamfer.analysis.report.atomic_write import replacing
from chamfer.analysis.report.traces import write_table
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Table
from chamfer.analysis.track.detection_overlay import REASONS, Caption, LiveOverlay, Overlay
from chamfer.analysis.track.frame_source import Frame
from chamfer.analysis.track.part_finder import Sighting
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.vision.detections import Status

FOLDER: Final = "track"
CSV, PARQUET, VIDEO = "detections.csv", "detections.parquet", "overlay.webm"
FRAMES: Final = "frames"
STATUS: Final = "_status"  # end of the columns that are numbers of :class:`Status`

_FORMULA: Final = ("=", "+", "-", "@", "\t", "\r")  # with what spreadsheets begin one
_IN_PIXELS: Final = ("_u", "_v", "error_along", "error_across")  # ends of columns
_PIXELS, _SI = 4, 6  # decimals, of what is in pixels and of s, rad and m


class TrackFiles:
    """The tables and the video of one run, which grow frame by frame while the block runs.

    They are made in a hidden folder; :meth:`finish` moves them into ``out/track``, where they
    replace those of an earlier run. Without it nothing of them stays.

    The lines for people have three kinds of column more than the table: ``file``, and behind every
    status, which is a name there, the reason in words. What was not found is empty. A file whose
    name a spreadsheet would take for a formula has an apostrophe in front of it.
    """

    def __init__(self, out: Path, columns: Sequence[str]) -> None:
        self._out = out
        self._columns = ("time", *columns)
        self._values = array("d")
        self._overlay: Overlay | None = None
        self.replaced = False  # whether there were files of an earlier run

    def __enter__(self) -> Self:
        """Make the hidden folder and begin the lines."""
        self._staging = tempfile.TemporaryDirectory(prefix=".unfinished-", dir=self._out)
        self._folder = Path(self._staging.name)
        self._csv = (self._folder / CSV).open("w", encoding="utf-8", newline="")
        self._lines = csv.writer(self._csv, lineterminator="\n")
        names = ["frame", "file"]
        for column in self._columns:
            reason = f"{column.removesuffix(STATUS)}_reason"
            names += [column, reason] if column.endswith(STATUS) else [column]
        self._lines.writerow(names)
        return self

    def add_overlay(self, rate: float, *, live: bool) -> None:
        """Write the video too; live frames arrive at their own times."""
        path = self._folder / VIDEO
        self._overlay = LiveOverlay(path) if live else Overlay(path, rate)

    def add(self, frames: Sequence[Frame], time: float, found: Sighting) -> None:
        """Append the detections at a time, s, or NaN; their line is on disk at return."""
        number, file = len(self), frames[0].name
        row = (time, *found.values)
        cells = [
            cell
            for column, value in zip(self._columns, row, strict=True)
            for cell in _cells(column, value)
        ]
        shown = f"'{file}" if file.startswith(_FORMULA) else file
        self._lines.writerow([number, shown, *cells])
        self._csv.flush()
        self._values.extend(row)
        if self._overlay is not None:
            captions = [Caption(number, time, frame.name, found.note) for frame in frames]
            self._overlay.show(found.seen, captions)

    def __len__(self) -> int:
        """Return how many rows there are."""
        return len(self._values) // len(self._columns)

    def table(self) -> Table:
        """Return the columns ``frame``, from 0, ``time``, s, and the detections."""
        values = np.array(self._values).reshape(-1, len(self._columns))
        return {
            "frame": np.arange(len(values)),
            **{
                name: column.astype(np.int64) if name.endswith(STATUS) else column
                for name, column in zip(self._columns, values.T.copy(), strict=True)
            },
        }

    def finish(self) -> list[Path]:
        """Complete the files, move them to where they stay and return their paths."""
        self._csv.close()
        if self._overlay is not None:
            self._overlay.close()
        write_table(self._folder / PARQUET, self.table())
        folder = self._out / FOLDER
        folder.mkdir(exist_ok=True)
        with _alone(folder):
            self.replaced = (folder / CSV).exists()
            (folder / VIDEO).unlink(missing_ok=True)
            paths = [folder / path.name for path in sorted(self._folder.iterdir())]
            for path in paths:
                os.replace(self._folder / path.name, path)
        return paths

    def __exit__(self, *_: object) -> None:
        """Remove the hidden folder and what is left in it."""
        with suppress(OSError):  # a full disk: what was not written now has been said before
            self._csv.close()
        if self._overlay is not None:
            self._overlay.close()
        self._staging.cleanup()


def _cells(column: str, value: float) -> Iterator[str]:
    if column.endswith(STATUS):
        status = Status(int(value))
        yield status.name
        yield "" if status == Status.VALID else REASONS[status]
    else:
        digits = _PIXELS if column.endswith(_IN_PIXELS) else _SI
        yield "" if math.isnan(value) else f"{value:z.{digits}f}"


@contextmanager
def _alone(folder: Path) -> Iterator[None]:
    """Wait until no other run moves its files into the folder, so that none are mixed."""
    number = os.open(folder, os.O_RDONLY)
    try:
        with suppress(OSError):  # a file system without locks
            fcntl.flock(number, fcntl.LOCK_EX)
        yield
    finally:
        os.close(number)


def write_picture(path: Path, image: Image) -> None:
    """Write an image, red, green, blue, as PNG, as a whole."""
    picture = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1]
    with replacing(path) as temporary:
        temporary.write_bytes(picture.tobytes())


class FrameFolder:
    """Keeps frames as PNG while the block runs, each on disk before the next is processed.

    The folder must not hold anything yet; it goes if no frame comes.
    """

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def __enter__(self) -> Self:
        """Make the folder."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            taken = any(self._folder.iterdir())
        except OSError as error:
            reason = error.strerror or error
            raise UserError(f"{self._folder} can't be written: {reason}") from error
        if taken:
            allowed = "allowed: another --out, or to move it away"
            raise UserError(f"{self._folder} holds what was kept before, {allowed}")
        return self

    def save(self, name: str, image: Image) -> None:
        """Write a frame, red, green, blue, shape (height, width, 3)."""
        write_picture(self._folder / name, image)

    def __exit__(self, *_: object) -> None:
        """Leave no folder, nor one around it, where there was no frame."""
        with suppress(OSError):
            self._folder.rmdir()
            self._folder.parent.rmdir()
