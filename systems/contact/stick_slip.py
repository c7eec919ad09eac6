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

The conditions are solved by projected Gauss-Seidel, warm-started; where that does not converge
(stiff contacts with much friction), by bisection of p_n, for any of which friction alone is a
convex problem. This is the velocity-level time stepping of Stewart and Trinkle (1996) with a
compliant normal.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from systems.compiled import compiled, inverse
from systems.contact.contact_law import normal_impulse

Array = NDArray[np.float64]

_SWEEPS: Final = 300
_MOST_SWEEPS: Final = 3000  # of friction with a given push
_BISECTIONS: Final = 200
_TOLERANCE: Final = 1e-10  # on the change of a speed in a sweep, relative
_ENOUGH: Final = 1e-7  # the same, which the sweeps may leave: a joint just at its breakaway creeps
_SOLVED: Final = 1e-6  # the same, beyond which a step counts as not solved
_SLOW: Final = 1e-3  # rad/s or m/s, what a slow speed's change is relative to


class Material(NamedTuple):
    """Friction of the joints, and the contact's spring and damper."""

    coulomb: Array  # (n,), N m or N
    breakaway: float  # static over Coulomb friction
    stribeck: float  # rad/s or m/s
    viscous: Array  # (n,), N m s/rad or N s/m
    stiffness: float  # N/m
    damping: float  # N s/m


class Held(NamedTuple):
    """The arm as it is held over a step, n joints."""

    mass: Array  # (n, n)
    force: Array  # (n,), u: torque less Coriolis and gravity torque
    J_v_WC: Array  # (3, n), translational Jacobian of the point that touches, fixed on the arm
    gap: float  # m, at the step's begin, negative while touching
    normal: Array  # (3,), unit, world frame, away from the surface
    mu: float  # of the surface there
    rigid: bool  # True: without a gripper
    yielding: Array  # (3, 3), (h K + D)^-1 of the gripper, m/(N s), world frame
    stiffness: Array  # (3, 3), N/m, K of the gripper, world frame
    stretch: Array  # (3,), m, s of the gripper, world frame


class Motion(NamedTuple):
    """The arm's velocities, and the impulses that start the next solution."""

    velocity: Array  # (n,)
    stuck: Array  # (n,), 1 where the joint's friction holds it, else 0
    joint_impulse: Array  # (n,), N m s or N s, of the last step
    impulse: Array  # (3,), N s, of the last step, world frame


class Moved(NamedTuple):
    """What a step did."""

    motion: Motion
    displacement: Array  # (n,)
    stretch: Array  # (3,), m, change of the gripper's stretch, world frame
    gap: float  # m, after the step
    approach_speed: float  # m/s, towards the surface; at the end, with a gripper the mean
    slip_speed: float  # m/s, likewise
    impact_speed: float  # m/s, approach speed with which contact was made in the step, or 0
    dissipated: float  # J, by all friction, the dampers and the step's own losses
    error: float  # what is left of the conditions, as a relative speed
    solved: bool  # whether that is rounding


class _Problem(NamedTuple):
    """The step's conditions; rows are the joints, the normal and the two tangents."""

    rows: Array  # (3, n), what the joints' velocities move the tip along normal and tangents
    reach: Array  # (n + 3, n), the velocity that a unit impulse along each row causes
    bound: Array  # (n,), of the joints' dry friction
    yielding: Array  # (3, 3), of the gripper, along normal and tangents
    mean: float  # 1/2: the tip's slip is that of the mean velocity, 1: of the last one
    before: Array  # (3,), m/s, of the tip along normal and tangents
    gap: float
    push: float  # m/(N s), the gap that a unit of normal impulse makes
    slide: float  # m/s/(N s), the largest eigenvalue of the tangents' mobility
    spring: float  # h k
    damping: float
    mu: float
    rigid: bool
    h: float
    scale: float  # m/s or rad/s, what an error is relative to


@compiled
def along(row: Array, vector: Array) -> float:
    """Return the scalar product."""
    total = 0.0
    for i in range(len(row)):
        total += row[i] * vector[i]
    return total


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
def _act(problem: _Problem, velocity: Array, stretch: Array, row: int, impulse: float) -> None:
    """Let an impulse act along a row."""
    n = len(velocity)
    for i in range(n):
        velocity[i] += problem.reach[row, i] * impulse
    if row >= n:
        for i in range(3):
            stretch[i] += problem.yielding[i, row - n] * impulse


