"""Where a chamfered peg touches a chamfered hole, in the plane: corners on faces.

The origin is in the middle of the bore where the mouth's chamfer ends, x to the right, z up. A
contact is a corner of one part on a face of the other, always on the right: one on the left is
its mirror image. Every contact slides: the force on the peg is N along the face's normal and
``mu N`` up the face.
"""

from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.models.peg.peg_hole_geometry import Chamfer, PegHoleGeometry

Array = NDArray[np.float64]

_FAR: Final = 1.0  # m, to the ends of the parts that are not part of the theory
# A face is its normal, outwards across and downwards along: out of the peg, into the hole.
_SIDE: Final = (1.0, 0.0)


class Pose(NamedTuple):
    """Where the peg is; arrays of one shape."""

    x: Array  # m, of the tip
    z: Array  # m, likewise
    tilt: Array  # rad

    def mirrored(self) -> "Pose":
        """Return the pose with left and right exchanged."""
        return Pose(-self.x, self.z, -self.tilt)

    def point(self, u: float, v: float | Array) -> tuple[Array, Array]:
        """Return the place of a point u across and v along the peg from the tip's middle."""
        c, s = np.cos(self.tilt), np.sin(self.tilt)
        return self.x + u * c + v * s, self.z - u * s + v * c


class Pressed(NamedTuple):
    """A contact: its place and, per unit of the normal force, the force on the peg."""

    x: Array
    z: Array
    across: Array
    up: Array


# Returns, for a height of the tip and a tilt, the x of the tip that closes the gap, and the
# contact: always on the right, the left is its mirror image.
Closing = Callable[[PegHoleGeometry, Array, Array], tuple[Array, Pressed]]


def closing_mouth(parts: PegHoleGeometry, z: Array, tilt: Array) -> tuple[Array, Pressed]:
    """Press the peg's right side on the bore's edge."""
    return _edge_on_peg(parts, z, tilt, (parts.hole_radius, 0.0), _SIDE)


def closing_tip(parts: PegHoleGeometry, z: Array, tilt: Array) -> tuple[Array, Pressed]:
    """Press the tip's right corner on the wall of the bore."""
    return _corner_on_hole(parts, z, tilt, _corner(parts), _SIDE)


def tip_height(parts: PegHoleGeometry, depth: Array) -> Array:
    """Return z of the tip at a depth l."""
    return -(depth + parts.peg_chamfer.height)


def mirrored(closing: Closing) -> Closing:
    """Return the same contact on the left."""

    def close(parts: PegHoleGeometry, z: Array, tilt: Array) -> tuple[Array, Pressed]:
        x, at = closing(parts, z, -tilt)
        return -x, Pressed(-at.x, at.z, -at.across, at.up)

    return close


def moment(centre_distance: float | Array, pose: Pose, at: Pressed) -> Array:
    """Return the clockwise moment, m, of a unit of a contact's force about the centre."""
    centre = pose.point(0.0, centre_distance)
    turning: Array = (at.z - centre[1]) * at.across - (at.x - centre[0]) * at.up
    return turning


def _corner(parts: PegHoleGeometry) -> tuple[float, float]:
    return parts.peg_radius, parts.peg_chamfer.height


def _tip_edge(parts: PegHoleGeometry) -> tuple[float, float]:
    return parts.peg_radius - parts.peg_chamfer.width, 0.0


def _mouth(parts: PegHoleGeometry) -> tuple[float, float]:
    return parts.hole_radius + parts.hole_chamfer.width, parts.hole_chamfer.height


def _facing(chamfer: Chamfer) -> tuple[float, float]:
    return float(np.sin(chamfer.angle)), float(np.cos(chamfer.angle))


def _corner_on_hole(
    parts: PegHoleGeometry,
    z: Array,
    tilt: Array,
    corner: tuple[float, float],
    face: tuple[float, float],
) -> tuple[Array, Pressed]:
    """Press a corner of the peg on a face of the hole through the bore's edge."""
    n, down = face
    u, v = Pose(np.zeros_like(z), z, tilt).point(*corner)
    x = parts.hole_radius + v * down / n - u
    mu, ones = parts.friction, np.ones_like(x)
    return x, Pressed(x + u, v, (-n + mu * down) * ones, (down + mu * n) * ones)


