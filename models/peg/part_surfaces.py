"""The surfaces of peg and hole part: points on them, and meshes to be seen.

A part is described by its profile, position along x and radius, and by its section: a ring of it
is a circle, or a square whose faces are in the part's y and z, with half its width as radius.

And whether a peg overlaps the material around its hole: where it starts, or is told to be.
"""

import math
from functools import lru_cache
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh
from pydrake.math import RigidTransform

from chamfer.models.peg.peg_and_hole import HolePart, Peg, PegAndHole, Section
from chamfer.models.validation import ParameterError

Vector = NDArray[np.float64]

SQUARE: Final = np.array(
    [[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]]
)  # of radius 1, y and z


def rings(profile: Vector, sides: int, section: Section = "round") -> Vector:
    """Return points on the rings of a profile, m, shape (n, sides or 4, 3), from y to z.

    Polygons in place of circles have their areas: their corners are a little outside, the middles
    of their sides a little inside. Of squares the corners are returned.
    """
    if section == "square":
        return swept(profile, SQUARE)
    scale = math.sqrt((2 * math.pi / sides) / math.sin(2 * math.pi / sides))
    return swept(profile, scale * around(sides, "round"))


def swept(profile: Vector, ring: Vector) -> Vector:
    """Return the points of a profile, (n, 2), on a ring, (k, 2), shape (n, k, 3)."""
    x = np.broadcast_to(profile[:, :1], (len(profile), len(ring)))
    return np.stack([x, profile[:, 1:] * ring[:, 0], profile[:, 1:] * ring[:, 1]], axis=-1)


def around(points: int, section: Section) -> Vector:
    """Return points around a section of radius 1, evenly over its angle, shape (points, 2)."""
    angle = 2 * math.pi * np.arange(points) / points
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    if section == "square":
        circle /= np.abs(circle).max(axis=1, keepdims=True)
    return circle


def radius_of(p: Vector, section: Section) -> Vector:
    """Return the radius of the ring that points of a part's frame, shape (..., 3), are on, m."""
    across = np.abs(p[..., 1:])
    flat: Vector = across.max(axis=-1)
    round_: Vector = np.hypot(across[..., 0], across[..., 1])
    return flat if section == "square" else round_


def part_shape(closed_profile: Vector, sides: int, name: str, section: Section = "round") -> Mesh:
    """Return :func:`part_mesh` as a shape of Drake's, not to be touched."""
    text = part_mesh(closed_profile, sides, section)
    file = MemoryFile(contents=text, extension=".obj", filename_hint=name)
    return Mesh(mesh_data=InMemoryMesh(mesh_file=file))


def part_mesh(closed_profile: Vector, sides: int, section: Section = "round") -> str:
    """Return a part as the text of a Wavefront OBJ file.

    The profile, m, shape (n, 2), has the material on the right of its way (seen with x to the
    right and the radius upwards). Every face is flat shaded along it; around it is smooth, or
    flat if it is square.
    """
    corners = SQUARE if section == "square" else around(sides, section)
    lines = []
    count = 0
    for (x0, r0), (x1, r1) in pairwise(closed_profile):
        length = math.hypot(x1 - x0, r1 - r0)
        nx, nr = (r0 - r1) / length, (x1 - x0) / length
        for ends in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            normals = [np.mean(ends, axis=0)] * 2 if section == "square" else ends
            for (c, s), (ny, nz) in zip(ends, normals, strict=True):
                lines.append(f"v {x0:.9g} {r0 * c:.9g} {r0 * s:.9g}")
                lines.append(f"v {x1:.9g} {r1 * c:.9g} {r1 * s:.9g}")
                lines.append(f"vn {nx:.9g} {nr * ny:.9g} {nr * nz:.9g}")
            a, m = count + 1, count // 2 + 1
            lines.append(f"f {a}//{m} {a + 2}//{m + 1} {a + 3}//{m + 1}")
            lines.append(f"f {a}//{m} {a + 3}//{m + 1} {a + 1}//{m}")
            count += 4
    return "\n".join(lines) + "\n"


TOUCHING: Final = 1e-6  # m, what counts as no overlap

_RING_SIDES: Final = 96  # points of a ring
_ALONG: Final = 0.1  # between points along a profile, of the hole's radius


def overlap(parts: PegAndHole, X_MT: RigidTransform) -> float:
    """Return how deep peg and hole part are in each other, m; 0 where they are apart.

    It is looked for at points a tenth of the hole's radius apart on both surfaces, also on all
    edges: two sides that cross each other by less than 0.3 % of it may go unseen.
    """
    on_peg = _surface(parts, "peg") @ X_MT.rotation().matrix().T + X_MT.translation()
    deepest = float(_in_hole_part(parts.hole, on_peg).max())
    X_TM = X_MT.inverse()
    on_hole = _surface(parts, "hole") @ X_TM.rotation().matrix().T + X_TM.translation()
    return max(deepest, float(_in_peg(parts.peg, on_hole).max()), 0.0)


def require_apart(parts: PegAndHole, X_MT: RigidTransform, name: str, value: object) -> None:
    """Raise :class:`ParameterError`, which names a field, if peg and hole part overlap."""
    if (deep := overlap(parts, X_MT)) > TOUCHING:
        apart = "one with which peg and hole part are apart"
        raise ParameterError(name, value, f"{apart}; they overlap by {1e3 * deep:.3g} mm")


def require_tilted_apart(parts: PegAndHole, tilt: float, gap: float) -> None:
    """Refuse a tilt, rad, that brings the peg's edge to the plane of a mouth a gap away, m."""
    if not abs(tilt) < math.pi / 4:
        raise ParameterError("tilt", tilt, "between -pi/4 and pi/4")
    leading = parts.leading(tilt)
    if not gap > leading:
        allowed = f"> {leading:.3g} m, so that peg and hole do not overlap at the start"
        raise ParameterError("gap", gap, allowed)


@lru_cache(maxsize=16)
def _surface(parts: PegAndHole, part: str) -> Vector:
    """Return points on a part's surface in its own frame, m, shape (n, 3)."""
    profile = (parts.peg if part == "peg" else parts.hole).closed_profile
    step = _ALONG * parts.hole_radius
    along = np.vstack(
        [
            np.linspace(start, end, 1 + math.ceil(float(np.linalg.norm(end - start)) / step))
            for start, end in pairwise(profile)
        ]
    )
    return swept(along, around(_RING_SIDES, parts.section)).reshape(-1, 3)


def _in_peg(peg: Peg, p_T: Vector) -> Vector:
    """Return how deep points are in the peg, m, < 0 outside, shape (n,)."""
    x, radius = p_T[:, 0], radius_of(p_T, peg.section)
    side = np.interp(x, *peg.profile.T)
    deep: Vector = np.minimum.reduce([-x, x + peg.length, side - radius])
    return deep


def _in_hole_part(hole: HolePart, p_M: Vector) -> Vector:
    """Return how deep points are in the material of the hole part, m, < 0 outside."""
    x, radius = p_M[:, 0], radius_of(p_M, hole.section)
    wall = radius - np.interp(x, *hole.bore.T)
    if hole.bore_depth is not None:
        wall = np.maximum(wall, x - hole.bore_depth)
    deep: Vector = np.minimum.reduce([x, hole.depth - x, hole.outer_radius - radius, wall])
    return deep
