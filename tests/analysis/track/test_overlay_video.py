"""The overlay's video: beside a live camera it never keeps anyone waiting."""

import threading
from pathlib import Path

import cv2
import numpy as np
import pytest

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track import overlay_video
from chamfer.analysis.track.detection_overlay import Caption
from chamfer.analysis.track.overlay_video import LiveOverlay, sheet
from chamfer.analysis.track.part_finder import Seen, Sighting
from chamfer.systems.vision.part_detection import Detection, Status

NOTHING = Detection(status=Status.NO_COLOUR)


def sighting(*levels: int, width: int = 64) -> Sighting:
    seen = [
        Seen(image=np.full((48, width, 3), level, np.uint8), peg=NOTHING, hole=NOTHING)
        for level in levels
    ]
    return Sighting(seen=tuple(seen), values=[])


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

    monkeypatch.setattr(overlay_video, "sheet", slow)
    path = tmp_path / "a.webm"
    overlay = LiveOverlay(path)
    overlay.show(sighting(100), caption(0.0))
    assert begun.wait(30)
    for time, level in ((0.1, 150), (0.2, 10), (0.3, 10)):
        overlay.show(sighting(level), caption(time))  # only the first of them waits
    go.set()
    overlay.close()
    capture, found = cv2.VideoCapture(str(path)), []
    while (frame := capture.read())[0]:
        found.append(int(frame[1][24, 32].mean()))
    # The first one stays until the second one's time, 0.1 s in frames of 1/15 s.
    assert found == pytest.approx([100, 100, 150], abs=6)


def test_what_goes_wrong_is_said_by_the_next_frame(tmp_path: Path) -> None:
    overlay = LiveOverlay(tmp_path / "no folder" / "a.webm")
    overlay.show(sighting(100), caption(0.0))
    overlay.close()
    with pytest.raises(UserError, match=r"a\.webm can't be written"):
        overlay.show(sighting(100), caption(0.1))


def test_cameras_are_side_by_side() -> None:
    both = sheet(sighting(100, 50), [Caption(0, 0.0, "a"), Caption(0, 0.0, "b")])
    one = sheet(sighting(100), caption(0.0))
    assert both.shape == (one.shape[0], 2 * one.shape[1], 3)
    assert (both[10, 10, 0], both[10, one.shape[1] + 10, 0]) == (100, 50)
