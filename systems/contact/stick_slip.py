"""Joint friction that truly sticks and compliant contact with friction, solved together.

One step h of an arm whose mass matrix M, contact Jacobian, tangent plane and slow forces are held
over it. The velocities v+ after the step solve, with the mean velocity v~ = (v + v+) / 2,

    M (v+ - v) = h (u - B v~) + p_joint + J_n^T p_n + J_t^T p_t

with u the torque less Coriolis and gravity torque, B the joints' viscous friction, and impulses p
that satisfy

* dry friction: p_joint,j is what stops joint j if that is within its friction's bound, else the
  bound against its velocity v+. The bound of a joint at rest is the breakaway torque.
* contact: a spring and a damper that push only, and only where the gap g is negative. Over the
  step g goes to g+ = g + h J_n v~, and with the spring's energy E(g) = k min(g, 0)^2 / 2
  ``p_n = max(0, -h (E(g+) - E(g)) / (g+ - g) - d (min(g+, 0) - min(g, 0)))``: the mean force of a
  spring that gives back all that it takes (Gonzalez, 1996), and the damper's exact impulse.
* surface friction: |p_t| <= mu p_n, sticking or against the slip.

Displacements are h v~. Kinetic energy changes by p . v~, so that what is booked as dissipated is,
to rounding, all that the step takes. Friction, whose conditions hold at the end of the step, may
in a step in which a joint or the slip reverses give back up to half of its bound times the change
of velocity; nothing else ever gives energy.

**A gripper** between arm and tip is a spring and a damper without mass, p = h K (s + e) + D e with
the stretch s and its change e over the step, by which the tip moves more than the arm. It is
implicit, as is then the contact's spring, p_n = max(0, -h k g+ - d (min(g+, 0) - min(g, 0))): the
tip has no inertia, it would ring otherwise. What that takes, K e^2 / 2 in a step, is booked. The
surface friction's conditions then are those of the tip's mean velocity.

Several points may touch at once: conditions of contact and surface friction are then those of each
point, and all points are fixed on one tip, which a gripper carries and which does not turn on it.
:mod:`chamfer.systems.contact.contact_conditions` solves them. This is the velocity-level time
stepping of Stewart and Trinkle (1996) with a compliant normal.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.compiled import compiled, inverse
from chamfer.systems.contact.contact_conditions import Conditions, act, along, moved, solve

Array = NDArray[np.float64]

_SOLVED: Final = 1e-6  # relative error, beyond which a step counts as not solved
_SLOW: Final = 1e-3  # rad/s or m/s, what a slow speed's change is relative to


class Material(NamedTuple):
    """Friction of the joints, and the contact's spring and damper."""

    coulomb: Array  # (n,), N m or N
    breakaway: float  # static over Coulomb friction
    stribeck: float  # rad/s or m/s
    viscous: Array  # (n,), N m s/rad or N s/m
    stiffness: Array  # (m,), N/m, at each point
    damping: Array  # (m,), N s/m


class Held(NamedTuple):
    """The arm as it is held over a step, n joints, and the m points where it may touch."""

    mass: Array  # (n, n)
    force: Array  # (n,), u: torque less Coriolis and gravity torque
    J_v_WC: Array  # (m, 3, n), translational Jacobians of the points, fixed on the arm
    gap: Array  # (m,), m, at the step's begin, negative while touching
    normal: Array  # (m, 3), unit, world frame, away from the surface
    mu: Array  # (m,), of the surface there
    rigid: bool  # True: without a gripper
    yielding: Array  # (3, 3), (h K + D)^-1 of the gripper, m/(N s), world frame
    stiffness: Array  # (3, 3), N/m, K of the gripper, world frame
    stretch: Array  # (3,), m, s of the gripper, world frame


class Motion(NamedTuple):
    """The arm's velocities, and the impulses that start the next solution."""

    velocity: Array  # (n,)
    stuck: Array  # (n,), 1 where the joint's friction holds it, else 0
    joint_impulse: Array  # (n,), N m s or N s, of the last step
    impulse: Array  # (m, 3), N s, of the last step, world frame


class Moved(NamedTuple):
    """What a step did."""

    motion: Motion
    displacement: Array  # (n,)
    stretch: Array  # (3,), m, change of the gripper's stretch, world frame
    gap: Array  # (m,), m, after the step
    approach_speed: Array  # (m,), m/s, towards the surface; at the end, with a gripper the mean
    slip_speed: Array  # (m,), m/s, likewise
    impact_speed: Array  # (m,), m/s, approach speed with which contact was made in the step, or 0
    dissipated: float  # J, by all friction, the dampers and the step's own losses
    error: float  # what is left of the conditions, as a relative speed
    solved: bool  # whether that is rounding


@compiled
def tangent(normal: Array) -> Array:
    """Return a unit vector at right angles to a unit normal."""
    least = 0
    for i in range(1, 3):
        if abs(normal[i]) < abs(normal[least]):
            least = i
    length = math.sqrt(1.0 - normal[least] ** 2)
    result = np.empty(3)
    for i in range(3):
        result[i] = ((1.0 if i == least else 0.0) - normal[least] * normal[i]) / length
    return result


