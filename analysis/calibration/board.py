"""Calibration boards: their notation in ``--board``, their corners, and their detection.

Board frame B: z into the board, away from who looks at it, x along its rows to the right and y
down. A chessboard's origin is its first inner corner; where one of its numbers of inner corners
is odd and the other even, the square diagonally outside of the first corner is black and the one
at the far end is white, so that it can't be taken for itself turned by half a turn. A ChArUco
board's origin is the outer corner of its first square, as in OpenCV.
"""

import re
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy.spatial import KDTree

from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]
Grey = NDArray[np.uint8]  # shape (height, width)

ALLOWED: Final = (
    "chessboard:9x6:25mm (inner corners, side of a square) or charuco:8x6:30mm:22mm:DICT_5X5_100 "
    "(squares, side of a square, side of a marker, OpenCV's dictionary)"
)
_UNITS: Final = {"mm": 1e-3, "cm": 1e-2, "m": 1.0}
_LENGTH: Final = r"([0-9]*\.?[0-9]+)(mm|cm|m)"
_SIZE: Final = rf"([0-9]{{1,3}})x([0-9]{{1,3}}):{_LENGTH}"
_CHESSBOARD: Final = re.compile(f"chessboard:{_SIZE}")
_CHARUCO: Final = re.compile(f"charuco:{_SIZE}:{_LENGTH}:([^:]*)")
_LEAST, _MOST = 3, 100  # squares along a side
_LEAST_FOUND: Final = 6  # corners of a ChArUco board
# Half a side of what cornerSubPix looks at; the shares are the best on photographs and drawings.
_OF_SPACING: Final = 0.34  # of the least distance between a chessboard's corners
_OF_GAP: Final = 0.8  # of the least distance between a ChArUco board's corners and its markers
_WINDOWS: Final = (2, 20)  # pixels
_LARGEST_SEARCHED: Final = 1280  # pixels, longest side: larger pictures take minutes
_STOP: Final = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 50, 1e-4)  # moves, pixels


class NotFoundError(Exception):
    """A board is not in a picture; the message says why."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Corners:
    """Corners of a board that were found in a picture."""

    points: Array  # shape (n, 2), m, x and y in the board's frame
    pixels: Array  # shape (n, 2), u and v


@dataclass(frozen=True, kw_only=True)
class Chessboard:
    """A chessboard without markers, of which all inner corners have to be seen."""

    columns: int  # inner corners in a row
    rows: int
    square: float  # m, side

    @property
    def directed(self) -> bool:
        """Whether its ends differ."""
        return (self.columns + self.rows) % 2 == 1

    @cached_property
    def points(self) -> Array:
        """Return the corners in the board's frame, row by row, m, shape (n, 2)."""
        return self.square * np.mgrid[: self.columns, : self.rows].T.reshape(-1, 2).astype(float)

    def find(self, image: Grey) -> Corners:
        """Return the corners in a picture.

        Raises:
            NotFoundError: If not all of them are found.
        """
        size = (self.columns, self.rows)
        shrunk = max(1.0, max(image.shape) / _LARGEST_SEARCHED)
        small = image
        if shrunk > 1:
            height, width = (round(side / shrunk) for side in image.shape)
            resized = cv2.resize(image, (width, height), interpolation=cv2.INTER_AREA)
            small = resized.astype(np.uint8, copy=False)
        found, corners = cv2.findChessboardCorners(small, size)
        if not found:
            found, corners = cv2.findChessboardCornersSB(small, size, flags=cv2.CALIB_CB_ACCURACY)
        if not found:
            raise NotFoundError("the board is not found")
        whole = shrunk * (corners.astype(float) + 0.5) - 0.5
        grid = self._ordered(image, whole.reshape(self.rows, self.columns, 2))
        spacing = min(np.linalg.norm(np.diff(grid, axis=k), axis=2).min() for k in (0, 1))
        pixels = _refined(image, grid.reshape(-1, 2), _OF_SPACING * float(spacing))
        return Corners(points=self.points, pixels=pixels)

    def _ordered(self, image: Grey, grid: Array) -> Array:
        """Return corners, shape (rows, columns, 2), from the first one on as defined above."""
        right, down = grid[0, -1] - grid[0, 0], grid[-1, 0] - grid[0, 0]
        if right[0] * down[1] - right[1] * down[0] < 0:  # seen from behind
            grid = grid[::-1]
        if self.directed and _outside(image, grid) > _outside(image, grid[::-1, ::-1]):
            grid = grid[::-1, ::-1]
        return grid


