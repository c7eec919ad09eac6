"""Where a camera sits in a hand, by pictures of a board at rest and the arm's poses.

Frames: W the arm's base, T the tool (or flange) that the poses are of, C the camera, B the board.
Motions between pictures give a start; then X_TC and X_WB are adjusted to all pictures at once,
weighed by the covariance of the board's poses in them, which share the lens, and by the arm's two
variances, the most likely ones (restricted maximum likelihood). To first order that is the least
squares of the reprojection, with lens and arm's poses unknown too.
"""

import csv
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Final

import numpy as np
import scipy  # whose submodules are imported where they are used
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from chamfer.analysis.calibration.camera_fit import (
    INTRINSIC,
    Fit,
    frame_pose,
    moved,
    pose_vector,
    transform,
)
from chamfer.analysis.drawing.figure_style import LIMIT, dress, legend, new_figure
from chamfer.analysis.scenario.errors import UserError
from chamfer.analysis.track.frame_source import shown_name
from chamfer.models.cameras.camera_file import FramePose

Array = NDArray[np.float64]

LEAST_POSES: Final = 5  # with fewer what remains hardly tells the arm's errors
REGION: Final = 0.95  # probability, for which standard deviations are right
_NUMBERS: Final = ("x", "y", "z", "qw", "qx", "qy", "qz")
_FORMAT: Final = (
    f"a CSV file with the header file,{','.join(_NUMBERS)} and a row a picture: its file's name, "
    "the tool's place in the arm's base, m, and its unit quaternion"
)
_UNIT: Final = 0.01  # what a quaternion's length may be from 1
_LEAST_TURN: Final = 0.05  # rad, rms between poses, about a second axis
_STEP: Final = 1e-6  # rad and m, of numerical derivatives
_ROUNDS: Final = 3, 30  # of the adjustment, and of the arm's variances in each
_LEAST_SD: Final = 1e-7  # rad and m, of the arm, so that exact poses can be weighed
_STARTS: Final = 60  # of four poses each
_AGREE: Final = 0.7  # share of the poses that a start is made better with
_BEYOND: Final = 8.0  # times the median of what remains: the pose of another picture
_ANY_ARM: Final = np.array([0.03, 0.01])  # rad and m that remain in the median at most; assumed


def read_poses(path: Path, pictures: Sequence[Path]) -> dict[str, Array]:
    """Return X_WT, shape (4, 4), by the names of pictures, each of them one of some files.

    Raises:
        UserError: If the file can't be read, or a row is not allowed.
    """
    try:
        with path.open(newline="", encoding="utf-8-sig") as file:
            rows = list(csv.DictReader(file, skipinitialspace=True))
        table = [(row["file"], np.array([float(row[one]) for one in _NUMBERS])) for row in rows]
    except (OSError, KeyError, TypeError, ValueError, csv.Error) as error:
        why = getattr(error, "strerror", None) or "can't be read"
        raise UserError(f"--poses {path}: {why}, allowed: {_FORMAT}") from error
    poses: dict[str, Array] = {}
    names = [shown_name(file) for file in pictures]
    for name, numbers in table:
        length = float(np.linalg.norm(numbers[3:]))
        why = "" if abs(length - 1) <= _UNIT else f"has a quaternion of length {length:.3g}"
        why = why if np.isfinite(numbers).all() else "is not at a finite place"
        why = "has two poses" if name in poses else why
        if why := why if names.count(name) == 1 else "is not the name of one of the pictures":
            raise UserError(f"--poses {path}: {name} {why}, allowed: {_FORMAT}")
        turn = Rotation.from_quat(numbers[3:], scalar_first=True)
        poses[name] = transform(np.append(turn.as_rotvec(), numbers[:3]))
    return poses


