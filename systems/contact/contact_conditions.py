"""The conditions of friction and contact that a step solves.

:mod:`chamfer.systems.contact.stick_slip` says what they are. Projected Gauss-Seidel sweeps solve
nearly all steps of one point. Where they don't arrive, with stiff contacts and much friction or
where several points on one tip hold it redundantly, Newton's method goes on with all impulses at
once, on the natural map: zero where the conditions hold, and smooth but for kinks (Alart and
Curnier, 1991). Impulses that the conditions leave open, as how points share friction where all
stick, stay near those of the step before, by a proximal term, which does not change what is
solved.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.systems.compiled import compiled
from chamfer.systems.contact.contact_law import normal_impulse, normal_slope

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
    """Sweep over the conditions until they hold; return the last change, a relative speed.

    Args:
        problem: The step.
        velocity: v+, shape (n,), changed.
        stretch: of the gripper along normals and tangents, shape (3m,), changed.
        impulse: shape (n + 3m,), changed.
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
    u the speed that it is against.

    Args:
        problem: The step.
        velocity: v+, shape (n,).
        stretch: of the gripper along normals and tangents, shape (3m,).
        impulse: shape (n + 3m,).
        mobility: As :func:`mobility_of` returns it.
        weight: > 0.
        lack: The map, as speeds, shape (n + 3m,).
        slope: One of its generalised derivatives by the impulses, shape (n + 3m, n + 3m).
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
    """Take semismooth Newton steps towards where the natural map is zero.

    Args:
        problem: The step.
        velocity: v+, shape (n,), changed.
        stretch: of the gripper along normals and tangents, shape (3m,), changed.
        impulse: shape (n + 3m,), changed.
        weight: Of the natural map; where it ends in a local minimum, that of another goes on.
        damped: Whether each step is as short as it takes to shorten the map.
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
    """Change velocity, stretch and impulses until the conditions hold.

    Args:
        problem: The step.
        velocity: v+, shape (n,), as the impulses make it.
        stretch: of the gripper along normals and tangents, shape (3m,), likewise.
        impulse: shape (n + 3m,), from which to start.

    Returns:
        What a sweep still changes, as a relative speed.
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
