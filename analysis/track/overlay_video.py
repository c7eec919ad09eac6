"""The overlay as a video: all frames of a recording, of a live camera those there is time for."""

import math
import queue
import threading
from collections.abc import Sequence
from pathlib import Path
from types import TracebackType
from typing import Final, Self

import cv2
import numpy as np

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track.detection_overlay import Caption, draw
from chamfer.analysis.track.frame_source import silenced, utf8_path
from chamfer.analysis.track.part_finder import Sighting
from chamfer.systems.cameras.camera_image import Image

_SLOWEST, _FASTEST = 1.0, 240.0  # frames/s that players take
_CODE: Final = cv2.VideoWriter.fourcc(*"VP80")


class VideoFile:
    """A video that grows frame by frame while the block runs.

    Args:
        path: Of the file, which ends in .webm.
        rate: Frames/s; the video plays at 1 to 240.

    Raises:
        UserError: If the video can't be written.
    """

    def __init__(self, path: Path, rate: float) -> None:
        self._path = path
        self._rate = round(min(max(rate, _SLOWEST), _FASTEST), 3)
        self._writer: cv2.VideoWriter | None = None
        self._last: cv2.typing.MatLike | None = None
        self._written = 0

    def __enter__(self) -> Self:
        """Begin without a file: the first image says how large the video is."""
        return self

    def write(self, image: Image, time: float | None = None) -> None:
        """Append an image.

        Args:
            image: Red, green, blue, shape (height, width, 3), of the same even size as all others.
            time: When it is shown, s after the first one: the one before stays until then. Where
                that is sooner than a frame's length after it, the image is left out. None: after
                the one before.
        """
        if self._writer is None:
            self._writer = self._opened((image.shape[1], image.shape[0]))
        if time is not None:
            due = round(time * self._rate)
            while self._last is not None and self._written < due:
                self._append(self._last)
            if self._written > due:
                return
        self._last = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        self._append(self._last)

    def _append(self, picture: cv2.typing.MatLike) -> None:
        assert self._writer is not None
        self._writer.write(picture)
        self._written += 1

    def _opened(self, size: tuple[int, int]) -> cv2.VideoWriter:
        with silenced(), utf8_path(self._path) as name:
            writer = cv2.VideoWriter(name, cv2.CAP_FFMPEG, _CODE, self._rate, size)
        if not writer.isOpened():
            raise UserError(f"{self._path.name} can't be written, {size[0]} x {size[1]} pixels")
        return writer

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Complete the file."""
        self.close()

    def close(self) -> None:
        """Complete the file; nothing can be appended any more."""
        if self._writer is not None:
            self._writer.release()


_UNKNOWN: Final = 30.0  # frames/s, where nobody says how fast frames were taken
_LIVE: Final = 15.0  # frames/s; encoding takes longer than detection


class Overlay:
    """A video of what is found in each frame.

    Args:
        path: Of the file.
        rate: Frames/s, or NaN.
    """

    def __init__(self, path: Path, rate: float) -> None:
        self._video = VideoFile(path, _UNKNOWN if math.isnan(rate) else rate)

    def show(self, found: Sighting, captions: Sequence[Caption]) -> None:
        """Append what was found in a frame, those of several cameras side by side."""
        self._video.write(sheet(found, captions))

    def close(self) -> None:
        """Complete the file."""
        self._video.close()


class LiveOverlay(Overlay):
    """The same of frames that come whether they are looked at or not.

    A thread of its own draws and encodes, and takes the next frame when it is done with one. The
    video takes as long as the frames did.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, _LIVE)
        self._next: queue.Queue[tuple[Sighting, Sequence[Caption]] | None] = queue.Queue(1)
        self._fault: UserError | None = None
        self._thread = threading.Thread(target=self._write, daemon=True)
        self._thread.start()

    def show(self, found: Sighting, captions: Sequence[Caption]) -> None:
        """Show what was found in a frame, unless another one is still being drawn.

        Raises:
            UserError: If the video can't be written.
        """
        if self._fault is not None:
            raise self._fault
        if not self._next.full():
            self._next.put((found, captions))

    def close(self) -> None:
        """Complete the file."""
        if self._thread.is_alive():
            self._next.put(None)
            self._thread.join()
        super().close()

    def _write(self) -> None:
        while (shown := self._next.get()) is not None:
            found, captions = shown
            if self._fault is None:
                try:
                    self._video.write(sheet(found, captions), captions[0].time)
                except UserError as error:
                    self._fault = error


def sheet(found: Sighting, captions: Sequence[Caption]) -> Image:
    """Return what was found in the frames of all cameras, side by side."""
    sheets = [
        draw(seen.image, seen.peg, seen.hole, seen.error, caption, found.note)
        for seen, caption in zip(found.seen, captions, strict=True)
    ]
    height = max(len(one) for one in sheets)
    return np.hstack([np.pad(one, ((0, height - len(one)), (0, 0), (0, 0))) for one in sheets])
