"""Whether a peg is in the material around its hole: where it starts, or is told to be."""

import math
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from chamfer.models.peg.part_surfaces import around, radius_of
from chamfer.models.peg.peg_and_hole import HolePart, Peg, PegAndHole
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

TOUCHING: Final = 1e-6  # m, what counts as no overlap

_SIDES: Final = 96  # points of a ring
_STEP: Final = 0.1  # between points along a profile, of the hole's radius


def overlap(parts: PegAndHole, X_MT: RigidTransform) -> float:
    """Return how deep peg and hole part are in each other, m; 0 where they are apart.

    It is looked for at points a tenth of the hole's radius apart on both surfaces, also on all
    edges: two sides that cross each other by less than 0.3 % of it may go unseen.

    Args:
        parts: Peg and hole part.
        X_MT: Pose of the peg's tip in the mouth's frame.
    """
    on_peg = _surface(parts, "peg") @ X_MT.rotation().matrix().T + X_MT.translation()
    deepest = float(_in_hole_part(parts.hole, on_peg).max())
    X_TM = X_MT.inverse()
    on_hole = _surface(parts, "hole") @ X_TM.rotation().matrix().T + X_TM.translation()
    return max(deepest, float(_in_peg(parts.peg, on_hole).max()), 0.0)


def require_apart(parts: PegAndHole, X_MT: RigidTransform, name: str, value: object) -> None:
    """Raise :class:`ParameterError`, which names a field, if peg and hole part overlap."""
    deep = overlap(parts, X_MT)
    if deep > TOUCHING:
        allowed = (
            f"one with which peg and hole part are apart; they overlap by {1e3 * deep:.3g} mm"
        )
        raise ParameterError(name, value, allowed)


def require_tilted_apart(parts: PegAndHole, tilt: float, gap: float) -> None:
    """Refuse a tilt of the peg that is none, or that brings its edge to the mouth's plane.

    Args:
        parts: Peg and hole part.
        tilt: Of the peg about its tip, rad.
        gap: From the tip to the mouth, m.

    Raises:
        ParameterError: It names the tilt or the gap.
    """
    if not abs(tilt) < math.pi / 4:
        raise ParameterError("tilt", tilt, "between -pi/4 and pi/4")
    leading = parts.leading(tilt)
    if not gap > leading:
        allowed = f"> {leading:.3g} m, so that peg and hole do not overlap at the start"
        raise ParameterError("gap", gap, allowed)


@lru_cache(maxsize=16)
def _surface(parts: PegAndHole, part: str) -> Array:
    """Return points on a part's surface in its own frame, m, shape (n, 3)."""
    profile = (parts.peg if part == "peg" else parts.hole).closed_profile
    step = _STEP * parts.hole_radius
    along = np.vstack(
        [
            np.linspace(start, end, 1 + math.ceil(float(np.linalg.norm(end - start)) / step))
            for start, end in pairwise(profile)
        ]
    )
    x, radius = along[:, :1], along[:, 1:]
    ring = around(_SIDES, parts.section)
    points = [np.broadcast_to(x, (len(x), _SIDES)), radius * ring[:, 0], radius * ring[:, 1]]
    return np.stack(points, axis=-1).reshape(-1, 3)


def _in_peg(peg: Peg, p_T: Array) -> Array:
    """Return how deep points are in the peg, m, < 0 outside, shape (n,)."""
    x, radius = p_T[:, 0], radius_of(p_T, peg.section)
    side = np.interp(x, *peg.profile.T)
    deep: Array = np.minimum.reduce([-x, x + peg.length, side - radius])
    return deep


def _in_hole_part(hole: HolePart, p_M: Array) -> Array:
    """Return how deep points are in the material of the hole part, m, < 0 outside."""
    x, radius = p_M[:, 0], radius_of(p_M, hole.section)
    wall = radius - np.interp(x, *hole.bore.T)
    if hole.bore_depth is not None:
        wall = np.maximum(wall, x - hole.bore_depth)
    deep: Array = np.minimum.reduce([x, hole.depth - x, hole.outer_radius - radius, wall])
    return deep
