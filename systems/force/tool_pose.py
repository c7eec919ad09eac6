"""The commanded pose of a tool, and the force of its springs, as numbers.

A pose, shape (7,), is a quaternion w, x, y, z and a position, m. A feed, shape (3,), is a
distance, m, a speed, m/s, and their time, s. An offset, shape (8,), is at the same time the offset
along y and z, m, the rotations about them, rad, and the rates, m/s and rad/s.
"""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError
from chamfer.systems.law import Signal

Array = NDArray[np.float64]

POSE: Final = Signal(7, ("",) * 4 + ("m",) * 3)


class StraightMotion:
    """A motion on a line from rest to rest, a cubic polynomial of time.

    It starts at ``p_WT``, m, shape (3,), and is at its ``end`` from the ``duration``, s, on.
    """

    def __init__(self, p_WT: Array, end: Array, duration: float) -> None:
        if not 0 < duration < math.inf:
            raise ParameterError("duration", duration, "a finite number > 0")
        if np.shape(p_WT) != (3,) or not np.isfinite(p_WT).all():
            raise ParameterError("p_WT", np.asarray(p_WT).tolist(), "three finite numbers")
        self._start, self.duration = np.array(p_WT), duration
        # As Drake's PiecewisePolynomial.CubicHermite has them, to the last bit.
        way = end - p_WT
        slope, scale = -2 / duration * way, 1 / (duration * duration)
        self._second, self._third = scale * (way - duration * slope), scale * slope

    def at(self, time: float, stopped: float = math.inf) -> tuple[Array, Array]:
        """Return position, m, and velocity, m/s, if the motion is stopped at a time, s."""
        until = min(self.duration, stopped)
        t = min(time, until)
        position = self._start + self._second * t**2 + self._third * t**3
        if not time < until:
            return position, np.zeros(3)
        return position, 2 * self._second * t + 3 * self._third * t**2


def axis_of(pose: Array) -> Array:
    """Return the x axis of a pose's frame, (3,), of its unit quaternion and position, (7,)."""
    w, x, y, z = pose[:4].tolist()
    return np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])


def axes_of(pose: Array) -> Array:
    """Return the axes of a pose's frame, R, (3, 3), of a quaternion of any length."""
    w, x, y, z = (pose[:4] / np.linalg.norm(pose[:4])).tolist()
    # As Drake's RotationMatrix has them, to the last bit, column by column.
    twice = 2 / ((x * x + z * z) + (y * y + w * w))
    sx, sy, sz = twice * x, twice * y, twice * z
    return np.array(
        [
            [1 - sy * y - sz * z, sy * x - sz * w, sz * x + sy * w],
            [sy * x + sz * w, 1 - sx * x - sz * z, sz * y - sx * w],
            [sz * x - sy * w, sz * y + sx * w, 1 - sx * x - sy * y],
        ],
        order="F",
    )


def advanced(
    pose: Array, along: Array, feed: Array, time: float, offset: Array | None = None
) -> Array:
    """Return a pose moved along the x axis of another one, and sideways, at a time, s."""
    fed, rate, since = feed.tolist()
    moved = np.array(pose)
    moved[4:] += (fed + rate * (time - since)) * axis_of(along)
    if offset is None or not offset.any():
        return moved
    y, z, about_y, about_z = offset[:4] + offset[4:] * (time - since)
    return compensate(moved, _in_world(along) @ np.array([0.0, y, z, 0.0, about_y, about_z]))


def feed_velocity(along: Array, feed: Array, offset: Array | None = None) -> Array:
    """Return a feed's and an offset's velocity, rad/s above m/s, (6,), in a pose's axes."""
    velocity = np.zeros(6)
    velocity[3:] = feed[1] * axis_of(along)
    if offset is not None and offset[4:].any():
        y, z, about_y, about_z = offset[4:].tolist()
        velocity += _in_world(along) @ np.array([0.0, about_y, about_z, 0.0, y, z])
    return velocity


def _in_world(pose: Array) -> Array:
    """Return the map of a pair of vectors from a pose's axes to the world's."""
    return share_of_compensation(1.0, axes_of(pose))


def spring_force(stiffness: Array, command: Array, tool_pose: Array, hole_pose: Array) -> Array:
    """Return the force of an arm's springs on its tool along the hole's axes, N, (3,).

    ``stiffness``, N/m, (3,), is along the axes of the command.
    """
    R_WD, R_WM = axes_of(command), axes_of(hole_pose)
    force: Array = R_WM.T @ (R_WD @ (stiffness * (R_WD.T @ (command[4:] - tool_pose[4:]))))
    return force


def advance_of(tool_pose: Array, hole_pose: Array) -> float:
    """Return a tool's distance beyond the hole's mouth along its axis, m."""
    return float(axes_of(hole_pose)[:, 0] @ (tool_pose[4:] - hole_pose[4:]))


def compensate(pose: Array, compensation: Array) -> Array:
    """Return a pose, (7,), moved and turned about its own origin by a compensation, (6,), m, rad.

    The compensation is in the world's axes; the quaternion is the one of the two that is nearer to
    the pose's.
    """
    w, x, y, z, *position = pose.tolist()
    *moved, r, p, q = compensation.tolist()
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0 < length < math.inf:
        raise ParameterError("desired_pose", pose[:4].tolist(), "a quaternion other than zero")
    angle = math.sqrt(r * r + p * p + q * q)
    cosine = math.cos(angle / 2)
    scale = math.sin(angle / 2) / angle if angle > 0 else 0.5
    r, p, q = scale * r, scale * p, scale * q
    # Beyond half a turn the other one of the two quaternions is nearer to the pose's.
    length = math.copysign(length, cosine)
    turned = (
        (cosine * w - r * x - p * y - q * z) / length,
        (cosine * x + r * w + p * z - q * y) / length,
        (cosine * y - r * z + p * w + q * x) / length,
        (cosine * z + r * y - p * x + q * w) / length,
    )
    return np.array([*turned, *(a + b for a, b in zip(position, moved, strict=True))])


def share_of_compensation(share: float, R_WH: Array) -> Array:
    """Return the map from a compensation in axes H to an arm's share of it in the world's."""
    return np.array(share * np.kron(np.eye(2), R_WH), dtype=np.float64)
