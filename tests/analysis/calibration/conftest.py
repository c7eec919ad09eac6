"""Cameras, and boards that they saw: corners projected, which takes no time, or drawn."""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from chamfer.analysis.calibration.board import Board, Chessboard, Corners
from chamfer.analysis.calibration.calibration_accuracy import (
    BoardPicture,
    BoardPoses,
    draw_board,
    place_board,
)
from chamfer.analysis.calibration.camera_fit import Seen
from chamfer.models.cameras.camera import Camera

BOARD = Chessboard(columns=9, rows=6, square=0.025)
CAMERA = Camera(
    width=640,
    height=480,
    focal=(560.0, 565.0),
    centre=(322.0, 236.0),
    distortion=(-0.28, 0.08, 0.001, -0.0005, 0.02),
    R_WC=np.eye(3),
    p_WC=np.zeros(3),
)


@pytest.fixture
def photographs() -> Path:
    """The folder of the thirteen photographs."""
    return Path(__file__).parent / "photographs"


@pytest.fixture
def board() -> Chessboard:
    return BOARD


@pytest.fixture
def camera() -> Camera:
    return CAMERA


@pytest.fixture
def project() -> Callable[[Camera, Board], Any]:
    """Where a camera sees a board's corners, the board's frame being its world."""

    def projected(camera: Camera, board: Board) -> Any:
        return camera.project(np.column_stack([board.points, np.zeros(len(board.points))]))

    return projected


@pytest.fixture(scope="session")
def place() -> Callable[..., list[Camera]]:
    """The camera at places in front of the board."""

    def placed(
        count: int, seed: int = 0, *, poses: BoardPoses | None = None, camera: Camera = CAMERA
    ) -> list[Camera]:
        random = np.random.default_rng(seed)
        return [place_board(BOARD, camera, poses or BoardPoses(), random) for _ in range(count)]

    return placed


@pytest.fixture
def look(project: Callable[[Camera, Board], Any]) -> Callable[..., list[Seen]]:
    """What cameras in front of the board see, with noise in pixels."""

    def looked(
        places: Sequence[Camera], seed: int = 0, *, noise: float = 0.05, name: str = "picture"
    ) -> list[Seen]:
        random = np.random.default_rng([seed, 1])
        looks = []
        for k, camera in enumerate(places):
            pixels = project(camera, BOARD)
            pixels = pixels + noise * random.standard_normal(pixels.shape)
            corners = Corners(points=BOARD.points, pixels=pixels)
            looks.append(Seen(name=f"{name}{k}.png", corners=corners))
        return looks

    return looked


@pytest.fixture(scope="session")
def save() -> Callable[..., list[Path]]:
    """Draws and saves what cameras in front of the board see."""

    def saved(folder: Path, places: Sequence[Camera], seed: int = 0) -> list[Path]:
        folder.mkdir(exist_ok=True)
        random = np.random.default_rng([seed, 2])
        files = []
        for k, camera in enumerate(places):
            files.append(folder / f"{folder.name}{k}.png")
            image = draw_board(BOARD, camera, BoardPicture(), random)
            assert cv2.imwrite(str(files[-1]), image)
        return files

    return saved
