"""The solver of a step's conditions on its own: a tip in a corner, which holds it redundantly."""

import numpy as np
import pytest

from chamfer.systems.contact.stick_slip import Conditions, solve

H = 1e-4  # s
SCALE = 1e-3  # rad/s or m/s
N, POINTS = 7, 2


def corner(seed: int) -> tuple[Conditions, np.ndarray, np.ndarray]:
    """A seven-joint arm whose gripper holds a nugget at a wall and on a layer, slow or at rest.

    Returns the conditions, and velocity and stretch without any impulse.
    """
    rng = np.random.default_rng(seed)
    root = rng.normal(size=(N, N))
    compliance = np.linalg.inv(root @ root.T + np.diag(10 ** rng.uniform(-2, 1, N)))
    turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    # Layer and wall are at right angles to within 0.2 rad.
    wall, _ = np.linalg.qr(turn[[1, 2, 0]].T + rng.uniform(-0.1, 0.1, (3, 3)))
    axes = np.vstack([turn, wall.T])
    J = rng.normal(size=(3, N))
    turned = J + 0.1 * rng.normal(size=(3, N))  # of the second point, as the arm turns
    rows = np.vstack([axes[:3] @ J, axes[3:] @ turned])
    spring = H * np.diag(10 ** rng.uniform(2.5, 3.5, 3)) + 10 * np.eye(3)
    yielding = axes @ np.linalg.inv(spring) @ axes.T
    reach = np.vstack([compliance, rows @ compliance])
    push, slide = np.empty(POINTS), np.empty(POINTS)
    for point in range(POINTS):
        own = slice(3 * point, 3 * point + 3)
        moves = rows[own] @ reach[N:][own].T / 2 + yielding[own, own] / H
        push[point] = H * moves[0, 0]
        slide[point] = np.max(np.linalg.eigvalsh(moves[1:, 1:]))
    before = rows @ rng.normal(size=N) * 10 ** rng.uniform(-7, -3) * rng.integers(0, 2)
    conditions = Conditions(
        rows=rows,
        reach=reach,
        bound=H * rng.uniform(0, 5, N) * rng.choice([0.0, 1.0, 30.0]),
        yielding=yielding,
        mean=0.5,
        before=before,
        gap=np.where(rng.random(POINTS) < 0.8, -1.0, 1.0) * 10 ** rng.uniform(-6, -4, POINTS),
        push=push,
        slide=slide,
        spring=H * 10 ** rng.uniform(3.5, 5.5, POINTS),
        damping=10 ** rng.uniform(0, 3, POINTS),
        mu=rng.uniform(0, 0.8, POINTS),
        rigid=False,
        h=H,
        scale=SCALE,
    )
    size = 10 ** rng.uniform(-8, -3)
    velocity, stretch = rng.normal(size=N) * size, axes @ rng.normal(size=3) * size * H
    if rng.integers(0, 2):  # the arm nearly balances what presses the tip into the corner
        pressing = np.zeros((POINTS, 3))
        pressing[:, 0] = conditions.spring * np.maximum(0.0, -conditions.gap)
        most = conditions.mu * pressing[:, 0] / 2
        pressing[:, 1:] = most[:, np.newaxis] * rng.uniform(-1, 1, (POINTS, 2))
        velocity -= reach[N:].T @ pressing.ravel()
        stretch -= yielding @ pressing.ravel()
    return conditions, velocity, stretch


def solved(
    problem: tuple[Conditions, np.ndarray, np.ndarray], start: np.ndarray
) -> tuple[float, np.ndarray, np.ndarray, np.ndarray]:
    """Return error, velocity, stretch and impulse."""
    conditions, velocity, stretch = problem
    impulse = start.copy()
    velocity = velocity + conditions.reach.T @ impulse
    stretch = stretch + conditions.yielding @ impulse[N:]
    error = solve(conditions, velocity, stretch, impulse)
    return error, velocity, stretch, impulse


def motion(found: Conditions, velocity: np.ndarray, stretch: np.ndarray) -> np.ndarray:
    """Return how far the points move along their axes, m."""
    moved: np.ndarray = found.h * (found.rows @ velocity + found.before) / 2 + stretch
    return moved


def test_corners_are_solved() -> None:
    both_stick = 0
    for seed in range(150):
        problem = corner(seed)
        conditions, free, slack = problem
        error, velocity, stretch, impulse = solved(problem, np.zeros(N + 6))
        assert error < 1e-7
        # What impulses cause.
        np.testing.assert_allclose(
            velocity, free + conditions.reach.T @ impulse, rtol=0, atol=1e-6 * SCALE
        )
        np.testing.assert_allclose(
            stretch, slack + conditions.yielding @ impulse[N:], rtol=0, atol=1e-6 * SCALE * H
        )
        # Joints: at rest within the bound, else the bound against the velocity.
        bound = conditions.bound
        moving = np.abs(velocity) > 1e-6 * SCALE
        assert np.all(np.abs(impulse[:N]) <= bound)
        np.testing.assert_array_equal(impulse[:N][moving], -(np.sign(velocity) * bound)[moving])
        moved, sticking = motion(conditions, velocity, stretch), 0
        for point in range(POINTS):
            way, push = (
                moved[3 * point : 3 * point + 3],
                impulse[N + 3 * point : N + 3 * point + 3],
            )
            gap, after = conditions.gap[point], conditions.gap[point] + way[0]
            spring, damping = conditions.spring[point], conditions.damping[point]
            law = -spring * after - damping * (after - min(gap, 0.0))
            allowed = 1e-6 * SCALE * H * (spring + damping)
            assert push[0] == pytest.approx(max(0.0, law), rel=1e-9, abs=allowed)
            most, slip = conditions.mu[point] * push[0], way[1:] / H
            size, speed = np.linalg.norm(push[1:]), np.linalg.norm(slip)
            assert size <= most * (1 + 1e-12)
            if speed > 1e-6 * SCALE:
                # the whole of it, against the slip
                against = -most * slip / speed
                wide = most * 1e-6 * SCALE / speed
                np.testing.assert_allclose(push[1:], against, rtol=0, atol=wide + 1e-18)
            elif push[0] > 0.0:
                sticking += 1
        both_stick += sticking == POINTS
    assert both_stick > 7
