"""When a peg wedges in its hole: Whitney's planar quasi-static conditions.

A peg of radius r hangs on a support that is compliant at one point of the peg's axis, L_g above
its tip: a lateral stiffness K_x and an angular stiffness K_theta. It is pushed down into a hole
of radius R. Small angles, no gravity, no inertia, everything in one plane.

Signs: x to the right, z up, the hole's axis at x = 0. The lateral error eps0 is the x of the tip
before any contact, the tilt theta is positive where the compliance centre lies to the right of
the tip. Errors of the same sign add, errors of opposite signs compensate. Depth l of the tip
below the mouth, ``lambda = l / (2 r mu)``.

Two points, one at the mouth and one at the tip, touch where ``l |theta| = 2 (R - r)``. If the
line between them lies in both friction cones, ``lambda <= 1``, they can hold the peg against any
force: it may wedge. That is so where two points touch at a tilt of
``theta_w = (R - r) / (mu r) = (c 2 R) / (mu 2 r)`` or more. It does not say that the peg has to.

Arguments of all functions of the theory: ``parts`` are peg and hole, ``support`` holds the peg,
``lateral`` is eps0 in m, ``rotation`` or ``tilt`` theta0 in rad, ``depth`` l in m. Arrays
broadcast.

Sources: D. E. Whitney, Quasi-static assembly of compliantly supported rigid parts, J. Dyn. Syst.
Meas. Control 104 (1982); Ruybal, Lumia and Wood, section 2, Fig. 2 and section 4.

The exact limits are those of :mod:`chamfer.models.peg_theory.planar_statics`, no small angles. The
state in which two opposite points touch is a family with one parameter, the tilt: depth, pose,
wedging and leverage follow from the parts alone. At the onset one of the two forces is still zero,
which ties the initial errors to that tilt.
"""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.planar_statics import (
    PlanarPose,
    Pressed,
    closing_mouth,
    closing_tip,
    leverage,
    mirrored,
    moment,
    tip_height,
)
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

_GRID: Final = 129  # tilts at which an onset is looked for
_LEAST: Final = 1e-3  # of the tilt at which two points touch at the mouth, the smallest tilt
_DEEPEST: Final = 20.0  # radii of the hole, an onset beyond is none
_HALVINGS: Final = 50
_NEWTON: Final = 5


class TwoPoints(NamedTuple):
    """The peg on the mouth's right and the left wall, at several tilts."""

    depth: Array  # l, m
    pose: PlanarPose
    mouth: Pressed
    across: Pressed


def two_points(parts: PegHoleGeometry, tilt: ArrayLike) -> TwoPoints:
    """Return the state in which two opposite points touch at a tilt, rad, > 0."""
    theta = np.asarray(tilt, dtype=np.float64)
    ground = np.zeros_like(theta)
    x, _ = mirrored(closing_tip)(parts, ground, theta)  # at any height
    z = (x - closing_mouth(parts, ground, theta)[0]) / np.tan(theta)
    depth = -z - parts.peg_chamfer.height
    pose = PlanarPose(x, tip_height(parts, depth), theta)
    _, mouth = closing_mouth(parts, pose.z, theta)
    _, across = mirrored(closing_tip)(parts, pose.z, theta)
    return TwoPoints(depth, pose, mouth, across)


def wedging_tilt(parts: PegHoleGeometry) -> float:
    """Return the least tilt, rad, at which two points can hold the peg.

    ``acos(r / R)``, that of a peg that spans the mouth, where they never can.

    At it the line that joins them lies in both friction cones, of which that at the mouth is
    tilted with the peg.
    """

    def outside(tilt: Array) -> Array:
        at = two_points(parts, tilt)
        slope = np.arctan2(at.mouth.z - at.across.z, at.mouth.x - at.across.x)
        left: Array = slope + tilt - math.atan(parts.friction)
        return left

    return _first(outside, parts.mouth_tilt_limit)


def sliding_tilt(parts: PegHoleGeometry, support: Support) -> float:
    """Return the tilt, rad, from which on no push slides a peg on two points; as above."""

    def lever(tilt: Array) -> Array:
        return leverage(support.centre_distance, *two_points(parts, tilt)[1:])

    return _first(lever, parts.mouth_tilt_limit)


def largest_tilt(
    parts: PegHoleGeometry,
    support: Support,
    lateral: ArrayLike,
    limit: ArrayLike,
    centre: ArrayLike | None = None,
) -> Array:
    """Return the largest theta0, rad, for which the tilt at the onset stays below a limit.

    Of several compliance centres L_g, m, if they are given in place of the support's own.
    """
    end = parts.mouth_tilt_limit
    share = np.linspace(0.0, 1.0, _GRID) ** 2
    low, eps0, L_g = (
        np.asarray(value, dtype=np.float64)[..., None]
        for value in (limit, lateral, support.centre_distance if centre is None else centre)
    )
    tilt = low + (end - low) * share
    smallest: Array = np.min(initial_tilt(parts, support, eps0, tilt, L_g), axis=-1)
    return smallest


