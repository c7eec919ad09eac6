"""Frames of a camera: recorded (image folder, image files, video file), or live."""

import math
import os
import queue
import re
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Final, NamedTuple, Self

import cv2
import numpy as np

from chamfer.analysis.scenario.errors import UserError
from chamfer.systems.cameras.camera_image import Image


@contextmanager
def silenced() -> Iterator[None]:
    """Suppress the output of decoders and encoders on the process's standard error."""
    sys.stderr.flush()
    before = os.dup(2)
    try:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), 2)
        yield
    finally:
        os.dup2(before, 2)
        os.close(before)


@contextmanager
def utf8_path(path: Path) -> Iterator[str]:
    """Give an absolute name, which is no address, by which OpenCV can open or make a file."""
    name = str(path.absolute())
    try:
        name.encode()
    except UnicodeEncodeError:
        with tempfile.TemporaryDirectory() as folder:
            link = Path(folder, f"link{path.suffix if path.suffix.isascii() else ''}")
            link.symlink_to(name)
            yield str(link)
    else:
        yield name


IMAGE_ENDINGS: Final = frozenset(
    (".bmp", ".jpeg", ".jpg", ".pbm", ".pgm", ".png", ".ppm", ".tif", ".tiff", ".webp")
)
LEAST_SIZE: Final = 16  # pixels, of a frame's sides

_BEGIN: Final = 65536  # bytes of a file that are looked at
_SAME_RATE: Final = 1e-3  # relative difference of frames/s
_ALLOWED: Final = "an image folder, image files or one video file"


class Frame(NamedTuple):
    """One picture of a recording."""

    name: str  # of the file; what is not UTF-8 in it is escaped
    image: Image  # red, green, blue, shape (height, width, 3)
    time: float | None = None  # s, after the first one; None: it doesn't say


@dataclass(frozen=True, kw_only=True)
class Recording:
    """Where frames are on disk; :func:`open_recording` makes one."""

    live: ClassVar = False  # whether it goes on until it is stopped
    missed: ClassVar = 0

    files: tuple[Path, ...]  # the images in order, or the video
    video: bool
    rate: float | None = None  # frames/s, as the video says
    announced: int | None = None  # frames that the video says it has, which may be an estimate

    @property
    def number(self) -> int | None:
        """Number of frames, as far as it is known."""
        return self.announced if self.video else len(self.files)

    def frames(self, stopped: Callable[[], bool] = lambda: False) -> Iterator[Frame]:
        """Yield the frames in order, all of one size; it ends by itself.

        Raises:
            UserError: If a frame can't be read or has another size than the first one.
        """
        first: Frame | None = None
        for k, frame in enumerate(_video(self.files[0]) if self.video else _images(self.files)):
            height, width = frame.image.shape[:2]
            if first is None:
                first = frame
                if min(width, height) < LEAST_SIZE:
                    raise UserError(
                        f"{frame.name} is {width} x {height} pixels, "
                        f"allowed: at least {LEAST_SIZE} x {LEAST_SIZE}"
                    )
            if frame.image.shape != first.image.shape:
                where = f"frame {k} of {frame.name}" if self.video else frame.name
                size = "{1} x {0}".format(*first.image.shape)
                raise UserError(
                    f"{where} is {width} x {height} pixels, "
                    f"allowed: {size} as the first one ({first.name})"
                )
            yield frame
        if first is None:
            raise UserError(f"{self.files[0]}: no frame of the video can be decoded")


def open_recording(paths: Sequence[Path]) -> Recording:
    """Find the frames of an image folder, of image files or of a video file.

    Images come in the natural order of their names (frame2 before frame10), however given.

    Raises:
        UserError: If there is nothing to be read, or more than one folder or video.
    """
    for path in paths:
        try:
            path.stat()
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise UserError(f"{path}: {reason}, allowed: {_ALLOWED}") from error
    others = [path for path in paths if not _is_image(path)]
    if not others:
        return Recording(files=tuple(sorted(paths, key=_natural)), video=False)
    if len(paths) > 1:
        raise UserError(f"{others[0]} is one of several files and no image, allowed: {_ALLOWED}")
    return _folder(others[0]) if others[0].is_dir() else _open_video(others[0])


def require_paired(left: Recording, right: Recording, *, rated: bool) -> None:
    """Refuse recordings that can't be of the same moments, frame by frame.

    Rated, it is known how fast both were taken, whatever they say.

    Raises:
        UserError: If they have different numbers of images, or of frames/s.
    """
    if not (left.video or right.video) and left.number != right.number:
        raise UserError(f"--right has {right.number} images, allowed: {left.number} as FILES")
    if left.rate is None or right.rate is None or rated:
        return
    if not math.isclose(left.rate, right.rate, rel_tol=_SAME_RATE):
        raise UserError(
            f"--right has {right.rate:g} frames/s, allowed: {left.rate:g} as FILES, or --rate"
        )


def _is_image(path: Path) -> bool:
    return path.is_file() and path.suffix.lower() in IMAGE_ENDINGS


def shown_name(path: Path) -> str:
    """Return a file's name as text, with non-UTF-8 bytes escaped."""
    return os.fsencode(path.name).decode(errors="backslashreplace")


def _natural(path: Path) -> tuple[object, ...]:
    """Return a key that compares the numbers in a path as numbers."""
    # Texts and numbers take turns, so that like is compared with like.
    pieces = re.split(r"([0-9]+)", str(path))
    return (*(int(p) if k % 2 else p.casefold() for k, p in enumerate(pieces)), "", str(path))


