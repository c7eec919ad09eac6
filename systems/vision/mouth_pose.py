"""Pose of a hole, from pictures of the circles of its mouth by a camera in the hand.

An ellipse is the image of a known circle at two poses; which one it is is known from where the
hole is expected. Of two circles, or of more looks, the pose is the one with which all ellipses are
most probable, together with what the hand's camera may be off.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from scipy.spatial.transform import Rotation

from chamfer.models.cameras.camera import Camera
from chamfer.models.peg.peg_and_hole import HolePart
from chamfer.systems.vision.mouth_ellipse import circle_ellipses

Array = NDArray[np.float64]

POSE_AXES: Final = ("x", "y", "z", "pitch", "yaw")  # along the expected hole's axes, about y and z
_SIZE: Final = len(POSE_AXES)
_STEPS: Final = np.array([1e-6] * 3 + [1e-5] * 2 + [1e-2] * 6)  # m, rad, standard deviations
_UNKNOWN: Final = np.array([1.0] * 3 + [10.0] * 2)  # m and rad: what is known without a look
_ITERATIONS: Final = 12
_STILL: Final = 1e-3  # of a standard deviation, from where a step is none


class Rim(NamedTuple):
    """A circle of a hole's mouth."""

    radius: float  # m
    depth: float  # m, below the front face


def rims(hole: HolePart) -> tuple[Rim, ...]:
    """Return the circles that a hole's mouth shows: of the bore, and of the chamfer's outside."""
    bore = Rim(hole.radius, hole.chamfer.height)
    return (bore, Rim(hole.mouth_radius, 0.0)) if hole.chamfer.width else (bore,)


class SeenRim(NamedTuple):
    """A circle of the mouth in a picture."""

    rim: Rim
    ellipse: Array  # shape (5,), of :mod:`chamfer.systems.vision.mouth_ellipse`
    covariance: Array  # shape (5, 5)


class Look(NamedTuple):
    """The detection in one picture, and the believed pose of its camera."""

    camera: Camera  # straight; its place in any frame that all looks share
    seen: tuple[SeenRim, ...]


class HolePose(NamedTuple):
    """Pose of a hole, estimated from pictures."""

    X_WM: RigidTransform  # in the looks' frame; about its axis it is as was expected
    covariance: Array  # shape (5, 5), m and rad, of POSE_AXES, with the hand's part of it
    surprise: float  # squared standard deviations that the ellipses are off (chi square)


def seen_ellipse(camera: Camera, X_WM: RigidTransform, rim: Rim) -> Array:
    """Return the image of a circle of a hole at a pose, shape (5,)."""
    R, p = X_WM.rotation().matrix(), X_WM.translation()
    return _seen(camera, R, p, rim, np.eye(3), np.zeros(3))


def _seen(camera: Camera, R: Array, p: Array, rim: Rim, turn: Array, moved: Array) -> Array:
    """Return images of a circle of holes, by cameras that are turned and moved in their axes."""
    centre = (p - camera.p_WC + rim.depth * R[..., 0]) @ camera.R_WC - moved
    across = rim.radius * (camera.R_WC.T @ R[..., 1:])
    circle = np.concatenate([across, centre[..., np.newaxis]], axis=-1)
    return circle_ellipses(camera.matrix @ turn.swapaxes(-1, -2) @ circle)


def hole_pose(
    looks: Sequence[Look],
    expected: RigidTransform,
    *,
    hand_eye: Array | None = None,
) -> HolePose | None:
    """Return where the hole is, with least squares; None where they don't converge.

    Args:
        looks: One or more; of one circle from one place the expected pose decides which of both
            solutions it is.
        expected: X_WM, about which is looked, its x axis into the hole; of both poses of one
            circle the nearer one is taken.
        hand_eye: Covariance, shape (6, 6), m and rad, of the pose of the camera in the hand, along
            and about its own axes; of all looks it is the same. None: it is known.
    """
    size = _SIZE if hand_eye is None else _SIZE + 6
    root = None if hand_eye is None else np.linalg.cholesky(hand_eye)
    known = np.append(_UNKNOWN, np.ones(size - _SIZE))  # the hand's state is in its deviations
    steps = _STEPS[:size]
    whiten = [
        (look.camera, one, np.linalg.inv(np.linalg.cholesky(one.covariance)))
        for look in looks
        for one in look.seen
    ]
    R_WE, p_WE = expected.rotation().matrix(), expected.translation()

    def left(states: Array) -> Array:
        """Return the residuals, in standard deviations, shape (n, ...), of n states."""
        R, p = R_WE @ _turns(states), p_WE + states[:, :3] @ R_WE.T
        hand = np.zeros((len(states), 6)) if root is None else states[:, _SIZE:] @ root.T
        moved, turn = hand[:, :3], Rotation.from_rotvec(hand[:, 3:]).as_matrix()
        off = [
            (_seen(camera, R, p, one.rim, turn, moved) - one.ellipse) @ white.T
            for camera, one, white in whiten
        ]
        return np.concatenate([states / known, *off], axis=1)

    state = np.zeros(size)
    for _ in range(_ITERATIONS):
        off = left(state + np.vstack([np.zeros(size), np.diag(steps)]))
        if not np.isfinite(off).all():
            return None
        J = ((off[1:] - off[0]) / steps[:, np.newaxis]).T
        normal = J.T @ J
        change = -np.linalg.solve(normal, J.T @ off[0])
        state += change
        if change @ normal @ change < _STILL**2:
            break
    else:
        return None
    X_WM = expected @ RigidTransform(RotationMatrix(_turns(state[np.newaxis])[0]), state[:3])
    covariance = np.linalg.inv(normal)[:_SIZE, :_SIZE]
    return HolePose(X_WM, covariance, float(off[0] @ off[0]))


def _turns(states: Array) -> Array:
    """Return the turns of states about the expected hole's y and z, shape (n, 3, 3)."""
    return Rotation.from_rotvec(np.insert(states[:, 3:_SIZE], 0, 0.0, axis=1)).as_matrix()