def two_point_onset(
    parts: PegHoleGeometry, support: Support, lateral: ArrayLike, rotation: ArrayLike
) -> Array:
    """Return the depth, m, at which two points touch first; NaN where they never do."""
    eps0, theta0 = np.broadcast_arrays(
        np.asarray(lateral, dtype=np.float64), np.asarray(rotation, dtype=np.float64)
    )
    right = _onset(parts, support, eps0, theta0)
    left = _onset(parts, support, -eps0, -theta0)
    return np.fmin(right, left)


def sits_on_edge(
    parts: PegHoleGeometry, lateral: ArrayLike, rotation: ArrayLike
) -> NDArray[np.bool_]:
    """Return where the peg's tilted rim may sit on the bore's edge, out of the plane.

    With errors of opposite signs the chamfer touches the rim on its higher side, and pushes it
    towards the axis until the tilted circle lies in the cone: there its middle is
    ``r sin(theta) / tan(a)`` off the axis, and the cone touches it at two points to the left and
    right, where it does not push it on. If that is more than the bore leaves it,
    ``R - r cos(theta)``, the rim sits on the edge, at two points that stand across the plane of
    the errors; only the support may turn it upright, with a force beyond the planar one, or over.
    The rim of a square peg is straight across the plane, and as wide as it is upright: it does
    not.
    """
    eps0, theta0 = np.broadcast_arrays(
        np.asarray(lateral, dtype=np.float64), np.asarray(rotation, dtype=np.float64)
    )
    lean = np.abs(theta0)
    off = np.abs(eps0) - parts.peg_chamfer.height * np.sin(lean)  # of the rim's middle
    room = parts.hole_radius - parts.peg_radius * np.cos(lean)
    rest = parts.peg_radius * np.sin(lean) / math.tan(parts.hole_chamfer.angle)
    sits: NDArray[np.bool_] = (eps0 * theta0 < 0) & (off > room) & (rest > room)
    return sits & parts.is_round


def _onset(parts: PegHoleGeometry, support: Support, eps0: Array, theta0: Array) -> Array:
    """Return the depth of the first onset of a peg that leans right."""
    tilt = parts.mouth_tilt_limit * np.geomspace(1.0, _LEAST, 4 * _GRID)
    tilt = tilt[two_points(parts, tilt).depth < _DEEPEST * parts.hole_radius]
    reached = initial_tilt(parts, support, eps0[..., None], tilt) <= theta0[..., None]
    first = np.argmax(reached, axis=-1)
    touched, _ = _bisected(
        tilt[first],
        tilt[np.maximum(first - 1, 0)],
        lambda middle: initial_tilt(parts, support, eps0, middle) <= theta0,
    )
    depth: Array = two_points(parts, touched).depth
    return np.where(reached.any(axis=-1), depth, np.nan)


def initial_tilt(
    parts: PegHoleGeometry,
    support: Support,
    lateral: ArrayLike,
    onset: ArrayLike,
    centre: Array | None = None,
) -> Array:
    """Return theta0, rad, of a peg whose two points, mouth right and tip left, touch at a tilt."""
    K_x, K_theta = support.lateral_stiffness, support.angular_stiffness
    L_g = support.centre_distance if centre is None else centre
    at = two_points(parts, onset)
    tilt, rest = at.pose.tilt, at.pose.point(0.0, L_g)[0] - np.asarray(lateral, dtype=np.float64)
    solutions = []
    for pressed in (at.mouth, at.across):
        turning, arm = K_theta * pressed.across, K_x * moment(L_g, at.pose, pressed)
        theta = tilt + 0 * rest
        for _ in range(_NEWTON):  # all but linear
            off = turning * (theta - tilt) - arm * (L_g * np.sin(theta) - rest)
            theta = theta - off / (turning - arm * L_g * np.cos(theta))
        pressing = (rest - L_g * np.sin(theta)) / pressed.across >= 0
        solutions.append((theta, pressing))
    (mouth, pressing), (tip, _) = solutions
    return np.where(pressing, mouth, tip)


def _first(function: Callable[[Array], Array], end: float) -> float:
    """Return where a function of the tilt that is positive at first is zero, or the end."""
    grid = end * np.geomspace(_LEAST, 1.0, 4 * _GRID)
    below = np.flatnonzero(function(grid) <= 0)
    if not below.size:
        return end
    low, high = grid[max(below[0] - 1, 0)], grid[below[0]]
    return float(_bisected(low, high, lambda middle: function(middle) > 0)[1])


