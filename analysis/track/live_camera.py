"""Frames of a camera that is there now, as they come."""

import math
import os
import queue
import re
import stat
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from types import TracebackType
from typing import Any, Final, Self

import cv2

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track.opencv_calls import silenced
from chamfer.analysis.track.recorded_frames import Frame, rgb

_ALLOWED: Final = "the number of a camera, as 0 for /dev/video0, or its path"
_SIZE: Final = (cv2.CAP_PROP_FRAME_WIDTH, cv2.CAP_PROP_FRAME_HEIGHT)
_WAITING: Final = 8  # frames that are kept until they are looked at
_POLL: Final = 0.1  # s, how often it is asked whether to stop
_PAUSE: Final = 0.01  # s, after a frame that did not come
_WAKING: Final = 10.0  # s, that a camera may take for its first frame
_SILENT: Final = 3.0  # s, that it may take for another one
_OLDEST: Final = 1.0  # s, since a frame was taken


def device_path(text: str) -> Path:
    """Return the path of a camera that is named by its number or by its path.

    Raises:
        UserError: If there is no such device, or it can't be opened.
    """
    path = Path(f"/dev/video{int(text)}" if re.fullmatch("[0-9]{1,3}", text) else text)
    try:
        if not stat.S_ISCHR(path.stat().st_mode):
            raise UserError(f"{path} is no device, allowed: {_ALLOWED}")
        os.close(os.open(path, os.O_RDWR | os.O_NONBLOCK))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UserError(f"{path}: {reason}, allowed: {_ALLOWED}") from error
    return path


class CameraError(Exception):
    """A camera that delivers no frames any more; the message says which."""


class LiveCamera:
    """A camera whose frames are read while the block runs.

    A thread of its own waits for them, so that one that has stopped delivering can be left. A
    frame's time is that at which it was taken, if the driver says so on the machine's monotonic
    clock, or else at which it arrived.

    Args:
        path: Of the device.
        size: Width and height that it is asked for, pixels; None: its own.

    Raises:
        UserError: If it can't be opened.
    """

    def __init__(self, path: Path, size: tuple[int, int] | None = None) -> None:
        self._path = path
        self._size = size
        self._waiting: queue.Queue[tuple[Any, float]] = queue.Queue(_WAITING)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self._missed = 0

    def __enter__(self) -> Self:
        """Open the camera and begin to read."""
        with silenced():
            self._capture = cv2.VideoCapture(str(self._path), cv2.CAP_V4L2)
            opened = self._capture.isOpened()
            if opened and self._size is not None:
                for name, value in zip(_SIZE, self._size, strict=True):
                    self._capture.set(name, value)
        if not opened:
            raise UserError(f"{self._path} can't be opened as a camera, allowed: {_ALLOWED}")
        self._level = cv2.utils.logging.getLogLevel()
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        self._thread.start()
        return self

    @property
    def rate(self) -> float | None:
        """Frames/s, as the camera says, or None."""
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        return rate if math.isfinite(rate) and rate > 0 else None

    @property
    def missed(self) -> int:
        """How many frames came while too many others waited."""
        return self._missed

    def frames(self, stopped: Callable[[], bool]) -> Iterator[Frame]:
        """Yield the frames with their times, s after the first one.

        Raises:
            CameraError: If no frame has come for some seconds.
        """
        number, first = 0, math.nan
        heard, patience = time.monotonic(), _WAKING
        while not stopped():
            try:
                image, moment = self._waiting.get(timeout=_POLL)
            except queue.Empty:
                gone = not self._path.exists()
                if gone or time.monotonic() - heard > patience:
                    why = "has gone" if gone else f"has sent nothing for {patience:g} s"
                    raise CameraError(f"{self._path} {why}") from None
                continue
            first = moment if number == 0 else first
            yield Frame(f"frame{number:06d}.png", rgb(image), moment - first)
            number += 1
            heard, patience = time.monotonic(), _SILENT

    def _read(self) -> None:
        while not self._ended.is_set():
            found, image = self._capture.read()
            if not found:
                self._ended.wait(_PAUSE)
                continue
            try:
                self._waiting.put_nowait((image, self._moment()))
            except queue.Full:
                self._missed += 1
        self._capture.release()

    def _moment(self) -> float:
        """Return when the last frame was taken, s, on the machine's monotonic clock."""
        now = time.monotonic()
        taken = float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
        return taken if 0 <= now - taken < _OLDEST else now

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        """Stop reading and give the camera back, unless its driver keeps it."""
        self._ended.set()
        self._thread.join(_OLDEST)
        cv2.utils.logging.setLogLevel(self._level)