def _folder(folder: Path) -> Recording:
    try:
        files = [path for path in folder.iterdir() if not path.name.startswith(".")]
    except OSError as error:
        raise UserError(f"{folder}: {error.strerror}") from error
    found = [path for path in files if _is_image(path)]
    if not found:
        endings = ", ".join(sorted(IMAGE_ENDINGS))
        raise UserError(f"{folder} holds no images, allowed: files that end in {endings}")
    return Recording(files=tuple(sorted(found, key=_natural)), video=False)


def _open_video(path: Path) -> Recording:
    capture = _capture(path)
    rate, announced = capture.get(cv2.CAP_PROP_FPS), capture.get(cv2.CAP_PROP_FRAME_COUNT)
    capture.release()
    return Recording(
        files=(path,),
        video=True,
        rate=rate if math.isfinite(rate) and rate > 0 else None,
        announced=int(announced) if math.isfinite(announced) and announced > 0 else None,
    )


def _capture(path: Path) -> cv2.VideoCapture:
    if path.is_file():  # not a device or a pipe, which may keep one waiting
        try:
            with path.open("rb") as file:
                begin = file.read(_BEGIN)
        except OSError as error:
            raise UserError(f"{path}: {error.strerror}") from error
        with silenced(), utf8_path(path) as name:
            capture = cv2.VideoCapture(name, cv2.CAP_FFMPEG)
        # FFmpeg also makes a video of a text, where no byte is 0.
        if capture.isOpened() and b"\0" in begin:
            return capture
    raise UserError(f"{path} can't be read as an image or as a video, allowed: {_ALLOWED}")


def _video(path: Path) -> Iterator[Frame]:
    capture = _capture(path)
    try:
        while True:
            with silenced():
                found, image = capture.read()
            if not found:
                return
            yield Frame(shown_name(path), rgb(image))
    finally:
        capture.release()


def _images(paths: Sequence[Path]) -> Iterator[Frame]:
    """Yield images with 8 bits a channel: grey as it is in all three, without transparency."""
    for path in paths:
        try:
            data = np.frombuffer(path.read_bytes(), np.uint8)
        except OSError as error:
            raise UserError(f"{path}: {error.strerror}") from error
        with silenced():
            try:
                # From memory, where OpenCV refuses a JPEG that ends too early; in a file it
                # fills up.
                image = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
            except cv2.error:  # too large
                image = None
        if image is None:
            raise UserError(f"{path} can't be decoded, allowed: an image that is whole")
        yield Frame(shown_name(path), rgb(image))


def rgb(image: cv2.typing.MatLike) -> Image:
    """Return an image as OpenCV decodes it with its channels in the usual order."""
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)


_DEVICES: Final = "the number of a camera, as 0 for /dev/video0, or its path"
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
            raise UserError(f"{path} is no device, allowed: {_DEVICES}")
        os.close(os.open(path, os.O_RDWR | os.O_NONBLOCK))
    except (OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or error
        raise UserError(f"{path}: {reason}, allowed: {_DEVICES}") from error
    return path


class CameraError(Exception):
    """A camera that delivers no frames any more; the message says which."""


class LiveCamera:
    """A camera whose frames are read while the block runs.

    A thread waits for them, so that a camera that has stopped can be left. A frame's time is
    that at which it was taken, if the driver says so on the machine's monotonic clock, or else at
    which it arrived. The camera is asked for a size, pixels; None: its own.
    """

    announced: ClassVar = None
    number: ClassVar = None
    live: ClassVar = True

    def __init__(self, path: Path, size: tuple[int, int] | None = None) -> None:
        self._path = path
        self._size = size
        self._waiting: queue.Queue[tuple[Any, float]] = queue.Queue(_WAITING)
        self._ended = threading.Event()
        self._thread = threading.Thread(target=self._read, daemon=True)
        self.missed = 0  # frames that came while too many others waited

    def __enter__(self) -> Self:
        """Open the camera and begin to read."""
        with silenced():
            self._capture = cv2.VideoCapture(str(self._path), cv2.CAP_V4L2)
            opened = self._capture.isOpened()
            if opened and self._size is not None:
                for name, value in zip(_SIZE, self._size, strict=True):
                    self._capture.set(name, value)
        if not opened:
            raise UserError(f"{self._path} can't be opened as a camera, allowed: {_DEVICES}")
        self._level = cv2.utils.logging.getLogLevel()
        cv2.utils.logging.setLogLevel(cv2.utils.logging.LOG_LEVEL_SILENT)
        self._thread.start()
        return self

    @property
    def rate(self) -> float | None:
        """Frames/s reported by the camera, or None."""
        rate = self._capture.get(cv2.CAP_PROP_FPS)
        return rate if math.isfinite(rate) and rate > 0 else None

    def frames(self, stopped: Callable[[], bool] = lambda: False) -> Iterator[Frame]:
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
                self.missed += 1
        self._capture.release()

    def _moment(self) -> float:
        """Return when the last frame was taken, s, on the machine's monotonic clock."""
        now = time.monotonic()
        taken = float(self._capture.get(cv2.CAP_PROP_POS_MSEC)) / 1e3
        return taken if 0 <= now - taken < _OLDEST else now

    def __exit__(self, *_: object) -> None:
        """Stop reading and give the camera back, unless its driver keeps it."""
        self._ended.set()
        self._thread.join(_OLDEST)
        cv2.utils.logging.setLogLevel(self._level)
