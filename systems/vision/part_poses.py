"""The poses of the peg and the hole part as ports of the cameras that draw them."""

from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, LeafSystem

from models.validation import ParameterError

Array = NDArray[np.float64]

POSE_SIZE = 7  # quaternion w, x, y, z and position x, y, z in m


def pose_vector(X_WP: RigidTransform) -> Array:
    """Return a pose as a vector: quaternion w, x, y, z and position x, y, z in m, shape (7,)."""
    return np.concatenate([X_WP.rotation().ToQuaternion().wxyz(), X_WP.translation()])


def pose_from_vector(pose: Array) -> RigidTransform:
    """Return the pose of a vector; the quaternion is normalised.

    Args:
        pose: Quaternion w, x, y, z and position x, y, z in m, shape (7,).

    Raises:
        ParameterError: If the pose is not finite or the quaternion's length is not about 1.
    """
    length = float(np.linalg.norm(pose[:4]))
    if not (np.isfinite(pose).all() and abs(length - 1) < 0.01):
        allowed = "finite numbers, the first four a quaternion of length 1"
        raise ParameterError("pose", pose.tolist(), allowed)
    return RigidTransform(Quaternion(pose[:4] / length), pose[4:])


class PosePorts:
    """The inputs ``peg_pose`` and ``hole_pose`` of a system; one not connected: not in view."""

    def __init__(self, system: LeafSystem) -> None:
        self._ports: list[Any] = [
            system.DeclareVectorInputPort(name, POSE_SIZE) for name in ("peg_pose", "hole_pose")
        ]

    def read(self, context: Context) -> tuple[RigidTransform | None, RigidTransform | None]:
        """Return X_WT of the peg and X_WM of the hole part, None where not connected."""
        peg, hole = (
            pose_from_vector(port.Eval(context)) if port.HasValue(context) else None
            for port in self._ports
        )
        return peg, hole

    def tickets(self) -> set[Any]:
        """Return what an output that reads the poses depends on."""
        return {port.ticket() for port in self._ports}
