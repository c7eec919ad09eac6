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

Displacements are h v~. Kinetic energy changes by p . v~, so that what is booked as dissipated is
all that the step takes. Friction, whose conditions hold at the end of the step, may in a step in
which a joint or the slip reverses give back up to half of its bound times the change of velocity;
nothing else ever gives energy.

**A gripper** between arm and tip is a spring and a damper without mass, p = h K (s + e) + D e with
the stretch s and its change e over the step, by which the tip moves more than the arm. It is
implicit, as is then the contact's spring, p_n = max(0, -h k g+ - d (min(g+, 0) - min(g, 0))): the
tip has no inertia, it would ring otherwise. What that takes, K e^2 / 2 in a step, is booked. The
surface friction's conditions then are those of the tip's mean velocity.

Several points may touch at once, all fixed on one tip, which a gripper carries and which does not
turn on it. This is the velocity-level time stepping of Stewart and Trinkle (1996) with a compliant
normal.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.compiled import add_product, compiled, inverse
from chamfer.systems.contact.arm_dynamics import add_cross


@compiled
def normal_impulse(
    gap: float, free: float, reach: float, spring: float, damping: float, rigid: bool
) -> float:
    """Return the only p, N s, with which the gap is ``free + reach p`` after the step.

    ``gap``, m, is that before the step, negative while touching; ``spring``, N s/m, the step's
    length times the stiffness; ``rigid``: the spring gives back all that it takes, else it is
    implicit.
    """
    if not rigid:
        wanted = -spring * free - damping * (free - min(gap, 0.0))
        return max(0.0, wanted / (1.0 + reach * (spring + damping)))
    if gap <= 0.0:
        wanted = -spring * (gap + free) / 2 - damping * (free - gap)
        wanted /= 1.0 + reach * (spring / 2 + damping)
        if free + reach * wanted <= 0.0:
            return max(0.0, wanted)
        moved = free - gap + reach * damping * gap  # leaving: g+ - g from a quadratic equation
        moved = (moved + math.hypot(moved, gap * math.sqrt(2.0 * reach * spring))) / 2
        return max(0.0, spring * gap * gap / (2.0 * moved) + damping * gap)
    if free >= 0.0:
        return 0.0
    # Touching: g+ < 0 from a quadratic equation.
    half = (gap * (1.0 + reach * damping) + free) / 2
    square = 1.0 + reach * (spring / 2 + damping)
    root = math.sqrt(half * half - square * free * gap)
    after = free * gap / (half + root) if half > 0.0 else (half - root) / square
    return spring * after * after / (2.0 * (gap - after)) - damping * after


@compiled
def normal_slope(gap: float, after: float, spring: float, damping: float, rigid: bool) -> float:
    """Return by how much p grows with the gap after the step, N s/m, where it pushes."""
    if not rigid:
        return -spring - damping
    if gap <= 0.0:
        if after <= 0.0:
            return -spring / 2 - damping
        return -spring / 2 * (gap / (after - gap)) ** 2
    if after >= 0.0:
        return 0.0
    return spring / 2 * after * (2.0 * gap - after) / (gap - after) ** 2 - damping


Array = NDArray[np.float64]

_SWEEPS: Final = 300  # over the conditions of one point
_FEW_SWEEPS: Final = 20  # of several, which Newton's method is done with sooner
_TURNS: Final = 20  # of Newton's method and sweeps
_NEWTON: Final = 20  # steps in a turn
_WEIGHTS: Final = 5  # of the natural map, which turns take one after the other
_SHORTEST: Final = 1e-3  # part of a Newton step
_BALANCED: Final = 1e-12  # length of the natural map that counts as none, relative
_PROXIMAL: Final = 1e-4  # of the mobility, added to it: what is open stays near
_TOLERANCE: Final = 1e-10  # on the change of a speed in a sweep, relative
_ENOUGH: Final = 1e-7  # the same, which the sweeps may leave: a joint just at its breakaway creeps


class Conditions(NamedTuple):
    """The conditions of a step; rows are the joints, then each point's normal and two tangents.

    Of n joints and m points; vectors of 3m go by points.
    """

    rows: Array  # (3m, n), what the joints' velocities move a point along normal and tangents
    reach: Array  # (n + 3m, n), the velocity that a unit impulse along each row causes
    bound: Array  # (n,), of the joints' dry friction
    yielding: Array  # (3m, 3m), of the gripper, along normals and tangents
    mean: float  # 1/2: a point's slip is that of the mean velocity, 1: of the last one
    before: Array  # (3m,), m/s, of the points along normals and tangents
    gap: Array  # (m,), m
    push: Array  # (m,), m/(N s), the gap that a unit of normal impulse makes
    slide: Array  # (m,), m/s/(N s), the largest eigenvalue of the tangents' mobility
    spring: Array  # (m,), h k
    damping: Array  # (m,)
    mu: Array  # (m,)
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
def act(problem: Conditions, velocity: Array, stretch: Array, row: int, impulse: float) -> None:
    """Let an impulse act along a row."""
    n = len(velocity)
    for i in range(n):
        velocity[i] += problem.reach[row, i] * impulse
    if row >= n:
        for i in range(len(stretch)):
            stretch[i] += problem.yielding[i, row - n] * impulse


