"""Pictures of the parts, and a camera that shows them in place of a real one."""

import csv
import importlib.util
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import cv2
import numpy as np
import pytest
from pydrake.math import RigidTransform

from chamfer.models.cameras.camera import CameraPlacement
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.software_camera import render

PARTS = ColouredParts()

# The interface of cv2.VideoCapture with V4L2, as far as it is used: it waits for the next frame,
# says when it was taken on the monotonic clock, and fails at once when it has been unplugged.
CAMERA = """
import time
from pathlib import Path

import cv2

PERIOD = 0.02  # s
COUNT = None  # frames until it stops delivering; None: for ever
STAMPS = True
SIZE = (320, 240)
PICTURES = [cv2.imread(str(path)) for path in sorted(Path(__file__).parent.glob("*.png"))]
OPEN_FILE = cv2.VideoCapture


def VideoCapture(path, backend):
    if backend != cv2.CAP_V4L2:
        return OPEN_FILE(path, backend)
    assert path == "/dev/null"
    return Camera()


class Camera:
    def __init__(self):
        self.open = True
        self.sent = 0
        self.asked = {}

    def isOpened(self):
        return self.open

    def set(self, name, value):
        self.asked[name] = value
        return True

    def get(self, name):
        if name == cv2.CAP_PROP_FPS:
            return 1 / PERIOD
        if name == cv2.CAP_PROP_POS_MSEC and STAMPS:
            return 1e3 * self.taken
        return 0.0

    def read(self):
        assert self.open
        if self.sent == COUNT:
            return False, None
        time.sleep(PERIOD)
        self.taken = time.monotonic() - 0.005
        self.sent += 1
        return True, PICTURES[(self.sent - 1) % len(PICTURES)].copy()

    def release(self):
        self.open = False
"""


def save(path: Path, gap: float | None, size: tuple[int, int] = (320, 240)) -> None:
    """Save a frame with a gap between the parts, m; None: of nothing."""
    image = np.full((size[1], size[0], 3), 200, np.uint8)
    if gap is not None:
        peg, hole = RigidTransform([-gap, 0.001, 0]), RigidTransform([0.01, 0, 0])
        image = render(PARTS, CameraPlacement().camera, peg, hole)
    assert cv2.imwrite(str(path), cv2.cvtColor(image, cv2.COLOR_RGB2BGR))


@pytest.fixture
def picture() -> Callable[[Path, float], None]:
    """Saves a frame with a gap between the parts, m."""
    return save


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
def camera(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> ModuleType:
    """A camera at /dev/null that shows two pictures in turn, in this process."""
    folder = tmp_path / "camera"
    folder.mkdir()
    for k in range(2):
        save(folder / f"{k}.png", 0.02 - 0.005 * k)
    path = folder / "fake_camera.py"
    path.write_text(CAMERA)
    spec = importlib.util.spec_from_file_location("fake_camera", path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    monkeypatch.setattr(cv2, "VideoCapture", module.VideoCapture)
    return module
