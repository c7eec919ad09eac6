"""The peg and the part with the hole: solids of revolution, red and blue (section 4).

Frame T of the peg: the origin in the centre of its end face, x along its axis out of the peg.
Frame M of the hole part: the origin in the centre of the mouth, x along the bore into the
material. T and M have the same orientation where the parts are aligned.
"""

import math
from dataclasses import dataclass
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.common import MemoryFile
from pydrake.geometry import InMemoryMesh, Mesh

from models.validation import ParameterError, require_positive

Vector = NDArray[np.float64]
Colour = tuple[int, int, int]  # red, green, blue, 0 to 255

FRICTION: Final = 0.45  # mu, section 4
RED: Final[Colour] = (205, 40, 40)  # of the peg; the shades are assumed
BLUE: Final[Colour] = (40, 70, 205)  # of the hole part


@dataclass(frozen=True, kw_only=True)
class Peg:
    """A round peg with a chamfer of 45 degrees."""

    radius: float = 0.009779  # m, r, section 4
    chamfer: float = 0.002  # m, along the axis and across it; assumed
    length: float = 0.06  # m, with the chamfer; assumed

    def __post_init__(self) -> None:
        require_positive(self, "radius", "chamfer", "length")
        if not self.chamfer < self.radius:
            raise ParameterError("chamfer", self.chamfer, f"less than the radius, {self.radius} m")
        if not self.chamfer < self.length:
            raise ParameterError("chamfer", self.chamfer, f"less than the length, {self.length} m")

    @property
    def profile(self) -> Vector:
        """Position along x_T and radius, m, from the far end to the tip, shape (3, 2)."""
        return np.array(
            [
                [-self.length, self.radius],
                [-self.chamfer, self.radius],
                [0.0, self.radius - self.chamfer],
            ]
        )

    @property
    def closed_profile(self) -> Vector:
        """The profile with its ends on the axis, shape (5, 2), m."""
        return np.vstack([[-self.length, 0.0], self.profile, [0.0, 0.0]])


@dataclass(frozen=True, kw_only=True)
class HolePart:
    """A tube: a bore with a chamfer of 45 degrees at the mouth, round outside."""

    radius: float = 0.010035  # m, R, section 4
    chamfer: float = 0.002  # m, along the axis and across it; assumed
    outer_radius: float = 0.014  # m, assumed
    depth: float = 0.04  # m, of the part along its axis; the bore goes through; assumed

    def __post_init__(self) -> None:
        require_positive(self, "radius", "chamfer", "outer_radius", "depth")
        if not self.chamfer < self.depth:
            raise ParameterError("chamfer", self.chamfer, f"less than the depth, {self.depth} m")
        if not self.outer_radius > self.mouth_radius:
            allowed = f"more than radius + chamfer, {self.mouth_radius} m"
            raise ParameterError("outer_radius", self.outer_radius, allowed)

    @property
    def mouth_radius(self) -> float:
        """Radius of the opening in the front face, m."""
        return self.radius + self.chamfer

    @property
    def outside(self) -> Vector:
        """Position along x_M and radius of the outside, m, from the mouth, shape (2, 2)."""
        return np.array([[0.0, self.outer_radius], [self.depth, self.outer_radius]])

    @property
    def bore(self) -> Vector:
        """Position along x_M and radius of chamfer and bore, m, from the mouth, shape (3, 2)."""
        return np.array(
            [
                [0.0, self.mouth_radius],
                [self.chamfer, self.radius],
                [self.depth, self.radius],
            ]
        )

    @property
    def closed_profile(self) -> Vector:
        """All around the material, m, the first point again at the end, shape (6, 2)."""
        return np.vstack([self.bore[::-1], self.outside, self.bore[-1:]])


def rings(profile: Vector, sides: int) -> Vector:
    """Return points on the circles that a profile describes about the x axis.

    The polygons have the areas of the circles: their corners are a little outside, the middles
    of their sides a little inside.

    Args:
        profile: Position along x and radius, m, shape (n, 2).
        sides: Corners of each ring, at least 3.

    Returns:
        Points in the part's frame, m, shape (n, sides, 3); the angle grows from y to z.
    """
    angle = 2 * math.pi * np.arange(sides) / sides
    scale = math.sqrt((2 * math.pi / sides) / math.sin(2 * math.pi / sides))
    points = np.empty((len(profile), sides, 3))
    points[:, :, 0] = profile[:, :1]
    points[:, :, 1] = profile[:, 1:] * (scale * np.cos(angle))
    points[:, :, 2] = profile[:, 1:] * (scale * np.sin(angle))
    return points


def revolved_shape(closed_profile: Vector, sides: int, name: str) -> Mesh:
    """Return a solid of revolution about the x axis as a shape of Drake's, not to be touched.

    Args:
        closed_profile: As of :func:`revolved_mesh`.
        sides: Likewise.
        name: For messages.
    """
    text = revolved_mesh(closed_profile, sides)
    file = MemoryFile(contents=text, extension=".obj", filename_hint=name)
    return Mesh(mesh_data=InMemoryMesh(mesh_file=file))


def revolved_mesh(closed_profile: Vector, sides: int) -> str:
    """Return a solid of revolution about the x axis as the text of a Wavefront OBJ file.

    Every face is flat shaded along the profile and smooth around it.

    Args:
        closed_profile: Position along x and radius, m, shape (n, 2), the material on the right
            of the way (as seen with x to the right and the radius upwards).
        sides: Corners of each circle.
    """
    lines = []
    angle = 2 * math.pi * np.arange(sides) / sides
    around = np.column_stack([np.cos(angle), np.sin(angle)])
    count = 0
    for (x0, r0), (x1, r1) in pairwise(closed_profile):
        length = math.hypot(x1 - x0, r1 - r0)
        nx, nr = (r0 - r1) / length, (x1 - x0) / length
        for c, s in around:
            lines.append(f"v {x0:.9g} {r0 * c:.9g} {r0 * s:.9g}")
            lines.append(f"v {x1:.9g} {r1 * c:.9g} {r1 * s:.9g}")
            lines.append(f"vn {nx:.9g} {nr * c:.9g} {nr * s:.9g}")
        for k in range(sides):
            a0, n0 = count + 2 * k + 1, count // 2 + k + 1
            b0, m0 = count + 2 * ((k + 1) % sides) + 1, count // 2 + (k + 1) % sides + 1
            lines.append(f"f {a0}//{n0} {b0}//{m0} {b0 + 1}//{m0}")
            lines.append(f"f {a0}//{n0} {b0 + 1}//{m0} {a0 + 1}//{n0}")
        count += 2 * sides
    return "\n".join(lines) + "\n"
