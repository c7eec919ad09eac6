"""A curve defined by its curvature along its length: bends, arcs, S-bends."""

import itertools
import math
from dataclasses import dataclass
from typing import ClassVar, Final

import numpy as np

from chamfer.models.surfaces.surface_code import (
    PROFILE,
    Coded,
    Nodes,
    Place,
    leaf,
    profile_chord,
)
from chamfer.models.validation import ParameterError

_SPACING: Final = 0.01  # m, at most, between two nodes
_MOST: Final = 100.0  # m, of all pieces


@dataclass(frozen=True, kw_only=True)
class Profile(Coded):
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

    def nodes(self, place: Place | None) -> Nodes:
        """Return the profile's node, with a table of the curve's points to start from."""
        part, s, angle = (0.5 if self.smooth else 1.0), 0.0, 0.0
        pieces, at = [], [0.0]
        for length, curvature in zip(self.lengths, self.curvatures, strict=True):
            pieces += [s, angle, curvature, length]
            count = math.ceil(length / _SPACING)
            at += [s + length * (i + 1) / count for i in range(count)]
            s, angle = s + length, angle + part * length * curvature
        numbers = [len(self.lengths), len(at), self.smooth, *pieces, s, angle, 0.0, 0.0]
        code, x, y, table = np.array(numbers, dtype=np.float64), 0.0, 0.0, [0.0, 0.0, 0.0]
        for begin, end in itertools.pairwise(at):
            across, up = profile_chord(code, 0, begin, end)
            x, y = x + across, y + up
            table += [end, x, y]
        return leaf(PROFILE, [*numbers, *table], place)
