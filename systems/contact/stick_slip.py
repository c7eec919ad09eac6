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

from chamfer.systems.compiled import compiled, in_place, invert, within
from chamfer.systems.contact.arm_dynamics import (
    ZERO,
    Three,
    add,
    add_cross,
    add_turned,
    dot,
    nine,
    row,
    scaled,
    vector,
)


@in_place
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


@in_place
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
    scale: Array  # (1,), m/s or rad/s, what an error is relative to


@in_place
def along(row: Array, vector: Array) -> float:
    """Return the scalar product."""
    total = 0.0
    for i in range(len(row)):
        total += row[i] * vector[i]
    return total


@within
def act(problem: Conditions, velocity: Array, stretch: Array, row: int, impulse: float) -> None:
    """Let an impulse act along a row."""
    n = len(velocity)
    for i in range(n):
        velocity[i] += problem.reach[row, i] * impulse
    if row >= n:
        for i in range(len(stretch)):
            stretch[i] += problem.yielding[i, row - n] * impulse


@within
def moved(problem: Conditions, velocity: Array, stretch: Array, mean: float, row: int) -> float:
    """Return by how much a point moves along its normal or a tangent, m."""
    speed = mean * along(problem.rows[row], velocity)
    speed += (1.0 - mean) * float(problem.before[row])
    return problem.h * speed + float(stretch[row])


@within
def _wanted_push(
    problem: Conditions, velocity: Array, stretch: Array, given: float, point: int
) -> float:
    gap, push = problem.gap[point], problem.push[point]
    after = gap + moved(problem, velocity, stretch, 0.5, 3 * point)
    free = after - push * given
    spring, damping = problem.spring[point], problem.damping[point]
    return normal_impulse(gap, free, push, spring, damping, problem.rigid)


@within
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
        if change <= _TOLERANCE * problem.scale[0]:
            break
    return change / float(problem.scale[0])


@compiled
def mobility_of(problem: Conditions) -> Array:
    """Return the speeds of joints and points that unit impulses cause, shape (n + 3m, n + 3m).

    Points' are those of which the conditions are: mean ones along the normals.
    """
    n, rows = len(problem.bound), len(problem.before)
    result = np.empty((n + rows, n + rows))
    for cause in range(n + rows):
        for j in range(n):
            result[j, cause] = problem.reach[cause, j]
        for i in range(rows):
            mean = problem.mean if i % 3 else 0.5
            speed = mean * along(problem.rows[i], problem.reach[cause])
            if cause >= n:
                speed += problem.yielding[i, cause - n] / problem.h
            result[n + i, cause] = speed
    return result


@within
def _add_row(slope: Array, mobility: Array, i: int, share: float) -> None:
    for k in range(len(mobility)):
        slope[i, k] += share * mobility[i, k]


@in_place
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
    for i in range(len(lack)):
        for k in range(len(lack)):
            slope[i, k] = 0.0
    for j in range(n):
        scale = weight * mobility[j, j]
        wanted = impulse[j] - velocity[j] / scale
        if abs(wanted) <= problem.bound[j]:
            lack[j] = velocity[j]
            _add_row(slope, mobility, j, 1.0)
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
            _add_row(slope, mobility, row, share)
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
            _add_row(slope, mobility, a, 1.0)
            _add_row(slope, mobility, b, 1.0)
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
    slope = np.empty((len(lack), len(lack)))
    length = natural_map(problem, velocity, stretch, impulse, mobility, weight, lack, slope)
    for _ in range(_NEWTON):
        if length <= _BALANCED * problem.scale[0]:
            break
        for j in range(n):
            slope[j, j] += _PROXIMAL * weight * mobility[j, j]
        for point in range(len(problem.gap)):
            for at in range(n + 3 * point + 1, n + 3 * point + 3):
                slope[at, at] += _PROXIMAL * weight * problem.slide[point]
        way, before = np.linalg.solve(slope, lack), length
        part, done = 1.0, 0.0
        while done != part:
            for i in range(len(impulse)):
                act(problem, velocity, stretch, i, (done - part) * way[i])
                impulse[i] += (done - part) * way[i]
            length = natural_map(
                problem, velocity, stretch, impulse, mobility, weight, lack, slope
            )
            done = part
            if damped and length >= before:
                part = part / 2.0 if part > _SHORTEST else 0.0
        if part == 0.0:
            break


@within
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


SOLVED: Final = 1e-6  # relative error, beyond which a step counts as not solved
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
    """The model that a step holds constant: the arm, n joints, and its m possible contacts."""

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
    """Result of a step."""

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


