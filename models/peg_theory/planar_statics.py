"""Exact statics in the plane of a rigid peg that is pushed down a rigid hole on a soft support.

No small angles. The push acts down at the centre of compliance, so that a tilted peg is turned by
its moment ``F_z L_g theta`` too, and the force at the mouth is normal to the tilted peg: both are
what :mod:`chamfer.models.peg_theory.insertion_statics` neglects.

Every contact slides, so equilibrium follows from
the depth alone. Signs are those of :mod:`chamfer.models.peg_theory.wedging`. Unknown are x of the
tip and the tilt, which close the gaps and balance the moment about the centre of compliance, and
the normal forces.

Depth is that of the tip below the mouth less the heights of both chamfers, l of the theory:
negative on the chamfers.

A contact is a corner of one part on a face of the other, computed on the right: one on the left is
its mirror image. Its origin is in the middle of the bore where the mouth's chamfer ends, x to the
right, z up. The force on the peg is N along the face's normal and ``mu N`` up the face.
"""

from collections.abc import Callable
from enum import IntEnum
from functools import partial
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from chamfer.models.peg.peg_and_hole import Chamfer, PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

_FAR: Final = 1.0  # m, to the ends of the parts that are not part of the theory


class PlanarPose(NamedTuple):
    """Where the peg is; arrays of one shape."""

    x: Array  # m, of the tip
    z: Array  # m, likewise
    tilt: Array  # rad

    def mirrored(self) -> "PlanarPose":
        """Return the pose with left and right exchanged."""
        return PlanarPose(-self.x, self.z, -self.tilt)

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
# Of the parts: a point across and up, or a face by its normal, outwards across and downwards
# along: out of the peg, into the hole.
Place = Callable[[PegHoleGeometry], tuple[float, float]]


def tip_height(parts: PegHoleGeometry, depth: Array) -> Array:
    """Return z of the tip at a depth l."""
    return -(depth + parts.peg_chamfer.height)


def mirrored(closing: Closing) -> Closing:
    """Return the contact mirrored to the left."""

    def close(parts: PegHoleGeometry, z: Array, tilt: Array) -> tuple[Array, Pressed]:
        x, at = closing(parts, z, -tilt)
        return -x, Pressed(-at.x, at.z, -at.across, at.up)

    return close


def moment(centre_distance: float | Array, pose: PlanarPose, at: Pressed) -> Array:
    """Return the clockwise moment, m, of a unit of a contact's force about the centre."""
    centre = pose.point(0.0, centre_distance)
    turning: Array = (at.z - centre[1]) * at.across - (at.x - centre[0]) * at.up
    return turning


def _corner(parts: PegHoleGeometry) -> tuple[float, float]:
    return parts.peg_radius, parts.peg_chamfer.height


def _tip_edge(parts: PegHoleGeometry) -> tuple[float, float]:
    return parts.peg_radius - parts.peg_chamfer.width, 0.0


def _bore_edge(parts: PegHoleGeometry) -> tuple[float, float]:
    return parts.hole_radius, 0.0


def _mouth_edge(parts: PegHoleGeometry) -> tuple[float, float]:
    return parts.hole_radius + parts.hole_chamfer.width, parts.hole_chamfer.height


def _side(parts: PegHoleGeometry) -> tuple[float, float]:
    return 1.0, 0.0


def _peg_chamfer(parts: PegHoleGeometry) -> tuple[float, float]:
    return _facing(parts.peg_chamfer)


def _hole_chamfer(parts: PegHoleGeometry) -> tuple[float, float]:
    return _facing(parts.hole_chamfer)


def _facing(chamfer: Chamfer) -> tuple[float, float]:
    return float(np.sin(chamfer.angle)), float(np.cos(chamfer.angle))


def _corner_on_hole(corner: Place, face: Place) -> Closing:
    """Press a corner of the peg on a face of the hole through the bore's edge."""

    def close(parts: PegHoleGeometry, z: Array, tilt: Array) -> tuple[Array, Pressed]:
        n, down = face(parts)
        u, v = PlanarPose(np.zeros_like(z), z, tilt).point(*corner(parts))
        x = parts.hole_radius + v * down / n - u
        mu, ones = parts.friction, np.ones_like(x)
        return x, Pressed(x + u, v, (-n + mu * down) * ones, (down + mu * n) * ones)

    return close