@compiled
def moved(problem: Conditions, velocity: Array, stretch: Array, mean: float, row: int) -> float:
    """Return by how much a point moves along its normal or a tangent, m."""
    speed = mean * along(problem.rows[row], velocity)
    speed += (1.0 - mean) * float(problem.before[row])
    return problem.h * speed + float(stretch[row])


@compiled
def _wanted_push(
    problem: Conditions, velocity: Array, stretch: Array, given: float, point: int
) -> float:
    gap, push = problem.gap[point], problem.push[point]
    after = gap + moved(problem, velocity, stretch, 0.5, 3 * point)
    free = after - push * given
    spring, damping = problem.spring[point], problem.damping[point]
    return normal_impulse(gap, free, push, spring, damping, problem.rigid)


@compiled
def _relax(
    problem: Conditions, velocity: Array, stretch: Array, impulse: Array, sweeps: int
) -> float:
    """Sweep over the conditions until they hold; return the last change, a relative speed."""
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
            act(problem, velocity, stretch, j, step)
            change = max(change, abs(step) * mobility)
        for point in range(len(problem.gap)):
            row = n + 3 * point
            wanted = _wanted_push(problem, velocity, stretch, impulse[row], point)
            step = wanted - impulse[row]
            impulse[row] = wanted
            act(problem, velocity, stretch, row, step)
            change = max(change, abs(step) * problem.push[point] / h)
            slide = problem.slide[point]
            if slide > 0.0 and (impulse[row] > 0.0 or impulse[row + 1] or impulse[row + 2]):
                first = moved(problem, velocity, stretch, mean, 3 * point + 1) / h
                second = moved(problem, velocity, stretch, mean, 3 * point + 2) / h
                first = impulse[row + 1] - first / slide
                second = impulse[row + 2] - second / slide
                size, most = math.hypot(first, second), problem.mu[point] * impulse[row]
                if size > most:
                    first *= most / size
                    second *= most / size
                step = max(abs(first - impulse[row + 1]), abs(second - impulse[row + 2]))
                act(problem, velocity, stretch, row + 1, first - impulse[row + 1])
                act(problem, velocity, stretch, row + 2, second - impulse[row + 2])
                impulse[row + 1], impulse[row + 2] = first, second
                change = max(change, step * slide)
        if change <= _TOLERANCE * problem.scale:
            break
    return change / problem.scale


@compiled
def mobility_of(problem: Conditions) -> Array:
    """Return the speeds of joints and points that unit impulses cause, shape (n + 3m, n + 3m).

    Points' are those of which the conditions are: mean ones along the normals.
    """
    n, rows = len(problem.bound), len(problem.before)
    result = np.empty((n + rows, n + rows))
    result[:n] = problem.reach.T
    for cause in range(n + rows):
        for i in range(rows):
            mean = problem.mean if i % 3 else 0.5
            speed = mean * along(problem.rows[i], problem.reach[cause])
            if cause >= n:
                speed += problem.yielding[i, cause - n] / problem.h
            result[n + i, cause] = speed
    return result


