"""A video that browsers play: VP8 in WebM.

The wheels of OpenCV encode it on any machine (libvpx comes with them). H.264 they don't, and
MPEG-4 Part 2 (``mp4v``), which they do, no browser plays.
"""

from pathlib import Path
from types import TracebackType
from typing import Final, Self

import cv2

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track.opencv_calls import silenced, utf8_path
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
