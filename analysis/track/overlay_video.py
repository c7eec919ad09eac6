"""The overlay as a video: all frames of a recording, of a live camera those there is time for."""

import math
import queue
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import numpy as np

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track.detection_overlay import Caption, draw
from chamfer.analysis.track.part_finder import Sighting
from chamfer.analysis.track.video_file import VideoFile
from chamfer.systems.cameras.camera_image import Image

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
