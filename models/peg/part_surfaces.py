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

_CORNERS = np.array([[1.0, 1.0], [-1.0, 1.0], [-1.0, -1.0], [1.0, -1.0]])  # of a square, y and z


def rings(profile: Vector, sides: int, section: Section = "round") -> Vector:
    """Return points on the rings that a profile describes about the x axis.

    Polygons in place of circles have their areas: their corners are a little outside, the middles
    of their sides a little inside. Of squares the corners are returned.

    Args:
        profile: Position along x and radius, m, shape (n, 2).
        sides: Corners of each circle, at least 3.
        section: Of the part.

    Returns:
        Points in the part's frame, m, shape (n, sides or 4, 3); the angle grows from y to z.
    """
    if section == "square":
        corners = _CORNERS
    else:
        angle = 2 * math.pi * np.arange(sides) / sides
        scale = math.sqrt((2 * math.pi / sides) / math.sin(2 * math.pi / sides))
        corners = scale * np.column_stack([np.cos(angle), np.sin(angle)])
    points = np.empty((len(profile), len(corners), 3))
    points[:, :, 0] = profile[:, :1]
    points[:, :, 1] = profile[:, 1:] * corners[:, 0]
    points[:, :, 2] = profile[:, 1:] * corners[:, 1]
    return points


def around(points: int, section: Section) -> Vector:
    """Return points around a section of radius 1, evenly over its angle, shape (points, 2)."""
    angle = 2 * math.pi * np.arange(points) / points
    circle = np.column_stack([np.cos(angle), np.sin(angle)])
    if section == "square":
        circle /= np.abs(circle).max(axis=1, keepdims=True)
    return circle


def radius_of(p: Vector, section: Section) -> Vector:
    """Return the radius of the ring that points are on, m.

    Args:
        p: Points in the part's frame, m, shape (..., 3).
        section: Of the part.
    """
    across = np.abs(p[..., 1:])
    found: Vector = (
        across.max(axis=-1) if section == "square" else np.hypot(*np.moveaxis(across, -1, 0))
    )
    return found


def part_shape(closed_profile: Vector, sides: int, name: str, section: Section = "round") -> Mesh:
    """Return a part as a shape of Drake's, not to be touched.

    Args:
        closed_profile: As of :func:`part_mesh`.
        sides: Likewise.
        name: For messages.
        section: Of the part.
    """
    text = part_mesh(closed_profile, sides, section)
    file = MemoryFile(contents=text, extension=".obj", filename_hint=name)
    return Mesh(mesh_data=InMemoryMesh(mesh_file=file))


def part_mesh(closed_profile: Vector, sides: int, section: Section = "round") -> str:
    """Return a part as the text of a Wavefront OBJ file.

    Every face is flat shaded along the profile; around it it is smooth, or flat if it is square.

    Args:
        closed_profile: Position along x and radius, m, shape (n, 2), the material on the right
            of the way (as seen with x to the right and the radius upwards).
        sides: Corners of each circle.
        section: Of the part.
    """
    corners = _CORNERS if section == "square" else around(sides, section)
    n = len(corners)
    lines = []
    count = 0
    for (x0, r0), (x1, r1) in pairwise(closed_profile):
        length = math.hypot(x1 - x0, r1 - r0)
        nx, nr = (r0 - r1) / length, (x1 - x0) / length
        for k in range(n):
            (y, z), (y_next, z_next) = corners[k], corners[(k + 1) % n]
            if section == "square":
                middle = (y + y_next) / 2, (z + z_next) / 2
                normals = [middle, middle]
            else:
                normals = [(y, z), (y_next, z_next)]
            for (c, s), (ny, nz) in zip([(y, z), (y_next, z_next)], normals, strict=True):
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
    x, radius = along[:, :1], along[:, 1:]
    ring = around(_RING_SIDES, parts.section)
    points = [np.broadcast_to(x, (len(x), _RING_SIDES)), radius * ring[:, 0], radius * ring[:, 1]]
    return np.stack(points, axis=-1).reshape(-1, 3)


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
