"""Boards: what describes them, how they are drawn, and where their corners are found."""

from collections.abc import Callable
from dataclasses import replace

import cv2
import numpy as np
import pytest

from chamfer.analysis.calibration.board import (
    Board,
    Charuco,
    Chessboard,
    NotFoundError,
    parse_board,
)
from chamfer.analysis.calibration.calibration_accuracy import (
    BoardPicture,
    BoardPoses,
    board_corners,
    draw_board,
    place_board,
)
from chamfer.models.cameras.camera import Camera
from chamfer.models.validation import ParameterError

CHARUCO = Charuco(columns=8, rows=6, square=0.03, marker=0.022, dictionary="DICT_5X5_100")
BOARDS = [Chessboard(columns=9, rows=6, square=0.025), CHARUCO]


def facing(camera: Camera, board: Board, *, roll: float = 0.0, extent: float = 0.5) -> Camera:
    """Return the camera in front of a board, rolled about its optical axis and leaned a little."""
    middle = board.points.mean(axis=0)
    width = np.ptp(board.points[:, 0])
    depth = camera.focal[0] * width / (extent * camera.width)
    turn, _ = cv2.Rodrigues(np.array([0.0, 0.0, roll]))
    lean, _ = cv2.Rodrigues(np.array([0.3, -0.2, 0.0]))
    R_BC = turn @ lean
    return camera.placed(R_BC, np.append(middle, 0.0) - depth * R_BC[:, 2])


def test_boards_are_described_in_words() -> None:
    assert parse_board("chessboard:9x6:25mm") == Chessboard(columns=9, rows=6, square=0.025)
    assert parse_board("chessboard:7x8:2.5cm") == Chessboard(columns=7, rows=8, square=0.025)
    assert parse_board("charuco:8x6:0.03m:22mm:DICT_5X5_100") == CHARUCO
    assert len(CHARUCO.points) == 7 * 5
    np.testing.assert_allclose(CHARUCO.points[0], [0.03, 0.03])
    np.testing.assert_allclose(parse_board("chessboard:9x6:25mm").points[10], [0.025, 0.025])


NO_BOARDS = (
    "|chessboard|chessboard:9x6|chessboard:9x6:25|chessboard:9x6:25mm:3|chessboard:9x2:25mm"
    "|chessboard:9x101:25mm|chessboard:9x6:0mm|chessboard:9x6:101m|chessboard:9x6:-25mm"
    "|chessboard:9 x 6:25mm|circles:9x6:25mm|charuco:8x6:30mm:22mm"
    "|charuco:8x6:30mm:22:DICT_5X5_100"
)


@pytest.mark.parametrize(
    ("text", "allowed"),
    [
        *(
            (text, "chessboard:9x6:25mm (inner corners, side of a")
            for text in NO_BOARDS.split("|")
        ),
        ("charuco:8x6:30mm:22mm:DICT_5X5_99", "one of OpenCV's"),
        ("charuco:8x6:30mm:22mm:__doc__", "one of OpenCV's"),
        ("charuco:8x6:22mm:22mm:DICT_5X5_100", "markers that are"),
        ("charuco:20x20:30mm:22mm:DICT_5X5_100", "at most 100 markers"),
    ],
)
def test_what_describes_no_board(text: str, allowed: str) -> None:
    with pytest.raises(ParameterError) as raised:
        parse_board(text)
    assert str(raised.value).startswith(f"board is {text!r}, allowed: {allowed}")


@pytest.mark.parametrize("board", BOARDS)
@pytest.mark.parametrize("roll", [0.0, 1.5, 3.1, -1.6])
def test_corners_are_found_in_their_order_however_the_board_is_held(
    camera: Camera, board: Board, roll: float
) -> None:
    there = facing(camera, board, roll=roll)
    image = draw_board(board, there, BoardPicture(), np.random.default_rng(0))
    found = board.find(image)
    np.testing.assert_array_equal(found.points, board.points)
    error = found.pixels - board_corners(board.points, there)
    assert np.sqrt(np.mean(error**2)) < 0.04
    assert np.abs(error).max() < 0.15