def _edge_on_peg(edge: Place, face: Place) -> Closing:
    """Press an edge of the hole on a face of the peg through the tip's corner."""

    def close(parts: PegHoleGeometry, z: Array, tilt: Array) -> tuple[Array, Pressed]:
        c, s = np.cos(tilt), np.sin(tilt)
        n, down = face(parts)
        # The normal out of the peg and the way up along its face, in the world.
        out = n * c - down * s, -n * s - down * c
        along = down * c + n * s, -down * s + n * c
        u, v = PlanarPose(np.zeros_like(z), z, tilt).point(*_corner(parts))
        right, up = edge(parts)
        x = right + (up - v) * out[1] / out[0] - u
        mu, ones = parts.friction, np.ones_like(x)
        across, push = -out[0] + mu * along[0], -out[1] + mu * along[1]
        return x, Pressed(right * ones, up * ones, across, push)

    return close


closing_mouth: Final = _edge_on_peg(_bore_edge, _side)
closing_tip: Final = _corner_on_hole(_corner, _side)
_corner_on_chamfer: Final = _corner_on_hole(_corner, _hole_chamfer)
_tip_on_chamfer: Final = _corner_on_hole(_tip_edge, _hole_chamfer)
_bore_on_chamfer: Final = _edge_on_peg(_bore_edge, _peg_chamfer)
_mouth_on_chamfer: Final = _edge_on_peg(_mouth_edge, _peg_chamfer)


def gap(parts: PegHoleGeometry, pose: PlanarPose) -> Array:
    """Return how far the peg is from the right side of the hole, negative where they overlap.

    Both are convex: it is the largest distance that a face of either one has to the other.
    """
    edge, mouth, corner, tip = (
        place(parts) for place in (_bore_edge, _mouth_edge, _corner, _tip_edge)
    )
    peg = [tip, corner, (-tip[0], tip[1]), (-corner[0], corner[1])]
    peg += [(side * parts.peg_radius, _FAR) for side in (1.0, -1.0)]
    corners = [pose.point(*one) for one in peg]
    hole = [edge, mouth, (edge[0], -_FAR), (_FAR, mouth[1])]
    distances = []
    side, end = _side(parts), (0.0, 1.0)
    for (n, down), through in ((side, edge), (_hole_chamfer(parts), edge), (end, mouth)):
        apart = [(through[0] - x) * n + (z - through[1]) * down for x, z in corners]
        distances.append(np.min(apart, axis=0))
    c, s = np.cos(pose.tilt), np.sin(pose.tilt)
    for (n, down), (u, v) in ((side, corner), (_peg_chamfer(parts), corner), (end, tip)):
        out = n * c - down * s, -n * s - down * c
        x, z = pose.point(u, v)
        apart = [(at[0] - x) * out[0] + (at[1] - z) * out[1] for at in hole]
        distances.append(np.min(apart, axis=0))
    largest: Array = np.max(distances, axis=0)
    return largest


_STEEPEST: Final = 0.5  # rad, of a peg in a hole that could be meant
_CLOSE, _NEAR = 1e-14, 1e-9  # rad, a step that ends the secant method, and a root that is good
_STEPS: Final = 20  # of the secant method, 4 to 8 are needed
_ROUNDING: Final = 1e-6  # of the clearance, and of K_x times it


class Contact(IntEnum):
    """The parts of the peg that touch the hole."""

    NONE = 0
    MOUTH = 1  # one point, the mouth's edge on the peg's side
    TIP = 2  # one point, the tip's corner on the wall
    TWO_POINT = 3  # one on the mouth, the other on the opposite wall
    ALONG_WALL = 4  # mouth and tip on the same side, the peg upright
    CHAMFER = 5  # one point, or a face, on one side
    STUCK = 6  # no sliding equilibrium: however hard the push, friction holds the peg


class Equilibrium(NamedTuple):
    """The peg at a depth, each of the shape of the inputs."""

    contact: NDArray[np.int64]  # of :class:`Contact`
    insertion_force: Array  # N, down; infinite where the peg is stuck
    lateral_force: Array  # N, of the hole on the peg, to the right; NaN where it is stuck
    tilt: Array  # rad, likewise
    tip: Array  # m, x of the tip, likewise


