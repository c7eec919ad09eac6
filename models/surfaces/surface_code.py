"""Surfaces in machine code: level, gradient and second derivatives of all surfaces here.

A code is one row of numbers, which only :func:`surface_code` writes and :func:`evaluate` reads. It
may hold several surfaces. Each is a list of nodes, leaves and what picks one of the leaves before
it, the least or the largest level; a leaf has its own place in the world.
"""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.models.compiled import compiled, in_place
from chamfer.models.surfaces.surface import Surface

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]
Place = tuple[Matrix, Vector]  # R_WS, p_WS
Nodes = list[list[float]]

# Kinds of nodes; those that pick come last.
PLANE: Final = 0.0
ROUND: Final = 1.0
ELLIPSOID: Final = 2.0
PARABOLA: Final = 3.0
WAVE: Final = 4.0
PROFILE: Final = 5.0
LEAST: Final = 6.0
MOST: Final = 7.0

_HEAD: Final = 15  # length, kind, whether it is placed, R_WS, p_WS; then a leaf's own numbers
_ITERATIONS: Final = 30
_GAUSS: Final = np.array(np.polynomial.legendre.leggauss(5))  # nodes and weights


def leaf(kind: float, numbers: Sequence[float], place: Place | None) -> Nodes:
    """Return the node of a surface with its own formula, at a place, or at the world's origin."""
    rotation, point = (np.eye(3), np.zeros(3)) if place is None else place
    head = [_HEAD + len(numbers), kind, float(place is not None), *rotation.ravel(), *point]
    return [[*head, *numbers]]


def nodes_of(surface: Surface, place: Place | None) -> Nodes:
    """Return a surface's nodes at a place.

    Raises:
        TypeError: If it is of a class that is not known here, or that overrides one.
    """

    def depth(name: str) -> int:
        owners = (name in vars(owner) for owner in type(surface).__mro__)
        return next((i for i, owns in enumerate(owners) if owns), -1)

    own = depth("nodes")
    if own < 0 or any(0 <= depth(name) < own for name in ("level", "gradient", "hessian")):
        raise TypeError(type(surface).__name__)
    nodes: Nodes = surface.nodes(place)  # type: ignore[attr-defined]
    return nodes


def surface_code(*surfaces: Surface) -> Vector | None:
    """Return the code of surfaces, or None if one is of a class that is not known here."""
    try:
        lists = [nodes_of(surface, None) for surface in surfaces]
    except TypeError:
        return None
    starts: list[float] = []
    flat: list[float] = []
    for nodes in lists:
        starts.append(float(len(lists) + len(flat)))
        flat += [float(len(nodes)), *(number for node in nodes for number in node)]
    return np.array([*starts, *flat])


class Coded:
    """A surface whose formulas are here."""

    def nodes(self, place: Place | None) -> Nodes:
        """Return its node at a place."""
        raise NotImplementedError

    def level(self, p: Vector) -> float:
        """Return the level, m: 0 on the surface, positive outside of the material."""
        return self._evaluate(p)[0]

    def gradient(self, p: Vector) -> Vector:
        """Return the level's gradient, shape (d,)."""
        return self._evaluate(p)[1]

    def hessian(self, p: Vector) -> Matrix:
        """Return the level's second derivatives, shape (d, d), 1/m."""
        return self._evaluate(p)[2]

    def _evaluate(self, p: Vector) -> tuple[float, Vector, Matrix]:
        d = len(p)
        try:
            code = self.__dict__["_code"]
        except KeyError:
            code = self.__dict__["_code"] = np.array([1.0, 1.0, *self.nodes(None)[0]])
        gradient, hessian = np.empty(d), np.empty((d, d))
        # A copy, because compiled code tells views from arrays.
        level = evaluate(code, 0, np.array(p, dtype=np.float64), gradient, hessian)
        return level, gradient, hessian


@compiled
def evaluate(code: Vector, which: int, point: Vector, gradient: Vector, hessian: Matrix) -> float:
    """Fill in gradient and second derivatives of a code's surface at a point; return its level.

    ``point``, m, and ``gradient``, shape (d,), ``hessian``, (d, d), with d = 3, or 2 for a curve.
    """
    start = int(code[which])
    count, at = int(code[start]), start + 1
    if count == 1:
        return _leaf(code, at, point, gradient, hessian)
    levels, leaves, top = np.empty(count), np.empty(count, dtype=np.int64), 0
    for _ in range(count):
        kind = code[at + 1]
        if kind < LEAST:
            levels[top], leaves[top] = _leaf(code, at, point, gradient, hessian), at
            top += 1
        else:
            first = top - int(code[at + 2])
            best = first
            for other in range(first + 1, top):
                more = levels[other] - levels[best]
                if (more < 0.0 and kind == LEAST) or (more > 0.0 and kind == MOST):
                    best = other
            levels[first], leaves[first] = levels[best], leaves[best]
            top = first + 1
        at += int(code[at])
    return _leaf(code, leaves[0], point, gradient, hessian)