class Work(NamedTuple):
    """Work arrays of a step, and its further results."""

    problem: Conditions
    axes: Array  # (3m, 3), rows: each point's normal and two tangents
    damped: Array  # (n, n)
    velocity: Array  # (n,)
    stretch: Array  # (3m,)
    impulse: Array  # (n + 3m,)
    touched: Array  # (m,), 1 where a point pushed in the step before
    displacement: Array  # (n,)
    change: Array  # (3,), m, of the gripper's stretch, world frame
    speeds: Array  # (3, m), m/s, approach, slip and impact speed


@compiled
def workspace(model: StepModel, material: Material, h: float) -> Work:
    """Return room for steps of ``h`` seconds of a model, whose arrays are filled in for each."""
    n, m = len(model.force), len(model.gap)
    rows, reach, yielding = (
        np.empty((3 * m, n)),
        np.empty((n + 3 * m, n)),
        np.zeros((3 * m, 3 * m)),
    )
    moving = rows, reach, np.empty(n), yielding, 1.0 if model.rigid else 0.5, np.empty(3 * m)
    pushing = model.gap, np.empty(m), np.empty(m), h * material.stiffness, material.damping
    problem = Conditions(*moving, *pushing, model.mu, model.rigid, h, np.empty(1))
    solved = np.empty((n, n)), np.empty(n), np.empty(3 * m), np.empty(n + 3 * m), np.empty(m)
    return Work(problem, np.empty((3 * m, 3)), *solved, np.empty(n), np.empty(3), np.empty((3, m)))


@compiled
def tangent(normal: Array) -> Array:
    """Return a unit vector at right angles to a unit normal."""
    return np.array(_tangent(vector(normal)))


@in_place
def _tangent(normal: Three) -> Three:
    x, y, z = normal
    if abs(z) < min(abs(x), abs(y)):
        length = math.sqrt(1.0 - z**2)
        return -z * x / length, -z * y / length, (1.0 - z * z) / length
    if abs(y) < abs(x):
        length = math.sqrt(1.0 - y**2)
        return -y * x / length, (1.0 - y * y) / length, -y * z / length
    length = math.sqrt(1.0 - x**2)
    return (1.0 - x * x) / length, -x * y / length, -x * z / length


@compiled
def _conditions(
    model: StepModel, material: Material, motion: Motion, axes: Array, compliance: Array, h: float
) -> Conditions:
    problem = workspace(model, material, h).problem
    problem.reach[: len(compliance)] = compliance
    _fill_conditions(model, material, motion, axes, problem)
    return problem