@dataclass(frozen=True, kw_only=True)
class Charuco:
    """A chessboard with markers in its white squares, of which a part may be hidden."""

    columns: int  # squares in a row
    rows: int
    square: float  # m, side
    marker: float  # m, side
    dictionary: str  # its name in OpenCV

    directed: Final = True

    @cached_property
    def drawing(self) -> cv2.aruco.CharucoBoard:
        """OpenCV's board."""
        dictionary = cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, self.dictionary))
        size = (self.columns, self.rows)
        return cv2.aruco.CharucoBoard(size, self.square, self.marker, dictionary)

    @cached_property
    def points(self) -> Array:
        """Return the corners in the board's frame, row by row, m, shape (n, 2)."""
        return np.asarray(self.drawing.getChessboardCorners(), float)[:, :2]

    def find(self, image: Grey) -> Corners:
        """Return the corners in a picture.

        Raises:
            NotFoundError: If too few of them are found to say where the board is.
        """
        corners, ids, _, _ = cv2.aruco.CharucoDetector(self.drawing).detectBoard(image)
        count = 0 if ids is None else len(ids)
        if count < _LEAST_FOUND:
            few = f"only {count} of {len(self.points)} corners are found" if count else ""
            raise NotFoundError(few or "the board is not found")
        points = self.points[ids.ravel()]
        if np.linalg.matrix_rank(points - points[0], tol=self.square / 2) < 2:
            raise NotFoundError("the corners that are found lie on one line")
        pixels = corners.reshape(-1, 2).astype(float)
        distances, _ = KDTree(pixels).query(pixels, k=2)
        nearest = float(np.min(np.asarray(distances)[:, 1]))
        gap = nearest * (1 - self.marker / self.square) / 2
        return Corners(points=points, pixels=_refined(image, pixels, _OF_GAP * gap))


Board = Chessboard | Charuco


def parse_board(text: str) -> Board:
    """Return the board that a text describes.

    Raises:
        ParameterError: If it describes none.
    """
    found = _CHESSBOARD.fullmatch(text) or _CHARUCO.fullmatch(text)
    if found is None:
        raise ParameterError("board", text, ALLOWED)
    columns, rows = int(found[1]), int(found[2])
    numbers = found.groups()[2:6]
    lengths = [
        float(number) * _UNITS[unit]
        for number, unit in zip(numbers[::2], numbers[1::2], strict=True)
    ]
    counted = all(_LEAST <= count <= _MOST for count in (columns, rows))
    if not (counted and all(1e-4 <= length <= 100 for length in lengths)):
        raise ParameterError("board", text, ALLOWED)
    if len(lengths) == 1:
        return Chessboard(columns=columns, rows=rows, square=lengths[0])
    square, marker = lengths
    dictionary = found[7]
    names = sorted(name for name in dir(cv2.aruco) if re.fullmatch(r"DICT_[A-Z0-9_]+", name))
    if dictionary not in names:
        raise ParameterError("board", text, f"one of OpenCV's dictionaries, {', '.join(names)}")
    if not marker < square:
        raise ParameterError("board", text, "markers that are smaller than the squares")
    known = len(cv2.aruco.getPredefinedDictionary(getattr(cv2.aruco, dictionary)).bytesList)
    if columns * rows // 2 > known:
        raise ParameterError("board", text, f"at most {known} markers, as {dictionary} has")
    return Charuco(columns=columns, rows=rows, square=square, marker=marker, dictionary=dictionary)


def _refined(image: Grey, pixels: Array, half: float) -> Array:
    """Return corners, shape (n, 2), at which the gradients within half a side's reach point."""
    side = int(np.clip(round(half), *_WINDOWS))
    corners = np.ascontiguousarray(pixels.reshape(-1, 1, 2), np.float32)
    refined = cv2.cornerSubPix(image, corners, (side, side), (-1, -1), _STOP)
    return refined[:, 0].astype(float)


def _outside(image: Grey, grid: Array) -> float:
    """Return how bright the square diagonally outside of a grid's first corner is."""
    u, v = (1.5 * grid[0, 0] - 0.5 * grid[1, 1]).round().astype(int)
    around = image[max(v - 1, 0) : v + 2, max(u - 1, 0) : u + 2]
    return float(around.mean()) if around.size else 255.0