@compiled
def _leaf(code: Vector, at: int, point: Vector, gradient: Vector, hessian: Matrix) -> float:
    d, kind, placed = len(point), code[at + 1], code[at + 2] > 0.0
    own, rotation = at + _HEAD, at + 3
    x, y, z = point[0], point[1], 0.0
    if d == 3:
        z = point[2]
    if placed:
        a, b, c = x - code[at + 12], y - code[at + 13], z - code[at + 14]
        x = a * code[rotation] + b * code[rotation + 3] + c * code[rotation + 6]
        y = a * code[rotation + 1] + b * code[rotation + 4] + c * code[rotation + 7]
        z = a * code[rotation + 2] + b * code[rotation + 5] + c * code[rotation + 8]
    for i in range(d):
        gradient[i] = 0.0
        for k in range(d):
            hessian[i, k] = 0.0
    if kind == PLANE:
        level = _plane(code, own, x, y, z, gradient, hessian)
    elif kind == ROUND:
        level = _round(code, own, x, y, z, gradient, hessian)
    elif kind == ELLIPSOID:
        level = _ellipsoid(code, own, x, y, z, gradient, hessian)
    elif kind == PROFILE:
        level = _profile(code, own, x, y, gradient, hessian)
    else:
        level = _graph(code, own, kind == WAVE, x, y, z, gradient, hessian)
    if placed:
        half, slope = np.empty((3, 3)), np.empty(3)
        for i in range(3):
            slope[i] = gradient[i]
            for k in range(3):
                half[i, k] = 0.0
                for j in range(3):
                    half[i, k] += code[rotation + 3 * i + j] * hessian[j, k]
        for i in range(3):
            gradient[i] = 0.0
            for k in range(3):
                gradient[i] += code[rotation + 3 * i + k] * slope[k]
                hessian[i, k] = 0.0
                for j in range(3):
                    hessian[i, k] += half[i, j] * code[rotation + 3 * k + j]
    return level


@in_place
def _plane(
    code: Vector, own: int, x: float, y: float, z: float, gradient: Vector, hessian: Matrix
) -> float:
    """Evaluate point, normal, direction along, slope, ripple and wave number of a plane."""
    x, y, z = x - code[own], y - code[own + 1], z - code[own + 2]
    slope, ripple, wave = code[own + 9], code[own + 10], code[own + 11]
    s = code[own + 6] * x + code[own + 7] * y + code[own + 8] * z
    sine = math.sin(wave * s)
    level: float = (
        code[own + 3] * x + code[own + 4] * y + code[own + 5] * z - (slope * s + ripple * sine)
    )
    slope += ripple * wave * math.cos(wave * s)
    bend = ripple * wave**2 * sine
    for i in range(3):
        gradient[i] = code[own + 3 + i] - slope * code[own + 6 + i]
        for k in range(3):
            hessian[i, k] = bend * code[own + 6 + i] * code[own + 6 + k]
    return level


@in_place
def _round(
    code: Vector, own: int, x: float, y: float, z: float, gradient: Vector, hessian: Matrix
) -> float:
    """Evaluate axes, centre, radius and sign, < 0 from inside, of a circle or sphere."""
    d, radius, sign = int(code[own]), code[own + 4], code[own + 5]
    x, y = x - code[own + 1], y - code[own + 2]
    z = z - code[own + 3] if d == 3 else 0.0
    distance = math.sqrt(x * x + y * y + z * z)
    if distance > 0.0:
        x, y, z = x / distance, y / distance, z / distance
        for i in range(d):
            one = x if i == 0 else y if i == 1 else z
            gradient[i] = sign * one
            for k in range(d):
                other = x if k == 0 else y if k == 1 else z
                hessian[i, k] = ((1.0 if i == k else 0.0) - one * other) / (sign * distance)
    level: float = sign * (distance - radius)
    return level


