"""The rotation that lays forces onto a friction cone, from sums over rows.

A surface pushes along d = (n - mu v) / sqrt(1 + mu^2), n its normal, v the direction of sliding.
The rotation that takes the directions of the forces there is Wahba's problem, solved by singular
values (Kabsch 1976); with it mu follows: both are found in turns.
"""

from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from chamfer.analysis.identify.quantity import Array

_TURNS: Final = 60


class Cone(NamedTuple):
    """A fit of the forces' directions."""

    friction: float
    mending: Array  # (3, 3), takes the recorded axes to the right ones; det -1: mirrored
    misfit: float  # rms distance of a unit force from its place on the cone


def fit_cone(along_normal: Array, along_sliding: Array, rows: float, sign: float = 1.0,
             friction: float = 0.3) -> Cone:  # fmt: skip
    """Return friction, which begins at ``friction``, and rotation (``sign`` 1) or mirror (-1).

    ``along_normal`` and ``along_sliding``, (3, 3), are the sums of n f^T and v f^T over the rows,
    f the direction of the force.
    """
    for _ in range(_TURNS):
        u, sizes, vt = np.linalg.svd(along_normal - friction * along_sliding)
        keep = np.array([1.0, 1.0, sign * np.sign(np.linalg.det(u @ vt))])
        mending = u * keep @ vt
        cosine = float(sizes @ keep) / np.sqrt(1 + friction**2) / rows
        before, pushed = friction, max(float(np.sum(mending * along_normal)), 1e-300)
        friction = float(np.clip(-np.sum(mending * along_sliding) / pushed, 0.0, 5.0))
        if abs(friction - before) < 1e-8:
            break
    return Cone(friction, mending, float(np.sqrt(max(0.0, 2 * (1 - cosine)))))


def rotation_vector(mending: Array, near: Array) -> Array:
    """Return the rotation vector, rad, of the two of a rotation that is nearer to ``near``."""
    vector = Rotation.from_matrix(mending).as_rotvec()
    angle = float(np.linalg.norm(vector))
    other = vector * (1 - 2 * np.pi / angle) if angle > 0.0 else vector
    return np.asarray(min(vector, other, key=lambda v: float(np.linalg.norm(v - near))))