def _edge_on_peg(
    parts: PegHoleGeometry,
    z: Array,
    tilt: Array,
    edge: tuple[float, float],
    face: tuple[float, float],
) -> tuple[Array, Pressed]:
    """Press an edge of the hole on a face of the peg through the tip's corner."""
    c, s = np.cos(tilt), np.sin(tilt)
    n, down = face
    # The normal out of the peg and the way up along its face, in the world.
    out = n * c - down * s, -n * s - down * c
    along = down * c + n * s, -down * s + n * c
    u, v = Pose(np.zeros_like(z), z, tilt).point(*_corner(parts))
    x = edge[0] + (edge[1] - v) * out[1] / out[0] - u
    mu, ones = parts.friction, np.ones_like(x)
    at = Pressed(edge[0] * ones, edge[1] * ones, -out[0] + mu * along[0], -out[1] + mu * along[1])
    return x, at


def closing_corner_on_chamfer(
    parts: PegHoleGeometry, z: Array, tilt: Array
) -> tuple[Array, Pressed]:
    """Press the tip's corner on the hole's chamfer."""
    return _corner_on_hole(parts, z, tilt, _corner(parts), _facing(parts.hole_chamfer))


def closing_tip_on_chamfer(parts: PegHoleGeometry, z: Array, tilt: Array) -> tuple[Array, Pressed]:
    """Press the tip's edge, below its chamfer, on the hole's chamfer."""
    return _corner_on_hole(parts, z, tilt, _tip_edge(parts), _facing(parts.hole_chamfer))


def closing_bore_on_chamfer(
    parts: PegHoleGeometry, z: Array, tilt: Array
) -> tuple[Array, Pressed]:
    """Press the peg's chamfer on the bore's edge."""
    edge = parts.hole_radius, 0.0
    return _edge_on_peg(parts, z, tilt, edge, _facing(parts.peg_chamfer))


def closing_mouth_on_chamfer(
    parts: PegHoleGeometry, z: Array, tilt: Array
) -> tuple[Array, Pressed]:
    """Press the peg's chamfer on the mouth's edge, above the hole's chamfer."""
    return _edge_on_peg(parts, z, tilt, _mouth(parts), _facing(parts.peg_chamfer))


def gap(parts: PegHoleGeometry, pose: Pose) -> Array:
    """Return how far the peg is from the right side of the hole, negative where they overlap.

    Both are convex: it is the largest distance that a face of either one has to the other.
    """
    edge, mouth = (parts.hole_radius, 0.0), _mouth(parts)
    corner, tip = _corner(parts), _tip_edge(parts)
    peg = [tip, corner, (-tip[0], tip[1]), (-corner[0], corner[1])]
    peg += [(side * parts.peg_radius, _FAR) for side in (1.0, -1.0)]
    corners = [pose.point(*one) for one in peg]
    hole = [edge, mouth, (edge[0], -_FAR), (_FAR, mouth[1])]
    distances = []
    chamfer = _facing(parts.hole_chamfer)
    for (n, down), through in ((_SIDE, edge), (chamfer, edge), ((0.0, 1.0), mouth)):
        apart = [(through[0] - x) * n + (z - through[1]) * down for x, z in corners]
        distances.append(np.min(apart, axis=0))
    c, s = np.cos(pose.tilt), np.sin(pose.tilt)
    for (n, down), (u, v) in (
        (_SIDE, corner),
        (_facing(parts.peg_chamfer), corner),
        ((0.0, 1.0), tip),
    ):
        out = n * c - down * s, -n * s - down * c
        x, z = pose.point(u, v)
        apart = [(at[0] - x) * out[0] + (at[1] - z) * out[1] for at in hole]
        distances.append(np.min(apart, axis=0))
    largest: Array = np.max(distances, axis=0)
    return largest