@dataclass(frozen=True, kw_only=True, eq=False)
class HandEye:
    """Where the camera is in the tool's frame, and how well that is known."""

    names: Sequence[str]  # of the pictures
    X_TC: Array  # shape (4, 4)
    covariance: Array  # of small turns, rad, and shifts, m, of X_TC in the tool, shape (6, 6)
    start: Array  # X_TC by motions between pictures alone, shape (4, 4)
    apart: Array  # of the tool as a picture says from the arm's, rad and m, shape (n, 6)
    arm: Array  # standard deviations of its poses about and along an axis, rad and m, shape (2,)
    turns: tuple[Array, Array]  # of the tool, see _turns

    @property
    def pose(self) -> FramePose:
        """Where the camera is, as a camera file has it."""
        return frame_pose(pose_vector(self.X_TC), frame_pose(np.sqrt(np.diag(self.covariance))))

    @property
    def notes(self) -> tuple[str, ...]:
        """The remarks on the result, a line each."""
        (axes, about), count = self.turns, len(self.names)
        return (
            f"hand-eye: {count} poses, of standard deviations of {1e3 * self.arm[1]:.2g} mm along "
            f"and {1e3 * self.arm[0]:.2g} mrad about an axis",
            f"motions between pictures alone put the camera {_said(moved(self.start, self.X_TC))} "
            "from there",
            f"{3 * count} more such pictures halve standard deviations; the tool turns least, "
            f"{math.degrees(about[0]):.2g} degrees rms, about its axis {axes[0].tolist()}",
        )


def fit_hand_eye(fit: Fit, called: Sequence[str], poses: Mapping[str, Array]) -> HandEye:
    """Fit the (left) camera's place in the hand to its pictures, by names, and X_WT of some.

    Raises:
        UserError: If the poses don't tell where the camera is, or don't belong to the pictures.
    """
    used = {called[k]: fit.board((0, k)) for c, k in fit.sights if not c and called[k] in poses}
    names, adjustment = list(used), fit.adjustment
    if (count := len(names)) < LEAST_POSES:
        raise UserError(f"{count} pictures that show the board have a pose, allowed: at least 5")
    X_WT = np.stack([poses[name] for name in names])
    axes, about = _turns(X_WT)
    if about[1] < _LEAST_TURN:
        raise UserError(
            f"the tool turns by {about[2]:.2g} rad rms about its axis {axes[2].tolist()} and by "
            f"{about[1]:.1g} across it, allowed: at least {_LEAST_TURN:g}; tilt it about "
            f"{axes[1].tolist()} too: one axis alone doesn't tell where along it the camera is"
        )
    where = np.concatenate([np.r_[one] for one in used.values()])
    boards = adjustment.parameters[where].reshape(-1, 6)
    # Of independent errors, widened as much as the jackknife widens the lens' own.
    own, jackknife = (np.diag(covariance)[:INTRINSIC] for covariance in adjustment.covariances)
    covariance = max(1.0, np.mean(jackknife / own)) * adjustment.covariances[0][where][:, where]
    X_CB = transform(boards)
    apart = _apart(X_WT, X_CB, *(start := _start(X_WT, X_CB)))
    size, worst = _size(apart), int(np.argmax(_size(apart)))
    usual = float(np.median(size))
    if usual <= 1 and size[worst] <= max(1, _BEYOND * usual):
        return _adjusted(names, X_WT, boards, covariance, start)
    vectors, scale = pose_vector(X_WT), np.repeat([1, 1e-3], 3)
    other = Rotation.from_quat(Rotation.from_rotvec(vectors[:, :3]).as_quat(scalar_first=True))
    turned = np.hstack([other.as_rotvec(), vectors[:, 3:]])
    inverse = np.asarray(np.linalg.inv(X_WT), float)
    readings = {
        "places are taken as mm, allowed: m": transform(vectors * scale),
        "quaternions are taken as x,y,z,w, allowed: w,x,y,z": transform(turned),
        "they are taken as the base's in the tool, allowed: the tool's in the base": inverse,
    }
    for said, X in readings.items():
        if usual > 1 >= np.median(_size(_apart(X, X_CB, *_start(X, X_CB)))):
            raise UserError(f"the poses fit the pictures only if {said}")
    raise UserError(
        f"poses don't belong to their pictures, worst {names[worst]}: {_said(apart[worst])}; in "
        f"the median {_said(np.median(np.abs(apart), axis=0))}, allowed: 10 mm and 30 mrad; "
        "are rows mixed up, is the board's square another, did it move?"
    )


