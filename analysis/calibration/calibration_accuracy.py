"""Calibrates from drawn boards, and compares with the cameras that drew them."""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from typing import Final

import cv2
import numpy as np
import scipy  # whose submodules are imported where they are used
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.analysis.calibration.board import Board, Charuco, Grey, NotFoundError, parse_board
from chamfer.analysis.calibration.calibration import calibrate
from chamfer.analysis.calibration.camera_fit import Picture, moved, transform
from chamfer.analysis.calibration.hand_eye import LEAST_POSES, REGION
from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import rate
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.drawing.figure_kit import draw_cumulative, metric_value
from chamfer.analysis.drawing.figure_style import BAND, LIMIT, Style, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, Table, column
from chamfer.analysis.sight.picture_conditions import PictureQuality
from chamfer.models.cameras.camera import Camera
from chamfer.models.cameras.camera_file import CalibratedCamera, Intrinsics
from chamfer.models.validation import ParameterError, require_between, require_not_negative
from chamfer.systems.cameras.coverage import paint

Array = NDArray[np.float64]

_PIECES: Final = 16  # straight ones of a square's side, which a lens bends
_BLACK, _WHITE, _BEHIND = 30.0, 220.0, 120.0  # grey levels
_MARGIN: Final = 4  # pixels around the black squares that have to be in the picture
_TRIES: Final = 300  # of a random pose


@dataclass(frozen=True, kw_only=True)
class BoardPicture(PictureQuality):
    """The errors of pictures of a board."""

    noise: float = 2.0  # grey levels, standard deviation


@dataclass(frozen=True, kw_only=True)
class BoardPoses:
    """How a board is held in front of a camera; uniform."""

    tilt: float = 0.7  # rad, between its normal and the optical axis, at most
    roll: float = 0.4  # rad, about its normal, at most
    extent: tuple[float, float] = (0.4, 0.8)  # share of the picture's width that the board covers

    def __post_init__(self) -> None:
        require_between(self, 0, 1.2, "tilt")
        require_between(self, 0, math.pi, "roll")
        low, high = self.extent
        if not 0.05 <= low <= high <= 1:
            raise ParameterError("extent", self.extent, "two numbers from 0.05 to 1, in order")


def draw_board(
    board: Board, camera: Camera, picture: BoardPicture, random: np.random.Generator
) -> Grey:
    """Return a camera's image of a board at the world's origin: grey levels."""
    image = np.full((camera.height, camera.width), _BEHIND)
    areas = [(_outline(board, board.square / 2), _WHITE - _BEHIND)]
    areas += [(square, _BLACK - _WHITE) for square in _black(board)]
    for area, level in areas:
        polygon = np.ascontiguousarray(board_corners(area, camera))
        if np.isfinite(polygon).all():
            paint(image[..., np.newaxis], polygon, np.array([level]), False)
    if picture.blur:
        image = cv2.GaussianBlur(image, (0, 0), picture.blur, borderType=cv2.BORDER_REPLICATE)
    image += random.normal(0.0, picture.noise, image.shape) if picture.noise else 0.0
    return np.asarray(np.clip(np.rint(image), 0, 255), np.uint8)


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
    from_middle = np.pad(outline, ((0, 0), (0, 1))) - middle
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
    """Return the pixels at which a camera, whose world is the board, sees points, m, (n, 2)."""
    return camera.project(np.pad(points, ((0, 0), (0, 1))))


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
    return np.asarray(low + (high - low) * _UNIT)


PARAMETERS: Final = ("fx", "fy", "cx", "cy", "k1", "k2", "p1", "p2", "k3")
DEVIATIONS: Final = 3.0  # of its standard ones, within which a parameter should be
NEAR: Final = 0.2  # %, of the focal length, that its error should be within

_MOST: Final = 10_000  # sets
_HELD: Final = ("turn_error", "shift_error", "turn_sd", "shift_sd", "square")  # of a hand