@compiled
def natural_map(
    problem: Conditions,
    velocity: Array,
    stretch: Array,
    impulse: Array,
    mobility: Array,
    weight: float,
    lack: Array,
    slope: Array,
) -> float:
    """Fill in the natural map, which is zero where the conditions hold; return its length.

    Friction is p less the projection of p - u / (weight mobility) onto what friction may be, with
    u the speed that it is against. ``velocity``, v+, and ``stretch`` along normals and tangents
    are as the impulses, shape (n + 3m,), make them. ``lack`` is the map, as speeds, and ``slope``
    one of its generalised derivatives by the impulses.
    """
    n, h = len(velocity), problem.h
    slope[:] = 0.0
    for j in range(n):
        scale = weight * mobility[j, j]
        wanted = impulse[j] - velocity[j] / scale
        if abs(wanted) <= problem.bound[j]:
            lack[j] = velocity[j]
            slope[j] = mobility[j]
        else:
            lack[j] = scale * (impulse[j] - math.copysign(problem.bound[j], wanted))
            slope[j, j] = scale
    for point in range(len(problem.gap)):
        row, push = n + 3 * point, problem.push[point]
        wanted = _wanted_push(problem, velocity, stretch, impulse[row], point)
        lack[row] = (impulse[row] - wanted) * push / h
        slope[row, row] = push / h
        if wanted > 0.0:
            after = problem.gap[point] + moved(problem, velocity, stretch, 0.5, 3 * point)
            after += push * (wanted - impulse[row])
            spring, damping = problem.spring[point], problem.damping[point]
            stiff = -normal_slope(problem.gap[point], after, spring, damping, problem.rigid)
            share = push * stiff / (1.0 + push * stiff)
            slope[row] += share * mobility[row]
            slope[row, row] -= share * push / h
        a, b, scale = row + 1, row + 2, weight * problem.slide[point]
        if scale <= 0.0:
            lack[a] = lack[b] = 0.0
            slope[a, a] = slope[b, b] = 1.0
            continue
        first = moved(problem, velocity, stretch, problem.mean, 3 * point + 1) / h
        second = moved(problem, velocity, stretch, problem.mean, 3 * point + 2) / h
        x, y = impulse[a] - first / scale, impulse[b] - second / scale
        size, most = math.hypot(x, y), problem.mu[point] * max(0.0, impulse[row])
        if size <= most:
            lack[a], lack[b] = first, second
            slope[a], slope[b] = mobility[a], mobility[b]
        else:
            x, y, share = x / size, y / size, most / size
            lack[a] = scale * (impulse[a] - most * x)
            lack[b] = scale * (impulse[b] - most * y)
            # The projection's derivative lets pass what is at right angles to the slip.
            for k in range(n + len(stretch)):
                across = share * (x * mobility[b, k] - y * mobility[a, k])
                slope[a, k], slope[b, k] = -y * across, x * across
            slope[a, a] += scale * (1.0 - share * y * y)
            slope[a, b] += scale * share * x * y
            slope[b, a] += scale * share * x * y
            slope[b, b] += scale * (1.0 - share * x * x)
            if impulse[row] > 0.0:
                slope[a, row] -= scale * problem.mu[point] * x
                slope[b, row] -= scale * problem.mu[point] * y
    return math.sqrt(along(lack, lack))


@compiled
def _newton(
    problem: Conditions,
    velocity: Array,
    stretch: Array,
    impulse: Array,
    weight: float,
    damped: bool,
) -> None:
    """Take semismooth Newton steps towards where the natural map of a weight is zero.

    Where it ends in a local minimum, that of another weight goes on. ``damped``: each step is as
    short as it takes to shorten the map.
    """
    n, mobility, lack = len(velocity), mobility_of(problem), np.empty(len(impulse))
    slope = np.empty_like(mobility)
    length = natural_map(problem, velocity, stretch, impulse, mobility, weight, lack, slope)
    for _ in range(_NEWTON):
        if length <= _BALANCED * problem.scale:
            break
        for j in range(n):
            slope[j, j] += _PROXIMAL * weight * mobility[j, j]
        for point in range(len(problem.gap)):
            for row in range(n + 3 * point + 1, n + 3 * point + 3):
                slope[row, row] += _PROXIMAL * weight * problem.slide[point]
        way, before = np.linalg.solve(slope, lack), length
        part, done = 1.0, 0.0
        while done != part:
            for row in range(len(impulse)):
                act(problem, velocity, stretch, row, (done - part) * way[row])
                impulse[row] += (done - part) * way[row]
            length = natural_map(
                problem, velocity, stretch, impulse, mobility, weight, lack, slope
            )
            done = part
            if damped and length >= before:
                part = part / 2.0 if part > _SHORTEST else 0.0
        if part == 0.0:
            break


@compiled
def solve(problem: Conditions, velocity: Array, stretch: Array, impulse: Array) -> float:
    """Change velocity v+, stretch and impulses until the conditions hold.

    The impulses, shape (n + 3m,), are those to start from, velocity and stretch as they make them.
    Returns what a sweep still changes, as a relative speed.
    """
    one = len(problem.gap) == 1
    sweeps, enough = (_SWEEPS, _ENOUGH) if one else (_FEW_SWEEPS, _TOLERANCE)
    error = _relax(problem, velocity, stretch, impulse, sweeps)
    turn = 0
    while error > enough and turn < _TURNS:
        weight, damped = 10.0 ** -(turn % _WEIGHTS), turn % 2 == 0
        _newton(problem, velocity, stretch, impulse, weight, damped)
        turn += 1
        # Where no weight arrives, many sweeps lead elsewhere.
        error = _relax(problem, velocity, stretch, impulse, 1 if turn % _WEIGHTS else _SWEEPS)
        enough = _ENOUGH
    return error


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