def _adjusted(
    names: Sequence[str], X_WT: Array, boards: Array, covariance: Array, start: Sequence[Array]
) -> HandEye:
    """Return what fits best to boards' poses, shape (n, 6), of a covariance, (6n, 6n)."""
    (X_TC, X_WB), count, variances = start, len(names), (_ANY_ARM / 10) ** 2
    kind = np.tile([0, 0, 0, 1, 1, 1], count)  # rotations and shifts

    def after(step: Array) -> Array:
        """Return the residuals after steps of X_TC, X_WB and all boards' poses, shape (18,)."""
        X_CB = transform(boards + step[12:])
        return _apart(X_WT, X_CB, _moved(X_TC, step[:6]), _moved(X_WB, step[6:12])).ravel()

    for _ in range(_ROUNDS[0]):
        apart = after(np.zeros(18))
        steps = _STEP * np.eye(18)
        slopes = np.column_stack([(after(one) - after(-one)) / (2 * _STEP) for one in steps])
        jacobian = slopes[:, :12]
        by_board = scipy.linalg.block_diag(*slopes[:, 12:].reshape(-1, 6, 6))
        seen = by_board @ covariance @ by_board.T
        for _ in range(_ROUNDS[1]):
            variances = np.maximum(variances, _LEAST_SD**2)
            weight = np.linalg.inv(seen + np.diag(variances[kind]))
            normal = np.linalg.inv(jacobian.T @ weight @ jacobian)
            rest = weight - weight @ jacobian @ normal @ jacobian.T @ weight
            found, expected = (rest @ apart) ** 2, np.diag(rest)
            variances = variances * np.bincount(kind, found) / np.bincount(kind, expected)
        move = -normal @ jacobian.T @ weight @ apart
        X_TC, X_WB = _moved(X_TC, move[:6]), _moved(X_WB, move[6:])
    # Few pictures tell the arm's variances badly: wider, so that the normal region of a pose is
    # as large as Fisher's, of three degrees of freedom fewer than one of the two is left with.
    f, chi = scipy.stats.f.ppf(REGION, 6, 3 * count - 9), scipy.stats.chi2.ppf(REGION, 6)
    return HandEye(
        names=names,
        X_TC=X_TC,
        covariance=np.asarray(6 * f / chi * normal[:6, :6], float),
        start=start[0],
        apart=after(np.zeros(18)).reshape(-1, 6),
        arm=np.sqrt(variances),
        turns=_turns(X_WT),
    )


def _start(X_WT: Array, X_CB: Array) -> tuple[Array, Array]:
    """Return X_TC and X_WB: the best in the median of those of few poses, made better."""
    random = np.random.default_rng(0)
    count, found = len(X_WT), []

    def add(which: NDArray[np.int64]) -> Array:
        X_TC = _of_motions(X_WT[which], X_CB[which])
        boards = X_WT[which] @ X_TC @ X_CB[which]
        turn = Rotation.from_matrix(boards[:, :3, :3]).mean().as_rotvec()
        X_WB = transform(np.append(turn, np.median(boards[:, :3, 3], axis=0)))
        found.append((X_TC, X_WB))
        return _size(_apart(X_WT, X_CB, X_TC, X_WB))

    sizes = [add(random.choice(count, 4, replace=False)) for _ in range(_STARTS)]
    best = min(sizes, key=np.median)
    add(np.argsort(best)[: math.ceil(_AGREE * count)].astype(np.int64))
    return found[-1]


