"""Cameras, and boards that they saw."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

from chamfer.analysis.calibration.board import Chessboard, Corners
from chamfer.analysis.calibration.calibration_accuracy import (
    BoardPoses,
    board_corners,
    place_board,
)
from chamfer.analysis.calibration.camera_fit import Picture
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
def look() -> Callable[..., list[Picture]]:
    """What cameras in front of the board see, with noise in pixels."""

    def looked(
        places: Sequence[Camera], seed: int = 0, *, noise: float = 0.05, name: str = "picture"
    ) -> list[Picture]:
        random = np.random.default_rng([seed, 1])
        looks = []
        for k, camera in enumerate(places):
            pixels = board_corners(BOARD.points, camera)
            pixels += noise * random.standard_normal(pixels.shape)
            corners = Corners(points=BOARD.points, pixels=pixels)
            looks.append(Picture(name=f"{name}{k}.png", corners=corners))
        return looks

    return looked
