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

Sources: D. E. Whitney, Quasi-static assembly of compliantly supported rigid parts, J. Dyn. Syst.
Meas. Control 104 (1982); Ruybal, Lumia and Wood, section 2, Fig. 2 and section 4.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Final, Literal, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.optimize import minimize_scalar

from models.peg_and_hole import FRICTION, HolePart, Peg
from models.validation import ParameterError, require_not_negative, require_positive

Array = NDArray[np.float64]
Form = Literal["exact", "simple"]

_FLIPS: Final = 1.5  # times mu r: the arm below which contact turns a soft support over


@dataclass(frozen=True, kw_only=True)
class PartsAndSupport:
    """Peg, hole and the compliant support that holds one of them."""

    hole_radius: float = HolePart.radius  # m, R of the bore; section 4
    peg_radius: float = Peg.radius  # m, r of the peg; section 4
    friction: float = FRICTION  # mu, between peg and hole; section 4
    lateral_stiffness: float = 400.0  # N/m, K_x of the support; section 5
    rotational_stiffness: float = 5.0  # N m/rad, K_theta of the support; section 5
    centre_distance: float = 0.1  # m, L_g, from tip to compliance centre; assumed, not published
    chamfer_width: float = Peg.chamfer + HolePart.chamfer
    # m, W, of both parts together; assumed, not published
    chamfer_angle: float = math.pi / 4  # rad, from the horizontal; assumed, not published

    RENAMED: ClassVar[Mapping[str, str]] = {"angular_stiffness": "rotational_stiffness"}

    def __post_init__(self) -> None:
        require_positive(self, "hole_radius", "peg_radius", "friction")
        require_positive(self, "lateral_stiffness", "rotational_stiffness")
        require_not_negative(self, "centre_distance", "chamfer_width")
        if not self.peg_radius < self.hole_radius:
            allowed = f"less than the hole's radius, {self.hole_radius!r}"
            raise ParameterError("peg_radius", self.peg_radius, allowed)
        if not 0 < self.chamfer_angle < math.pi / 2:
            raise ParameterError("chamfer_angle", self.chamfer_angle, "between 0 and pi/2")
        least = self.lateral_stiffness * (_FLIPS * self.friction * self.peg_radius) ** 2
        if not self.rotational_stiffness > least:
            allowed = f"> {least:.6g} = K_x (3 mu r / 2)^2, softer supports turn over in contact"
            raise ParameterError("rotational_stiffness", self.rotational_stiffness, allowed)

    @property
    def clearance(self) -> float:
        """``R - r``, m."""
        return self.hole_radius - self.peg_radius

    @property
    def clearance_ratio(self) -> float:
        """``c = (R - r) / R``."""
        return self.clearance / self.hole_radius

    @property
    def friction_radius(self) -> float:
        """``mu r``, m: how far friction shifts the line of a contact force."""
        return self.friction * self.peg_radius

    @property
    def rotation_limit(self) -> float:
        """``theta_w``, rad: the tilt at which two points that touch can hold the peg."""
        return self.clearance / self.friction_radius

    @property
    def wedging_depth(self) -> float:
        """``l_w = 2 mu r``, m: two points that touch below it can't wedge, lambda > 1."""
        return 2 * self.friction_radius

    @property
    def lateral_limit(self) -> float:
        """``r + R``, m, the published limit: beyond it peg and hole don't even overlap."""
        return self.peg_radius + self.hole_radius

    @property
    def chamfer_limit(self) -> float:
        """``W + (R - r)``, m: the lateral error that the chamfers still guide into the hole."""
        return self.chamfer_width + self.clearance

    @property
    def mouth_tilt_limit(self) -> float:
        """``acos(r / R)``, rad: a peg that leans further is too wide for the mouth."""
        return math.acos(self.peg_radius / self.hole_radius)

    @property
    def tilt_per_error(self) -> float:
        """``S = L_g / (L_g^2 + K_theta / K_x)``, rad/m: how far a lateral error tilts the peg.

        Zero for a centre of compliance at the tip or far from it.
        """
        ratio = self.rotational_stiffness / self.lateral_stiffness
        return self.centre_distance / (self.centre_distance**2 + ratio)

    @property
    def worst_centre_distance(self) -> float:
        """``sqrt(K_theta / K_x)``, m: the L_g at which S is largest, ``1 / (2 L_g)``."""
        return math.sqrt(self.rotational_stiffness / self.lateral_stiffness)


class BoxMargin(NamedTuple):
    """What is left of each limit, as a share of it; below zero beyond the limit."""

    lateral: Array
    rotation: Array


def chamfer_needed(parts: PartsAndSupport, lateral: ArrayLike) -> Array:
    """Return the chamfer width, m, that a lateral error, m, asks for: ``|eps0| - (R - r)``."""
    return np.maximum(np.abs(lateral) - parts.clearance, 0.0)


def rotation_bounds(
    parts: PartsAndSupport, lateral: ArrayLike, form: Form = "exact"
) -> tuple[Array, Array]:
    """Return the initial tilts, rad, between which the peg can't wedge.

    The *simple* form is Whitney's parallelogram, ``|theta0 + S eps0'| < theta_w`` where eps0 > 0,
    with ``eps0' = max(|eps0| - (R - r), 0)``. It neglects how friction and depth shorten the arm
    of the contact force; it is up to 4 % too wide for the published parts.

    The *exact* form (of the small-angle model) asks at every depth l up to l_w that
    ``theta(l) < 2 (R - r) / l`` in one-point contact. With the arm ``C = L_g - l - mu r`` the
    tilt on the mouth is ``theta0 + S_l (eps0 - (R - r) + l theta0)``,
    ``S_l = C K_x / (C K_x (L_g - l) + K_theta)``; with the tip on the other wall, where
    ``eps0 < -(R - r)``, it is ``theta0 + S_t (eps0 + R - r)`` at any depth,
    ``S_t = (L_g - mu r) K_x / ((L_g - mu r) K_x L_g + K_theta)``. The depth that decides is l_w
    unless the centre of compliance is closer to the tip than ``3 mu r``.

    Args:
        parts: Peg, hole and support.
        lateral: eps0, m, of any shape.
        form: Which of the two.

    Returns:
        Lower and upper bound, each of the shape of ``lateral``.
    """
    eps0 = np.asarray(lateral, dtype=np.float64)
    bound = _simple_upper if form == "simple" else _exact_upper
    return -bound(parts, -eps0), bound(parts, eps0)


