"""Detections drawn over the frames, and their video.

Below the frame a panel says in words what was found, so that no text covers a part.
"""

import math
import queue
import threading
from collections.abc import Sequence
from pathlib import Path
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track.frame_source import silenced, utf8_path
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.vision.detections import Detection, Status
from chamfer.systems.vision.part_detector import alignment_error

Array = NDArray[np.float64]
Colour = tuple[int, int, int]  # red, green, blue

PEG_COLOUR: Final[Colour] = (255, 221, 51)
HOLE_COLOUR: Final[Colour] = (51, 238, 238)

REASONS: Final = {
    Status.VALID: "valid",
    Status.OCCLUDED: "occluded: no background beyond its end",
    Status.NO_IMAGE: "lost: no image",
    Status.NO_COLOUR: "lost: too few pixels of its colour",
    Status.AT_BORDER: "lost: the image ends before the part does",
    Status.NOT_STRAIGHT: "lost: no two long straight edges",
    Status.NO_CONTRAST: "lost: too little contrast with the background",
    Status.WRONG_SIZE: "lost: wider or narrower than the part can be",
    Status.WRONG_SHAPE: "lost: too long or too short, or not the part's end",
    Status.SHARED: "lost: its pixels also match the other part",
    Status.AMBIGUOUS: "lost: several candidates",
    Status.JUMPED: "lost: too far from its last place",
    Status.BLURRED: "lost: edges too blurred to be measured",
}

_DARK: Final = 24  # grey level
_INK: Final[Colour] = (_DARK, _DARK, _DARK)
_PAPER: Final[Colour] = (240, 240, 240)
_PANEL_WIDTH: Final = 640  # pixels, at least
_SMALL: Final = (640, 480)  # pixels; smaller frames are enlarged by a whole number
_LARGE: Final = 1920  # pixels; larger frames are reduced
_ROW: Final = 24  # pixels, of a line of text in a panel of the least width
_ROWS: Final = 4
_SHIFT: Final = 4  # bits of a pixel's fraction in OpenCV's coordinates


def scale(width: int, height: int) -> float:
    """Return how much larger than a frame its picture in the overlay is."""
    if max(width, height) > _LARGE:
        return _LARGE / max(width, height)
    return max(1, min(math.ceil(_SMALL[0] / width), math.ceil(_SMALL[1] / height)))


class SeenParts(NamedTuple):
    """The detections in one frame of one camera."""

    image: Image  # red, green, blue, shape (height, width, 3), in which it was found
    peg: Detection
    hole: Detection

    @property
    def error(self) -> Array:
        """Of :func:`chamfer.systems.vision.part_detector.alignment_error`, shape (3,)."""
        return alignment_error(self.peg, self.hole)


class Caption(NamedTuple):
    """Which frame is shown."""

    frame: int
    time: float  # s, or NaN
    name: str  # of its file
    note: str = ""  # a further line


def draw(seen: SeenParts, caption: Caption) -> Image:
    """Return a frame with the axes that were found, the tips as crosses, and a panel below.

    A point (u, v) of the frame is at ``s (u + 1/2) - 1/2`` and likewise in v, where s is
    :func:`scale`: (0, 0) is the middle of the first pixel in both.
    """
    height, width = seen.image.shape[:2]
    s = scale(width, height)
    size = (max(round(s * width), 1), max(round(s * height), 1))
    picture = cv2.resize(
        seen.image, size, interpolation=cv2.INTER_NEAREST if s >= 1 else cv2.INTER_AREA
    )
    unit = max(1, round(max(size) / 960))  # pixels, half the width of a line
    parts = ((seen.peg, PEG_COLOUR), (seen.hole, HOLE_COLOUR))
    for part, colour in parts:
        if not part.status.lost:
            middle = s * (np.array(part.point) + 0.5) - 0.5
            way = sum(picture.shape[:2]) * _along(part)
            _line(picture, middle - way, middle + way, colour, unit)
    for part, colour in parts:  # above both axes
        if part.status == Status.VALID:
            tip = s * (np.array(part.tip) + 0.5) - 0.5
            along = _along(part)
            across = np.array([-along[1], along[0]])
            for way in (along + across, along - across):
                _line(picture, tip - 7 * unit * way, tip + 7 * unit * way, colour, unit)

    full = max(size[0], _PANEL_WIDTH)
    unit_text = min(full / _PANEL_WIDTH, 2.0)
    panel_height = round((_ROWS + bool(caption.note) + 0.5) * _ROW * unit_text)
    # The encoder halves the resolution of colours and so wants even sides.
    rows, columns = (one + one % 2 for one in (size[1] + panel_height, full))
    sheet = np.full((rows, columns, 3), _DARK, np.uint8)
    sheet[: size[1], : size[0]] = picture
    _write_panel(sheet[size[1] :], seen, caption, unit_text)
    return sheet


def _along(part: Detection) -> Array:
    return np.array([math.cos(part.angle), math.sin(part.angle)])


def _line(
    picture: cv2.typing.MatLike, start: Array, end: Array, colour: Colour, unit: int
) -> None:
    """Draw a line with a dark rim, which is seen on any ground."""
    ends = [np.rint(point * 2**_SHIFT).astype(int).tolist() for point in (start, end)]
    for ink, thickness in ((_INK, 4 * unit), (colour, 2 * unit)):
        cv2.line(picture, ends[0], ends[1], ink, thickness, cv2.LINE_AA, _SHIFT)


