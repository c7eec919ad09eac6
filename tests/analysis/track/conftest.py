"""Pictures of the parts, and a camera that shows them in place of a real one."""

import csv
import time
from collections.abc import Callable, Iterable
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform

from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.software_camera import render

PARTS = ColouredParts()


class FakeCamera:
    """The interface of cv2.VideoCapture with V4L2, as far as it is used.

    It waits for the next frame and says when it was taken on the monotonic clock.
    """

    def __init__(self, does: SimpleNamespace) -> None:
        self.does = does
        self.open, self.sent = True, 0
        self.asked: dict[int, float] = {}

    def isOpened(self) -> bool:  # noqa: N802
        return self.open

    def set(self, name: int, value: float) -> bool:
        self.asked[name] = value
        return True

    def get(self, name: int) -> float:
        if name == cv2.CAP_PROP_FPS:
            return 1 / self.does.PERIOD
        return 1e3 * self.taken if name == cv2.CAP_PROP_POS_MSEC and self.does.STAMPS else 0.0

    def read(self) -> tuple[bool, np.ndarray | None]:
        assert self.open
        if self.sent == self.does.COUNT:
            return False, None
        time.sleep(self.does.PERIOD)
        self.taken = time.monotonic() - 0.005
        self.sent += 1
        return True, self.does.PICTURES[self.sent % 2 - 1].copy()

    def release(self) -> None:
        self.open = False


def drawn(gap: float | None) -> np.ndarray:
    """Return a frame with a gap between the parts, m; None: of nothing."""
    if gap is None:
        return np.full((240, 320, 3), 200, np.uint8)
    peg, hole = RigidTransform([-gap, 0.001, 0]), RigidTransform([0.01, 0, 0])
    return render(PARTS, CameraPlacement().camera, peg, hole)


def save(path: Path, gap: float | None) -> None:
    """Save a frame with a gap between the parts, m; None: of nothing."""
    assert cv2.imwrite(str(path), cv2.cvtColor(drawn(gap), cv2.COLOR_RGB2BGR))


@pytest.fixture
def picture() -> Callable[[Path, float], None]:
    """Saves a frame with a gap between the parts, m."""
    return save


@pytest.fixture(scope="session")
def film() -> Callable[..., Path]:
    """Saves a video of images, red, green, blue, and returns its path."""

    def saved(
        path: Path, images: Iterable[np.ndarray], rate: float = 30.0, code: str = "MJPG"
    ) -> Path:
        images = list(images)
        size, kind = images[0].shape[1::-1], cv2.VideoWriter.fourcc(*code)
        writer = cv2.VideoWriter(str(path), cv2.CAP_FFMPEG, kind, rate, size)
        assert writer.isOpened()
        for image in images:
            writer.write(cv2.cvtColor(image, cv2.COLOR_RGB2BGR))
        writer.release()
        return path

    return saved


@pytest.fixture
def rows() -> Callable[[Path], list[dict[str, str]]]:
    """The lines of a run's table."""

    def read(out: Path) -> list[dict[str, str]]:
        with (out / "track" / "detections.csv").open(encoding="utf-8", newline="") as file:
            return list(csv.DictReader(file))

    return read


@pytest.fixture
def frames(tmp_path: Path) -> Path:
    """Eleven frames: nine of both parts, one with the peg's tip hidden, one of nothing."""
    folder = tmp_path / "frames"
    folder.mkdir()
    for k in range(9):
        save(folder / f"frame{k}.png", 0.02 - 0.001 * k)
    save(folder / "frame9.png", -0.02)
    save(folder / "frame10.png", None)
    return folder


@pytest.fixture
def camera(monkeypatch: pytest.MonkeyPatch) -> SimpleNamespace:
    """What a camera at /dev/null does, which shows two pictures in turn; COUNT None: for ever."""
    pictures = [cv2.cvtColor(drawn(gap), cv2.COLOR_RGB2BGR) for gap in (0.02, 0.015)]
    does = SimpleNamespace(PERIOD=0.02, COUNT=None, STAMPS=True, PICTURES=pictures)  # s, frames
    open_file = cv2.VideoCapture

    def opened(path: str, backend: int = cv2.CAP_ANY) -> object:
        if backend != cv2.CAP_V4L2:
            return open_file(path, backend)
        assert path == "/dev/null"
        return FakeCamera(does)

    monkeypatch.setattr(cv2, "VideoCapture", opened)
    return does