@compiled
def _moved(problem: _Problem, velocity: Array, stretch: Array, mean: float, row: int) -> float:
    """Return by how much the tip moves along normal or a tangent, m."""
    speed = mean * along(problem.rows[row], velocity)
    speed += (1.0 - mean) * float(problem.before[row])
    return problem.h * speed + float(stretch[row])


@compiled
def _wanted_push(problem: _Problem, velocity: Array, stretch: Array, given: float) -> float:
    after = problem.gap + _moved(problem, velocity, stretch, 0.5, 0)
    free = after - problem.push * given
    spring, damping = problem.spring, problem.damping
    return normal_impulse(problem.gap, free, problem.push, spring, damping, problem.rigid)


@compiled
def _relax(
    problem: _Problem, velocity: Array, stretch: Array, impulse: Array, frozen: bool, sweeps: int
) -> float:
    """Sweep over the conditions until they hold; return the last change, a relative speed.

    Args:
        problem: The step.
        velocity: v+, shape (n,), changed.
        stretch: of the gripper along normal and tangents, shape (3,), changed.
        impulse: shape (n + 3,), changed.
        frozen: Whether the normal impulse stays as it is.
        sweeps: the most.
    """
    n, h, mean = len(velocity), problem.h, problem.mean
    change = 0.0
    for _ in range(sweeps):
        change = 0.0
        for j in range(n):
            mobility = problem.reach[j, j]
            wanted = impulse[j] - velocity[j] / mobility
            wanted = min(max(wanted, -problem.bound[j]), problem.bound[j])
            step = wanted - impulse[j]
            impulse[j] = wanted
            _act(problem, velocity, stretch, j, step)
            change = max(change, abs(step) * mobility)
        if not frozen:
            wanted = _wanted_push(problem, velocity, stretch, impulse[n])
            step = wanted - impulse[n]
            impulse[n] = wanted
            _act(problem, velocity, stretch, n, step)
            change = max(change, abs(step) * problem.push / h)
        if problem.slide > 0.0 and (impulse[n] > 0.0 or impulse[n + 1] or impulse[n + 2]):
            first = _moved(problem, velocity, stretch, mean, 1) / h
            second = _moved(problem, velocity, stretch, mean, 2) / h
            first = impulse[n + 1] - first / problem.slide
            second = impulse[n + 2] - second / problem.slide
            size, most = math.hypot(first, second), problem.mu * impulse[n]
            if size > most:
                first *= most / size
                second *= most / size
            step = max(abs(first - impulse[n + 1]), abs(second - impulse[n + 2]))
            _act(problem, velocity, stretch, n + 1, first - impulse[n + 1])
            _act(problem, velocity, stretch, n + 2, second - impulse[n + 2])
            impulse[n + 1], impulse[n + 2] = first, second
            change = max(change, step * problem.slide)
        if change <= _TOLERANCE * problem.scale:
            break
    return change / problem.scale


@compiled
def _lack(
    problem: _Problem, velocity: Array, stretch: Array, impulse: Array, push: float
) -> tuple[float, float]:
    """Return by how much the law's normal impulse is less than a given one, and friction's error.

    Friction answers the given push, which makes the lack a continuous function of it, negative at
    0 and positive where the push is large.
    """
    n = len(velocity)
    _act(problem, velocity, stretch, n, push - impulse[n])
    impulse[n] = push
    error = _relax(problem, velocity, stretch, impulse, True, _MOST_SWEEPS)
    return push - _wanted_push(problem, velocity, stretch, push), error


@compiled
def _bisect(problem: _Problem, velocity: Array, stretch: Array, impulse: Array) -> float:
    """Solve the conditions by bisection of the normal impulse; return the error, as a speed."""
    n = len(velocity)
    low, high = 0.0, max(impulse[n], 1e-12)
    lack, error = _lack(problem, velocity, stretch, impulse, high)
    while lack < 0.0 and high < 1e12:
        low, high = high, 4.0 * high
        lack, error = _lack(problem, velocity, stretch, impulse, high)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        lack, error = _lack(problem, velocity, stretch, impulse, middle)
        small = abs(lack) * problem.push <= _TOLERANCE * problem.h * problem.scale
        if small or not low < middle < high:
            break
        if lack < 0.0:
            low = middle
        else:
            high = middle
    return max(error, abs(lack) * problem.push / (problem.h * problem.scale))


