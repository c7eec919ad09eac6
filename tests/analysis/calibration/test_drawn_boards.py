"""Drawn boards: exact areas, and the same places as by OpenCV's model."""

from collections.abc import Callable

import cv2
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from chamfer.analysis.calibration.board import Charuco, Chessboard
from chamfer.analysis.calibration.drawn_boards import (
    BoardPicture,
    BoardPoses,
    draw_board,
    place_board,
)
from chamfer.models.cameras.camera import Camera
from chamfer.models.validation import ParameterError

CLEAN = BoardPicture(noise=0.0, blur=0.0)


def straight(board: Chessboard | Charuco, pixels: float, shift: tuple[float, float]) -> Camera:
    """Return a camera that shows a board's origin at shift and its squares in pixels."""
    return Camera(
        width=64,
        height=48,
        focal=(100.0, 100.0),
        centre=shift,
        R_WC=np.eye(3),
        p_WC=np.array([0.0, 0.0, -100.0 * board.square / pixels]),
    )


def test_squares_cover_pixels_exactly() -> None:
    board = Chessboard(columns=4, rows=3, square=0.01)
    image = draw_board(board, straight(board, 8.0, (15.75, 11.5)), CLEAN, np.random.default_rng(0))
    black, white = 30, 220
    assert (image[5, 9], image[5, 20]) == (black, white)  # outside of the first corner, beside it
    assert image[13, 17] == black  # the square between the first corners
    # Of the column at the corner's u, which reaches from 15.5 to 16.5, 0.25 is left of it.
    assert image[5, 16] == round(0.25 * black + 0.75 * white)
    assert image[13, 16] == round(0.25 * white + 0.75 * black)
    assert image[0, 0] == 120  # beyond the paper


def test_a_charuco_board_is_drawn_as_opencv_draws_it() -> None:
    board = Charuco(columns=4, rows=3, square=0.01, marker=0.006, dictionary="DICT_4X4_50")
    camera = Camera(
        width=400,
        height=300,
        focal=(100.0, 100.0),
        centre=(-0.5, -0.5),
        R_WC=np.eye(3),
        p_WC=np.array([0.0, 0.0, -0.01]),
    )
    image = draw_board(board, camera, CLEAN, np.random.default_rng(0))
    np.testing.assert_array_equal(image > 125, board.drawing.generateImage((400, 300)) > 125)


def test_distortion_bends_the_drawing_as_opencv_does(
    camera: Camera, board: Chessboard, place: Callable[..., list[Camera]]
) -> None:
    for there in place(3):
        image = draw_board(board, there, CLEAN, np.random.default_rng(0))
        R_CB = there.R_WC.T
        expected, _ = cv2.projectPoints(
            np.column_stack([board.points, np.zeros(54)]),
            Rotation.from_matrix(R_CB).as_rotvec(),
            -R_CB @ there.p_WC,
            there.matrix,
            np.array(there.distortion),
        )
        np.testing.assert_allclose(board.find(image).pixels, expected[:, 0], atol=0.1)


def test_noise_and_blur_are_drawn(board: Chessboard, place: Callable[..., list[Camera]]) -> None:
    (there,) = place(1)
    random = np.random.default_rng(1)
    clean = draw_board(board, there, CLEAN, random).astype(float)
    noisy = draw_board(board, there, BoardPicture(noise=5.0, blur=0.0), random)
    assert np.std(noisy - clean) == pytest.approx(5.0, rel=0.05)
    blurred = draw_board(board, there, BoardPicture(noise=0.0, blur=2.0), random).astype(float)
    assert np.abs(np.diff(blurred)).max() < 0.6 * np.abs(np.diff(clean)).max()


def test_boards_are_held_as_asked(camera: Camera, board: Chessboard) -> None:
    random = np.random.default_rng(2)
    poses = BoardPoses(tilt=0.5, roll=0.1, extent=(0.3, 0.4))
    places = [place_board(board, camera, poses, random) for _ in range(20)]
    tilts = [np.arccos(there.R_WC[2, 2]) for there in places]
    assert 0.35 < max(tilts) <= 0.5
    with pytest.raises(ParameterError, match="extent is"):
        place_board(board, camera, BoardPoses(extent=(1.0, 1.0)), random)


@pytest.mark.parametrize(
    ("field", "value"), [("tilt", 1.3), ("roll", -1.0), ("extent", (0.4, 0.3)), ("extent", (0, 1))]
)
def test_poses_that_are_none(field: str, value: object) -> None:
    with pytest.raises(ParameterError, match=f"{field} is"):
        BoardPoses(**{field: value})  # type: ignore[arg-type]