def _of_motions(X_WT: Array, X_CB: Array) -> Array:
    """Return X_TC by motions between pictures (Park and Martin 1994), as OpenCV has it in C++."""
    i, j = np.triu_indices(len(X_WT), 1)
    tool, board = np.linalg.inv(X_WT[i]) @ X_WT[j], X_CB[i] @ np.linalg.inv(X_CB[j])
    a, b = (pose_vector(X)[:, :3] for X in (tool, board))
    u, _, v = np.linalg.svd(a.T @ b)
    R_TC = u @ np.diag([1.0, 1.0, np.linalg.det(u @ v)]) @ v
    shift = board[:, :3, 3] @ R_TC.T - tool[:, :3, 3]
    p_TC = np.linalg.lstsq((tool[:, :3, :3] - np.eye(3)).reshape(-1, 3), shift.ravel())[0]
    return transform(np.append(Rotation.from_matrix(R_TC).as_rotvec(), p_TC))


def _apart(X_WT: Array, X_CB: Array, X_TC: Array, X_WB: Array) -> Array:
    """Return where the tool is as pictures say, from where the arm says, rad and m, (n, 6)."""
    return pose_vector(np.linalg.inv(X_WT) @ X_WB @ np.linalg.inv(X_CB) @ np.linalg.inv(X_TC))


def _size(apart: Array) -> Array:
    """Return turns and shifts, shape (n, 6), as a number each, 1 for what no arm leaves."""
    return np.asarray(np.max(_lengths(apart) / _ANY_ARM, axis=-1))


def _lengths(apart: Array) -> Array:
    return np.asarray(np.linalg.norm(np.reshape(apart, (*np.shape(apart)[:-1], 2, 3)), axis=-1))


def _turns(X_WT: Array) -> tuple[Array, Array]:
    """Return axes of the tool, rows, and rms turns between poses about them, rad, rising."""
    R = Rotation.from_matrix(X_WT[:, :3, :3])
    i, j = np.triu_indices(len(X_WT), 1)
    turns = (R[i].inv() * R[j]).as_rotvec()
    values, axes = np.linalg.eigh(turns.T @ turns / len(turns))
    return np.round(axes.T, 2) + 0.0, np.sqrt(np.maximum(values, 0.0))


def _moved(X: Array, step: Array) -> Array:
    """Return a pose turned, rad, and shifted, m, about the axes in which it is given."""
    turn = Rotation.from_rotvec(step[:3]) * Rotation.from_matrix(X[:3, :3])
    return transform(np.append(turn.as_rotvec(), X[:3, 3] + step[3:]))


def _said(apart: Array) -> str:
    turn, shift = 1e3 * _lengths(apart)
    return f"{shift:.3g} mm and {turn:.3g} mrad"


def plot_hand_eye(found: HandEye) -> Figure:
    """Draw the residuals of each picture."""
    numbers = np.arange(len(found.names))
    names = [one[-21:].replace("$", r"\$") for one in found.names]
    figure = new_figure(
        height=max(3.8, 0.18 * len(names) + 1.6),
        caption="Difference between the tool's pose by each picture and by the arm, in rotation "
        "and position, beside the arm's rms error.",
    )
    for k, (axes, unit) in enumerate(zip(figure.subplots(1, 2), ("mrad", "mm"), strict=True)):
        axes.barh(numbers, 1e3 * _lengths(found.apart)[:, k], color=("#e07b00", "#1b4f9c")[k])
        axes.axvline(1e3 * math.sqrt(3) * found.arm[k], **LIMIT, label="rms error of the arm")
        title = f"({'ab'[k]}) {('Rotation', 'Position')[k]} of the tool"
        dress(axes, title=title, x=f"difference / {unit}", y="")
        axes.set_yticks(numbers, names, fontsize=8)
        axes.invert_yaxis()
        legend(axes)
    return figure
