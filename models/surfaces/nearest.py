"""The nearest point of a surface."""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from chamfer.models.compiled import compiled, interpreted
from chamfer.models.surfaces.surface import Surface
from chamfer.models.surfaces.surface_code import evaluate, surface_code
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
    code: Any = surface_code(surface)
    search = find_nearest
    if code is None:
        code, search = surface, interpreted(find_nearest, evaluate=uncoded)
    weight = np.eye(surface.dimension) if metric is None else np.array(metric, dtype=float)
    try:
        return search(code, np.array(p, dtype=float), weight)
    except ArithmeticError as error:
        raise too_far(p) from error


def too_far(p: Vector) -> ParameterError:
    """Return the error of :func:`nearest` where it finds no point."""
    allowed = "a point nearer to the surface than its radius of curvature"
    return ParameterError("p", p.tolist(), allowed)


def uncoded(surface: Surface, which: int, p: Vector, gradient: Vector, hessian: Matrix) -> float:
    """Return the same as :func:`chamfer.models.surfaces.surface_code.evaluate`, of any surface."""
    gradient[:], hessian[:] = surface.gradient(p), surface.hessian(p)
    return surface.level(p)


@compiled
def find_nearest(surface: Vector, p: Vector, metric: Matrix) -> Vector:
    """Return the same as :func:`nearest`, of a surface's code.

    Raises:
        ArithmeticError: If the search ends nowhere, or in a point that is not a local minimum.
    """
    d = len(p)
    gradient, hessian = np.empty(d), np.empty((d, d))
    system, right = np.zeros((d + 1, d + 1)), np.empty(d + 1)
    point, multiplier = p.copy(), 0.0
    for _ in range(_ITERATIONS):
        # Stationarity of the Lagrangian and the constraint, both linearised. Where the Lagrangian
        # has no minimum along the surface the constraint's bend is left out, to descend anyway.
        right[d] = evaluate(surface, 0, point, gradient, hessian)
        bent = metric - multiplier * hessian
        square = gradient @ gradient
        if not 0.0 < square < math.inf:
            break
        system[:d, :d] = bent
        system[:d, d], system[d, :d] = -gradient, -gradient
        # Positive in every direction across the gradient: trace and determinant of that part.
        spread = np.trace(bent) * square - gradient @ (bent @ gradient)
        minimal = spread > 0.0 and np.linalg.det(system) < 0.0
        if not minimal:
            system[:d, :d] = metric
        right[:d] = metric @ (p - point)
        solution = np.linalg.solve(system, right)
        point += solution[:d]
        multiplier = solution[d]
        size = np.max(np.abs(point))
        if minimal and np.max(np.abs(solution[:d])) <= _CONVERGED * max(1.0, size):
            return point
    raise ArithmeticError("no nearest point")
