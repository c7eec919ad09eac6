"""Joint friction that truly sticks and compliant contact with friction, solved together.

Over a few steps the arm is linearised: mass matrix M, contact Jacobian, the surface's tangent
plane and all slow forces are held. In each step h the velocities v+ solve

    (M + h B) v+ = M v + h u + p_joint + J_n^T p_n + J_t^T p_t

with u the torque less Coriolis and gravity torque, B the joints' viscous friction, and impulses p
that satisfy, at the end of the step,

* dry friction: p_joint,j is what stops joint j if that is within its friction's bound, else the
  bound against its velocity. The bound of a joint at rest is the breakaway torque.
* contact: p_n = h max(0, -k g+ - d g+') for the gap g+ = g + h J_n v+, pushing only. The force is
  continuous; an approaching tip is braked from a gap of d |g'| / k on, tenths of a millimetre.
* surface friction: |p_t| <= mu p_n, sticking or against the slip.

The conditions are solved by projected Gauss-Seidel, warm-started. Being implicit in p, they hold
for any stiffness, the friction never adds energy and a joint at rest stays exactly at rest. This
is the velocity-level time stepping of Stewart and Trinkle (1996) with a compliant normal.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from systems.compiled import compiled, inverse

Array = NDArray[np.float64]

_ITERATIONS: Final = 2000
_TOLERANCE: Final = 1e-10  # on the change of a speed in an iteration, relative
_SLOW: Final = 1e-3  # rad/s or m/s, what a slow speed's change is relative to


class Frozen(NamedTuple):
    """The arm as it is held over the steps, n joints."""

    mass: Array  # (n, n)
    force: Array  # (n,), u: torque less Coriolis and gravity torque
    J_v_WC: Array  # (3, n), the contact point's translational Jacobian
    gap: float  # m, at the first step's begin, negative while touching
    normal: Array  # (3,), unit, world frame, away from the surface


class Material(NamedTuple):
    """Friction of the joints and of the contact."""

    coulomb: Array  # (n,), N m or N
    breakaway: float  # static over Coulomb friction
    stribeck: float  # rad/s or m/s
    viscous: Array  # (n,), N m s/rad or N s/m
    stiffness: float  # N/m
    damping: float  # N s/m
    mu: float


class Motion(NamedTuple):
    """The arm's motion, and the impulses that start the next solution."""

    velocity: Array  # (n,)
    stuck: Array  # (n,), 1 where the joint's friction holds it, else 0
    joint_impulse: Array  # (n,), N m s or N s, of the last step
    impulse: Array  # (3,), N s, of the last step, world frame


class Moved(NamedTuple):
    """What the steps did."""

    motion: Motion
    displacement: Array  # (n,)
    dry_friction: Array  # (n,), N m or N, in the last step
    force: Array  # (3,), N, of the surface on the arm in the last step, world frame
    gap: float  # m, after the last step
    approach_speed: float  # m/s, towards the surface, after the last step
    slip_speed: float  # m/s, after the last step
    peak_force: float  # N, largest normal force of the steps
    impact_speed: float  # m/s, largest approach speed with which contact was made, or 0
    dissipated: float  # J, by dry, viscous and surface friction and the contact's damping


@compiled
def _along(row: Array, vector: Array) -> float:
    total = 0.0
    for i in range(len(row)):
        total += row[i] * vector[i]
    return total


@compiled
def _push(velocity: Array, reach: Array, impulse: float) -> None:
    for i in range(len(velocity)):
        velocity[i] += reach[i] * impulse


@compiled
def _tangent(normal: Array) -> Array:
    """Return a unit vector at right angles to a unit normal."""
    least = 0
    for i in range(1, 3):
        if abs(normal[i]) < abs(normal[least]):
            least = i
    length = math.sqrt(1.0 - normal[least] ** 2)
    tangent = np.empty(3)
    for i in range(3):
        tangent[i] = ((1.0 if i == least else 0.0) - normal[least] * normal[i]) / length
    return tangent


