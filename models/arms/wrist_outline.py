"""What of the Adept's wrist comes near a crucible's wall: the gripper's body, fork and fingers.

Leier (1998) asks that nuggets be placed without the gripper touching the wall (thesis, section
1.1.1); the seventh element of the endpoint vector, the lean of the gripper's body, is for that.
Shapes are not published: assumed, as adept_wrist.urdf draws them. All are convex, so that inside a
round wall their corners are what comes nearest to it.
"""

from itertools import product
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.models.arms.adept_wrist import FINGER_LENGTH

Array = NDArray[np.float64]

_BODY: Final = (0.030, 0.040, 0.17)  # m, of the body, along its axes
_BODY_ABOVE: Final = 0.10  # m, of its middle, above joint 6
_FORK: Final = (0.008, 0.05)  # m, radius and length of the fork's cylinder about joint 6
_FINGER: Final = (0.014, 0.006, 0.06)  # m, of each finger
_FINGER_ASIDE: Final = 0.016  # m, of its middle from the nugget's
_ROUND: Final = 16  # points of the fork's circles


def _box(size: tuple[float, float, float], middle: tuple[float, float, float]) -> Array:
    signs = np.array(list(product((-0.5, 0.5), repeat=3)))
    return signs * size + middle


def _fork() -> Array:
    angle = 2 * np.pi * np.arange(_ROUND) / _ROUND
    radius, length = _FORK
    return np.array(
        [
            (radius * np.cos(one), side * length / 2, radius * np.sin(one))
            for one in angle
            for side in (-1.0, 1.0)
        ]
    )


# In the body's axes, from joint 6, and in the endpoint's frame.
_ON_BODY: Final = np.vstack([_box(_BODY, (0.0, 0.0, _BODY_ABOVE)), _fork()])
_ON_FINGERS: Final = np.vstack(
    [_box(_FINGER, (0.0, side * _FINGER_ASIDE, FINGER_LENGTH / 2)) for side in (-1.0, 1.0)]
)


def gripper_points(x: Array) -> Array:
    """Return the gripper's corners in the world, m, shape (k, 56, 3).

    Args:
        x: Endpoint vectors (x, y, z, yaw, pitch, roll, lean), m and rad, shape (k, 7).
    """
    yaw, pitch, roll, lean = x[:, 3:].T
    R_WM = _turn(yaw, 2)
    R_WE = R_WM @ _turn(pitch, 1) @ _turn(roll, 0)
    p_WE = x[:, np.newaxis, :3]
    p_WJ = p_WE + FINGER_LENGTH * R_WE[:, np.newaxis, :, 2]
    body = p_WJ + np.einsum("kij,pj->kpi", R_WM @ _turn(-lean, 1), _ON_BODY)
    fingers = p_WE + np.einsum("kij,pj->kpi", R_WE, _ON_FINGERS)
    return np.concatenate([body, fingers], axis=1)


def _turn(angle: Array, axis: int) -> Array:
    """Return rotations about a coordinate axis, shape (k, 3, 3)."""
    found = np.zeros((len(angle), 3, 3))
    i, j = (axis + 1) % 3, (axis + 2) % 3
    found[:, axis, axis] = 1.0
    found[:, i, i] = found[:, j, j] = np.cos(angle)
    found[:, j, i] = np.sin(angle)
    found[:, i, j] = -found[:, j, i]
    return found
