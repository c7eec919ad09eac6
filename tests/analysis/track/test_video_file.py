"""Videos: every image, at its time, and played by a browser."""

import base64
import os
import shutil
import signal
import subprocess
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path
from queue import Queue

import cv2
import numpy as np
import pytest

from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track.overlay_video import VideoFile

Array = np.ndarray


def test_video_has_every_image_and_its_rate(tmp_path: Path) -> None:
    path = tmp_path / "a.webm"
    with VideoFile(path, 80.0) as video:
        for level in (50, 100, 150):
            video.write(np.full((48, 64, 3), (level, 20, 10), np.uint8))
    capture = cv2.VideoCapture(str(path))
    assert capture.get(cv2.CAP_PROP_FPS) == pytest.approx(80)
    found = [capture.read()[1][24, 32].tolist() for _ in range(3)]
    for level, bgr in zip((50, 100, 150), found, strict=True):
        assert bgr == pytest.approx([10, 20, level], abs=6)
    assert not capture.read()[0]


@pytest.mark.parametrize(
    ("rate", "played"), [(1e-3, 1), (23.976, 23.98), (80.0049, 80), (1e5, 240), (1 / 0.03, 33.33)]
)
def test_rates_that_the_encoder_would_not_take(tmp_path: Path, rate: float, played: float) -> None:
    path = tmp_path / "a.webm"
    with VideoFile(path, rate) as video:
        for _ in range(5):
            video.write(np.zeros((48, 64, 3), np.uint8))
    assert cv2.VideoCapture(str(path)).get(cv2.CAP_PROP_FPS) == pytest.approx(played, rel=1e-3)


def levels(path: Path) -> list[int]:
    capture, found = cv2.VideoCapture(str(path)), []
    while (frame := capture.read())[0]:
        found.append(int(frame[1].mean()))
    return found


def grey(level: int, size: tuple[int, int] = (64, 48)) -> Array:
    return np.full((size[1], size[0], 3), level, np.uint8)


def test_images_with_times_stay_until_the_next_one(tmp_path: Path) -> None:
    path = tmp_path / "a.webm"
    with VideoFile(path, 10.0) as video:
        for time, level in ((0.0, 50), (0.1, 100), (0.11, 250), (0.42, 150), (0.5, 200)):
            video.write(grey(level), time)
    assert levels(path) == pytest.approx([50, 100, 100, 100, 150, 200], abs=5)


def test_a_video_that_the_encoder_does_not_take(
    tmp_path: Path, capfd: pytest.CaptureFixture[str]
) -> None:
    said = r"a\.webm can't be written, 16400 x 16 pixels"
    with VideoFile(tmp_path / "a.webm", 30.0) as video, pytest.raises(UserError, match=said):
        video.write(grey(0, (16400, 16)))
    assert capfd.readouterr().err == ""


def test_a_name_that_is_no_text(tmp_path: Path) -> None:
    path = tmp_path / "a\udcff.webm"
    with VideoFile(path, 30.0) as video:
        video.write(grey(90))
    copy = tmp_path / "copy.webm"
    copy.write_bytes(path.read_bytes())
    assert levels(copy) == pytest.approx([90], abs=5)
    assert [one.name for one in tmp_path.iterdir()].count(path.name) == 1


PAGE = """<!doctype html><video id="video" muted></video><script>
const video = document.getElementById("video");
const say = (...words) => fetch("/said/" + words.join("/"));
video.onerror = () => say(video.error.message);
video.onloadeddata = () => { video.currentTime = 0.25; };
video.onseeked = () => {
  const canvas = document.createElement("canvas").getContext("2d");
  canvas.drawImage(video, 0, 0);
  const colour = canvas.getImageData(32, 24, 1, 1).data;
  say(video.videoWidth, video.videoHeight, video.duration, ...colour);
};
video.src = "data:video/webm;base64,DATA";
</script>"""


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("chromium") is None, reason="needs the browser Chromium")
def test_a_browser_plays_it(tmp_path: Path) -> None:
    path = tmp_path / "a.webm"
    with VideoFile(path, 10.0) as video:
        for level in (50, 100, 150, 200):
            video.write(np.full((48, 64, 3), (level, 20, 10), np.uint8))
    page = PAGE.replace("DATA", base64.b64encode(path.read_bytes()).decode())
    said: Queue[str] = Queue()

    class Server(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if self.path.startswith("/said/"):
                said.put(self.path.removeprefix("/said/"))
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()
            self.wfile.write(page.encode() if self.path == "/" else b"")

        def log_message(self, *_: object) -> None:
            pass

    with HTTPServer(("localhost", 0), Server) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        options = ["--headless", "--no-sandbox", "--disable-gpu", f"--user-data-dir={tmp_path}/u"]
        address = f"http://localhost:{server.server_port}/"
        with subprocess.Popen(
            ["chromium", *options, "--remote-debugging-port=0", address],
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
            start_new_session=True,
        ) as browser:
            try:
                words = said.get(timeout=60)
            finally:
                os.killpg(browser.pid, signal.SIGKILL)
        server.shutdown()
    width, height, duration, red, green, blue, _ = map(float, words.split("/"))
    assert (width, height) == (64, 48)
    assert duration == pytest.approx(0.4, abs=0.1)
    assert (red, green, blue) == pytest.approx((150, 20, 10), abs=12)
