"""What tracking leaves on disk: tables, the overlay video, the frames of a live camera."""

import fcntl
import os
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import cv2

from chamfer.analysis.report.atomic_write import replacing
from chamfer.analysis.report.traces import write_table
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.scenario.experiment import Table
from chamfer.analysis.track.overlay_video import LiveOverlay, Overlay
from chamfer.systems.cameras.camera_image import Image

FOLDER: Final = "track"
CSV, PARQUET, VIDEO = "detections.csv", "detections.parquet", "overlay.webm"
FRAMES: Final = "frames"


class TrackFiles:
    """The tables and the video of one run, which grow frame by frame while the block runs.

    They are made in a hidden folder; :meth:`finish` moves them into ``out/track``, where they
    replace those of an earlier run. Without it nothing of them stays.

    Args:
        out: The folder of all results.
        video: Whether to write the overlay video.
    """

    def __init__(self, out: Path, *, video: bool) -> None:
        self._out = out
        self._with_video = video
        self.overlay: Overlay | None = None  # the video, if it is to be written

    def __enter__(self) -> Self:
        """Make the hidden folder."""
        self._staging = tempfile.TemporaryDirectory(prefix=".unfinished-", dir=self._out)
        self._csv = (self._folder / CSV).open("w", encoding="utf-8", newline="\n")
        return self

    def begin(self, header: str, rate: float, *, live: bool) -> None:
        """Begin the table with its header and, if it is to be written, the video.

        Args:
            header: Line of the columns' names.
            rate: Of the frames, frames/s, or NaN.
            live: Whether the frames come whether they are looked at or not.
        """
        self._csv.write(header)
        if self._with_video:
            path = self._folder / VIDEO
            self.overlay = LiveOverlay(path) if live else Overlay(path, rate)

    def add_line(self, line: str) -> None:
        """Append a line of the table; it is on disk when this returns."""
        self._csv.write(line)
        self._csv.flush()

    def finish(self, table: Table, replaces: Callable[[], None]) -> list[Path]:
        """Complete the files, move them to where they stay and return their paths.

        Args:
            table: All of it.
            replaces: Called before the files of an earlier run are replaced, if there are any.
        """
        self._csv.close()
        if self.overlay is not None:
            self.overlay.close()
        write_table(self._folder / PARQUET, table)
        folder = self._out / FOLDER
        folder.mkdir(exist_ok=True)
        with _alone(folder):
            if (folder / CSV).exists():
                replaces()
            (folder / VIDEO).unlink(missing_ok=True)
            paths = [folder / path.name for path in sorted(self._folder.iterdir())]
            for path in paths:
                os.replace(self._folder / path.name, path)
        return paths

    @property
    def _folder(self) -> Path:
        return Path(self._staging.name)

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Remove the hidden folder and what is left in it."""
        with suppress(OSError):  # a full disk: what was not written now has been said before
            self._csv.close()
        if self.overlay is not None:
            self.overlay.close()
        self._staging.cleanup()


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


class FrameFolder:
    """Keeps frames as PNG while the block runs, each on disk before the next one is looked at.

    Args:
        folder: Which must not hold anything yet; it goes if no frame comes.

    Raises:
        UserError: If it can't be made, or is there with something in it.
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
        picture = cv2.imencode(".png", cv2.cvtColor(image, cv2.COLOR_RGB2BGR))[1]
        with replacing(self._folder / name) as temporary:
            temporary.write_bytes(picture.tobytes())

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Leave no folder, nor one around it, where there was no frame."""
        with suppress(OSError):
            self._folder.rmdir()
            self._folder.parent.rmdir()