@dataclass(frozen=True, kw_only=True)
class DrawnCameras:
    """Which cameras boards are drawn with; uniform."""

    width: int = 640  # pixels
    height: int = 480  # pixels
    focal_length: tuple[float, float] = (500.0, 900.0)  # pixels, least and most
    aspect: float = 0.01  # largest deviation of fy/fx from 1
    principal_point: float = 15.0  # pixels, from the image's middle along u and v, at most
    k1: tuple[float, float] = (-0.3, 0.1)  # of the distortion, least and most
    k2: tuple[float, float] = (0.0, 0.15)  # of the distortion, least and most
    tangential: float = 0.002  # p1 and p2, at most
    k3: float = 0.03  # at most

    def __post_init__(self) -> None:
        require_not_negative(self, "principal_point", "tangential", "k3")
        for name in ("width", "height"):
            if not 64 <= getattr(self, name) <= 4096:
                raise ParameterError(name, getattr(self, name), "a whole number from 64 to 4096")
        for name in ("focal_length", "k1", "k2"):
            low, high = getattr(self, name)
            if not -math.inf < low <= high < math.inf:
                raise ParameterError(name, getattr(self, name), "two finite numbers, in order")
        if not self.focal_length[0] >= 50:
            raise ParameterError("focal_length", self.focal_length, "two numbers >= 50, in order")
        require_between(self, 0, 0.5, "aspect")

    def draw(self, random: np.random.Generator) -> Camera:
        """Return a random one of them."""
        fx = random.uniform(*self.focal_length)
        fy = fx * (1 + random.uniform(-self.aspect, self.aspect))
        cx, cy = random.uniform(-self.principal_point, self.principal_point, 2)
        k1, k2 = random.uniform(*self.k1), random.uniform(*self.k2)
        p1, p2 = random.uniform(-self.tangential, self.tangential, 2)
        return Camera(
            width=self.width,
            height=self.height,
            focal=(fx, fy),
            centre=((self.width - 1) / 2 + cx, (self.height - 1) / 2 + cy),
            distortion=(k1, k2, p1, p2, random.uniform(-self.k3, self.k3)),
            R_WC=np.eye(3),
            p_WC=np.zeros(3),
        )


