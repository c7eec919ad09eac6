"""What the overlay shows, and where."""

import math

import numpy as np
import pytest

from chamfer.analysis.track.detection_overlay import (
    HOLE_COLOUR,
    PEG_COLOUR,
    REASONS,
    Caption,
    draw,
    scale,
)
from chamfer.systems.vision.part_detection import Detection, Status

Array = np.ndarray
NOTHING = Detection(status=Status.NO_COLOUR)
NO_ERROR = np.full(3, math.nan)
CAPTION = Caption(3, 0.0375, "frame3.png")


def valid(u: float, v: float, angle: float = 0.0) -> Detection:
    back = (u - 30 * math.cos(angle), v - 30 * math.sin(angle))
    return Detection(status=Status.VALID, tip=(u, v), angle=angle, point=back)


def drawn(peg: Detection = NOTHING, hole: Detection = NOTHING, width: int = 320) -> Array:
    image = np.full((240, width, 3), 200, np.uint8)
    return draw(image, peg, hole, NO_ERROR, CAPTION)


def ink(sheet: Array, colour: tuple[int, int, int], rows: slice = slice(None)) -> Array:
    """Return where a colour is, as u and v in the overlay."""
    near = np.abs(sheet[rows].astype(int) - colour).max(axis=2) < 60
    v, u = np.nonzero(near)
    return np.column_stack([u, v + (rows.start or 0)])


@pytest.mark.parametrize(
    ("size", "factor"),
    [
        ((320, 240), 2),
        ((640, 480), 1),
        ((400, 300), 2),
        ((100, 75), 7),
        ((100, 2000), 1920 / 2000),
        ((1920, 1080), 1),
        ((3840, 2160), 0.5),
    ],
)
def test_scale(size: tuple[int, int], factor: float) -> None:
    assert scale(*size) == factor


def test_cross_is_at_the_tip() -> None:
    peg, hole = valid(100.3, 80.6, 0.1), valid(220.0, 150.0, -0.05)
    sheet = drawn(peg, hole)
    for part, colour in ((peg, PEG_COLOUR), (hole, HOLE_COLOUR)):
        u, v = 2 * (np.array(part.tip) + 0.5) - 0.5
        found = ink(sheet, colour, slice(0, 480))
        along = np.array([math.cos(part.angle), math.sin(part.angle)])
        # Beside the axis there is the cross only.
        beside = (found - (u, v)) @ [-along[1], along[0]]
        cross = found[np.abs(beside) > 3]
        assert len(cross) > 20
        np.testing.assert_allclose(cross.mean(axis=0), (u, v), atol=0.3)
        assert np.abs(cross - (u, v)).max() < 14


def test_first_pixel_of_the_frame_and_of_the_overlay_have_one_corner() -> None:
    image = np.zeros((240, 320, 3), np.uint8)
    image[50, 70] = 255
    sheet = draw(image, NOTHING, NOTHING, NO_ERROR, CAPTION)[:480]
    v, u = np.nonzero(sheet.min(axis=2) > 200)
    # The convention that also places the cross.
    assert (u.mean(), v.mean()) == (2 * 70.5 - 0.5, 2 * 50.5 - 0.5)


@pytest.mark.parametrize("status", list(Status))
def test_what_each_status_draws(status: Status) -> None:
    seen = {} if status.lost else {"angle": 0.0, "point": (100.0, 100.0)}
    tip = {"tip": (160.0, 100.0)} if status == Status.VALID else {}
    sheet = drawn(Detection(status=status, **seen, **tip))
    picture = ink(sheet, PEG_COLOUR, slice(0, 480))
    if status.lost:
        assert len(picture) == 0
    else:
        rows, columns = np.unique(picture[:, 1]), np.unique(picture[:, 0])
        assert len(columns) == 640
        assert (len(rows) > 5) == (status == Status.VALID)
    assert len(ink(sheet, PEG_COLOUR, slice(480, None))) > 50  # the words in the panel


def test_every_status_has_its_words() -> None:
    assert set(REASONS) == set(Status)
    assert len(set(REASONS.values())) == len(Status)
    for status, words in REASONS.items():
        assert words.startswith("lost: ") == status.lost


def test_panel_is_below_the_picture_and_leaves_it_alone() -> None:
    image = np.random.default_rng(0).integers(0, 256, (240, 320, 3), dtype=np.uint8)
    sheet = draw(image, NOTHING, NOTHING, NO_ERROR, CAPTION)
    np.testing.assert_array_equal(sheet[:480], image.repeat(2, axis=0).repeat(2, axis=1))


@pytest.mark.parametrize(
    "size", [(16, 16), (33, 17), (101, 75), (50, 900), (1921, 1081), (5000, 16)]
)
def test_any_size_has_even_sides_and_room_for_the_text(size: tuple[int, int]) -> None:
    width, height = size
    image = np.full((height, width, 3), 200, np.uint8)
    part = Detection(status=Status.OCCLUDED, angle=0.01, point=(width / 2, height / 2))
    caption = Caption(1234567, 12345.6789, "n" * 300 + "ä.png")
    error = np.array([-1000.0, 1000.0, -1.0])
    sheet = draw(image, part, NOTHING, error, caption, note="n" * 300)
    assert sheet.shape[0] % 2 == sheet.shape[1] % 2 == 0
    assert sheet.shape[1] >= 640
    assert max(sheet.shape[:2]) <= 2200


def test_a_note_has_a_line_of_its_own() -> None:
    image = np.full((240, 320, 3), 200, np.uint8)
    sheets = [draw(image, NOTHING, NOTHING, NO_ERROR, CAPTION, note) for note in ("", "a note")]
    rows = len(sheets[0])
    assert len(sheets[1]) > rows
    np.testing.assert_array_equal(sheets[0][:-12], sheets[1][: rows - 12])
    assert len(ink(sheets[1], (240, 240, 240), slice(rows - 12, None))) > 30