class StepModel(NamedTuple):
    """What is frozen over a step: the arm, n joints, and the m points where it may touch."""

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
    sticking: Array  # (n,), 1 where the joint's friction holds it, else 0
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
    model: StepModel, material: Material, motion: Motion, axes: Array, compliance: Array, h: float
) -> Conditions:
    velocity = motion.velocity
    n, m = len(velocity), len(model.gap)
    rows, before, largest = np.zeros((3 * m, n)), np.zeros(3 * m), 0.0
    reach, bound = np.zeros((n + 3 * m, n)), np.empty(n)
    for j in range(n):
        largest = max(largest, abs(velocity[j]))
        fading = 1.0 if motion.sticking[j] else math.exp(-((velocity[j] / material.stribeck) ** 2))
        bound[j] = h * material.coulomb[j] * (1.0 + (material.breakaway - 1.0) * fading)
    reach[:n] = compliance
    yielding = np.zeros((3 * m, 3 * m))
    for i in range(3 * m):
        add_product(model.J_v_WC[i // 3].T, axes[i], rows[i])
        before[i] = along(rows[i], velocity)
        add_product(compliance, rows[i], reach[n + i])
        if not model.rigid:
            for k in range(3 * m):
                for j in range(3):
                    yielding[i, k] += axes[i, j] * along(model.yielding[j], axes[k])
    mean = 1.0 if model.rigid else 0.5
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
        model.gap,
        push,
        slide,
        h * material.stiffness,
        material.damping,
        model.mu,
        model.rigid,
        h,
        _SLOW + largest,
    )


@compiled
def step(model: StepModel, material: Material, motion: Motion, h: float) -> Moved:
    """Take a step of ``h`` seconds."""
    mass, before = model.mass, motion.velocity
    n, m = len(before), len(model.gap)
    axes = np.zeros((3 * m, 3))  # rows: each point's normal and two tangents
    for point in range(m):
        own = axes[3 * point : 3 * point + 3]
        own[0] = model.normal[point]
        own[1] = tangent(own[0])
        add_cross(own[0], own[1], own[2])
    damped = mass.copy()
    momentum = np.empty(n)
    for j in range(n):
        damped[j, j] += h * material.viscous[j] / 2
        momentum[j] = along(mass[j], before) + h * model.force[j]
        momentum[j] -= h * material.viscous[j] * before[j] / 2
    compliance = inverse(damped)
    problem = _conditions(model, material, motion, axes, compliance, h)
    velocity, stretch = np.zeros(n), np.zeros(3 * m)
    add_product(compliance, momentum, velocity)
    impulse, pull = np.zeros(n + 3 * m), np.zeros(3)
    impulse[:n] = motion.joint_impulse
    for i in range(3):
        pull[i] = h * along(model.stiffness[i], model.stretch)  # what keeps the stretch
    for i in range(3 * m):
        impulse[n + i] = along(axes[i], motion.impulse[i // 3])
        if not model.rigid:
            for k in range(3):
                stretch[i] -= problem.yielding[i, k] * along(axes[k], pull)
    touched = impulse[n::3] > 0.0
    for row in range(n + 3 * m):
        act(problem, velocity, stretch, row, impulse[row])
    error = solve(problem, velocity, stretch, impulse)

    sticking, displacement, change = np.zeros(n), np.empty(n), np.zeros(3)
    dissipated = 0.0
    for j in range(n):
        if abs(impulse[j]) < problem.bound[j]:
            sticking[j] = 1.0
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
                gap[point] = model.gap[point] + way
            for k in range(3):
                world[point, k] += axes[i, k] * impulse[n + i]
        deep, was = min(gap[point], 0.0), min(model.gap[point], 0.0)
        dissipated -= material.stiffness[point] * (deep**2 - was**2) / 2
        approach[point] = -moved(problem, velocity, stretch, problem.mean, first) / h
        along_b = moved(problem, velocity, stretch, problem.mean, first + 1)
        along_c = moved(problem, velocity, stretch, problem.mean, first + 2)
        slip[point] = math.hypot(along_b, along_c) / h
        if impulse[n + first] > 0.0 and not touched[point]:
            impact[point] = max(0.0, -problem.before[first])
    add_product(axes[:3].T, stretch[:3], change)
    if not model.rigid:
        for i in range(3):
            dissipated -= along(model.stiffness[i], model.stretch + change / 2) * change[i]
    return Moved(
        Motion(velocity, sticking, impulse[:n].copy(), world),
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