@compiled
def _conditions(
    held: Held, material: Material, motion: Motion, axes: Array, compliance: Array, h: float
) -> _Problem:
    velocity = motion.velocity
    n = len(velocity)
    rows, before = np.zeros((3, n)), np.zeros(3)
    reach = np.empty((n + 3, n))  # the velocity that a unit impulse along each row causes
    bound = np.empty(n)
    largest = 0.0
    for j in range(n):
        largest = max(largest, abs(velocity[j]))
        fading = 1.0 if motion.stuck[j] else math.exp(-((velocity[j] / material.stribeck) ** 2))
        bound[j] = h * material.coulomb[j] * (1.0 + (material.breakaway - 1.0) * fading)
        for i in range(n):
            reach[i, j] = compliance[i, j]
        for i in range(3):
            for k in range(3):
                rows[i, j] += axes[i, k] * held.J_v_WC[k, j]
            before[i] += rows[i, j] * velocity[j]
    yielding = np.zeros((3, 3))
    for i in range(3):
        for j in range(n):
            reach[n + i, j] = along(compliance[j], rows[i])
        if not held.rigid:
            for k in range(3):
                for j in range(3):
                    yielding[i, k] += axes[i, j] * along(held.yielding[j], axes[k])
    mean = 1.0 if held.rigid else 0.5
    # The largest eigenvalue of the tangents' mobility: with less, sticking need not converge.
    first = mean * along(rows[1], reach[n + 1]) + yielding[1, 1] / h
    second = mean * along(rows[2], reach[n + 2]) + yielding[2, 2] / h
    mixed = mean * along(rows[1], reach[n + 2]) + yielding[1, 2] / h
    return _Problem(
        rows,
        reach,
        bound,
        yielding,
        mean,
        before,
        held.gap,
        h * along(rows[0], reach[n]) / 2 + yielding[0, 0],
        (first + second) / 2 + math.hypot((first - second) / 2, mixed),
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
    n = len(before)
    axes = np.empty((3, 3))  # rows: normal and two tangents
    axes[1] = tangent(held.normal)
    for i in range(3):
        axes[0, i] = held.normal[i]
        j, k = (i + 1) % 3, (i + 2) % 3
        axes[2, i] = held.normal[j] * axes[1, k] - held.normal[k] * axes[1, j]
    damped = mass.copy()
    momentum = np.empty(n)
    for j in range(n):
        damped[j, j] += h * material.viscous[j] / 2
        momentum[j] = along(mass[j], before) + h * held.force[j]
        momentum[j] -= h * material.viscous[j] * before[j] / 2
    compliance = inverse(damped)
    problem = _conditions(held, material, motion, axes, compliance, h)
    velocity, stretch = np.empty(n), np.zeros(3)
    for j in range(n):
        velocity[j] = along(compliance[j], momentum)
    impulse, pull = np.zeros(n + 3), np.zeros(3)
    for j in range(n):
        impulse[j] = motion.joint_impulse[j]
    for i in range(3):
        pull[i] = h * along(held.stiffness[i], held.stretch)  # what keeps the stretch
    for i in range(3):
        impulse[n + i] = along(axes[i], motion.impulse)
        if not held.rigid:
            for k in range(3):
                stretch[i] -= problem.yielding[i, k] * along(axes[k], pull)
    touched = impulse[n] > 0.0
    for row in range(n + 3):
        _act(problem, velocity, stretch, row, impulse[row])
    error = _relax(problem, velocity, stretch, impulse, False, _SWEEPS)
    if error > _ENOUGH:
        error = _bisect(problem, velocity, stretch, impulse)

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
    moved = np.empty(3)
    for i in range(3):
        moved[i] = _moved(problem, velocity, stretch, 0.5, i)
        dissipated -= impulse[n + i] * (moved[i] - stretch[i]) / h
    gap = held.gap + moved[0]
    dissipated -= material.stiffness * (min(gap, 0.0) ** 2 - min(held.gap, 0.0) ** 2) / 2
    world = np.zeros(3)
    for k in range(3):
        for i in range(3):
            world[k] += axes[i, k] * impulse[n + i]
            change[k] += axes[i, k] * stretch[i]
    if not held.rigid:
        for i in range(3):
            dissipated -= along(held.stiffness[i], held.stretch + change / 2) * change[i]
    return Moved(
        Motion(velocity, stuck, impulse[:n].copy(), world),
        displacement,
        change,
        gap,
        -_moved(problem, velocity, stretch, problem.mean, 0) / h,
        math.hypot(
            _moved(problem, velocity, stretch, problem.mean, 1),
            _moved(problem, velocity, stretch, problem.mean, 2),
        )
        / h,
        max(0.0, -problem.before[0]) if impulse[n] > 0.0 and not touched else 0.0,
        dissipated,
        error,
        error <= _SOLVED,
    )
