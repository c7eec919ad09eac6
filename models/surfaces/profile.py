"""A curve that is given by its curvature along its length: bends, arcs, S-bends."""

import itertools
import math
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar, Final

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError

Vector = NDArray[np.float64]
Matrix = NDArray[np.float64]

_SPACING: Final = 0.01  # m, at most, between two nodes
_MOST: Final = 100.0  # m, of all pieces
_ITERATIONS: Final = 30
_NODES, _WEIGHTS = np.polynomial.legendre.leggauss(5)


@dataclass(frozen=True, kw_only=True)
class Profile:
    """The material below a curve that leaves the origin along +x and consists of pieces.

    A piece is an arc, or with ``smooth`` a bend whose curvature rises from 0 and falls to 0 as the
    square of a sine, and which so turns by half as much. Before the first piece and after the last
    one the curve is straight. The level is the distance, m, as far as the curve's normals do not
    cross.
    """

    dimension: ClassVar[int] = 2

    lengths: tuple[float, ...] = (1.0, 0.4)  # m, of the pieces, one after the other
    curvatures: tuple[float, ...] = (0.0, 1.0)  # 1/m, the largest of each; > 0: it turns upwards
    smooth: bool = True  # False: the curvature jumps from piece to piece

    def __post_init__(self) -> None:
        lengths, curvatures = self.lengths, self.curvatures
        if not lengths or not (min(lengths) > 0 and sum(lengths) <= _MOST):
            allowed = f"numbers > 0, together at most {_MOST:g} m"
            raise ParameterError("lengths", lengths, allowed)
        if len(curvatures) != len(lengths) or not all(map(math.isfinite, curvatures)):
            raise ParameterError("curvatures", curvatures, f"{len(lengths)} finite numbers")

    def level(self, p: Vector) -> float:
        """Return the distance above the curve, m."""
        return self._foot(p)[0]

    def gradient(self, p: Vector) -> Vector:
        """Return the distance's gradient."""
        x, y = self._foot(p)[1]
        return np.array([-y, x])

    def hessian(self, p: Vector) -> Matrix:
        """Return the distance's second derivatives."""
        offset, tangent, curvature = self._foot(p)
        return -curvature / (1.0 - curvature * offset) * np.outer(tangent, tangent)

    def _foot(self, p: Vector) -> tuple[float, tuple[float, float], float]:
        """Return how far p is above, m, and tangent and curvature, 1/m, nearest to it (Newton)."""
        x, y = p.tolist()
        at, points = self._table
        s = float(at[np.argmin((points[:, 0] - x) ** 2 + (points[:, 1] - y) ** 2)])
        for _ in range(_ITERATIONS):
            (px, py), angle, curvature = self._at(s)
            tx, ty = math.cos(angle), math.sin(angle)
            offset = ty * (px - x) + tx * (y - py)
            ahead = (tx * (x - px) + ty * (y - py)) / max(1.0 - curvature * offset, 0.1)
            if abs(ahead) < 1e-13:
                break
            s += ahead
        return offset, (tx, ty), curvature

    @cached_property
    def _starts(self) -> list[tuple[float, float]]:
        """Where each piece begins, m, and the curve's angle there, rad; and the end."""
        part, found = (0.5 if self.smooth else 1.0), [(0.0, 0.0)]
        for length, curvature in zip(self.lengths, self.curvatures, strict=True):
            s, angle = found[-1]
            found.append((s + length, angle + part * length * curvature))
        return found

    def _bend(self, s: float) -> tuple[float, float]:
        """Return angle, rad, and curvature, 1/m, after a length of the curve."""
        i = sum(start <= s for start, _ in self._starts) - 1
        start, angle = self._starts[max(i, 0)]
        if not 0 <= i < len(self.lengths):
            return angle, 0.0
        curvature, u = self.curvatures[i], s - start
        if not self.smooth:
            return angle + curvature * u, curvature
        wave = 2 * math.pi / self.lengths[i]
        turned = 0.5 * curvature * (u - math.sin(wave * u) / wave)
        return angle + turned, 0.5 * curvature * (1 - math.cos(wave * u))

    @cached_property
    def _table(self) -> tuple[Vector, Matrix]:
        """Lengths, m, shape (n,), and the curve's points there, m, shape (n, 2)."""
        at = [0.0]
        for (start, _), length in zip(self._starts, self.lengths, strict=False):
            count = math.ceil(length / _SPACING)
            at += [start + length * (i + 1) / count for i in range(count)]
        points = [np.zeros(2)]
        for begin, end in itertools.pairwise(at):
            points.append(points[-1] + self._chord(begin, end))
        return np.array(at), np.array(points)

    def _chord(self, begin: float, end: float) -> Vector:
        half = 0.5 * (end - begin)
        angles = [self._bend(begin + half * (1 + node))[0] for node in _NODES]
        return half * np.array([_WEIGHTS @ np.cos(angles), _WEIGHTS @ np.sin(angles)])

    def _at(self, s: float) -> tuple[list[float], float, float]:
        """Return point, m, angle, rad, and curvature, 1/m, after a length of the curve."""
        at, points = self._table
        i = max(int(np.searchsorted(at, s, side="right")) - 1, 0)
        return (points[i] + self._chord(float(at[i]), s)).tolist(), *self._bend(s)
