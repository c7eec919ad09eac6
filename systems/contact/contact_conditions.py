"""The conditions of friction and contact that a step solves.

:mod:`systems.contact.stick_slip` says what they are. They are solved by projected Gauss-Seidel;
where that does not converge (stiff contacts with much friction), by bisection of one point's
normal impulse after the other, for any of which friction alone is a convex problem.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from systems.compiled import compiled
from systems.contact.contact_law import normal_impulse

Array = NDArray[np.float64]

_SWEEPS: Final = 300
_MOST_SWEEPS: Final = 3000  # of friction with a given push
_BISECTIONS: Final = 200
_ROUNDS: Final = 30  # of bisections, over all points
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
    problem: Conditions, velocity: Array, stretch: Array, impulse: Array, frozen: bool, sweeps: int
) -> float:
    """Sweep over the conditions until they hold; return the last change, a relative speed.

    Args:
        problem: The step.
        velocity: v+, shape (n,), changed.
        stretch: of the gripper along normals and tangents, shape (3m,), changed.
        impulse: shape (n + 3m,), changed.
        frozen: Whether the normal impulses stay as they are.
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
            if not frozen:
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
def _lack(
    problem: Conditions, velocity: Array, stretch: Array, impulse: Array, push: float, point: int
) -> tuple[float, float]:
    """Return by how much the law's normal impulse is less than a given one, and friction's error.

    Friction answers the given push, which makes the lack a continuous function of it, negative at
    0 and positive where the push is large.
    """
    row = len(velocity) + 3 * point
    act(problem, velocity, stretch, row, push - impulse[row])
    impulse[row] = push
    error = _relax(problem, velocity, stretch, impulse, True, _MOST_SWEEPS)
    return push - _wanted_push(problem, velocity, stretch, push, point), error


@compiled
def _bisect(
    problem: Conditions, velocity: Array, stretch: Array, impulse: Array, point: int
) -> float:
    """Solve one point's push by bisection, others as they are; return the error, as a speed."""
    low, high = 0.0, max(impulse[len(velocity) + 3 * point], 1e-12)
    lack, error = _lack(problem, velocity, stretch, impulse, high, point)
    while lack < 0.0 and high < 1e12:
        low, high = high, 4.0 * high
        lack, error = _lack(problem, velocity, stretch, impulse, high, point)
    for _ in range(_BISECTIONS):
        middle = (low + high) / 2
        lack, error = _lack(problem, velocity, stretch, impulse, middle, point)
        small = abs(lack) * problem.push[point] <= _TOLERANCE * problem.h * problem.scale
        if small or not low < middle < high:
            break
        if lack < 0.0:
            low = middle
        else:
            high = middle
    left = abs(lack) * float(problem.push[point]) / (problem.h * problem.scale)
    return max(error, left)


@compiled
def solve(problem: Conditions, velocity: Array, stretch: Array, impulse: Array) -> float:
    """Change velocity, stretch and impulses until the conditions hold.

    Args:
        problem: The step.
        velocity: v+, shape (n,), as the impulses make it.
        stretch: of the gripper along normals and tangents, shape (3m,), likewise.
        impulse: shape (n + 3m,), from which to start.

    Returns:
        What is left of the conditions, as a relative speed.
    """
    error = _relax(problem, velocity, stretch, impulse, False, _SWEEPS)
    points = len(problem.gap)
    for _ in range(_ROUNDS):
        if error <= _ENOUGH:
            break
        for point in range(points):
            error = _bisect(problem, velocity, stretch, impulse, point)
        if points == 1:
            break
        # Each point's push has changed what the others want.
        for point in range(points):
            row = len(velocity) + 3 * point
            lack = impulse[row] - _wanted_push(problem, velocity, stretch, impulse[row], point)
            error = max(error, abs(lack) * problem.push[point] / (problem.h * problem.scale))
    return error
