"""The conditions of friction and contact that a step solves.

:mod:`systems.contact.stick_slip` says what they are. They are solved by projected Gauss-Seidel;
where that does not converge (stiff contacts with much friction), by bisection of one point's
normal impulse after the other, for any of which friction alone is a convex problem. Several points
on one tip hold it redundantly where they stick, which sweeps don't get done with; on a gripper all
of them are solved together then, for the tip's motion, which is unique.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from systems.compiled import compiled, inverse
from systems.contact.contact_law import normal_impulse

Array = NDArray[np.float64]

_SWEEPS: Final = 300
_FEW_SWEEPS: Final = 20
_TURNS: Final = 30  # of joints and tip
_NEWTON: Final = 40
_BALANCED: Final = 1e-12  # what Newton's method leaves of the push
_FIRST, _LAST = 1.0, 0.9e-10  # speeds over which friction turns around, of the scale
_MOST_SWEEPS: Final = 3000  # of friction with a given push
_BISECTIONS: Final = 200
_ROUNDS: Final = 30  # of bisections, over all points
_TOLERANCE: Final = 1e-10  # on the change of a speed in a sweep, relative
_ENOUGH: Final = 1e-7  # the same, which the sweeps may leave: a joint just at its breakaway creeps
_REDUNDANT: Final = 5e-7  # the same, of several points on a tip that is held redundantly


class Conditions(NamedTuple):
    """The conditions of a step; rows are the joints, then each point's normal and two tangents.

    Of n joints and m points; vectors of 3m go by points.
    """

    axes: Array  # (3m, 3), the points' normals and tangents, world frame
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
def _pushes(
    problem: Conditions, free: Array, tip: Array, smooth: float, push: Array, total: Array
) -> None:
    """Fill in the points' impulses for a motion of the tip, and how their sum changes with it.

    Args:
        problem: The step.
        free: Motion of the points along their axes to start from, m, shape (3m,).
        tip: By how much more the gripper gives, m, shape (3,), world frame.
        smooth: Slip over which friction turns around, m.
        push: N s, shape (3m,), along the points' axes.
        total: N s/m, shape (3, 3), world frame.
    """
    total[:] = 0.0
    slope, half, at = np.empty((3, 3)), np.empty((3, 3)), np.empty(3)
    for point in range(len(problem.gap)):
        first = 3 * point
        axes = problem.axes[first : first + 3]
        for i in range(3):
            at[i] = free[first + i] + along(axes[i], tip)
        gap, spring, damping = problem.gap[point], problem.spring[point], problem.damping[point]
        after, mu = gap + at[0], problem.mu[point]
        normal = max(0.0, -spring * after - damping * (after - min(gap, 0.0)))
        stiff = spring + damping if normal > 0.0 else 0.0
        size = math.sqrt(at[1] ** 2 + at[2] ** 2 + smooth**2)
        push[first] = normal
        slope[0, 0], slope[0, 1], slope[0, 2] = -stiff, 0.0, 0.0
        for i in range(1, 3):
            push[first + i] = -mu * normal * at[i] / size
            slope[i, 0] = mu * stiff * at[i] / size
            for k in range(1, 3):
                unit = 1.0 if i == k else 0.0
                slope[i, k] = -mu * normal * (unit - at[i] * at[k] / size**2) / size
        for i in range(3):
            for k in range(3):
                half[i, k] = 0.0
                for j in range(3):
                    half[i, k] += slope[i, j] * axes[j, k]
        for i in range(3):
            for k in range(3):
                for j in range(3):
                    total[i, k] += axes[j, i] * half[j, k]


@compiled
def _lacking(problem: Conditions, held: Array, pull: Array, tip: Array, push: Array) -> Array:
    """Return by how much the gripper pushes more than the points, N s, shape (3,)."""
    lack = pull.copy()
    for i in range(3):
        lack[i] += along(held[i], tip)
        for row in range(len(push)):
            lack[i] -= problem.axes[row, i] * push[row]
    return lack


@compiled
def _settle(problem: Conditions, velocity: Array, stretch: Array, impulse: Array) -> None:
    """Solve all points together for the tip's motion, while the joints keep their velocity.

    By Newton's method on the tip without mass, with friction that turns around over a slip that
    is made smaller and smaller. The motion is counted from that of the slip before, or rounding
    would be as large as the last slips.
    """
    n, rows = len(velocity), len(problem.axes)
    free, push, pull = np.empty(rows), np.empty(rows), np.zeros(3)
    yielding, slopes, changed = np.zeros((3, 3)), np.empty((3, 3)), np.empty(3)
    for row in range(rows):
        free[row] = moved(problem, velocity, stretch, 0.5, row)
        for i in range(3):
            pull[i] += problem.axes[row, i] * impulse[n + row]
    for i in range(3):
        for m in range(3):
            for j in range(3):
                for k in range(3):
                    part = problem.axes[j, i] * problem.yielding[j, k]
                    yielding[i, m] += part * problem.axes[k, m]
    held = inverse(yielding)
    smooth = _FIRST * problem.h * problem.scale
    while smooth >= _LAST * problem.h * problem.scale:
        tip = np.zeros(3)
        _pushes(problem, free, tip, smooth, push, slopes)
        lack = _lacking(problem, held, pull, tip, push)
        error = math.sqrt(along(lack, lack))
        for _ in range(_NEWTON):
            if error <= _BALANCED * math.sqrt(along(push, push)):
                break
            change = np.linalg.solve(held - slopes, lack)
            part, before = 1.0, error
            while part > 1e-3:
                for i in range(3):
                    changed[i] = tip[i] - part * change[i]
                _pushes(problem, free, changed, smooth, push, slopes)
                lack = _lacking(problem, held, pull, changed, push)
                error = math.sqrt(along(lack, lack))
                if error < before:
                    break
                part /= 2.0
            tip[:] = changed
        for row in range(rows):
            free[row] += along(problem.axes[row], tip)
        for i in range(3):
            pull[i] += along(held[i], tip)
        smooth /= 10.0
    for row in range(rows):
        act(problem, velocity, stretch, n + row, push[row] - impulse[n + row])
        impulse[n + row] = push[row]


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
    points = len(problem.gap)
    together = points > 1 and not problem.rigid
    sweeps = _FEW_SWEEPS if together else _SWEEPS
    error = _relax(problem, velocity, stretch, impulse, False, sweeps)
    if together:
        for _ in range(_TURNS):
            if error <= _ENOUGH:
                break
            before = error
            _settle(problem, velocity, stretch, impulse)
            error = _relax(problem, velocity, stretch, impulse, False, 1)
            if before / 2 < error <= _REDUNDANT:  # as far as rounding allows
                break
        return error
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
