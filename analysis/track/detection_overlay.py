"""What was detected, drawn over the frames.

Below the frame a panel says in words what was found, so that no text covers a part.
"""

import math
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray

from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.vision.part_detection import Detection, Status

Array = NDArray[np.float64]
Colour = tuple[int, int, int]  # red, green, blue

PEG_COLOUR: Final[Colour] = (255, 221, 51)
HOLE_COLOUR: Final[Colour] = (51, 238, 238)

REASONS: Final = {
    Status.VALID: "valid",
    Status.OCCLUDED: "occluded: no background beyond its end",
    Status.NO_IMAGE: "lost: no image",
    Status.NO_COLOUR: "lost: not enough of its colour",
    Status.AT_BORDER: "lost: the image ends before the part does",
    Status.NOT_STRAIGHT: "lost: no two long straight edges",
    Status.NO_CONTRAST: "lost: background too dark or too much like the part",
    Status.WRONG_SIZE: "lost: wider or narrower than the part can be",
    Status.WRONG_SHAPE: "lost: too long or too short, or not the part's end",
    Status.SHARED: "lost: its pixels are taken for the other part's, too",
    Status.AMBIGUOUS: "lost: more than one thing looks like it",
    Status.JUMPED: "lost: too far from where it was a moment ago",
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


class Caption(NamedTuple):
    """Which frame is shown."""

    frame: int
    time: float  # s, or NaN
    name: str  # of its file


def draw(
    image: Image, peg: Detection, hole: Detection, error: Array, caption: Caption, note: str = ""
) -> Image:
    """Return a frame with the axes that were found, the tips as crosses, and a panel below.

    A point (u, v) of the frame is at ``s (u + 1/2) - 1/2`` and likewise in v, where s is
    :func:`scale`: (0, 0) is the middle of the first pixel in both.

    Args:
        image: Red, green, blue, shape (height, width, 3).
        peg: What was found of the peg.
        hole: What was found of the hole part.
        error: Of :func:`chamfer.systems.vision.part_detector.alignment_error`.
        caption: Which frame it is.
        note: A further line of the panel, none if it is empty.
    """
    height, width = image.shape[:2]
    s = scale(width, height)
    size = (max(round(s * width), 1), max(round(s * height), 1))
    picture = cv2.resize(
        image, size, interpolation=cv2.INTER_NEAREST if s >= 1 else cv2.INTER_AREA
    )
    unit = max(1, round(max(size) / 960))  # pixels, half the width of a line
    parts = ((peg, PEG_COLOUR), (hole, HOLE_COLOUR))
    for part, colour in parts:
        _draw_axis(picture, part, colour, s, unit)
    for part, colour in parts:  # above both axes
        _draw_tip(picture, part, colour, s, unit)

    full = max(size[0], _PANEL_WIDTH)
    unit_text = min(full / _PANEL_WIDTH, 2.0)
    panel_height = round((_ROWS + bool(note) + 0.5) * _ROW * unit_text)
    # The encoder halves the resolution of colours and so wants even sides.
    sheet = np.full((_even(size[1] + panel_height), _even(full), 3), _DARK, np.uint8)
    sheet[: size[1], : size[0]] = picture
    _write_panel(sheet[size[1] :], peg, hole, error, caption, note, unit_text)
    return sheet


def _even(size: int) -> int:
    return size + size % 2


def _draw_axis(
    picture: cv2.typing.MatLike, part: Detection, colour: Colour, s: float, unit: int
) -> None:
    if not part.status.lost:
        middle = s * (np.array(part.point) + 0.5) - 0.5
        way = sum(picture.shape[:2]) * _along(part)
        _line(picture, middle - way, middle + way, colour, unit)


def _draw_tip(
    picture: cv2.typing.MatLike, part: Detection, colour: Colour, s: float, unit: int
) -> None:
    if part.status == Status.VALID:
        tip = s * (np.array(part.tip) + 0.5) - 0.5
        along = _along(part)
        across = np.array([-along[1], along[0]])
        for way in (along + across, along - across):
            _line(picture, tip - 7 * unit * way, tip + 7 * unit * way, colour, unit)


def _along(part: Detection) -> Array:
    return np.array([math.cos(part.angle), math.sin(part.angle)])


def _line(
    picture: cv2.typing.MatLike, start: Array, end: Array, colour: Colour, unit: int
) -> None:
    """Draw a line with a dark rim, which is seen on any ground."""
    ends = [np.rint(point * 2**_SHIFT).astype(int).tolist() for point in (start, end)]
    for ink, thickness in ((_INK, 4 * unit), (colour, 2 * unit)):
        cv2.line(picture, ends[0], ends[1], ink, thickness, cv2.LINE_AA, _SHIFT)


def _write_panel(
    panel: Image,
    peg: Detection,
    hole: Detection,
    error: Array,
    caption: Caption,
    note: str,
    unit: float,
) -> None:
    # Each at a place of its own, so that nothing moves when a number gets longer.
    moment = "" if math.isnan(caption.time) else f"{caption.time:.4f} s"
    lines = (
        (_PAPER, {10: f"frame {caption.frame}", 170: moment, 280: caption.name}),
        (PEG_COLOUR, {10: "peg", **_found(peg)}),
        (HOLE_COLOUR, {10: "hole part", **_found(hole)}),
        (_PAPER, {10: "error", **_error(error)}),
        (_PAPER, {10: note}),
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
