"""Pictures of boards, drawn with the exact area that every black square covers of every pixel."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.analysis.calibration.board import Board, Charuco, Grey
from chamfer.models.cameras.camera import Camera
from chamfer.models.validation import ParameterError, require_not_negative
from chamfer.systems.cameras.coverage import coverage

Array = NDArray[np.float64]

_PIECES: Final = 16  # straight ones of a square's side, which a lens bends
_BLACK, _WHITE, _BEHIND = 30.0, 220.0, 120.0  # grey levels
_MARGIN: Final = 4  # pixels around the black squares that have to be in the picture
_TRIES: Final = 300  # of a random pose


@dataclass(frozen=True, kw_only=True)
class BoardPicture:
    """What pictures of a board suffer from."""

    noise: float = 2.0  # grey levels, standard deviation
    blur: float = 0.7  # pixels, standard deviation

    def __post_init__(self) -> None:
        require_not_negative(self, "blur")
        if not 0 <= self.noise <= 60:
            raise ParameterError("noise", self.noise, "from 0 to 60")


@dataclass(frozen=True, kw_only=True)
class BoardPoses:
    """How a board is held in front of a camera; uniform."""

    tilt: float = 0.7  # rad, between its normal and the optical axis, at most
    roll: float = 0.4  # rad, about its normal, at most
    extent: tuple[float, float] = (0.4, 0.8)  # of the picture's width, that its width covers

    def __post_init__(self) -> None:
        for name, most in (("tilt", 1.2), ("roll", math.pi)):
            if not 0 <= getattr(self, name) <= most:
                raise ParameterError(name, getattr(self, name), f"a number from 0 to {most:g}")
        low, high = self.extent
        if not 0.05 <= low <= high <= 1:
            raise ParameterError("extent", self.extent, "two numbers from 0.05 to 1, in order")


def draw_board(
    board: Board, camera: Camera, picture: BoardPicture, random: np.random.Generator
) -> Grey:
    """Return what a camera, whose world is the board, sees of it: grey levels."""
    image = np.full((camera.height, camera.width), _BEHIND)
    paper = _outline(board, board.square / 2)
    _paint(image, board_corners(paper, camera), _WHITE - _BEHIND)
    for square in _black(board):
        _paint(image, board_corners(square, camera), _BLACK - _WHITE)
    if picture.blur:
        image = cv2.GaussianBlur(image, (0, 0), picture.blur, borderType=cv2.BORDER_REPLICATE)
    image += random.normal(0.0, picture.noise, image.shape) if picture.noise else 0.0
    grey: Grey = np.clip(np.rint(image), 0, 255).astype(np.uint8)
    return grey


def place_board(
    board: Board, camera: Camera, poses: BoardPoses, random: np.random.Generator
) -> Camera:
    """Return a camera somewhere in front of a board that is seen as a whole.

    Raises:
        ParameterError: If no such place is found.
    """
    outline = _outline(board)
    width = float(np.ptp(outline[:, 0]))
    middle = np.append(outline.mean(axis=0), 0.0)
    from_middle = np.column_stack([outline, np.zeros(len(outline))]) - middle
    size = np.array([camera.width, camera.height])
    front = camera.placed(np.eye(3), np.zeros(3))  # the camera's own frame
    for _ in range(_TRIES):
        about = random.uniform(0, 2 * math.pi)
        tilt = poses.tilt * math.sqrt(random.uniform())
        leaned = Rotation.from_rotvec(tilt * np.array([math.cos(about), math.sin(about), 0.0]))
        R_CB = leaned * Rotation.from_euler("z", random.uniform(-poses.roll, poses.roll))
        extent = random.uniform(*poses.extent)
        depth = camera.focal[0] * width / (extent * camera.width)
        seen = random.uniform(0, size)
        ahead = front.point(seen, depth)
        pixels = front.project(ahead + R_CB.apply(from_middle))
        if ((pixels >= _MARGIN) & (pixels <= size - 1 - _MARGIN)).all():
            R_BC = R_CB.as_matrix().T
            return camera.placed(R_BC, middle - R_BC @ ahead)
    raise ParameterError("extent", poses.extent, "what leaves the board in the picture")


def board_corners(points: Array, camera: Camera) -> Array:
    """Return the pixels at which a camera, whose world is the board, sees its points.

    Args:
        points: x and y in the board's frame, m, shape (n, 2).
        camera: The camera.
    """
    pixels: Array = camera.project(np.column_stack([points, np.zeros(len(points))]))
    return pixels


def _squares(board: Board) -> Iterator[tuple[Array, bool]]:
    """Yield the squares' first corners, m, shape (2,), and whether they are black."""
    inner = 0 if isinstance(board, Charuco) else 1  # from the first square to the origin
    for i in range(board.columns + inner):
        for j in range(board.rows + inner):
            yield board.square * (np.array([i, j]) - float(inner)), (i + j) % 2 == 0


def _black(board: Board) -> Iterator[Array]:
    """Yield what is black: outlines in the board's frame, m, shape (n, 2)."""
    for corner, black in _squares(board):
        if black:
            yield corner + board.square * _UNIT
    if isinstance(board, Charuco):
        dictionary = board.drawing.getDictionary()
        cells = dictionary.markerSize + 2  # with its border
        size = board.marker / cells
        first = np.asarray(board.drawing.getObjPoints())[:, 0, :2]
        for place, marker in zip(first, np.ravel(board.drawing.getIds()), strict=True):
            bits = np.asarray(dictionary.generateImageMarker(int(marker), cells))
            for row, column in np.argwhere(bits == 0):
                yield place + size * np.array([column, row]) + size * _UNIT


_ALONG: Final = np.arange(_PIECES) / _PIECES
_ZERO, _ONE = np.zeros(_PIECES), np.ones(_PIECES)
_UNIT: Final = np.column_stack(  # a square's outline from its first corner on, in pieces
    [
        np.concatenate([_ALONG, _ONE, 1 - _ALONG, _ZERO]),
        np.concatenate([_ZERO, _ALONG, _ONE, 1 - _ALONG]),
    ]
)


def _outline(board: Board, margin: float = 0.0) -> Array:
    """Return the outline of all squares and a margin, m, shape (n, 2)."""
    corners = np.array([corner for corner, _ in _squares(board)])
    low, high = corners.min(axis=0) - margin, corners.max(axis=0) + board.square + margin
    outline: Array = low + (high - low) * _UNIT
    return outline


def _paint(image: Array, polygon: Array, level: float) -> None:
    """Add a level, times the share that a polygon covers, to the pixels of an image."""
    if not np.isfinite(polygon).all():
        return
    size = np.array(image.shape[::-1])
    left, top = np.clip(np.floor(polygon.min(axis=0)).astype(int), 0, size).tolist()
    right, bottom = np.clip(np.ceil(polygon.max(axis=0)).astype(int) + 1, 0, size).tolist()
    if right > left and bottom > top:
        image[top:bottom, left:right] += level * coverage(
            np.ascontiguousarray(polygon), left, top, right - left, bottom - top
        )