def equilibrium(
    parts: PegHoleGeometry,
    support: Support,
    lateral: ArrayLike,
    rotation: ArrayLike,
    depth: ArrayLike,
) -> Equilibrium:
    """Return the contacts and their forces at a depth.

    Of several sliding equilibria the one with the least force is taken: it is the one that the
    peg is in before two points touch, the others are reached by turning it by force.
    """
    inputs = (np.asarray(value, dtype=np.float64) for value in (lateral, rotation, depth))
    eps0, theta0, bore_depth = np.broadcast_arrays(*inputs)
    if not np.all(np.isfinite(bore_depth)):
        raise ParameterError("depth", depth, "finite numbers")
    shape = eps0.shape
    start = _Start(parts, support, eps0.ravel(), theta0.ravel(), bore_depth.ravel())
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found = _candidates(start)
    force = np.stack([one.force for one in found])
    best = np.argmin(force, axis=0), np.arange(force.shape[1])
    stuck = np.isinf(force[best])

    def chosen(name: str) -> Array:
        values = np.stack([getattr(one, name) for one in found])[best]
        return np.where(stuck, np.nan, values).reshape(shape)

    contact = np.array([one.contact for one in found], dtype=np.int64)[best[0]]
    return Equilibrium(
        contact=np.where(stuck, Contact.STUCK, contact).reshape(shape),
        insertion_force=force[best].reshape(shape),
        lateral_force=chosen("lateral"),
        tilt=chosen("tilt"),
        tip=chosen("x"),
    )


def leverage(
    centre_distance: float | Array, pose: PlanarPose, mouth: Pressed, across: Pressed
) -> Array:
    """Return the lever, m, with which a push at the centre slides a peg on two opposite points.

    That is the determinant of their forces across and their moments, about l for small tilts
    and a centre close to the hole.
    """
    m1, m2 = (moment(centre_distance, pose, at) for at in (mouth, across))
    return mouth.across * m2 - across.across * m1


def _secant(function: Callable[[Array], Array], first: Array, second: Array) -> Array:
    """Return roots of a function of each element, NaN where the method finds none."""
    a, b = first, second
    fa, fb = function(a), function(b)
    for _ in range(_STEPS):
        step = np.where(fb == fa, 0.0, fb * (b - a) / (fb - fa))
        a, fa = b, fb
        b = b - step
        if not np.any(np.abs(step) > _CLOSE):
            break
        fb = function(b)
    return np.where(np.abs(b - a) < _NEAR, b, np.nan)


class _Start(NamedTuple):
    """The problem, with one axis."""

    parts: PegHoleGeometry
    support: Support
    eps0: Array
    theta0: Array
    depth: Array

    @property
    def z(self) -> Array:
        return tip_height(self.parts, self.depth)

    def mirrored(self) -> "_Start":
        return self._replace(eps0=-self.eps0, theta0=-self.theta0)


class _Candidate(NamedTuple):
    """An equilibrium; its force is infinite where it is none."""

    contact: Contact
    force: Array
    lateral: Array
    x: Array
    tilt: Array


def _spring(start: _Start, pose: PlanarPose) -> Array:
    """Return the force of the support across, to the right, N."""
    L_g = start.support.centre_distance
    off: Array = start.eps0 + L_g * np.sin(start.theta0) - pose.point(0.0, L_g)[0]
    return start.support.lateral_stiffness * off


def _candidates(start: _Start) -> list[_Candidate]:
    pairs = [(Contact.ALONG_WALL, closing_mouth, closing_tip)]
    if start.parts.peg_chamfer.angle == start.parts.hole_chamfer.angle:
        pairs += _ON_CHAMFER
    sliding: list[Callable[[_Start], _Candidate]] = [
        *(partial(_single, contact=contact, closing=one) for contact, one in _SINGLE),
        *(partial(_flat, contact=contact, one=one, other=two) for contact, one, two in pairs),
        _two_point,
    ]
    found = [_free(start)]
    for of in sliding:
        left = of(start.mirrored())
        left = left._replace(lateral=-left.lateral, x=-left.x, tilt=-left.tilt)
        found += [of(start), left]
    return found


def _free(start: _Start) -> _Candidate:
    pose = PlanarPose(start.eps0, start.z, start.theta0)
    room = _room(start.parts)
    fits = (gap(start.parts, pose) >= -room) & (gap(start.parts, pose.mirrored()) >= -room)
    none = np.zeros_like(start.eps0)
    return _Candidate(Contact.NONE, np.where(fits, 0.0, np.inf), none, pose.x, pose.tilt)