@pytest.mark.parametrize("size", [(9, 6), (6, 9), (7, 8)])
def test_the_first_corner_is_the_one_with_a_black_square_outside(
    camera: Camera, size: tuple[int, int]
) -> None:
    board = Chessboard(columns=size[0], rows=size[1], square=0.02)
    assert board.directed
    there = facing(camera, board, roll=3.0, extent=0.35)
    image = draw_board(board, there, BoardPicture(), np.random.default_rng(0))
    np.testing.assert_allclose(
        board.find(image).pixels, board_corners(board.points, there), atol=0.15
    )
    assert not Chessboard(columns=8, rows=6, square=0.02).directed


def test_a_part_of_a_charuco_board_is_enough(camera: Camera) -> None:
    there = facing(camera, CHARUCO)
    image = draw_board(CHARUCO, there, BoardPicture(), np.random.default_rng(0))
    image[:, :320] = 120
    found = CHARUCO.find(image)
    assert 6 <= len(found.points) < 30
    kept = [np.flatnonzero((CHARUCO.points == point).all(axis=1))[0] for point in found.points]
    np.testing.assert_allclose(found.pixels, board_corners(CHARUCO.points, there)[kept], atol=0.3)
    image[:, :405] = image[:220] = 120
    with pytest.raises(NotFoundError, match=r"only \d of 35 corners are found"):
        CHARUCO.find(image)


@pytest.mark.parametrize("board", BOARDS)
def test_no_board(board: Board) -> None:
    with pytest.raises(NotFoundError, match="the board is not found"):
        board.find(np.full((240, 320), 127, np.uint8))


def test_a_large_picture_is_searched_small_and_measured_large(
    camera: Camera, board: Chessboard
) -> None:
    large = replace(
        camera, width=2560, height=1920, focal=(2240.0, 2240.0), centre=(1290.0, 950.0)
    )
    there = facing(large, board, extent=0.7)
    image = draw_board(board, there, BoardPicture(), np.random.default_rng(0))
    error = board.find(image).pixels - board_corners(board.points, there)
    assert np.sqrt(np.mean(error**2)) < 0.03


CLEAN = BoardPicture(noise=0.0, blur=0.0)


def straight(size: tuple[int, int], square: float, origin: tuple[float, float]) -> Camera:
    """Return a camera that shows squares of 1 cm in pixels, and a board's origin at a pixel."""
    return Camera(
        width=size[0],
        height=size[1],
        focal=(100.0, 100.0),
        centre=origin,
        R_WC=np.eye(3),
        p_WC=np.array([0.0, 0.0, -1.0 / square]),
    )


def test_squares_cover_pixels_exactly() -> None:
    board = Chessboard(columns=4, rows=3, square=0.01)
    camera = straight((64, 48), 8.0, (15.75, 11.5))
    image = draw_board(board, camera, CLEAN, np.random.default_rng(0))
    black, white = 30, 220
    assert (image[5, 9], image[5, 20]) == (black, white)  # outside of the first corner, beside it
    assert image[13, 17] == black  # the square between the first corners
    # Of the column at the corner's u, which reaches from 15.5 to 16.5, 0.25 is left of it.
    assert image[5, 16] == round(0.25 * black + 0.75 * white)
    assert image[13, 16] == round(0.25 * white + 0.75 * black)
    assert image[0, 0] == 120  # beyond the paper


def test_a_charuco_board_is_drawn_as_opencv_draws_it() -> None:
    board = Charuco(columns=4, rows=3, square=0.01, marker=0.006, dictionary="DICT_4X4_50")
    camera = straight((400, 300), 100.0, (-0.5, -0.5))
    image = draw_board(board, camera, CLEAN, np.random.default_rng(0))
    np.testing.assert_array_equal(image > 125, board.drawing.generateImage((400, 300)) > 125)


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
