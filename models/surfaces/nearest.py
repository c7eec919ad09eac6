"""The nearest point of a surface."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import ParameterError

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

_ITERATIONS: Final = 50
_CONVERGED: Final = 1e-14  # m, relative to the distance from the origin where that is above 1 m


def nearest(surface: Surface, p: Vector, metric: Matrix | None = None) -> Vector:
    """Return the point of the surface that is nearest to p, shape (d,), m.

    Newton's method from p, so p has to be near the surface: nearer than its radius of curvature.

    Args:
        surface: the surface.
        p: m, shape (d,).
        metric: symmetric positive definite, shape (d, d); the distance is ``sqrt(r^T metric r)``.
            The Euclidean distance if None. With a stiffness, a spring from p to the point found
            pushes along the normal alone.

    Raises:
        ParameterError: if the search ends nowhere, or in a point that is not a local minimum.
    """
    if not all(map(math.isfinite, p.tolist())):
        raise ParameterError("p", p.tolist(), "finite numbers")
    d = surface.dimension
    weight = np.eye(d) if metric is None else metric
    point, multiplier = np.array(p, dtype=float), 0.0
    for _ in range(_ITERATIONS):
        gradient = surface.gradient(point)
        bent = weight - multiplier * surface.hessian(point)
        minimal = _convex_along(bent, gradient)
        # Stationarity of the Lagrangian and the constraint, both linearised. Where the Lagrangian
        # has no minimum along the surface the constraint's bend is left out, to descend anyway.
        system = np.zeros((d + 1, d + 1))
        system[:d, :d] = bent if minimal else weight
        system[:d, d] = -gradient
        system[d, :d] = -gradient
        right = np.append(-weight @ (point - p), surface.level(point))
        try:
            solution = np.linalg.solve(system, right)
        except np.linalg.LinAlgError:
            break
        point, multiplier = point + solution[:d], float(solution[d])
        size = float(np.max(np.abs(point)))
        if not size < math.inf:
            break
        if minimal and float(np.max(np.abs(solution[:d]))) <= _CONVERGED * max(1.0, size):
            return point
    allowed = "a point nearer to the surface than its radius of curvature"
    raise ParameterError("p", p.tolist(), allowed)


def _convex_along(matrix: Matrix, gradient: Vector) -> bool:
    """Return whether a quadratic form is positive in every direction across the gradient."""
    tangents = np.linalg.svd(gradient[np.newaxis])[2][1:]
    try:
        np.linalg.cholesky(tangents @ matrix @ tangents.T)
    except np.linalg.LinAlgError:
        return False
    return True
