"""The plane that a tool slides on, from its path."""

from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.identify.motion import Motion
from chamfer.analysis.identify.quantity import Array, solve

Rows = NDArray[np.bool_]
_STRAIGHT: Final = 20.0  # times its distance from the plane a path is wide that tells the normal

_ABOVE: Final = 0.8  # of the rows, less those beneath, in which a reference tells the side


@dataclass(frozen=True, kw_only=True)
class Surface:
    """A plane that yields in proportion to the force."""

    out: Array  # (3,), m, some vector away from the surface
    upright: Array  # (3,), the axis next to the force
    told: bool  # whether the path determines the normal; if not it is the axis next to the force
    axes: Array  # (3, 3), unit rows: the path's main directions
    products: Array  # (m, 5, 5), of 1, path along two axes, size of the force, along the third

    def coefficients(self, products: Array) -> Array:
        """Return height, two slopes and minus the compliance, m/N, from sums of products."""
        return solve(products[:4, :4], products[:4, 4])

    def normal(self, coefficients: Array) -> Array:
        """Return the normal, (3,), out of the surface."""
        if self.told:
            normal = np.array([-coefficients[1], -coefficients[2], 1.0]) @ self.axes
        else:
            normal = self.upright
        return np.asarray(normal * np.copysign(1 / np.linalg.norm(normal), normal @ self.out))

    def compliance(self, coefficients: Array) -> float:
        """Return the surface's compliance, m/N of the force's size."""
        return float(-coefficients[3] * np.sign(self.axes[2] @ self.normal(coefficients)))


def fit_surface(motion: Motion, used: Rows) -> tuple[Surface, Array]:
    """Return the surface below the used rows, and their height over it, m."""
    path, push = motion.position[used], motion.force[used]
    centre = path.mean(axis=0)
    axes = np.linalg.svd(path - centre, full_matrices=False)[2]
    along = (path - centre) @ axes.T
    size = np.linalg.norm(push, axis=1)
    rows = np.c_[np.ones(len(path)), along[:, :2], size, along[:, 2]]
    products = rows[:, :, None] * rows[:, None, :]
    total = products.sum(axis=0)
    height = along[:, 2] - rows[:, :4] @ solve(total[:4, :4], total[:4, 4])
    told = bool(np.std(along[:, 1]) > _STRAIGHT * np.std(height))
    before = motion.position[: int(np.argmax(used))]
    out = push.mean(axis=0)
    normal = axes[2] if told else np.eye(3)[int(np.argmax(np.abs(out)))]
    if len(before) > 1 / motion.period:
        out = before.mean(axis=0) - centre
    if motion.reference is not None:
        above = np.mean(np.sign((motion.position - motion.reference)[used] @ normal))
        out = normal * above if abs(above) > _ABOVE else out  # it lies beneath
    return Surface(out=out, upright=normal, told=told, axes=axes, products=products), height
