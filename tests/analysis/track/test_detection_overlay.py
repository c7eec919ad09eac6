"""What the overlay shows and where, and its video, at its times and keeping no one waiting."""

import math
import threading
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track import detection_overlay
from chamfer.analysis.track.detection_overlay import (
    HOLE_COLOUR,
    PEG_COLOUR,
    REASONS,
    Caption,
    LiveOverlay,
    Overlay,
    SeenParts,
    draw,
    scale,
    sheet,
)
from chamfer.systems.vision.detections import Detection, Status

Array = np.ndarray
NOTHING = Detection(status=Status.NO_COLOUR)
CAPTION = Caption(3, 0.0375, "frame3.png")


def valid(u: float, v: float, angle: float = 0.0) -> Detection:
    back = (u - 30 * math.cos(angle), v - 30 * math.sin(angle))
    return Detection(status=Status.VALID, tip=(u, v), angle=angle, point=back)


def drawn(peg: Detection = NOTHING, hole: Detection = NOTHING, width: int = 320) -> Array:
    image = np.full((240, width, 3), 200, np.uint8)
    return draw(SeenParts(image, peg, hole), CAPTION)


def ink(sheet: Array, colour: tuple[int, int, int], rows: slice = slice(None)) -> Array:
    """Return where a colour is, as u and v in the overlay."""
    near = np.abs(sheet[rows].astype(int) - colour).max(axis=2) < 60
    v, u = np.nonzero(near)
    return np.column_stack([u, v + (rows.start or 0)])


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


@pytest.mark.parametrize("status", list(Status))
def test_a_lost_part_is_not_drawn_and_its_reason_says_so(status: Status) -> None:
    assert REASONS[status].startswith("lost: ") == status.lost
    seen = {} if status.lost else {"angle": 0.0, "point": (100.0, 100.0)}
    tip = {"tip": (160.0, 100.0)} if status == Status.VALID else {}
    picture = ink(drawn(Detection(status=status, **seen, **tip)), PEG_COLOUR, slice(0, 480))
    assert (len(picture) == 0) == status.lost


def test_the_scale_is_a_whole_number_of_pixels_where_it_can_be() -> None:
    sizes = {(320, 240): 2, (640, 480): 1, (100, 75): 7, (100, 2000): 0.96, (3840, 2160): 0.5}
    assert {size: scale(*size) for size in sizes} == sizes


@pytest.mark.parametrize(
    "size", [(16, 16), (33, 17), (101, 75), (50, 900), (1921, 1081), (5000, 16)]
)
def test_any_size_has_even_sides_and_room_for_the_text(size: tuple[int, int]) -> None:
    width, height = size
    image = np.full((height, width, 3), 200, np.uint8)
    hole = valid(width / 2, height / 2, 0.01)
    seen = SeenParts(image, valid(width + 1000, height + 1000, -1.0), hole)
    sheet = draw(seen, Caption(1234567, 12345.6789, "n" * 300 + "ä.png", "n" * 300))
    assert sheet.shape[0] % 2 == sheet.shape[1] % 2 == 0
    assert sheet.shape[1] >= 640
    assert max(sheet.shape[:2]) <= 2200


@pytest.mark.parametrize(
    ("rate", "played"), [(1e-3, 1), (23.976, 23.98), (80.0049, 80), (1e5, 240), (1 / 0.03, 33.33)]
)
def test_rates_that_the_encoder_would_not_take(tmp_path: Path, rate: float, played: float) -> None:
    path = tmp_path / "a.webm"
    write(path, rate, [(None, 0)] * 5)
    assert cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FPS) == pytest.approx(played, rel=1e-3)


def write(path: Path, rate: float, images: list[tuple[float | None, int]]) -> None:
    """Write a video of grey images, their times and levels given."""
    video = Overlay(path, rate)
    for time, level in images:
        video.write(np.full((48, 64, 3), level, np.uint8), time)
    video.close()


def levels(path: Path, where: Any = ...) -> list[int]:
    capture, found = cv2.VideoCapture(str(path)), []
    while (frame := capture.read())[0]:
        found.append(int(frame[1][where].mean()))
    return found


def test_images_with_times_stay_until_the_next_one(tmp_path: Path) -> None:
    path = tmp_path / "a.webm"
    write(path, 10.0, [(0.0, 50), (0.1, 100), (0.11, 250), (0.42, 150), (0.5, 200)])
    assert levels(path) == pytest.approx([50, 100, 100, 100, 150, 200], abs=5)


def test_a_video_that_the_encoder_does_not_take(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    said = r"a\.webm can't be written, 16400 x 16 pixels"
    with pytest.raises(UserError, match=said):
        Overlay(tmp_path / "a.webm", 30.0).write(np.zeros((16, 16400, 3), np.uint8))
    assert capfd.readouterr().err == ""


def seen(*levels: int) -> list[SeenParts]:
    return [SeenParts(np.full((48, 64, 3), one, np.uint8), NOTHING, NOTHING) for one in levels]


def caption(time: float) -> list[Caption]:
    return [Caption(0, time, "a.png")]


def test_a_frame_that_comes_while_another_is_drawn_is_left_out(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    begun, go = threading.Event(), threading.Event()

    def slow(*arguments: object) -> np.ndarray:
        begun.set()
        assert go.wait(30)
        return sheet(*arguments)  # type: ignore[arg-type]

    monkeypatch.setattr(detection_overlay, "sheet", slow)
    path = tmp_path / "a.webm"
    overlay = LiveOverlay(path)
    overlay.show(seen(100), caption(0.0))
    assert begun.wait(30)
    for time, level in ((0.1, 150), (0.2, 10), (0.3, 10)):
        overlay.show(seen(level), caption(time))  # only the first of them waits
    go.set()
    overlay.close()
    # The first one stays until the second one's time, 0.1 s in frames of 1/15 s.
    assert levels(path, np.s_[24, 32]) == pytest.approx([100, 100, 150], abs=6)


def test_what_goes_wrong_is_said_by_the_next_frame(tmp_path: Path) -> None:
    overlay = LiveOverlay(tmp_path / "no folder" / "a.webm")
    overlay.show(seen(100), caption(0.0))
    overlay.close()
    with pytest.raises(UserError, match=r"a\.webm can't be written"):
        overlay.show(seen(100), caption(0.1))


def test_cameras_are_side_by_side() -> None:
    both = sheet(seen(100, 50), [Caption(0, 0.0, "a"), Caption(0, 0.0, "b")])
    one = sheet(seen(100), caption(0.0))
    assert both.shape == (one.shape[0], 2 * one.shape[1], 3)
    assert (both[10, 10, 0], both[10, one.shape[1] + 10, 0]) == (100, 50)


def test_a_name_that_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "a\udcff.webm"
    write(path, 30.0, [(None, 90)])
    copy = tmp_path / "copy.webm"
    copy.write_bytes(path.read_bytes())
    assert levels(copy) == pytest.approx([90], abs=5)
    assert [one.name for one in tmp_path.iterdir()].count(path.name) == 1