def _bisected(
    low: Array, high: Array, holds: Callable[[Array], NDArray[np.bool_]]
) -> tuple[Array, Array]:
    """Return the ends of where something that holds at the low end ceases to."""
    for _ in range(_HALVINGS):
        middle = np.asarray((low + high) / 2)
        there = holds(middle)
        low, high = np.where(there, middle, low), np.where(there, high, middle)
    return low, high


Form = Literal["exact", "simple"]

_FLIPS: Final = 1.5  # times mu r: the arm below which contact turns a soft support over
_LOOKS: Final = 41  # at compliance centres at a time
_ZOOMS: Final = 4


def require_stiff(parts: PegHoleGeometry, support: Support) -> None:
    """Raise :class:`ParameterError` if friction can turn the peg over on so soft a support."""
    least = support.lateral_stiffness * (_FLIPS * parts.friction_radius) ** 2
    if not support.angular_stiffness > least:
        allowed = f"> {least:.6g} = K_x (3 mu r / 2)^2, softer supports turn over in contact"
        raise ParameterError("support.angular_stiffness", support.angular_stiffness, allowed)


class BoxMargin(NamedTuple):
    """The margin to each limit, as a share of it; below zero beyond the limit."""

    lateral: Array
    rotation: Array


def chamfer_needed(parts: PegHoleGeometry, lateral: ArrayLike) -> Array:
    """Return the chamfer width, m, that a lateral error, m, needs: ``|eps0| - (R - r)``."""
    return np.maximum(np.abs(lateral) - parts.clearance, 0.0)


def rotation_bounds(
    parts: PegHoleGeometry, support: Support, lateral: ArrayLike, form: Form = "exact"
) -> tuple[Array, Array]:
    """Return the initial tilts, rad, between which the peg can't wedge and a push slides it.

    The *simple* form is Whitney's parallelogram, :func:`wedging_bounds` alone. The *exact* one
    is the narrower of :func:`wedging_bounds` and :func:`sliding_bounds`.
    """
    lower, upper = wedging_bounds(parts, support, lateral, form)
    if form == "simple":
        return lower, upper
    least, most = sliding_bounds(parts, support, lateral)
    return np.maximum(lower, least), np.minimum(upper, most)


def wedging_bounds(
    parts: PegHoleGeometry, support: Support, lateral: ArrayLike, form: Form = "exact"
) -> tuple[Array, Array]:
    """Return the initial tilts, rad, between which two points that touch can't hold the peg.

    The *simple* form is Whitney's parallelogram, ``|theta0 + S eps0'| < theta_w`` where eps0 > 0,
    with ``eps0' = max(|eps0| - (R - r), 0)``. The *exact* one leaves nothing out. The published
    parts' simple sides are 3 to 7 % too narrow: the normal at the mouth tilts with the peg, which
    makes it harder to hold. Of 150 random pegs (R 4 to 15 mm, clearance 1 to 4 %, mu 0.1 to 0.5)
    they are 14 % too narrow in the middle, and from 45 % too narrow to 2 % too wide in nine of
    ten.
    """
    eps0 = np.asarray(lateral, dtype=np.float64)
    if form == "simple":
        return -_simple_upper(parts, support, -eps0), _simple_upper(parts, support, eps0)
    return _within(parts, support, eps0, wedging_tilt(parts))


def sliding_bounds(
    parts: PegHoleGeometry, support: Support, lateral: ArrayLike
) -> tuple[Array, Array]:
    """Return the initial tilts, rad, between which some push always slides the peg.

    Beyond them two points touch where the lines of their forces meet on the wrong side of the
    push, which turns the peg by its moment ``F_z L_g theta``: however hard it is, friction holds
    the peg. Whitney's theory neglects that moment. Shape as of :func:`wedging_bounds`.
    """
    eps0 = np.asarray(lateral, dtype=np.float64)
    return _within(parts, support, eps0, sliding_tilt(parts, support))


def wedges(
    parts: PegHoleGeometry, support: Support, lateral: ArrayLike, rotation: ArrayLike
) -> NDArray[np.bool_]:
    """Return where a peg that starts at eps0, m, and theta0, rad, may wedge."""
    lower, upper = wedging_bounds(parts, support, lateral)
    theta0 = np.asarray(rotation, dtype=np.float64)
    return (theta0 >= upper) | (theta0 <= lower)


def assembles(
    parts: PegHoleGeometry, support: Support, lateral: ArrayLike, rotation: ArrayLike
) -> NDArray[np.bool_]:
    """Return where a start is on the chamfer, free of wedging, and slides."""
    on_chamfer = np.abs(lateral) < parts.chamfer_limit
    return on_chamfer & (rotation_margin(parts, support, lateral, rotation) > 0)