@within
def _fill_conditions(
    model: StepModel, material: Material, motion: Motion, axes: Array, problem: Conditions
) -> None:
    """Fill in the conditions of a step, except the joints' reach and its effect on points."""
    velocity, h, mean, yielding = motion.velocity, problem.h, problem.mean, problem.yielding
    n, largest, rows, reach = len(velocity), 0.0, problem.rows, problem.reach
    for j in range(n):
        largest = max(largest, abs(velocity[j]))
        fading = 1.0
        if motion.sticking[j] == 0.0:
            fading = math.exp(-((velocity[j] / material.stribeck) ** 2))
        problem.bound[j] = h * material.coulomb[j] * (1.0 + (material.breakaway - 1.0) * fading)
    problem.scale[0] = _SLOW + largest
    for i in range(len(axes)):
        problem.before[i] = 0.0
        for j in range(n):
            rows[i, j] = 0.0
            for k in range(3):
                rows[i, j] += model.J_v_WC[i // 3, k, j] * axes[i, k]
            problem.before[i] += rows[i, j] * velocity[j]
        for j in range(n):
            reach[n + i, j] = 0.0
            for k in range(n):
                reach[n + i, j] += reach[j, k] * rows[i, k]
        if not model.rigid:
            give = add_turned(nine(model.yielding), row(axes, i, 0), ZERO)
            for k in range(len(axes)):
                yielding[k, i] = dot(row(axes, k, 0), give)
    for point in range(len(model.gap)):
        a, b, c = 3 * point, 3 * point + 1, 3 * point + 2
        first, second, mixed, up = 0.0, 0.0, 0.0, 0.0
        for j in range(n):
            up += rows[a, j] * reach[n + a, j]
            first += rows[b, j] * reach[n + b, j]
            second += rows[c, j] * reach[n + c, j]
            mixed += rows[b, j] * reach[n + c, j]
        problem.push[point] = h * up / 2 + yielding[a, a]
        # The largest eigenvalue of the tangents' mobility: with less, sticking need not converge.
        first = mean * first + yielding[b, b] / h
        second = mean * second + yielding[c, c] / h
        mixed = mean * mixed + yielding[b, c] / h
        difference = math.hypot((first - second) / 2, mixed)
        problem.slide[point] = (first + second) / 2 + difference


@compiled
def step(model: StepModel, material: Material, motion: Motion, h: float) -> Moved:
    """Take a step of ``h`` seconds."""
    velocity, sticking, joint_impulse, impulse = motion
    after = Motion(velocity.copy(), sticking.copy(), joint_impulse.copy(), impulse.copy())
    mass, force, J, gap, normal, mu, rigid, give, spring, stretch = model
    now = StepModel(mass, force, J, gap.copy(), normal, mu, rigid, give, spring, stretch)
    work = workspace(now, material, h)
    dissipated, error = take_step(now, material, after, work)
    approach, slip, impact = work.speeds
    done = work.displacement, work.change, now.gap, approach, slip, impact
    return Moved(after, *done, dissipated, error, error <= SOLVED)


@in_place
def take_step(
    model: StepModel, material: Material, motion: Motion, work: Work
) -> tuple[float, float]:
    """Take a step; change motion and gap, and return the energy dissipated, J, and the error."""
    problem, axes, impulse, before = work.problem, work.axes, work.impulse, motion.velocity
    n, m, h, velocity, stretch = (
        len(before),
        len(model.gap),
        problem.h,
        work.velocity,
        work.stretch,
    )
    for point in range(m):
        normal = row(model.normal, point, 0)
        across = _tangent(normal)
        other = add_cross(normal, across, ZERO)
        for k in range(3):
            axes[3 * point, k] = normal[k]
            axes[3 * point + 1, k], axes[3 * point + 2, k] = across[k], other[k]
    for j in range(n):
        momentum = 0.0
        for k in range(n):
            work.damped[j, k] = model.mass[j, k]
            momentum += model.mass[j, k] * before[k]
        momentum += h * model.force[j]
        momentum -= h * material.viscous[j] * before[j] / 2
        work.damped[j, j] += h * material.viscous[j] / 2
        impulse[j] = momentum
    invert(work.damped, problem.reach)
    _fill_conditions(model, material, motion, axes, problem)
    for j in range(n):
        velocity[j] = 0.0
        for k in range(n):
            velocity[j] += problem.reach[j, k] * impulse[k]
    for j in range(n):
        impulse[j] = motion.joint_impulse[j]
    pull = scaled(add_turned(nine(model.stiffness), vector(model.stretch), ZERO), h)
    for i in range(3 * m):
        # The last impulse to start from, and what keeps the stretch.
        impulse[n + i] = dot(row(axes, i, 0), row(motion.impulse, i // 3, 0))
        stretch[i] = 0.0
        if not model.rigid:
            for k in range(3):
                stretch[i] -= problem.yielding[i, k] * dot(row(axes, k, 0), pull)
    for point in range(m):
        work.touched[point] = impulse[n + 3 * point]
    for i in range(n + 3 * m):
        act(problem, velocity, stretch, i, impulse[i])
    error = solve(problem, velocity, stretch, impulse)

    dissipated = 0.0
    for j in range(n):
        motion.sticking[j] = 0.0
        if abs(impulse[j]) < problem.bound[j]:
            motion.sticking[j] = 1.0
            velocity[j] = 0.0
        mean = (before[j] + velocity[j]) / 2
        work.displacement[j] = h * mean
        motion.joint_impulse[j] = impulse[j]
        dissipated += (h * material.viscous[j] * mean - impulse[j]) * mean
    # What contact and gripper take of the work that the arm does on them, and don't store.
    for point in range(m):
        first = 3 * point
        world, was = ZERO, model.gap[point]
        for i in range(first, first + 3):
            way = moved(problem, velocity, stretch, 0.5, i)
            dissipated -= impulse[n + i] * (way - stretch[i]) / h
            if i == first:
                model.gap[point] = was + way
            world = add(world, scaled(row(axes, i, 0), impulse[n + i]))
        for k in range(3):
            motion.impulse[point, k] = world[k]
        deep, was = min(model.gap[point], 0.0), min(was, 0.0)
        dissipated -= material.stiffness[point] * (deep**2 - was**2) / 2
        approach = -moved(problem, velocity, stretch, problem.mean, first) / h
        along_b = moved(problem, velocity, stretch, problem.mean, first + 1)
        along_c = moved(problem, velocity, stretch, problem.mean, first + 2)
        work.speeds[0, point], work.speeds[1, point] = approach, math.hypot(along_b, along_c) / h
        work.speeds[2, point] = 0.0
        if impulse[n + first] > 0.0 and not work.touched[point] > 0.0:
            work.speeds[2, point] = max(0.0, -problem.before[first])
    change = ZERO
    for i in range(3):
        change = add(change, scaled(row(axes, i, 0), stretch[i]))
    if not model.rigid:
        half = add(vector(model.stretch), scaled(change, 0.5))
        dissipated -= dot(add_turned(nine(model.stiffness), half, ZERO), change)
    for i in range(3):
        work.change[i] = change[i]
    for j in range(n):
        before[j] = velocity[j]
    return dissipated, error