@compiled
def _conditions(
    held: Held, material: Material, motion: Motion, axes: Array, compliance: Array, h: float
) -> Conditions:
    velocity = motion.velocity
    n, m = len(velocity), len(held.gap)
    rows, before = np.zeros((3 * m, n)), np.zeros(3 * m)
    reach = np.empty((n + 3 * m, n))  # the velocity that a unit impulse along each row causes
    bound = np.empty(n)
    largest = 0.0
    for j in range(n):
        largest = max(largest, abs(velocity[j]))
        fading = 1.0 if motion.stuck[j] else math.exp(-((velocity[j] / material.stribeck) ** 2))
        bound[j] = h * material.coulomb[j] * (1.0 + (material.breakaway - 1.0) * fading)
        for i in range(n):
            reach[i, j] = compliance[i, j]
        for i in range(3 * m):
            for k in range(3):
                rows[i, j] += axes[i, k] * held.J_v_WC[i // 3, k, j]
            before[i] += rows[i, j] * velocity[j]
    yielding = np.zeros((3 * m, 3 * m))
    for i in range(3 * m):
        for j in range(n):
            reach[n + i, j] = along(compliance[j], rows[i])
        if not held.rigid:
            for k in range(3 * m):
                for j in range(3):
                    yielding[i, k] += axes[i, j] * along(held.yielding[j], axes[k])
    mean = 1.0 if held.rigid else 0.5
    push, slide = np.empty(m), np.empty(m)
    for point in range(m):
        a, b, c = 3 * point, 3 * point + 1, 3 * point + 2
        push[point] = h * along(rows[a], reach[n + a]) / 2 + yielding[a, a]
        # The largest eigenvalue of the tangents' mobility: with less, sticking need not converge.
        first = mean * along(rows[b], reach[n + b]) + yielding[b, b] / h
        second = mean * along(rows[c], reach[n + c]) + yielding[c, c] / h
        mixed = mean * along(rows[b], reach[n + c]) + yielding[b, c] / h
        slide[point] = (first + second) / 2 + math.hypot((first - second) / 2, mixed)
    return Conditions(
        rows,
        reach,
        bound,
        yielding,
        mean,
        before,
        held.gap,
        push,
        slide,
        h * material.stiffness,
        material.damping,
        held.mu,
        held.rigid,
        h,
        _SLOW + largest,
    )


@compiled
def step(held: Held, material: Material, motion: Motion, h: float) -> Moved:
    """Take a step of ``h`` seconds."""
    mass, before = held.mass, motion.velocity
    n, m = len(before), len(held.gap)
    axes = np.empty((3 * m, 3))  # rows: each point's normal and two tangents
    for point in range(m):
        normal, own = held.normal[point], axes[3 * point : 3 * point + 3]
        own[1] = tangent(normal)
        for i in range(3):
            own[0, i] = normal[i]
            j, k = (i + 1) % 3, (i + 2) % 3
            own[2, i] = normal[j] * own[1, k] - normal[k] * own[1, j]
    damped = mass.copy()
    momentum = np.empty(n)
    for j in range(n):
        damped[j, j] += h * material.viscous[j] / 2
        momentum[j] = along(mass[j], before) + h * held.force[j]
        momentum[j] -= h * material.viscous[j] * before[j] / 2
    compliance = inverse(damped)
    problem = _conditions(held, material, motion, axes, compliance, h)
    velocity, stretch = np.empty(n), np.zeros(3 * m)
    for j in range(n):
        velocity[j] = along(compliance[j], momentum)
    impulse, pull = np.zeros(n + 3 * m), np.zeros(3)
    for j in range(n):
        impulse[j] = motion.joint_impulse[j]
    for i in range(3):
        pull[i] = h * along(held.stiffness[i], held.stretch)  # what keeps the stretch
    for i in range(3 * m):
        impulse[n + i] = along(axes[i], motion.impulse[i // 3])
        if not held.rigid:
            for k in range(3):
                stretch[i] -= problem.yielding[i, k] * along(axes[k], pull)
    touched = np.empty(m, np.bool_)
    for point in range(m):
        touched[point] = impulse[n + 3 * point] > 0.0
    for row in range(n + 3 * m):
        act(problem, velocity, stretch, row, impulse[row])
    error = solve(problem, velocity, stretch, impulse)

    stuck, displacement, change = np.zeros(n), np.empty(n), np.zeros(3)
    dissipated = 0.0
    for j in range(n):
        if abs(impulse[j]) < problem.bound[j]:
            stuck[j] = 1.0
            velocity[j] = 0.0
        mean = (before[j] + velocity[j]) / 2
        displacement[j] = h * mean
        dissipated += (h * material.viscous[j] * mean - impulse[j]) * mean
    # What contact and gripper take of the work that the arm does on them, and don't store.
    gap, world = np.empty(m), np.zeros((m, 3))
    approach, slip, impact = np.empty(m), np.empty(m), np.zeros(m)
    for point in range(m):
        first = 3 * point
        for i in range(first, first + 3):
            way = moved(problem, velocity, stretch, 0.5, i)
            dissipated -= impulse[n + i] * (way - stretch[i]) / h
            if i == first:
                gap[point] = held.gap[point] + way
            for k in range(3):
                world[point, k] += axes[i, k] * impulse[n + i]
        deep, was = min(gap[point], 0.0), min(held.gap[point], 0.0)
        dissipated -= material.stiffness[point] * (deep**2 - was**2) / 2
        approach[point] = -moved(problem, velocity, stretch, problem.mean, first) / h
        slip[point] = (
            math.hypot(
                moved(problem, velocity, stretch, problem.mean, first + 1),
                moved(problem, velocity, stretch, problem.mean, first + 2),
            )
            / h
        )
        if impulse[n + first] > 0.0 and not touched[point]:
            impact[point] = max(0.0, -problem.before[first])
    for k in range(3):
        for i in range(3):
            change[k] += axes[i, k] * stretch[i]
    if not held.rigid:
        for i in range(3):
            dissipated -= along(held.stiffness[i], held.stretch + change / 2) * change[i]
    return Moved(
        Motion(velocity, stuck, impulse[:n].copy(), world),
        displacement,
        change,
        gap,
        approach,
        slip,
        impact,
        dissipated,
        error,
        error <= _SOLVED,
    )