def _write_panel(panel: Image, seen: SeenParts, caption: Caption, unit: float) -> None:
    # Each at a place of its own, so that nothing moves when a number gets longer.
    moment = "" if math.isnan(caption.time) else f"{caption.time:.4f} s"
    lines = (
        (_PAPER, {10: f"frame {caption.frame}", 170: moment, 280: caption.name}),
        (PEG_COLOUR, {10: "peg", **_found(seen.peg)}),
        (HOLE_COLOUR, {10: "hole part", **_found(seen.hole)}),
        (_PAPER, {10: "error", **_error(seen.error)}),
        (_PAPER, {10: caption.note}),
    )
    for k, (colour, texts) in enumerate(lines):
        for x, text in texts.items():
            _text(panel, text, (round(x * unit), round((k + 1) * _ROW * unit)), colour, unit)


def _text(panel: Image, text: str, at: tuple[int, int], colour: Colour, unit: float) -> None:
    font, size, thickness = cv2.FONT_HERSHEY_SIMPLEX, 0.5 * unit, max(1, round(unit))
    text = text.encode("ascii", "replace").decode()
    shown = text
    while shown and at[0] + cv2.getTextSize(shown, font, size, thickness)[0][0] > panel.shape[1]:
        text = text[:-1]
        shown = f"{text}..."
    cv2.putText(panel, shown, at, font, size, colour, thickness, cv2.LINE_AA)


def _found(part: Detection) -> dict[int, str]:
    """Return texts by where they begin, pixels of a panel of the least width."""
    texts = {100: REASONS[part.status]}
    if part.status == Status.VALID:
        texts[170] = "tip ({:.2f}, {:.2f}) px".format(*part.tip)
    if not part.status.lost:
        texts[420] = f"axis {part.angle:+.4f} rad"
    return texts


def _error(error: Array) -> dict[int, str]:
    along, across, angle = (
        "-" if math.isnan(value) else f"{value:+.{digits}f} {unit}"
        for value, digits, unit in zip(error.tolist(), (2, 2, 4), ("px", "px", "rad"), strict=True)
    )
    return {100: f"along {along}", 260: f"across {across}", 420: f"angle {angle}"}


_SLOWEST, _FASTEST = 1.0, 240.0  # frames/s that players take
_CODE: Final = cv2.VideoWriter.fourcc(*"VP80")
_UNKNOWN: Final = 30.0  # frames/s, where nobody says how fast frames were taken
_LIVE: Final = 15.0  # frames/s; encoding takes longer than detection


class Overlay:
    """Writes a .webm video of the detections in each frame while the block runs.

    The rate is in frames/s, or NaN; the video plays at 1 to 240.
    """

    def __init__(self, path: Path, rate: float) -> None:
        self._path = path
        rate = _UNKNOWN if math.isnan(rate) else rate
        self._rate = round(min(max(rate, _SLOWEST), _FASTEST), 3)
        self._writer: cv2.VideoWriter | None = None
        self._last: cv2.typing.MatLike | None = None
        self._written = 0

    def show(self, seen: Sequence[SeenParts], captions: Sequence[Caption]) -> None:
        """Append the detections in the frames of one moment.

        Raises:
            UserError: If the video can't be written.
        """
        self.write(sheet(seen, captions))

    def write(self, image: Image, time: float | None = None) -> None:
        """Append an image of the same even size as all others.

        It is shown at a time, s after the first one: the one before stays until then. Sooner than
        a frame's length after it, the image is left out. None: after the one before.
        """
        if self._writer is None:
            width, height = image.shape[1::-1]
            with silenced(), utf8_path(self._path) as name:
                size = (width, height)
                writer = cv2.VideoWriter(name, cv2.CAP_FFMPEG, _CODE, self._rate, size)
            if not writer.isOpened():
                raise UserError(f"{self._path.name} can't be written, {width} x {height} pixels")
            self._writer = writer
        picture = cv2.cvtColor(image, cv2.COLOR_RGB2BGR)
        due = self._written if time is None else round(time * self._rate)
        while self._last is not None and self._written < due:
            self._writer.write(self._last)
            self._written += 1
        if self._written <= due:
            self._writer.write(picture)
            self._last, self._written = picture, self._written + 1

    def close(self) -> None:
        """Complete the file; nothing can be appended any more."""
        if self._writer is not None:
            self._writer.release()


class LiveOverlay(Overlay):
    """Writes the video of live frames, at their own times.

    A thread draws and encodes, and takes the next frame when it is done with one.
    """

    def __init__(self, path: Path) -> None:
        super().__init__(path, _LIVE)
        self._next: queue.Queue[tuple[Sequence[SeenParts], Sequence[Caption]] | None]
        self._next = queue.Queue(1)
        self._fault: UserError | None = None
        self._thread = threading.Thread(target=self._draw, daemon=True)
        self._thread.start()

    def show(self, seen: Sequence[SeenParts], captions: Sequence[Caption]) -> None:
        """Show the detections, unless other frames are still being drawn."""
        if self._fault is not None:
            raise self._fault
        if not self._next.full():
            self._next.put((seen, captions))

    def close(self) -> None:
        """Complete the file."""
        if self._thread.is_alive():
            self._next.put(None)
            self._thread.join()
        super().close()

    def _draw(self) -> None:
        while (shown := self._next.get()) is not None:
            if self._fault is None:
                try:
                    self.write(sheet(*shown), shown[1][0].time)
                except UserError as error:
                    self._fault = error


def sheet(seen: Sequence[SeenParts], captions: Sequence[Caption]) -> Image:
    """Return the detections in the frames of all cameras, side by side."""
    sheets = list(map(draw, seen, captions))
    height = max(len(one) for one in sheets)
    return np.hstack([np.pad(one, ((0, height - len(one)), (0, 0), (0, 0))) for one in sheets])
