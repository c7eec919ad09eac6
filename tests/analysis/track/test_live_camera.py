"""A live camera: frames as they come, and every way in which it ends."""

import time
from collections.abc import Callable
from contextlib import nullcontext
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from chamfer.analysis.cli import main
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track import frame_source, tracking
from chamfer.analysis.track.frame_source import CameraError, LiveCamera, device_path

DEVICE = Path("/dev/null")

Rows = Callable[[Path], list[dict[str, str]]]


@pytest.mark.parametrize("stamps", [True, False])
def test_frames_have_the_times_at_which_they_were_taken(
    camera: SimpleNamespace, stamps: bool
) -> None:
    camera.STAMPS, camera.COUNT = stamps, 6
    with LiveCamera(DEVICE, (640, 480)) as live:
        asked = {cv2.CAP_PROP_FRAME_WIDTH: 640, cv2.CAP_PROP_FRAME_HEIGHT: 480}
        assert live._capture.asked == asked
        assert live.rate == pytest.approx(50)
        frames = live.frames()
        first = next(frames)
        time.sleep(0.1)  # while it waits its frames are kept, and their times do not change
        found = [first, *(next(frames) for _ in range(5))]
    assert [frame.name for frame in found] == [f"frame{k:06d}.png" for k in range(6)]
    times = [frame.time for frame in found]
    assert times[0] == 0
    gaps = np.diff(np.array(times, dtype=float))
    assert ((gaps >= camera.PERIOD) & (gaps < 3 * camera.PERIOD)).all()
    np.testing.assert_array_equal(first.image, cv2.cvtColor(camera.PICTURES[0], cv2.COLOR_BGR2RGB))


def test_what_comes_too_fast_is_counted(camera: SimpleNamespace) -> None:
    camera.PERIOD = 0.001
    with LiveCamera(DEVICE) as live:
        frames = live.frames()
        next(frames)
        time.sleep(0.1)
        assert live.missed > 10


def test_a_stop_is_heard_while_it_waits(camera: SimpleNamespace) -> None:
    camera.COUNT = 0
    asked = iter([False, False, True])
    with LiveCamera(DEVICE) as live:
        assert list(live.frames(lambda: next(asked))) == []


def test_a_camera_that_is_unplugged(camera: SimpleNamespace, tmp_path: Path) -> None:
    camera.COUNT = 0
    live = LiveCamera(DEVICE)
    with live:
        live._path = tmp_path / "video0"
        with pytest.raises(CameraError, match="video0 has gone"):
            next(live.frames())


ALLOWED = "allowed: the number of a camera, as 0 for /dev/video0, or its path"


def test_devices_that_are_none(tmp_path: Path) -> None:
    file = tmp_path / "file"
    file.touch()
    for text, said in (
        ("999", "/dev/video999: No such file or directory"),
        ("", ". is no device"),
        ("-1", "-1: No such file or directory"),
        (str(file), f"{file} is no device"),
        ("a\0b", "a\0b: embedded null byte"),
        ("x" * 300, f"{'x' * 300}: File name too long"),
    ):
        with pytest.raises(UserError) as raised:
            device_path(text)
        assert str(raised.value) == f"{said}, {ALLOWED}"
    with pytest.raises(UserError, match=r"^/dev/null can't be opened as a camera"):
        LiveCamera(device_path("/dev/null")).__enter__()


def test_a_number_of_frames(
    rows: Rows, camera: SimpleNamespace, out: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    arguments = ["track", "--device", "/dev/null", "--out", str(out)]
    assert main([*arguments, "--frames", "5", "--save-frames"]) == 0
    printed = capsys.readouterr()
    assert printed.err == ""
    assert printed.out.startswith("5 frames, 320 x 240 pixels, 50 frames/s, both parts valid in 5")
    assert str(out / "track" / "frames") in printed.out.splitlines()
    live = rows(out)
    assert [row["file"] for row in live] == [f"frame{k:06d}.png" for k in range(5)]
    times = [float(row["time"]) for row in live]
    assert min(np.diff(times)) >= camera.PERIOD

    # What was kept is a recording of the same.
    again = out / "again"
    assert main(["track", str(out / "track" / "frames"), "--out", str(again)]) == 0
    for row, first in zip(rows(again), live, strict=True):
        assert {**row, "time": ""} == {**first, "time": ""}
    capsys.readouterr()
    assert main([*arguments, "--frames", "5", "--save-frames"]) == 2
    assert "frames holds what was kept before, allowed: another --out" in capsys.readouterr().err


def test_a_camera_is_asked_for_its_models_size(
    camera: SimpleNamespace, out: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    file = tmp_path / "camera.yaml"
    text = "{{width: {}, height: 240, focal_length: [1000, 1000], principal_point: [160, 120], "
    text += "distortion: [-0.1, 0, 0, 0, 0]}}\n"
    arguments = ["track", "--device", "/dev/null", "--out", str(out), "--frames", "2"]
    for width, status in ((320, 0), (640, 2)):
        file.write_text(text.format(width))
        assert main([*arguments, "--camera-model", str(file)]) == status
    said = "chamfer: a frame is 320 x 240 pixels, allowed: 640 x 240 as the camera model says\n"
    assert capsys.readouterr().err.endswith(said)


def test_ctrl_c_ends_it_as_it_is_meant_to_end(
    rows: Rows,
    camera: SimpleNamespace,
    out: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def stop_request() -> nullcontext[Callable[[], bool]]:
        return nullcontext(lambda: len(list(saved.glob("*.png"))) >= 4)

    saved = out / "track" / "frames"
    monkeypatch.setattr(tracking, "stop_request", stop_request)
    assert main(["track", "--device", "/dev/null", "--out", str(out), "--save-frames"]) == 0
    printed = capsys.readouterr()
    assert printed.err == "chamfer: frames of /dev/null as they come, Ctrl-C ends it\n"
    assert printed.out.startswith("4 frames, 320 x 240 pixels")
    assert [row["file"] for row in rows(out)] == sorted(path.name for path in saved.iterdir())
    assert sorted(path.name for path in out.iterdir()) == ["track"]


def test_a_camera_that_stops_keeps_what_was_found(
    rows: Rows,
    camera: SimpleNamespace,
    out: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    camera.COUNT = 3
    monkeypatch.setattr(frame_source, "_SILENT", 0.15)
    assert main(["track", "--device", "/dev/null", "--out", str(out)]) == 1
    printed = capsys.readouterr()
    assert printed.out.startswith("3 frames")
    assert printed.err == (
        "chamfer: frames of /dev/null as they come, Ctrl-C ends it\n"
        "chamfer: /dev/null has sent nothing for 0.15 s, what was found in 3 frames is kept\n"
    )
    assert len(rows(out)) == 3


def test_a_camera_that_sends_nothing(
    camera: SimpleNamespace,
    out: Path,
    capsys: pytest.CaptureFixture[str],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    camera.COUNT = 0
    monkeypatch.setattr(frame_source, "_WAKING", 0.15)
    arguments = ["track", "--device", "/dev/null", "--out", str(out), "--frames", "2"]
    assert main([*arguments, "--save-frames"]) == 1
    assert capsys.readouterr() == ("", "chamfer: /dev/null has sent nothing for 0.15 s\n")
    assert list(out.rglob("*")) == []
