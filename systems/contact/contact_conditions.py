"""The conditions of friction and contact that a step solves.

:mod:`systems.contact.stick_slip` says what they are. They are solved by projected Gauss-Seidel;
where that does not converge (stiff contacts with much friction), by bisection of one point's
normal impulse after the other, for any of which friction alone is a convex problem. Several points
on one tip hold it redundantly where they stick, which sweeps don't get done with; on a gripper all
of them are solved together then, by Newton's method for the motion, which is unique.
"""

import math
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from systems.compiled import compiled
from systems.contact.contact_law import normal_impulse

Array = NDArray[np.float64]

_SWEEPS: Final = 300
_FEW_SWEEPS: Final = 20
_TURNS: Final = 10  # of joints and tip
_NEWTON: Final = 100
_BALANCED: Final = 1e-12  # what Newton's method leaves of the push
_FIRST, _LAST = 1.0, 0.9e-10  # speeds over which friction turns around, of the scale
_MOST_SWEEPS: Final = 3000  # of friction with a given push
_BISECTIONS: Final = 200
_ROUNDS: Final = 30  # of bisections, over all points
_TOLERANCE: Final = 1e-10  # on the change of a speed in a sweep, relative
_ENOUGH: Final = 1e-7  # the same, which the sweeps may leave: a joint just at its breakaway creeps
_NEARLY: Final = 1e-3  # the same, beyond which such points are tried one by one
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
def _pushes(problem: Conditions, at: Array, smooth: float, push: Array, slope: Array) -> None:
    """Fill in the points' impulses for a motion of the tip, and how they change with it.

    Args:
        problem: The step.
        at: Motion of the points along their axes, m, shape (3m,).
        smooth: Slip over which friction turns around, m.
        push: N s, shape (3m,), along the points' axes.
        slope: N s/m, shape (3m, 3m), likewise.
    """
    slope[:] = 0.0
    for point in range(len(problem.gap)):
        n = 3 * point
        gap, spring, damping = problem.gap[point], problem.spring[point], problem.damping[point]
        after, mu = gap + at[n], problem.mu[point]
        normal = max(0.0, -spring * after - damping * (after - min(gap, 0.0)))
        stiff = spring + damping if normal > 0.0 else 0.0
        size = math.sqrt(at[n + 1] ** 2 + at[n + 2] ** 2 + smooth**2)
        push[n], slope[n, n] = normal, -stiff
        for i in range(n + 1, n + 3):
            push[i] = -mu * normal * at[i] / size
            slope[i, n] = mu * stiff * at[i] / size
            for k in range(n + 1, n + 3):
                unit = 1.0 if i == k else 0.0
                slope[i, k] = -mu * normal * (unit - at[i] * at[k] / size**2) / size


@compiled
def _unmoved(
    problem: Conditions, begin: Array, change: Array, smooth: float, push: Array, slope: Array
) -> tuple[Array, Array]:
    """Return by how much joints and tip move more than impulses move them, and its derivative.

    Args:
        problem: The step, n joints.
        begin: Velocities of the joints, then motion of the points along their axes, then what
            joints and tip lack without any impulse, as speeds; shape (n + 3m + n + 3,).
        change: Of the joints' velocities, and of the tip's, from there on; shape (n + 3,).
        smooth: Speed over which friction turns around, m/s or rad/s.
        push: Impulses, shape (n + 3m,), filled in.
        slope: shape (3m, 3m), for use in here.
    """
    n, rows, h = len(problem.bound), len(problem.axes), problem.h
    at, moves = begin[n : n + rows].copy(), np.empty((rows, n + 3))
    for row in range(rows):
        moves[row, :n] = problem.rows[row] * (h / 2)
        moves[row, n:] = problem.axes[row] * h
        at[row] += along(moves[row], change)
    _pushes(problem, at, smooth * h, push[n:], slope)
    reach = np.zeros((n + rows, n + 3))
    reach[:, :n] = problem.reach
    for row in range(rows):
        for i in range(rows):
            for k in range(3):
                # Along its axes, of which the first point's are a base of space.
                if i < 3:
                    reach[n + row, n + k] += problem.yielding[i, row] * problem.axes[i, k] / h
    lack, derivative = begin[n + rows :] + change, np.eye(n + 3)
    turned = slope @ moves
    for j in range(n):
        speed = begin[j] + change[j]
        size = math.sqrt(speed**2 + smooth**2)
        push[j] = -problem.bound[j] * speed / size
        for i in range(n + 3):
            derivative[i, j] += reach[j, i] * problem.bound[j] * smooth**2 / size**3
    lack -= push @ reach
    derivative -= np.ascontiguousarray(reach[n:].T) @ turned
    return lack, derivative


@compiled
def _settle(
    problem: Conditions, velocity: Array, stretch: Array, impulse: Array, shrink: float
) -> None:
    """Solve joints and points together for the motion of arm and tip.

    By Newton's method, with friction that turns around over a speed that is made smaller and
    smaller. The motion is counted from that of the speed before, or rounding would be as large
    as the last speeds.
    """
    n, rows, h = len(velocity), len(problem.axes), problem.h
    begin, change = np.zeros(2 * n + rows + 3), np.zeros(n + 3)
    push, slope, found = np.zeros(n + rows), np.empty((rows, rows)), impulse.copy()
    begin[:n] = velocity
    for row in range(rows):
        begin[n + row] = moved(problem, velocity, stretch, 0.5, row)
    for row in range(n + rows):
        for j in range(n):
            begin[n + rows + j] += problem.reach[row, j] * impulse[row]
    for k in range(3):
        for i in range(3):
            for row in range(rows):
                gives = problem.yielding[i, row] * impulse[n + row] / h
                begin[2 * n + rows + k] += problem.axes[i, k] * gives
    smooth = _FIRST * problem.scale
    while smooth >= _LAST * problem.scale:
        change[:] = 0.0
        lack, derivative = _unmoved(problem, begin, change, smooth, push, slope)
        error = math.sqrt(along(lack, lack))
        for _ in range(_NEWTON):
            if error <= _BALANCED * problem.scale:
                break
            way = np.linalg.solve(derivative, lack)
            part, before, last = 1.0, error, change.copy()
            while part > 1e-3:
                change[:] = last - part * way
                lack, derivative = _unmoved(problem, begin, change, smooth, push, slope)
                error = math.sqrt(along(lack, lack))
                if error < before:
                    break
                part /= 2.0
        if error > _ENOUGH * problem.scale:
            break  # the last speed's impulses are better
        found[:] = push
        for j in range(n):
            begin[j] += change[j]
        for row in range(rows):
            begin[n + row] += h * along(problem.rows[row], change[:n]) / 2
            begin[n + row] += h * along(problem.axes[row], change[n:])
        begin[n + rows :] += change
        smooth /= shrink
    for row in range(n + rows):
        act(problem, velocity, stretch, row, found[row] - impulse[row])
        impulse[row] = found[row]


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
        for turn in range(_TURNS):
            if error <= _ENOUGH:
                break
            before = error
            # Where one way there does not arrive, another does.
            _settle(problem, velocity, stretch, impulse, 10.0 / (1.0 + 0.3 * turn))
            error = _relax(problem, velocity, stretch, impulse, False, 1)
            if before / 2 < error <= _REDUNDANT:  # as far as rounding allows
                break
        if error <= _NEARLY:
            return error
        error = _relax(problem, velocity, stretch, impulse, False, _SWEEPS)
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