@in_place
def _ellipsoid(
    code: Vector, own: int, x: float, y: float, z: float, gradient: Vector, hessian: Matrix
) -> float:
    """Evaluate the semi-axes of an ellipsoid."""
    a, b, c = code[own], code[own + 1], code[own + 2]
    x, y, z, least = x / a, y / b, z / c, min(a, b, c)
    length = math.sqrt(x * x + y * y + z * z)
    if length > 0.0:
        gradient[0], gradient[1], gradient[2] = x / a, y / b, z / c
        for i in range(3):
            for k in range(3):
                bent = code[own + i] ** -2 if i == k else 0.0
                bent -= gradient[i] * gradient[k] / length**2
                hessian[i, k] = least / length * bent
        for i in range(3):
            gradient[i] *= least / length
    level: float = least * (length - 1.0)
    return level


@in_place
def _graph(
    code: Vector,
    own: int,
    wavy: bool,
    x: float,
    y: float,
    z: float,
    gradient: Vector,
    hessian: Matrix,
) -> float:
    """Evaluate across how many axes, and for each factor and wave number, of a sum's graph."""
    across = int(code[own])
    level = y if across == 1 else z
    gradient[across] = 1.0
    for i in range(across):
        s, a, wave = x if i == 0 else y, code[own + 1 + 2 * i], code[own + 2 + 2 * i]
        if wavy:
            sine = a * math.sin(wave * s)
            level -= sine
            gradient[i] = -a * wave * math.cos(wave * s)
            hessian[i, i] = wave * wave * sine
        else:
            level -= a * s * s
            gradient[i] = -2.0 * a * s
            hessian[i, i] = -2.0 * a
    return level


@in_place
def profile_bend(code: Vector, own: int, s: float) -> tuple[float, float]:
    """Return angle, rad, and curvature, 1/m, of a profile after a length of its curve.

    Its numbers: how many pieces, and nodes of its table; whether it is smooth; for each piece, and
    after the last, where it begins, m, the angle there, curvature and length; then the table.
    """
    pieces = int(code[own])
    at = own + 3
    while at < own + 3 + 4 * pieces and code[at + 4] <= s:
        at += 4
    angle, curvature, u = code[at + 1], code[at + 2], s - code[at]
    if u < 0.0 or at == own + 3 + 4 * pieces:
        return angle, 0.0
    if code[own + 2] == 0.0:
        return angle + curvature * u, curvature
    wave = 2.0 * math.pi / code[at + 3]
    turned = 0.5 * curvature * (u - math.sin(wave * u) / wave)
    return angle + turned, 0.5 * curvature * (1.0 - math.cos(wave * u))


@in_place
def profile_chord(code: Vector, own: int, begin: float, end: float) -> tuple[float, float]:
    """Return the vector between two lengths along a profile's curve, m, along x and y."""
    half, x, y = 0.5 * (end - begin), 0.0, 0.0
    for i in range(_GAUSS.shape[1]):
        angle = profile_bend(code, own, begin + half * (1.0 + _GAUSS[0, i]))[0]
        x += _GAUSS[1, i] * math.cos(angle)
        y += _GAUSS[1, i] * math.sin(angle)
    return half * x, half * y


@in_place
def _profile(
    code: Vector, own: int, x: float, y: float, gradient: Vector, hessian: Matrix
) -> float:
    """Evaluate a profile at its point nearest to (x, y), Newton's method from its table's."""
    count, table = int(code[own + 1]), own + 7 + 4 * int(code[own])
    nearest, least = table, math.inf
    for node in range(count):
        at = table + 3 * node
        square = (code[at + 1] - x) ** 2 + (code[at + 2] - y) ** 2
        if square < least:
            nearest, least = at, square
    s, offset, tx, ty, curvature = code[nearest], 0.0, 1.0, 0.0, 0.0
    for _ in range(_ITERATIONS):
        while nearest > table and code[nearest] > s:
            nearest -= 3
        while nearest < table + 3 * (count - 1) and code[nearest + 3] <= s:
            nearest += 3
        px, py = profile_chord(code, own, code[nearest], s)
        px, py = px + code[nearest + 1], py + code[nearest + 2]
        angle, curvature = profile_bend(code, own, s)
        tx, ty = math.cos(angle), math.sin(angle)
        offset = ty * (px - x) + tx * (y - py)
        ahead = (tx * (x - px) + ty * (y - py)) / max(1.0 - curvature * offset, 0.1)
        if abs(ahead) < 1e-13:
            break
        s += ahead
    gradient[0], gradient[1] = -ty, tx
    scale = -curvature / (1.0 - curvature * offset)
    hessian[0, 0], hessian[0, 1] = scale * tx * tx, scale * tx * ty
    hessian[1, 0], hessian[1, 1] = scale * tx * ty, scale * ty * ty
    return offset