def rotation_margin(
    parts: PegHoleGeometry,
    support: Support,
    lateral: ArrayLike,
    rotation: ArrayLike,
    form: Form = "exact",
) -> Array:
    """Return how far, in theta_w, the tilt is from :func:`rotation_bounds`; <= 0 outside."""
    lower, upper = rotation_bounds(parts, support, lateral, form)
    theta0 = np.asarray(rotation, dtype=np.float64)
    return np.minimum(upper - theta0, theta0 - lower) / parts.rotation_limit


def least_margin(
    parts: PegHoleGeometry, support: Support, lateral: float, rotation: float, form: Form = "exact"
) -> tuple[float, float]:
    """Return the smallest margin to wedging over all compliance centres, and that L_g, m."""
    # From far below the distance at which the slope is largest to far beyond it.
    low, high = -5.0, 5.0
    for _ in range(_ZOOMS):
        grid = np.linspace(low, high, _LOOKS)
        distance = support.worst_centre_distance * np.exp(grid)
        if form == "simple":
            there = [replace(support, centre_distance=one) for one in distance.tolist()]
            uppers = [
                np.array([_simple_upper(parts, one, np.asarray(side * lateral)) for one in there])
                for side in (1.0, -1.0)
            ]
        else:
            limit = np.full_like(distance, wedging_tilt(parts))
            uppers = [
                largest_tilt(parts, support, side * lateral, limit, distance)
                for side in (1.0, -1.0)
            ]
        left = np.minimum(uppers[0] - rotation, uppers[1] + rotation)
        best = int(np.argmin(left))
        low, high = grid[max(0, best - 1)], grid[min(_LOOKS - 1, best + 1)]
    return float(left[best]) / parts.rotation_limit, float(distance[best])


def box_margin(parts: PegHoleGeometry, lateral: ArrayLike, rotation: ArrayLike) -> BoxMargin:
    """Return the margins to theta_w and to r + R, each by itself, as section 5 does."""
    return BoxMargin(
        lateral=1 - np.abs(lateral) / parts.lateral_limit,
        rotation=1 - np.abs(rotation) / parts.rotation_limit,
    )


def jamming_level(
    parts: PegHoleGeometry, force_ratio: ArrayLike, moment_ratio: ArrayLike, depth: ArrayLike
) -> Array:
    """Return where loads of the support are in the jamming diagram: 1 on its sides, more outside.

    The peg slides iff ``|F_x / F_z| < 1 / mu`` and
    ``|M / (r F_z) + mu (1 + lambda) F_x / F_z| < lambda``, and only for lambda >= 1 whatever
    the contacts have stored: at less depth the same loads can be held by a peg that is wedged.
    While it slides at rest with its load, as on a soft support, the load is on the sides; the
    exact statics have it up to 8 % inside at a tilt of 5 degrees, as the mouth's normal tilts.
    """
    depth_ratio = _depth_ratio(parts, depth)
    across = np.asarray(force_ratio, dtype=np.float64)
    turned = np.asarray(moment_ratio) + parts.friction * (1 + depth_ratio) * across
    return np.maximum(np.abs(parts.friction * across), np.abs(turned) / depth_ratio)


def jamming_vertices(parts: PegHoleGeometry, depth: float) -> Array:
    """Return the corners (``F_x / F_z``, ``M / (r F_z)``) of the loads that slide, shape (4, 2).

    Counter-clockwise from the upper left.
    """
    depth_ratio = float(_depth_ratio(parts, depth))
    edge = 1 / parts.friction
    return np.array(
        [
            [-edge, 2 * depth_ratio + 1],
            [-edge, 1.0],
            [edge, -(2 * depth_ratio + 1)],
            [edge, -1.0],
        ]
    )


def _depth_ratio(parts: PegHoleGeometry, depth: ArrayLike) -> Array:
    """Return lambda."""
    ratio = np.asarray(depth, dtype=np.float64) / parts.wedging_depth
    if not np.all((ratio > 0) & np.isfinite(ratio)):
        raise ParameterError("depth", depth, "finite numbers > 0")
    return ratio


def _simple_upper(parts: PegHoleGeometry, support: Support, eps0: Array) -> Array:
    error = np.sign(eps0) * np.maximum(np.abs(eps0) - parts.clearance, 0.0)
    return parts.rotation_limit - support.tilt_per_error * error


def _within(
    parts: PegHoleGeometry, support: Support, eps0: Array, limit: float
) -> tuple[Array, Array]:
    """Return the initial tilts for which the tilt at the onset is within the limit."""
    upper, lower = (largest_tilt(parts, support, side * eps0, limit) for side in (1.0, -1.0))
    return -lower, upper