@compiled
def advance(frozen: Frozen, material: Material, motion: Motion, h: float, count: int) -> Moved:
    """Take ``count`` steps of ``h`` seconds each."""
    mass, force, J = frozen.mass, frozen.force, frozen.J_v_WC
    gap, away = frozen.gap, frozen.normal
    stiffness, damping, mu = material.stiffness, material.damping, material.mu
    velocity, stuck = motion.velocity.copy(), motion.stuck.copy()
    n = len(velocity)
    normal, first, second = n, n + 1, n + 2
    displacement = np.zeros(n)
    axes = np.empty((3, 3))  # rows: normal and two tangents
    axes[1] = _tangent(away)
    for i in range(3):
        axes[0, i] = away[i]
        j, k = (i + 1) % 3, (i + 2) % 3
        axes[2, i] = away[j] * axes[1, k] - away[k] * axes[1, j]
    rows = np.zeros((3, n))
    impulse = np.zeros(n + 3)
    for j in range(n):
        impulse[j] = motion.joint_impulse[j]
    for i in range(3):
        for k in range(3):
            impulse[n + i] += axes[i, k] * motion.impulse[k]
            for j in range(n):
                rows[i, j] += axes[i, k] * J[k, j]
    damped = mass.copy()
    for j in range(n):
        damped[j, j] += h * material.viscous[j]
    compliance = inverse(damped)
    reach = np.empty((n + 3, n))  # the velocity that a unit impulse along each row causes
    for j in range(n):
        for i in range(n):
            reach[i, j] = compliance[i, j]
        for i in range(3):
            reach[n + i, j] = _along(compliance[j], rows[i])
    yielding = h * stiffness + damping
    weight = _along(rows[0], reach[normal])
    # The largest eigenvalue of the tangents' mobility: with less, sticking need not converge.
    along, across = _along(rows[1], reach[first]), _along(rows[2], reach[second])
    sliding = (along + across) / 2
    sliding += math.hypot((along - across) / 2, _along(rows[1], reach[second]))
    bound = np.empty(n)
    momentum = np.empty(n)
    dissipated, peak, impact = 0.0, 0.0, 0.0
    for _ in range(count):
        largest = 0.0
        before = _along(rows[0], velocity)
        touched = impulse[normal] > 0.0
        for j in range(n):
            fading = 1.0 if stuck[j] else math.exp(-((velocity[j] / material.stribeck) ** 2))
            bound[j] = h * material.coulomb[j] * (1.0 + (material.breakaway - 1.0) * fading)
            momentum[j] = _along(mass[j], velocity) + h * force[j]
            largest = max(largest, abs(velocity[j]))
        for j in range(n):
            velocity[j] = _along(compliance[j], momentum)
        for r in range(n + 3):
            _push(velocity, reach[r], impulse[r])
        for _ in range(_ITERATIONS):
            change = 0.0
            for j in range(n):
                wanted = impulse[j] - velocity[j] / compliance[j, j]
                wanted = min(max(wanted, -bound[j]), bound[j])
                step = wanted - impulse[j]
                impulse[j] = wanted
                _push(velocity, reach[j], step)
                change = max(change, abs(step) * compliance[j, j])
            rest = _along(rows[0], velocity) - weight * impulse[normal]
            wanted = -h * (stiffness * gap + yielding * rest) / (1.0 + h * yielding * weight)
            wanted = max(wanted, 0.0)
            step = wanted - impulse[normal]
            impulse[normal] = wanted
            _push(velocity, reach[normal], step)
            change = max(change, abs(step) * weight)
            if sliding > 0.0:
                along = impulse[first] - _along(rows[1], velocity) / sliding
                across = impulse[second] - _along(rows[2], velocity) / sliding
                size = math.hypot(along, across)
                if size > mu * impulse[normal]:
                    along *= mu * impulse[normal] / size
                    across *= mu * impulse[normal] / size
                _push(velocity, reach[first], along - impulse[first])
                _push(velocity, reach[second], across - impulse[second])
                step = max(abs(along - impulse[first]), abs(across - impulse[second]))
                impulse[first] = along
                impulse[second] = across
                change = max(change, step * sliding)
            if change <= _TOLERANCE * (_SLOW + largest):
                break
        for j in range(n):
            if abs(impulse[j]) < bound[j]:
                stuck[j] = 1.0
                velocity[j] = 0.0
            else:
                stuck[j] = 0.0
            dissipated += h * material.viscous[j] * velocity[j] ** 2 - impulse[j] * velocity[j]
            displacement[j] += h * velocity[j]
        approach = _along(rows[0], velocity)
        gap += h * approach
        # What the contact force takes beyond the spring's, and what a surface left behind keeps.
        dissipated -= (impulse[normal] + h * stiffness * min(gap, 0.0)) * approach
        if impulse[normal] > 0.0:
            peak = max(peak, impulse[normal] / h)
            if not touched:
                impact = max(impact, -before)
            dissipated -= impulse[first] * _along(rows[1], velocity)
            dissipated -= impulse[second] * _along(rows[2], velocity)
    world = np.zeros(3)
    for i in range(3):
        for k in range(3):
            world[k] += impulse[n + i] * axes[i, k]
    joint_impulse = impulse[:n].copy()
    return Moved(
        Motion(velocity, stuck, joint_impulse, world),
        displacement,
        joint_impulse / h,
        world / h,
        gap,
        -_along(rows[0], velocity),
        math.hypot(_along(rows[1], velocity), _along(rows[2], velocity)),
        peak,
        impact,
        dissipated,
    )
