"""Frames that a camera has recorded: an image folder, image files or a video file.

They are read one at a time, so that a long recording needs no more memory than a short one.
"""

import math
import os
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final, NamedTuple

import cv2
import numpy as np

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track.opencv_calls import silenced, utf8_path
from chamfer.systems.cameras.camera_image import Image

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

    files: tuple[Path, ...]  # the images in order, or the video
    video: bool
    rate: float | None = None  # frames/s, as the video says
    announced: int | None = None  # frames that the video says it has, which may be an estimate

    @property
    def number(self) -> int | None:
        """How many frames there are, as far as that is known."""
        return self.announced if self.video else len(self.files)

    def frames(self) -> Iterator[Frame]:
        """Yield the frames in order, all of one size.

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

    Images come in the natural order of their names (frame2 before frame10), however they are
    given: a shell sorts them otherwise. In a folder all other files are left alone.

    Raises:
        UserError: If there is nothing to be read, or more than one folder or video.
    """
    for path in paths:
        try:
            path.stat()
        except (OSError, ValueError) as error:
            reason = getattr(error, "strerror", None) or error
            raise UserError(f"{path}: {reason}, allowed: {_ALLOWED}") from error
    if all(path.is_file() and _is_image(path) for path in paths):
        return Recording(files=_in_order(paths), video=False)
    if len(paths) > 1:
        other = next(path for path in paths if not (path.is_file() and _is_image(path)))
        raise UserError(f"{other} is one of several files and no image, allowed: {_ALLOWED}")
    (path,) = paths
    return _folder(path) if path.is_dir() else _open_video(path)


def require_paired(left: Recording, right: Recording, *, rated: bool) -> None:
    """Refuse recordings that can't be of the same moments, frame by frame.

    Args:
        left: The first one.
        right: The second one.
        rated: Whether it is known how fast both were taken, whatever they say.

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


def shown_name(path: Path) -> str:
    """Return a file's name as a text, in which what is not UTF-8 is escaped."""
    return os.fsencode(path.name).decode(errors="backslashreplace")


def _is_image(path: Path) -> bool:
    return path.suffix.lower() in IMAGE_ENDINGS


def _in_order(paths: Sequence[Path]) -> tuple[Path, ...]:
    return tuple(sorted(paths, key=_natural))


def _natural(path: Path) -> tuple[object, ...]:
    """Return a key that compares the numbers in a path as numbers."""
    # Texts and numbers take turns, so that like is compared with like.
    pieces = re.split(r"([0-9]+)", str(path))
    return (*(int(p) if k % 2 else p.casefold() for k, p in enumerate(pieces)), "", str(path))


def _folder(folder: Path) -> Recording:
    try:
        found = [
            path
            for path in folder.iterdir()
            if _is_image(path) and path.is_file() and not path.name.startswith(".")
        ]
    except OSError as error:
        raise UserError(f"{folder}: {error.strerror}") from error
    if not found:
        endings = ", ".join(sorted(IMAGE_ENDINGS))
        raise UserError(f"{folder} holds no images, allowed: files that end in {endings}")
    return Recording(files=_in_order(found), video=False)


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
    for path in paths:
        try:
            data = np.frombuffer(path.read_bytes(), np.uint8)
        except OSError as error:
            raise UserError(f"{path}: {error.strerror}") from error
        yield Frame(shown_name(path), _decoded(path, data))


def _decoded(path: Path, data: Image) -> Image:
    """Return an image with 8 bits a channel: grey as it is in all three, without transparency."""
    with silenced():
        try:
            # From memory, where OpenCV refuses a JPEG that ends too early; in a file it fills up.
            image = cv2.imdecode(data, cv2.IMREAD_COLOR) if data.size else None
        except cv2.error:  # too large
            image = None
    if image is None:
        raise UserError(f"{path} can't be decoded, allowed: an image that is whole")
    return rgb(image)


def rgb(image: cv2.typing.MatLike) -> Image:
    """Return an image as OpenCV decodes it with its channels in the usual order."""
    return cv2.cvtColor(image, cv2.COLOR_BGR2RGB).astype(np.uint8, copy=False)