def _single(start: _Start, contact: Contact, closing: Closing) -> _Candidate:
    support = start.support

    def off(tilt: Array) -> Array:
        """Return by how much a contact that balances the force misses the moment."""
        x, at = closing(start.parts, start.z, tilt)
        pose = PlanarPose(x, start.z, tilt)
        turned: Array = support.angular_stiffness * (start.theta0 - tilt) * at.across
        return turned - _spring(start, pose) * moment(support.centre_distance, pose, at)

    tilt = _secant(off, start.theta0, start.theta0 + 1e-3)
    x, at = closing(start.parts, start.z, tilt)
    pose = PlanarPose(x, start.z, tilt)
    normal = -_spring(start, pose) / at.across
    return _valid(start, contact, pose, [(normal, at)])


def _flat(start: _Start, contact: Contact, one: Closing, other: Closing) -> _Candidate:
    """Return the equilibrium in which two faces lie on each other, the peg upright."""
    upright = np.zeros_like(start.theta0)
    x, first = one(start.parts, start.z, upright)
    _, second = other(start.parts, start.z, upright)
    pose = PlanarPose(x, start.z, upright)
    return _valid(start, contact, pose, _shared(start, pose, first, second))


def _two_point(start: _Start) -> _Candidate:
    """Return the equilibrium on the mouth's right and the left wall.

    Both forces grow without bound where their lines meet on that of the push, at
    :func:`leverage` zero; beyond it no push slides the peg.
    """
    parts, z = start.parts, start.z
    across = mirrored(closing_tip)

    def off(tilt: Array) -> Array:
        return closing_mouth(parts, z, tilt)[0] - across(parts, z, tilt)[0]

    inside = np.where(start.depth > 0, start.depth, np.nan)
    guess = np.minimum(2 * parts.clearance / inside, parts.mouth_tilt_limit)
    tilt = _secant(off, guess, 0.99 * guess)
    tilt = np.where((tilt > 0) & (tilt < _STEEPEST), tilt, np.nan)
    x, first = closing_mouth(parts, z, tilt)
    _, second = across(parts, z, tilt)
    pose = PlanarPose(x, z, tilt)
    slides = leverage(start.support.centre_distance, pose, first, second) > 0
    pose = pose._replace(x=np.where(slides, x, np.nan))
    return _valid(start, Contact.TWO_POINT, pose, _shared(start, pose, first, second))


def _shared(
    start: _Start, pose: PlanarPose, first: Pressed, second: Pressed
) -> list[tuple[Array, Pressed]]:
    """Return the normal forces of two contacts that balance the support."""
    m1, m2 = (moment(start.support.centre_distance, pose, at) for at in (first, second))
    across = -_spring(start, pose)
    turning = -start.support.angular_stiffness * (start.theta0 - pose.tilt)
    det = first.across * m2 - second.across * m1
    one = (across * m2 - second.across * turning) / det
    other = (first.across * turning - across * m1) / det
    return [(one, first), (other, second)]


def _valid(
    start: _Start,
    contact: Contact,
    pose: PlanarPose,
    pressed: list[tuple[Array, Pressed]],
) -> _Candidate:
    """Return the candidate, with an infinite force where it pulls or parts overlap."""
    room = _room(start.parts)
    right, left = gap(start.parts, pose), gap(start.parts, pose.mirrored())
    holds = (np.abs(right) <= room) & (left >= -room)
    if contact == Contact.TWO_POINT:
        holds &= np.abs(left) <= room
    for normal, _ in pressed:
        holds &= normal >= -room * start.support.lateral_stiffness
    up = np.sum([normal * at.up for normal, at in pressed], axis=0)
    across = np.sum([normal * at.across for normal, at in pressed], axis=0)
    return _Candidate(contact, np.where(holds, up, np.inf), across, pose.x, pose.tilt)


def _room(parts: PegHoleGeometry) -> float:
    return _ROUNDING * parts.clearance


_SINGLE: Final[tuple[tuple[Contact, Closing], ...]] = (
    (Contact.MOUTH, closing_mouth),
    (Contact.TIP, closing_tip),
    (Contact.CHAMFER, _corner_on_chamfer),
    (Contact.CHAMFER, _tip_on_chamfer),
    (Contact.CHAMFER, _bore_on_chamfer),
    (Contact.CHAMFER, _mouth_on_chamfer),
)
# The lower and the upper end of what two parallel chamfers have in common.
_ON_CHAMFER: Final[tuple[tuple[Contact, Closing, Closing], ...]] = tuple(
    (Contact.CHAMFER, lower, upper)
    for lower in (_tip_on_chamfer, _bore_on_chamfer)
    for upper in (_corner_on_chamfer, _mouth_on_chamfer)
)
