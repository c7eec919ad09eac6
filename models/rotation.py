"""Rotations as numbers, for code without Drake and SciPy."""

import math
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray


def rotation_matrix(vector: Sequence[float] | NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the matrix, shape (3, 3), of a rotation vector, rad, shape (3,).

    By the quaternion, as SciPy's ``Rotation.from_rotvec``, and the same to the last bit.
    """
    x, y, z = map(float, vector)
    angle = math.sqrt(x * x + y * y + z * z)
    square = angle * angle
    series = 0.5 - square / 48 + square * square / 3840
    scale = series if angle <= 1e-3 else math.sin(angle / 2) / angle
    x, y, z, w = scale * x, scale * y, scale * z, math.cos(angle / 2)
    xx, yy, zz, ww = x * x, y * y, z * z, w * w
    xy, zw, xz, yw, yz, xw = x * y, z * w, x * z, y * w, y * z, x * w
    return np.array(
        [
            [xx - yy - zz + ww, 2 * (xy - zw), 2 * (xz + yw)],
            [2 * (xy + zw), -xx + yy - zz + ww, 2 * (yz - xw)],
            [2 * (xz - yw), 2 * (yz + xw), -xx - yy + zz + ww],
        ]
    )
