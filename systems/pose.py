"""Poses as vectors, for ports and logs."""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RigidTransform

from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

POSE_NAMES: Final = ("qw", "qx", "qy", "qz", "x", "y", "z")  # quaternion and position in m
POSE_SIZE: Final = len(POSE_NAMES)


def pose_vector(X: RigidTransform) -> Array:
    """Return quaternion (w, x, y, z), w >= 0, and position, m, shape (7,)."""
    quaternion = X.rotation().ToQuaternion().wxyz()  # Drake makes w >= 0
    return np.concatenate([quaternion, X.translation()])


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