@dataclass(frozen=True, kw_only=True)
class CalibrationScenario:
    """Sets of rendered images, each of another camera."""

    sets: int = 40  # of pictures
    pictures: int = 12  # of a set
    board: str = "chessboard:9x6:25mm"  # in the notation of chamfer calibrate
    cameras: DrawnCameras = field(default_factory=DrawnCameras)
    poses: BoardPoses = field(default_factory=BoardPoses)
    picture: BoardPicture = field(default_factory=BoardPicture)
    reach: float = 0.1  # m, of an arm's tool to the camera along each axis, at most; uniform
    arm_shift: float = 1e-4  # m, standard deviation of the arm's poses along an axis; assumed
    arm_turn: float = 3e-4  # rad, likewise about an axis; assumed

    @property
    def counts(self) -> tuple[int, ...]:
        """Of a set's first pictures, that a hand is calibrated from: half of them and all."""
        return tuple(sorted({max(LEAST_POSES, self.pictures // 2), self.pictures}))

    def __post_init__(self) -> None:
        parse_board(self.board)
        require_not_negative(self, "reach", "arm_shift", "arm_turn")
        if not 1 <= self.sets <= _MOST:
            raise ParameterError("sets", self.sets, f"a whole number from 1 to {_MOST}")
        if not 5 <= self.pictures <= 200:
            raise ParameterError("pictures", self.pictures, "a whole number from 5 to 200")


CALIBRATION: Final = CalibrationScenario()


def _calibrate(scenario: CalibrationScenario, seed: int, number: int) -> Row:
    """Return what came of a set: errors and standard deviations of the parameters, and more."""
    random = np.random.default_rng([seed, number])
    board = parse_board(scenario.board)
    camera = scenario.cameras.draw(random)
    seen, off, places = [], [], []
    for k in range(scenario.pictures):
        there = place_board(board, camera, scenario.poses, random)
        places.append(np.vstack([np.column_stack([there.R_WC, there.p_WC]), [0, 0, 0, 1]]))
        image = draw_board(board, there, scenario.picture, random)
        try:
            corners = board.find(image)
        except NotFoundError as error:
            seen.append(Picture(name=str(k), left_out=str(error)))
            continue
        seen.append(Picture(name=str(k), corners=corners))
        off.append(corners.pixels - board_corners(corners.points, there))
    X_TC, poses = _in_hand(scenario, places, np.random.default_rng([seed, number, 1]))
    held = []
    for count in scenario.counts:
        found = calibrate([seen[:count]], [(camera.width, camera.height)], poses=poses)
        if (hand := found.hand_eye) is not None:
            off_by = moved(X_TC, hand.X_TC)
            square = float(off_by @ np.linalg.solve(hand.covariance, off_by))
            both = np.reshape([off_by, np.sqrt(np.diag(hand.covariance))], (4, 3))
            held.append([*np.linalg.norm(both, axis=1), square])
    left, (pictures,) = found.cameras.left, found.pictures
    if left.sd is None or left.reprojection_error is None:
        raise ValueError("a calibration without standard deviations")
    true = np.array([*camera.focal, *camera.centre, *camera.distortion])
    return {
        "true": true,
        "error": _vector(left) - true,
        "sd": _vector(left.sd),
        "hand": np.array(held),
        "corner_squares": float(np.mean(np.concatenate(off) ** 2)),
        "reprojection_error": left.reprojection_error,
        "found": float(len(off)),
        "left_out": float(len(off) - sum(one.error is not None for one in pictures)),
    }


def _in_hand(
    scenario: CalibrationScenario, X_BC: Sequence[Array], random: np.random.Generator
) -> tuple[Array, dict[str, Array]]:
    """Return X_TC, shape (4, 4), and X_WT by pictures as an arm says that held the camera so."""
    turns = Rotation.random(2, rng=random).as_rotvec()
    shifts = random.uniform(-1, 1, (2, 3)) * [[scenario.reach], [0.5]]
    X_TC, X_WB = map(transform, np.hstack([turns, shifts]))
    sizes = np.repeat([scenario.arm_turn, scenario.arm_shift], 3)
    X_CT = [np.linalg.inv(X_TC) @ transform(sizes * random.standard_normal(6)) for _ in X_BC]
    return X_TC, {str(k): X_WB @ X @ X_CT[k] for k, X in enumerate(X_BC)}


def _vector(of: CalibratedCamera | Intrinsics) -> Array:
    return np.array([*of.focal_length, *of.principal_point, *of.distortion])


def run(scenario: CalibrationScenario, seed: int, progress: Progress) -> Outcome:
    """Draw sets of pictures, calibrate each, and compare with the true cameras."""
    finished = run_each(partial(_calibrate, scenario, seed), range(scenario.sets), progress)
    finished.require("a calibration can't be compared")
    traces: dict[str, Array] = {"set": column(list(finished.tasks))}
    for part in ("true", "error", "sd"):
        values = finished.column(part)
        traces |= {f"{name}_{part}": column(values[:, i]) for i, name in enumerate(PARAMETERS)}
    for name in ("corner_squares", "reprojection_error", "found", "left_out"):
        traces[name] = column(finished.column(name))
    for count, held in zip(scenario.counts, finished.column("hand").swapaxes(0, 1), strict=True):
        traces |= {f"hand_eye_{count}_{of}": column(held[:, k]) for k, of in enumerate(_HELD)}
    return Outcome(metrics=_metrics(scenario, traces), traces=traces, simulated_seconds=0.0)


def focal_errors(traces: Table) -> Array:
    """Return the focal lengths' errors, the larger one of each set, %, shape (sets,)."""
    of_both = [np.abs(traces[f"{name}_error"]) / traces[f"{name}_true"] for name in ("fx", "fy")]
    return column(100 * np.max(of_both, axis=0))


def _metrics(scenario: CalibrationScenario, traces: Table) -> dict[str, Metric]:
    sets = len(traces["set"])
    focal = focal_errors(traces)
    near = int(np.sum(focal <= NEAR))
    metrics: dict[str, Metric] = {
        "focal_length.error.max": Metric(value=float(focal.max()), unit="%", note="of fx and fy"),
        "focal_length.error.rms": Metric(value=float(np.sqrt(np.mean(focal**2))), unit="%"),
        **rate("focal_length.near", near, sets, f"of {sets} sets, within {NEAR:g} %"),
    }
    for name in PARAMETERS:
        off = traces[f"{name}_error"] / traces[f"{name}_sd"]
        within = int(np.sum(np.abs(off) <= DEVIATIONS))
        said = f"of {sets} sets, within {DEVIATIONS:g} of its standard deviations"
        metrics |= rate(f"{name}.within", within, sets, said)
        metrics[f"{name}.ratio"] = Metric(
            value=float(np.sqrt(np.mean(off**2))),
            unit="",
            note="rms of errors over standard deviations, 1 if those are right",
        )
    for count in scenario.counts:
        squares = traces[f"hand_eye_{count}_square"]
        within = int(np.sum(squares <= scipy.stats.chi2.ppf(REGION, 6)))
        said = f"of {sets} hands, within the {100 * REGION:g} % region of {count} pictures"
        metrics |= rate(f"hand_eye_{count}.within", within, sets, said)
        for of in _HELD[:4]:
            value = math.sqrt(float(np.mean(traces[f"hand_eye_{count}_{of}"] ** 2)))
            unit = "m" if "shift" in of else "rad"
            metrics[f"hand_eye_{count}.{of}"] = Metric(value=value, unit=unit, note="rms")
    pictures = sets * scenario.pictures
    found = int(traces["found"].sum())
    return {
        **metrics,
        "corners.error": Metric(
            value=math.sqrt(float(np.mean(traces["corner_squares"]))),
            unit="px",
            note="rms along an axis, found minus true",
        ),
        "reprojection_error": Metric(
            value=float(np.mean(traces["reprojection_error"])), unit="px", note="mean of the sets"
        ),
        **rate("found", found, pictures, f"of {pictures} pictures with a board"),
        "left_out": Metric(
            value=float(traces["left_out"].sum()), unit="", note=f"outliers of {found} pictures"
        ),
    }


_POINT: Final[Style] = {"color": "#1b4f9c", "linestyle": "none", "marker": "o", "markersize": 3}
_SPREAD: Final = 0.3  # of a column, to either side


def figures(scenario: CalibrationScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw errors over standard deviations, how many are within, and focal lengths' errors."""
    near = metric_value(outcome.metrics, "focal_length.near")
    within_ = f"{near:.3g} % of the sets" if np.isfinite(near) else "An unknown share of the sets"
    figure = new_figure(
        height=9.0,
        caption=f"{within_} have focal lengths within {NEAR:g} % (c). Errors of each parameter "
        "over its claimed standard deviation (a, b), and of the camera in the hand (d, e).",
    )
    over, within, lengths, *hands = figure.subplot_mosaic("oo;wl;ts").values()
    _over(over, outcome)
    _within(within, outcome)
    _lengths(lengths, focal_errors(outcome.traces))
    for axes, part, unit in zip(hands, ("turn", "shift"), ("mrad", "mm"), strict=True):
        claimed = LIMIT | {"marker": "_"}
        for of, style, label in (("error", _POINT, "actual"), ("sd", claimed, "claimed")):
            names = [f"hand_eye_{count}.{part}_{of}" for count in scenario.counts]
            values = [metric_value(outcome.metrics, name, 1e3) for name in names]
            axes.plot(scenario.counts, values, **style, label=label)
        axes.set_ylim(0, None)
        title = "(d) Rotation" if part == "turn" else "(e) Position"
        title = f"{title} of the camera in the hand"
        dress(axes, title=title, x="pictures / number", y=f"rms error / {unit}")
        legend(axes, ncols=2)
    return {"calibration-accuracy": figure}


def _over(axes: Axes, outcome: Outcome) -> None:
    for i, name in enumerate(PARAMETERS):
        off = outcome.traces[f"{name}_error"] / outcome.traces[f"{name}_sd"]
        places = i + np.linspace(-_SPREAD, _SPREAD, len(off))
        axes.plot(places, off, **_POINT, alpha=0.6, label="a set" if i == 0 else None)
    axes.axhspan(-DEVIATIONS, DEVIATIONS, **BAND)
    axes.set_xticks(range(len(PARAMETERS)), PARAMETERS)
    largest = max(np.abs(axes.get_ylim()).max(), DEVIATIONS + 1)
    axes.set_ylim(-largest, largest)
    y = "error / standard deviation"
    dress(axes, title="(a) Error of each parameter in each set", x="", y=y)
    legend(axes)


def _within(axes: Axes, outcome: Outcome) -> None:
    def values(key: str) -> Array:
        return np.array([outcome.metrics[f"{name}.{key}"].value for name in PARAMETERS], float)

    shares, low, high = values("within"), values("within.low"), values("within.high")
    places = np.arange(len(PARAMETERS))
    axes.errorbar(places, shares, [shares - low, high - shares], **_POINT, capsize=3)
    axes.axhline(95, **LIMIT, label="required: 95 %")
    axes.set_xticks(places, PARAMETERS)
    axes.set_ylim(min(80, *low) - 1, 101)
    title = f"(b) {shares.min():.3g} % or more within {DEVIATIONS:g} deviations"
    title = title if np.isfinite(shares).all() else f"(b) Within {DEVIATIONS:g} deviations"
    dress(axes, title=title, x="", y="sets / %")
    legend(axes)


def _lengths(axes: Axes, focal: Array) -> None:
    draw_cumulative(axes, focal, {"color": _POINT["color"]}, "sets")
    axes.axvline(NEAR, **LIMIT, label=f"required: {NEAR:g} %")
    axes.set_xlim(0, 1.1 * max(NEAR, float(focal.max())))
    axes.set_ylim(0, 101)
    axes.locator_params(axis="x", nbins=5)
    dress(axes, title="(c) Focal lengths", x="largest error / %", y="sets / %")
    legend(axes, ncols=2)
