"""Force and tilt of a compliantly supported peg on its way into a chamfered hole.

The model and the signs are those of :mod:`chamfer.models.peg_theory.wedging`. First the tip slides
down the chamfer, then one or two points of the peg touch the bore. Every contact slides: its force
is the normal force N and, upward, ``mu N``. So the state follows from the depth alone, without a
history, and a wedge is not modelled: beyond a two-point contact at lambda <= 1 the force is that
of a peg that happens to slide on.

In the bore there are four places for contact: the mouth's edge and the tip's corner, each on the
right (x > 0) and on the left. With ``s = 1`` on the right, -1 on the left, and the place's
distance h below the compliance centre (``L_g - l`` for the mouth, ``L_g`` for the tip)::

    gap_i = (R - r) - s_i (eps0 + (L_g - h_i) theta0) + sum_j M_ij N_j
    M_ij = s_i s_j (1 / K_x + h_i (h_j - mu r) / K_theta)

and each gap or its force is zero, the other is not negative. For one contact and for two opposite
ones these are Whitney's equations; two on the same side are a peg that lies along the wall.

What small angles leave out, the moment of the push and the tilt of the mouth's normal, makes the
force too low. Against :mod:`chamfer.models.peg_theory.planar_statics` the peak of the published
parts is 2 to 3 % low where the tilt is 0.3 of the largest that goes in, 8 to 10 % at 0.6 and 20 %
at 0.9; of 150 random pegs in the middle 7 % below half of it, 17 % at 0.6 and a third close to it.
Onsets are 1 % too deep, and at most 3 % in eight of ten.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg.support import Support
from chamfer.models.peg_theory.planar_statics import Contact
from chamfer.models.validation import ParameterError

Array = NDArray[np.float64]

_ROUNDING: Final = 1e-9
_SIDE: Final = np.array([1.0, -1.0, 1.0, -1.0])
# Which of the places mouth right, mouth left, tip right and tip left are pressed.
_STATES: Final[tuple[tuple[Contact, tuple[int, ...]], ...]] = (
    (Contact.NONE, ()),
    *((Contact.MOUTH, (place,)) for place in (0, 1)),
    *((Contact.TIP, (place,)) for place in (2, 3)),
    *((Contact.TWO_POINT, places) for places in ((0, 3), (1, 2))),
    *((Contact.ALONG_WALL, places) for places in ((0, 2), (1, 3))),
)


class ChamferCrossing(NamedTuple):
    """The peg on the chamfer, each of the shape of the inputs."""

    insertion_force: Array  # N, down
    lateral_force: Array  # N, the size of the chamfer's push towards the hole
    tilt: Array  # rad


class BoreContact(NamedTuple):
    """The peg in the bore, each of the shape of the inputs; forces have one axis more."""

    contact: NDArray[np.int64]  # of :class:`Contact`
    insertion_force: Array  # N, down
    tilt: Array  # rad
    tip: Array  # m, x of the tip
    normal_forces: Array  # N, shape (..., 4)


def chamfer_depth(parts: PegHoleGeometry, lateral: ArrayLike) -> Array:
    """Return how far, m, the peg descends on the chamfer until its tip is in the hole."""
    error = np.maximum(np.abs(lateral) - parts.clearance, 0.0)
    return np.asarray(error * math.tan(parts.chamfer_angle))


def cross_chamfer(
    parts: PegHoleGeometry,
    support: Support,
    lateral: ArrayLike,
    rotation: ArrayLike,
    descent: ArrayLike,
) -> ChamferCrossing:
    """Return force and tilt at a descent after the first touch; NaN beyond the chamfer's end.

    Whitney's chamfer crossing, ``F_z = K_x K_theta A (z / tan a) / den`` with
    ``A = cos a + mu sin a``, ``B = sin a - mu cos a`` and
    ``den = (K_x L_g^2 + K_theta) B - K_x L_g r A``. A chamfer to which the tip sticks is refused.
    """
    angle, L_g = parts.chamfer_angle, support.centre_distance
    A = math.cos(angle) + parts.friction * math.sin(angle)
    B = math.sin(angle) - parts.friction * math.cos(angle)
    K_x, K_theta = support.lateral_stiffness, support.angular_stiffness
    turning = L_g * B - parts.peg_radius * A
    den = K_theta * B + K_x * L_g * turning
    if not den > 0:  # which takes B > 0, tan a > mu
        allowed = "steeper, or with less friction: the peg sticks to the chamfer"
        raise ParameterError("chamfer_angle", angle, allowed)
    eps0, theta0, z = np.broadcast_arrays(*_floats(lateral, rotation, descent))
    on_it = (z >= 0) & (z <= chamfer_depth(parts, eps0))
    normal = K_x * K_theta * np.where(on_it, z, np.nan) / math.tan(angle) / den
    return ChamferCrossing(
        insertion_force=A * normal,
        lateral_force=B * normal,
        tilt=theta0 + np.copysign(turning / K_theta * normal, eps0),
    )


def bore_contact(
    parts: PegHoleGeometry,
    support: Support,
    lateral: ArrayLike,
    rotation: ArrayLike,
    depth: ArrayLike,
) -> BoreContact:
    """Return the contacts and their forces at a depth in the bore."""
    eps0, theta0, bore_depth = np.broadcast_arrays(*_floats(lateral, rotation, depth))
    if not np.all((bore_depth >= 0) & np.isfinite(bore_depth)):
        raise ParameterError("depth", depth, "finite numbers >= 0")
    free_gap, M = _compliance(parts, support, eps0, theta0, bore_depth)
    forces = np.stack([_forces(pressed, free_gap, M) for _, pressed in _STATES])
    # The state whose forces and gaps are not negative; at a boundary, to rounding.
    gaps = free_gap + np.einsum("...ij,k...j->k...i", M, forces)
    slack = np.minimum(gaps, forces / support.lateral_stiffness).min(axis=-1)
    state = np.argmax(np.where(np.isnan(slack), -np.inf, slack), axis=0)
    normal = np.take_along_axis(forces, state[None, ..., None], axis=0)[0]
    arm = support.centre_distance - _above_tip(bore_depth) - parts.friction_radius
    tilt = theta0 + np.sum(_SIDE * normal * arm, axis=-1) / support.angular_stiffness
    pushed = -np.sum(_SIDE * normal, axis=-1) / support.lateral_stiffness
    return BoreContact(
        contact=np.array([contact for contact, _ in _STATES], dtype=np.int64)[state],
        insertion_force=parts.friction * normal.sum(axis=-1),
        tilt=tilt,
        tip=eps0 + pushed - support.centre_distance * (tilt - theta0),
        normal_forces=normal,
    )


def two_point_onset(
    parts: PegHoleGeometry, support: Support, lateral: ArrayLike, rotation: ArrayLike
) -> Array:
    """Return the depth, m, at which two points touch first; NaN where they never do.

    That is where the tilt of the one-point contact reaches ``2 (R - r) / l``.
    """
    eps0, theta0 = np.broadcast_arrays(*_floats(lateral, rotation))
    onsets = []
    for side in (1.0, -1.0):  # leaning right and left
        onsets += [_onset_on_tip(parts, support, side * eps0, side * theta0)]
        onsets += _onsets_on_mouth(parts, support, side * eps0, side * theta0)
    first: Array = np.min(onsets, axis=0)
    return np.where(np.isfinite(first), first, np.nan)


def enters(
    parts: PegHoleGeometry, support: Support, lateral: ArrayLike, rotation: ArrayLike
) -> NDArray[np.bool_]:
    """Return whether the peg meets the chamfer and leaves it upright enough for the mouth."""
    eps0, theta0 = np.broadcast_arrays(*_floats(lateral, rotation))
    tilt = cross_chamfer(parts, support, eps0, theta0, chamfer_depth(parts, eps0)).tilt
    leaning = np.maximum(np.abs(theta0), np.abs(tilt))
    entering: NDArray[np.bool_] = (np.abs(eps0) <= parts.chamfer_limit) & (
        leaning < parts.mouth_tilt_limit
    )
    return entering


def _floats(*values: ArrayLike) -> list[Array]:
    return [np.asarray(value, dtype=np.float64) for value in values]


def _above_tip(depth: Array) -> Array:
    """Return the heights of the four places above the tip, shape (..., 4)."""
    tip = np.zeros_like(depth)
    return np.stack([depth, depth, tip, tip], axis=-1)


def _compliance(
    parts: PegHoleGeometry, support: Support, eps0: Array, theta0: Array, depth: Array
) -> tuple[Array, Array]:
    """Return the gaps without contact, shape (..., 4), and the matrix M, shape (..., 4, 4)."""
    above = _above_tip(depth)
    free_gap = parts.clearance - _SIDE * (eps0[..., None] + above * theta0[..., None])
    below = support.centre_distance - above
    turning = below[..., :, None] * (below - parts.friction_radius)[..., None, :]
    M = np.outer(_SIDE, _SIDE) * (
        1 / support.lateral_stiffness + turning / support.angular_stiffness
    )
    return free_gap, M


def _forces(pressed: tuple[int, ...], free_gap: Array, M: Array) -> Array:
    """Return the forces that close the gaps of the places that are pressed; NaN where none do."""
    forces = np.zeros_like(free_gap)
    with np.errstate(divide="ignore", invalid="ignore"):
        if len(pressed) == 1:
            (i,) = pressed
            forces[..., i] = -free_gap[..., i] / M[..., i, i]
        elif pressed:
            i, j = pressed
            det = M[..., i, i] * M[..., j, j] - M[..., i, j] * M[..., j, i]
            det = np.where(det > 0, det, np.nan)  # l^2 / (K_x K_theta), zero at the mouth
            forces[..., i] = (
                M[..., i, j] * free_gap[..., j] - M[..., j, j] * free_gap[..., i]
            ) / det
            forces[..., j] = (
                M[..., j, i] * free_gap[..., i] - M[..., i, i] * free_gap[..., j]
            ) / det
    return forces


def _onset_on_tip(parts: PegHoleGeometry, support: Support, eps0: Array, theta0: Array) -> Array:
    """Return where a peg that leans right with its tip on the left wall meets the mouth."""
    arm, L_g = support.centre_distance - parts.friction_radius, support.centre_distance
    stiffness = support.lateral_stiffness / support.angular_stiffness
    error = eps0 + parts.clearance
    tilt = theta0 + arm * stiffness / (1 + arm * L_g * stiffness) * error
    onset = 2 * parts.clearance / np.where(tilt > 0, tilt, np.nan)
    return np.where((error <= 0) & (tilt > 0), onset, np.inf)


def _onsets_on_mouth(
    parts: PegHoleGeometry, support: Support, eps0: Array, theta0: Array
) -> list[Array]:
    """Return where a peg that leans right on the mouth meets the left wall, two candidates."""
    K_x, K_theta = support.lateral_stiffness, support.angular_stiffness
    L_g = support.centre_distance
    arm, gap = L_g - parts.friction_radius, 2 * parts.clearance
    error = eps0 - parts.clearance
    load = K_x * (theta0 * L_g + error)
    # theta(l) l = gap, multiplied by the denominator of theta(l)
    a = -(load + gap * K_x)
    b = theta0 * K_theta + load * arm + gap * K_x * (arm + L_g)
    c = np.full_like(a, -gap * (K_x * arm * L_g + K_theta))
    onsets = []
    for depth in _roots(a, b, c):
        found = (depth > 0) & np.isfinite(depth)
        pressed = error + np.where(found, depth, 0.0) * theta0 >= -_ROUNDING * gap
        onsets.append(np.where(found & pressed, depth, np.inf))
    return onsets


def _roots(a: Array, b: Array, c: Array) -> tuple[Array, Array]:
    """Return the roots of ``a x^2 + b x + c``, NaN where there are none, stable for small a."""
    with np.errstate(invalid="ignore", divide="ignore", over="ignore"):
        q = -(b + np.copysign(np.sqrt(b * b - 4 * a * c), b)) / 2
        return q / a, c / q
