"""Lens distortion by OpenCV's model: where straight lines go in an image, and back."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Coefficients = tuple[float, float, float, float, float]

UNDISTORTED: Final[Coefficients] = (0.0, 0.0, 0.0, 0.0, 0.0)

_LARGEST: Final = 1e30  # of a coefficient: its products stay numbers
_DIRECTIONS: Final = 36  # over half a turn, in which the fold is looked for
_REAL: Final = 1e-6  # imaginary part of what counts as a real root, relative
_SHORT_OF_FOLD: Final = 0.999  # at the fold itself nothing can be turned back
_STEPS: Final = 80  # at most, of Newton's method with halved steps
_EXACT: Final = 1e-14  # at a focal length of 1, from where on no step is needed
_CONVERGED: Final = 1e-11  # likewise, what counts as found


@dataclass(frozen=True)
class LensDistortion:
    """k1, k2, p1, p2, k3 of OpenCV's model.

    Points are x and y at a focal length of 1, from the principal point, shape (..., 2). With
    r^2 = x^2 + y^2 and g = 1 + k1 r^2 + k2 r^4 + k3 r^6 a point is seen at
    x g + 2 p1 x y + p2 (r^2 + 2 x^2) and y g + p1 (r^2 + 2 y^2) + 2 p2 x y.

    Far from the middle the model folds back: two points would be seen at one place. It is the
    gradient of a potential, so that its Jacobian is symmetric, and on the largest disc on which
    that is positive definite no two points meet. What is outside is refused.
    """

    coefficients: Coefficients

    def __post_init__(self) -> None:
        if len(self.coefficients) != 5 or not all(map(math.isfinite, self.coefficients)):
            allowed = "five finite numbers: k1, k2, p1, p2, k3"
            raise ParameterError("distortion", self.coefficients, allowed)
        if max(map(abs, self.coefficients)) > _LARGEST:
            allowed = f"five numbers from {-_LARGEST:g} to {_LARGEST:g}"
            raise ParameterError("distortion", self.coefficients, allowed)

    @cached_property
    def reach(self) -> float:
        """Radius up to which the model does not fold back, infinite if it never does."""
        k1, k2, p1, p2, k3 = self.coefficients
        # Negative radii are the other half turn.
        turns = np.linspace(0.0, math.pi, _DIRECTIONS if p1 or p2 else 1, endpoint=False)
        c, s = np.cos(turns)[:, np.newaxis], np.sin(turns)[:, np.newaxis]
        # Along a direction the Jacobian's elements are polynomials of the radius.
        g = np.array([1.0, 0.0, k1, 0.0, k2, 0.0, k3])
        slope = np.array([0.0, 0.0, 2 * k1, 0.0, 4 * k2, 0.0, 6 * k3])
        r = np.eye(len(g))[1]
        xx = g + c * c * slope + (2 * p1 * s + 6 * p2 * c) * r
        yy = g + s * s * slope + (6 * p1 * s + 2 * p2 * c) * r
        xy = c * s * slope + (2 * p1 * c + 2 * p2 * s) * r
        degree = 2 * (len(g) - 1)
        determinant = np.zeros((len(turns), degree + 1))
        for k in range(len(g)):
            product = xx[:, k : k + 1] * yy - xy[:, k : k + 1] * xy
            determinant[:, k : k + len(g)] += product
        # It begins with 1, so that one over its roots are eigenvalues of a companion matrix.
        companion = np.zeros((len(turns), degree, degree))
        companion[:, np.arange(1, degree), np.arange(degree - 1)] = 1.0
        companion[:, 0] = -determinant[:, 1:]
        inverse = np.linalg.eigvals(companion)
        real = np.abs(inverse)[np.abs(inverse.imag) <= _REAL * np.abs(inverse)]
        most = float(real.max(initial=0.0))
        return _SHORT_OF_FOLD / most if most > 0 else math.inf

    def distort(self, points: Vector) -> Vector:
        """Return where points are seen; NaN outside of the reach."""
        k1, k2, p1, p2, k3 = self.coefficients
        x, y = points[..., 0], points[..., 1]
        square = x * x + y * y
        g = 1.0 + square * (k1 + square * (k2 + square * k3))
        g = np.where(square <= self.reach**2, g, math.nan)
        both = 2.0 * x * y
        seen = np.empty(points.shape)
        seen[..., 0] = x * g + p1 * both + p2 * (square + 2.0 * x * x)
        seen[..., 1] = y * g + p1 * (square + 2.0 * y * y) + p2 * both
        return seen

    def jacobian(self, points: Vector) -> Matrix:
        """Return how what is seen moves with the points, shape (..., 2, 2)."""
        k1, k2, p1, p2, k3 = self.coefficients
        x, y = points[..., 0], points[..., 1]
        square = x * x + y * y
        g = 1.0 + square * (k1 + square * (k2 + square * k3))
        slope = 2.0 * (k1 + square * (2.0 * k2 + square * 3.0 * k3))
        result = np.empty((*points.shape, 2))
        result[..., 0, 0] = g + slope * x * x + 2.0 * p1 * y + 6.0 * p2 * x
        result[..., 1, 1] = g + slope * y * y + 6.0 * p1 * y + 2.0 * p2 * x
        result[..., 0, 1] = slope * x * y + 2.0 * p1 * x + 2.0 * p2 * y
        result[..., 1, 0] = result[..., 0, 1]
        return result

    def undistort(self, seen: Vector) -> Vector:
        """Return the points that are seen at places; NaN where no point within reach is seen."""
        target = np.asarray(seen, dtype=float).reshape(-1, 2)
        far = np.linalg.norm(target, axis=1, keepdims=True)
        points = target * np.minimum(1.0, 0.9 * self.reach / np.maximum(far, 1e-300))
        left = target - self.distort(points)
        error = np.linalg.norm(left, axis=1)
        share = np.ones(len(target))
        for _ in range(_STEPS):
            active = np.flatnonzero((error > _EXACT) & (share > 1e-6))
            if not len(active):
                break
            way = np.linalg.solve(self.jacobian(points[active]), left[active, :, np.newaxis])
            tried = points[active] + share[active, np.newaxis] * way[..., 0]
            remains = target[active] - self.distort(tried)
            size = np.linalg.norm(remains, axis=1)
            better = size < error[active]  # not where it is NaN
            good = active[better]
            points[good], left[good], error[good] = tried[better], remains[better], size[better]
            share[good] = 1.0
            share[active[~better]] /= 2.0
        points[~(error <= _CONVERGED * (1.0 + far[:, 0]))] = math.nan
        found: Vector = points.reshape(np.shape(seen))
        return found
