"""The rotation that lays forces onto a friction cone, from sums over rows.

A sliding surface pushes along d = (n - mu v) / sqrt(1 + mu^2), n its normal and v the direction of
sliding. The rotation that takes the directions of the forces to those is Wahba's problem, solved
by singular values (Kabsch 1976); with it mu follows, and both are found in turns.
"""

from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from chamfer.analysis.identify.quantity import Array

_TURNS: Final = 60
_FIRST: Final = 0.3  # friction to begin with


class Cone(NamedTuple):
    """A fit of the forces' directions."""

    friction: float
    mending: Array  # (3, 3), takes the recorded axes to the right ones; det -1: mirrored
    agreement: float  # mean cosine between a mended force and its place on the cone

    @property
    def misfit(self) -> float:
        """The rms distance of a unit force from its place on the cone."""
        return float(np.sqrt(max(0.0, 2 * (1 - self.agreement))))


def fit_cone(along_normal: Array, along_sliding: Array, rows: float, sign: float = 1.0) -> Cone:
    """Return friction and rotation (``sign`` 1) or mirror (-1).

    ``along_normal`` and ``along_sliding``, (3, 3), are the sums of n f^T and v f^T over the rows,
    f the direction of the force.
    """
    friction, mending, agreement = _FIRST, np.eye(3), 0.0
    for _ in range(_TURNS):
        u, sizes, vt = np.linalg.svd(along_normal - friction * along_sliding)
        keep = np.array([1.0, 1.0, sign * np.sign(np.linalg.det(u @ vt))])
        mending = u * keep @ vt
        agreement = float(sizes @ keep) / np.sqrt(1 + friction**2) / rows
        before, friction = friction, cone_friction(along_normal, along_sliding, mending)
        if abs(friction - before) < 1e-9:
            break
    return Cone(friction, mending, agreement)


def cone_friction(along_normal: Array, along_sliding: Array, mending: Array) -> float:
    """Return the friction that a mended sensor sees."""
    pushed = max(float(np.sum(mending * along_normal)), 1e-300)
    return float(np.clip(-np.sum(mending * along_sliding) / pushed, 0.0, 5.0))


def rotation_vector(mending: Array, near: Array) -> Array:
    """Return the rotation vector, rad, of the two of a rotation that is nearer to ``near``."""
    vector = Rotation.from_matrix(mending).as_rotvec()
    angle = float(np.linalg.norm(vector))
    other = vector * (1 - 2 * np.pi / angle) if angle > 0.0 else vector
    return np.asarray(min(vector, other, key=lambda v: float(np.linalg.norm(v - near))))