def wedges(parts: PartsAndSupport, lateral: ArrayLike, rotation: ArrayLike) -> NDArray[np.bool_]:
    """Say where a peg that starts at eps0, m, and theta0, rad, may wedge."""
    return rotation_margin(parts, lateral, rotation) <= 0


def rotation_margin(
    parts: PartsAndSupport, lateral: ArrayLike, rotation: ArrayLike, form: Form = "exact"
) -> Array:
    """Return how far, in theta_w, the tilt is from the region's sloped sides; <= 0 outside."""
    lower, upper = rotation_bounds(parts, lateral, form)
    theta0 = np.asarray(rotation, dtype=np.float64)
    return np.minimum(upper - theta0, theta0 - lower) / parts.rotation_limit


def least_margin(
    parts: PartsAndSupport, lateral: float, rotation: float, form: Form = "exact"
) -> tuple[float, float]:
    """Return the smallest margin over all places of the compliance centre, and that L_g, m.

    Args:
        parts: Peg, hole and support; its own centre distance does not count.
        lateral: eps0, m.
        rotation: theta0, rad.
        form: Of the region's sides.
    """

    def margin(log_distance: float) -> float:
        there = replace(parts, centre_distance=math.exp(log_distance))
        return float(rotation_margin(there, lateral, rotation, form))

    # From far below the distance at which the slope is largest to far beyond it.
    middle = math.log(parts.worst_centre_distance)
    grid = np.linspace(middle - 5, middle + 5, 201)
    best = int(np.argmin([margin(value) for value in grid.tolist()]))
    low, high = grid[max(0, best - 1)], grid[min(len(grid) - 1, best + 1)]
    found = minimize_scalar(margin, bounds=(low, high), method="bounded")
    return float(found.fun), math.exp(float(found.x))


def box_margin(parts: PartsAndSupport, lateral: ArrayLike, rotation: ArrayLike) -> BoxMargin:
    """Return the margins to theta_w and to r + R, each by itself, as section 5 does."""
    return BoxMargin(
        lateral=1 - np.abs(lateral) / parts.lateral_limit,
        rotation=1 - np.abs(rotation) / parts.rotation_limit,
    )


def _simple_upper(parts: PartsAndSupport, eps0: Array) -> Array:
    error = np.sign(eps0) * np.maximum(np.abs(eps0) - parts.clearance, 0.0)
    return parts.rotation_limit - parts.tilt_per_error * error


def _exact_upper(parts: PartsAndSupport, eps0: Array) -> Array:
    """Return the tilt from which on two points, right of mouth and left of tip, may wedge."""
    K_x, K_theta, L_g = parts.lateral_stiffness, parts.rotational_stiffness, parts.centre_distance
    arm = L_g - parts.friction_radius
    S_t = arm * K_x / (arm * K_x * L_g + K_theta)
    on_tip = parts.rotation_limit - S_t * (eps0 + parts.clearance)
    return np.where(eps0 < -parts.clearance, on_tip, _mouth_upper(parts, eps0 - parts.clearance))


def _mouth_upper(parts: PartsAndSupport, error: Array) -> Array:
    """Return the largest theta0 for which a peg on the mouth stays below 2 (R - r) / l to l_w.

    At depth l that is n(l) / m(l), both quadratic; it is least at l_w or where its derivative is
    zero.
    """
    K_x, K_theta, L_g = parts.lateral_stiffness, parts.rotational_stiffness, parts.centre_distance
    arm, gap = L_g - parts.friction_radius, 2 * parts.clearance
    # n = gap (K_x (arm - l) (L_g - l) + K_theta) - K_x (arm - l) error l
    n0 = gap * (K_x * arm * L_g + K_theta)
    n1 = -K_x * (gap * (arm + L_g) + arm * error)
    n2 = K_x * (gap + error)
    # m = l (K_x L_g (arm - l) + K_theta)
    m1 = K_x * L_g * arm + K_theta
    m2 = -K_x * L_g

    def limit(depth: Array) -> Array:
        quotient: Array = (n0 + n1 * depth + n2 * depth**2) / (m1 * depth + m2 * depth**2)
        return quotient

    # n' m - n m' = 0
    least = limit(np.full_like(error, parts.wedging_depth))
    for depth in quadratic_roots(n2 * m1 - n1 * m2, -2 * n0 * m2, -n0 * m1):
        within = (depth > 0) & (depth < parts.wedging_depth)
        at = np.where(within, depth, parts.wedging_depth)
        least = np.minimum(least, limit(at))
    return least


def quadratic_roots(a: ArrayLike, b: ArrayLike, c: ArrayLike) -> tuple[Array, Array]:
    """Return the roots of ``a x^2 + b x + c``, NaN where there are none, stable for small a."""
    a, b, c = np.broadcast_arrays(*(np.asarray(one, dtype=np.float64) for one in (a, b, c)))
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        q = -(b + np.copysign(np.sqrt(b * b - 4 * a * c), b)) / 2
        return q / a, c / q
