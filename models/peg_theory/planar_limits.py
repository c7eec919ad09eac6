"""From which errors on two points touch, wedge, or leave no push that slides the peg.

Exact, as :mod:`chamfer.models.peg_theory.planar_statics`, whose signs and depths these are. The
state in which two opposite points touch is a family with one parameter, the tilt: depth, pose,
wedging and leverage follow from the parts alone. At the onset one of the two forces is still zero,
which ties the initial errors to that tilt.
"""

import math
from collections.abc import Callable
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from chamfer.models.peg.peg_hole_geometry import PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.planar_contact import (
    Pose,
    Pressed,
    closing_mouth,
    closing_tip,
    mirrored,
    moment,
    tip_height,
)
from chamfer.models.peg_theory.planar_statics import leverage

Array = NDArray[np.float64]

_GRID: Final = 129  # tilts at which an onset is looked for
_LEAST: Final = 1e-3  # of the tilt at which two points touch at the mouth, the smallest tilt
_DEEPEST: Final = 20.0  # radii of the hole, an onset beyond is none
_HALVINGS: Final = 50
_NEWTON: Final = 5


class Springs(NamedTuple):
    """A support, or several at a time."""

    lateral: Array  # K_x, N/m
    angular: Array  # K_theta, N m/rad
    centre: Array  # L_g, m

    @staticmethod
    def of(support: Support, centre_distance: ArrayLike | None = None) -> "Springs":
        """Return those of a support, with centres of its own or with others."""
        centre = support.centre_distance if centre_distance is None else centre_distance
        return Springs(
            *(
                np.asarray(value, dtype=np.float64)
                for value in (support.lateral_stiffness, support.angular_stiffness, centre)
            )
        )


class TwoPoints(NamedTuple):
    """The peg on the mouth's right and the left wall, at several tilts."""

    depth: Array  # l, m
    pose: Pose
    mouth: Pressed
    across: Pressed


def two_points(parts: PegHoleGeometry, tilt: ArrayLike) -> TwoPoints:
    """Return the state in which two opposite points touch at a tilt, rad, > 0."""
    theta = np.asarray(tilt, dtype=np.float64)
    ground = np.zeros_like(theta)
    x, _ = mirrored(closing_tip)(parts, ground, theta)  # at any height
    z = (x - closing_mouth(parts, ground, theta)[0]) / np.tan(theta)
    depth = -z - parts.peg_chamfer.height
    pose = Pose(x, tip_height(parts, depth), theta)
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
        at = two_points(parts, tilt)
        return leverage(support.centre_distance, at.pose, at.mouth, at.across)

    return _first(lever, parts.mouth_tilt_limit)


def largest_tilt(
    parts: PegHoleGeometry,
    springs: Springs,
    lateral: ArrayLike,
    limit: ArrayLike,
) -> Array:
    """Return the largest theta0, rad, for which the tilt at the onset stays below a limit.

    Args:
        parts: Peg and hole.
        springs: What holds the peg.
        lateral: eps0, m.
        limit: rad, of the tilt of a peg that leans right.
    """
    end = parts.mouth_tilt_limit
    share = np.linspace(0.0, 1.0, _GRID) ** 2
    low = np.asarray(limit, dtype=np.float64)[..., None]
    tilt = low + (end - low) * share
    wide = Springs(*(one[..., None] for one in springs))
    start = initial_tilt(parts, wide, np.asarray(lateral, dtype=np.float64)[..., None], tilt)
    smallest: Array = np.min(start, axis=-1)
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
    """Say where the tilted rim of the peg may sit down on the bore's edge, unseen in a plane.

    With errors of opposite signs the chamfer touches the rim on its higher side, and pushes it
    towards the axis until the tilted circle lies in the cone: there its middle is
    ``r sin(theta) / tan(a)`` off the axis, and the cone touches it at two points to the left and
    right, where it does not push it on. If that is more than the bore leaves it,
    ``R - r cos(theta)``, the rim sits on the edge, at two points that stand across the plane of
    the errors; only the support may turn it upright, with a force beyond the planar one, or over.
    The rim of a square peg is straight across the plane, and as wide as it is upright: it does
    not.

    Args:
        parts: Peg and hole.
        lateral: eps0, m, of the tip.
        rotation: theta0, rad.
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
    springs = Springs.of(support)
    tilt = parts.mouth_tilt_limit * np.geomspace(1.0, _LEAST, 4 * _GRID)
    tilt = tilt[two_points(parts, tilt).depth < _DEEPEST * parts.hole_radius]
    reached = initial_tilt(parts, springs, eps0[..., None], tilt) <= theta0[..., None]
    first = np.argmax(reached, axis=-1)
    low, high = tilt[first], tilt[np.maximum(first - 1, 0)]
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        touches = initial_tilt(parts, springs, eps0, middle) <= theta0
        low, high = np.where(touches, middle, low), np.where(touches, high, middle)
    depth: Array = two_points(parts, low).depth
    return np.where(reached.any(axis=-1), depth, np.nan)


def initial_tilt(
    parts: PegHoleGeometry, springs: Springs, lateral: ArrayLike, onset: ArrayLike
) -> Array:
    """Return theta0, rad, of a peg whose two points, mouth right and tip left, touch at a tilt.

    Args:
        parts: Peg and hole.
        springs: What holds the peg.
        lateral: eps0, m.
        onset: Tilt at the onset, rad, > 0.
    """
    K_x, K_theta, L_g = springs
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
    low, high = float(grid[max(below[0] - 1, 0)]), float(grid[below[0]])
    for _ in range(_HALVINGS):
        middle = (low + high) / 2
        if function(np.array(middle)) > 0:
            low = middle
        else:
            high = middle
    return high
