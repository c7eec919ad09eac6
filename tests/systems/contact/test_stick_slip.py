"""Sticking friction and contact: the law, closed forms, and the conditions on random arms."""

import math
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from chamfer.systems.contact.stick_slip import (
    Material,
    Motion,
    Moved,
    StepModel,
    _conditions,
    mobility_of,
    natural_map,
    normal_impulse,
    normal_slope,
    step,
    tangent,
)

gaps = st.floats(-1e-2, 1e-2)
H = 1e-4  # s
SPRING, DAMPING = H * 1e4, 20.0  # h k, d


def law(
    gap: float, after: float, rigid: bool, spring: float = SPRING, damping: float = DAMPING
) -> float:
    """Return the impulse for a gap after the step: mean force of the spring, and the damper."""
    damper = damping * (min(after, 0.0) - min(gap, 0.0))
    if not rigid:
        return max(0.0, -spring * after - damper)
    if max(gap, after) <= 0.0:
        return max(0.0, -spring * (gap + after) / 2 - damper)
    given_back = spring * (min(gap, 0.0) ** 2 - min(after, 0.0) ** 2) / 2
    return max(0.0, given_back / (after - gap) - damper) if given_back else max(0.0, -damper)


@pytest.mark.parametrize("rigid", [True, False], ids=["rigid", "gripper"])
@given(gap=gaps, free=gaps, reach=st.sampled_from([0.0, 1e-5, 1e-3, 1.0]))
@example(gap=1e-3, free=-5e-3, reach=1e-3)  # meets the surface in the step
@example(gap=-1e-3, free=5e-3, reach=1e-3)  # leaves it
def test_impulse_is_what_the_law_says_of_the_gap_that_it_makes(
    gap: float, free: float, reach: float, rigid: bool
) -> None:
    impulse = normal_impulse(gap, free, reach, SPRING, DAMPING, rigid)
    expected = law(gap, free + reach * impulse, rigid)
    # to rounding of the gap
    assert impulse == pytest.approx(expected, rel=1e-9, abs=(SPRING + DAMPING) * 1e-15)


@pytest.mark.parametrize(
    ("gap", "after", "rigid"),
    [(-1e-3, -2e-3, True), (-1e-3, 1e-5, True), (1e-3, -2e-3, True), (-1e-3, -2e-3, False)],
)
def test_slope_is_that_of_the_law(gap: float, after: float, rigid: bool) -> None:
    more, less = (law(gap, after + step, rigid, damping=0.1) for step in (1e-8, -1e-8))
    change = (more - less) / 2e-8
    assert change != 0.0
    slope = normal_slope(gap, after, SPRING, 0.1, rigid)
    assert slope == pytest.approx(change, rel=1e-4)


UP = np.array([0.0, 0.0, 1.0])


def held(mass: Any, force: Any, jacobian: Any, gap: float, mu: float = 0.0) -> StepModel:
    none = np.zeros((3, 3))
    one = np.array
    return StepModel(
        mass, force, one([jacobian]), one([gap]), one([UP]), one([mu]), True, none, none, none[0]
    )


def block(mass: float, force: tuple[float, float, float], gap: float) -> StepModel:
    """A point mass above a table."""
    return held(mass * np.eye(3), np.array(force), np.eye(3), gap)


def made_of(n: int, *, stiffness: float = 1e4, damping: float = 0.0) -> Material:
    spring, damper = np.array([stiffness]), np.array([damping])
    return Material(np.zeros(n), 1.0, 0.02, np.zeros(n), spring, damper)


def moving(*velocity: float) -> Motion:
    v = np.array(velocity)
    return Motion(v, np.zeros(len(v)), np.zeros(len(v)), np.zeros((1, 3)))


class Steps(NamedTuple):
    """What several steps did; gap and force are those of the first point."""

    motion: Motion
    displacement: np.ndarray
    gap: float
    peak_force: float
    impact_speed: float
    dissipated: float
    force: np.ndarray  # in the last step


def take_steps(now: StepModel, material: Material, motion: Motion, h: float, count: int) -> Steps:
    """Take steps of an arm that is held over all of them."""
    displacement, peak, impact, dissipated = np.zeros(len(now.force)), 0.0, 0.0, 0.0
    for _ in range(count):
        done = step(now, material, motion, h)
        motion, now = done.motion, now._replace(gap=done.gap)
        assert done.solved
        displacement += done.displacement
        dissipated += done.dissipated
        force = motion.impulse[0] / h
        peak, impact = max(peak, now.normal[0] @ force), max(impact, done.impact_speed[0])
    return Steps(motion, displacement, now.gap[0], peak, impact, dissipated, force)


def test_damped_bounce() -> None:
    stiffness, damping = 3e4, 150.0
    mass, speed, start, duration = 2.24, 0.33, 5e-3, 0.08

    def push(gap: float, rate: float) -> float:
        return max(0.0, -stiffness * gap - damping * rate) if gap < 0 else 0.0

    exact = solve_ivp(
        lambda _, y: [y[1], push(*y) / mass],
        (0.0, duration),
        [start, -speed],
        method="RK45",
        rtol=1e-9,
        atol=1e-12,
        max_step=2e-5,
    )
    peak = max(push(*state) for state in exact.y.T)
    errors = []
    for h in (8e-5, 4e-5, 2e-5):
        done = take_steps(
            block(mass, (0.0, 0.0, 0.0), start),
            made_of(3, stiffness=stiffness, damping=damping),
            moving(0.0, 0.0, -speed),
            h,
            round(duration / h),
        )
        rebound = done.motion.velocity[2]
        errors.append([abs(peak - done.peak_force) / peak, abs(exact.y[1, -1] / rebound - 1)])
        lost = mass * (speed**2 - rebound**2) / 2
        assert done.dissipated == pytest.approx(lost, rel=1e-9)
    assert np.max(errors[0]) < 1e-3
    assert np.max(errors[-1]) < 2e-4


def test_impact_speed_is_of_contact_made_in_these_steps() -> None:
    table = made_of(3, damping=20.0)
    falling = moving(0.0, 0.0, -0.4)
    first = take_steps(block(1.0, (0.0, 0.0, 0.0), 2e-3), table, falling, H, 20)
    assert first.impact_speed == 0.0 or first.force[2] > 0
    landed = take_steps(block(1.0, (0.0, 0.0, 0.0), 2e-3), table, falling, H, 60)
    assert landed.impact_speed == pytest.approx(0.4, rel=1e-12)
    # In contact already, nothing new is made.
    still = take_steps(block(1.0, (0.0, 0.0, -9.0), landed.gap), table, landed.motion, H, 5)
    assert still.force[2] > 0
    assert still.impact_speed == 0.0


ANGLES = [0.0, 0.3, math.pi / 4, 2.0, -math.pi / 4, -3.0]


@pytest.mark.parametrize("angle", ANGLES)
def test_a_carriage_sticks_whatever_its_direction(angle: float) -> None:
    # One joint along the table: its two tangents see the same motion.
    way = np.array([[math.cos(angle)], [math.sin(angle)], [0.0]])
    rail = held(np.eye(1), np.array([3.0]), way, -1e-3, mu=1.0)
    table = made_of(1)
    stays = take_steps(rail, table, moving(0.0), H, 200)
    np.testing.assert_allclose(stays.displacement, 0.0, atol=1e-14)
    np.testing.assert_allclose(stays.force, 10 * UP - 3 * way[:, 0], rtol=0, atol=1e-9)
    slowed = take_steps(rail, table, moving(0.1), H, 1000)
    assert slowed.motion.velocity[0] == pytest.approx(0.0, abs=1e-12)
    assert slowed.displacement[0] == pytest.approx(0.1**2 / (2 * 7.0), rel=1e-5)
    worked = 0.1**2 / 2 + 3 * slowed.displacement[0]
    assert slowed.dissipated == pytest.approx(worked, rel=1e-9)


seeds = st.integers(0, 2**32 - 1)
several = pytest.mark.parametrize("points", [1, 2])
rigid_or_gripper = pytest.mark.parametrize("rigid", [True, False], ids=["rigid", "gripper"])


class Case(NamedTuple):
    held: StepModel
    material: Material
    motion: Motion
    gripper_damping: np.ndarray


def random_case(
    seed: int,
    *,
    rigid: bool,
    stiffness: float | None = None,
    mu: float | None = None,
    points: int = 1,
) -> Case:
    """An arm of 1 to 4 joints near surfaces, with every kind of friction; some joints at rest."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))

    def conditioned(rows: int, least: float) -> np.ndarray:
        u, _, vt = np.linalg.svd(rng.normal(size=(rows, n)), full_matrices=False)
        return u @ np.diag(rng.uniform(least, 1.0, len(vt))) @ vt

    root = conditioned(n, 0.5)
    normals = rng.normal(size=(points, 3))
    normals /= np.linalg.norm(normals, axis=1)[:, np.newaxis]
    jacobians = np.array([conditioned(3, 0.4) for _ in range(points)])
    if n == 2:  # a planar arm on surfaces at right angles to its plane
        plane, _ = np.linalg.qr(rng.normal(size=(3, 2)))
        jacobians = np.array([plane @ conditioned(2, 0.4) for _ in range(points)])
        normals = np.array([plane @ [math.cos(a), math.sin(a)] for a in 1.0 + np.arange(points)])
    stuck = rng.integers(0, 2, n).astype(float)
    spring, damping, stretch = np.zeros((3, 3)), np.zeros((3, 3)), np.zeros(3)
    yielding = np.zeros((3, 3))
    if not rigid:
        turn, _ = np.linalg.qr(rng.normal(size=(3, 3)))
        spring = turn @ np.diag(10 ** rng.uniform(2, 5, 3)) @ turn.T
        damping = turn @ np.diag(10 ** rng.uniform(-1, 2, 3)) @ turn.T
        yielding = np.linalg.inv(H * spring + damping)
        stretch = rng.normal(size=3) * 1e-3
    return Case(
        StepModel(
            10 ** rng.uniform(-1, 1) * root @ root.T,
            rng.normal(size=n) * 5,
            jacobians,
            rng.uniform(-1e-3, 1e-4, points),
            normals,
            rng.uniform(0, 1, points) if mu is None else np.full(points, mu),
            rigid,
            yielding,
            spring,
            stretch,
        ),
        Material(
            rng.uniform(0, 2, n),
            rng.uniform(1, 2),
            0.02,
            rng.uniform(0, 2, n),
            10 ** rng.uniform(3, 4.5, points) if stiffness is None else np.full(points, stiffness),
            10 ** rng.uniform(0, 2, points),
        ),
        Motion(
            np.where(stuck, 0.0, rng.normal(size=n) * 10 ** rng.uniform(-3, 0)),
            stuck,
            rng.normal(size=n) * 1e-5,
            rng.normal(size=(points, 3)) * 1e-5,
        ),
        damping,
    )


def energy(
    case: Case, velocity: np.ndarray, gap: np.ndarray | float, stretch: np.ndarray
) -> float:
    kinetic = velocity @ case.held.mass @ velocity / 2
    elastic = np.sum(case.material.stiffness * np.minimum(gap, 0.0) ** 2)
    elastic += stretch @ case.held.stiffness @ stretch
    return float(kinetic + elastic / 2)


def check_conditions(case: Case, done: Moved) -> None:
    held, material, motion, gripper_damping = case
    mass, J = held.mass, held.J_v_WC
    before, v = motion.velocity, done.motion.velocity
    p_joint, p, mean = done.motion.joint_impulse, done.motion.impulse, (before + v) / 2
    speeds = 1e-3 + np.max(np.abs(before))
    assert done.solved
    # Equations of motion.
    right = H * (held.force - material.viscous * mean) + p_joint
    right += np.einsum("aij,ai->j", J, p)
    most = 1e-8 * speeds * np.linalg.norm(mass) + 1e-9 * np.max(np.abs(p))
    np.testing.assert_allclose(mass @ (v - before), right, rtol=0, atol=most)
    # Joints: held within the bound, else the bound against the motion.
    fading = np.where(motion.sticking, 1.0, np.exp(-((before / material.stribeck) ** 2)))
    bounds = H * material.coulomb * (1 + (material.breakaway - 1) * fading)
    for speed, impulse, bound, stuck in zip(v, p_joint, bounds, done.motion.sticking, strict=True):
        if stuck:
            assert speed == 0.0
            assert abs(impulse) <= bound * (1 + 1e-12)
        else:
            assert abs(impulse) == pytest.approx(bound, rel=1e-12)
            assert impulse * speed <= 1e-7 * bound * speeds
    # The gripper: spring and damper carry what the surfaces give.
    pull = H * held.stiffness @ (held.stretch + done.stretch) + gripper_damping @ done.stretch
    if held.rigid:
        np.testing.assert_array_equal(done.stretch, 0.0)
    else:
        weight = np.max(np.abs([*p, H * held.stiffness @ held.stretch]))
        np.testing.assert_allclose(pull, p.sum(axis=0), rtol=0, atol=1e-9 * weight)
    np.testing.assert_allclose(done.displacement, H * mean, rtol=1e-12)
    for point in range(len(p)):
        check_contact(case, done, point)
    # Energy: all that is gone is booked.
    gone = energy(case, before, held.gap, held.stretch) + H * held.force @ mean
    gone -= energy(case, v, done.gap, held.stretch + done.stretch)
    scale = energy(case, np.abs(before) + np.abs(v), held.gap, held.stretch)
    assert done.dissipated == pytest.approx(gone, abs=1e-7 * scale)
    # Friction gives energy back only where a motion is stopped or reversed, and little.
    stopped = np.sum(bounds * np.abs(v - before)) / 2 * np.any(before * v <= 1e-9 * before**2)
    for mu, normal, push, jacobian in zip(held.mu, held.normal, p, J, strict=True):
        bound = mu * (normal @ push)
        stopped += bound * np.linalg.norm(jacobian @ (v - before)) / 2 * held.rigid
    assert done.dissipated >= -stopped - 1e-9 * scale


def check_contact(case: Case, done: Moved, point: int) -> None:
    held, material, motion, _ = case
    J, normal, p = held.J_v_WC[point], held.normal[point], done.motion.impulse[point]
    before, v = motion.velocity, done.motion.velocity
    speeds = 1e-3 + np.max(np.abs(before))
    # The spring and damper, pushing only.
    moved = H * J @ (before + v) / 2 + done.stretch
    after = held.gap[point] + normal @ moved
    spring, damping = H * material.stiffness[point], material.damping[point]
    p_n = normal @ p
    wanted = law(held.gap[point], after, held.rigid, spring, damping)
    assert p_n == pytest.approx(wanted, rel=1e-6, abs=1e-7 * H * (spring + damping) * speeds)
    # The surface's friction: within the cone, sticking inside it, against the slip on it.
    slip_motion = J @ v if held.rigid else moved / H
    p_t, v_t = p - p_n * normal, slip_motion - normal @ slip_motion * normal
    size, slip = float(np.linalg.norm(p_t)), float(np.linalg.norm(v_t))
    bound = held.mu[point] * p_n
    assert size <= bound * (1 + 1e-12) + 1e-18
    if size < bound * (1 - 1e-9):
        assert slip < 1e-6 * speeds
    else:
        assert p_t @ v_t == pytest.approx(-size * slip, abs=1e-6 * size * speeds)
    # What is reported.
    assert done.gap[point] == pytest.approx(after, abs=1e-12)
    assert done.slip_speed[point] == pytest.approx(slip, abs=1e-9)
    assert done.approach_speed[point] == pytest.approx(-normal @ slip_motion, abs=1e-9)


@rigid_or_gripper
@several
@given(seed=seeds)
def test_one_step_satisfies_its_conditions(seed: int, points: int, rigid: bool) -> None:
    case = random_case(seed, rigid=rigid, points=points)
    check_conditions(case, step(*case[:3], H))


@rigid_or_gripper
@pytest.mark.parametrize(("stiffness", "mu"), [(1e8, 5.0), (1e9, 20.0)])
@given(seed=seeds)
def test_stiff_contacts_with_much_friction_are_solved(
    seed: int, stiffness: float, mu: float, rigid: bool
) -> None:
    case = random_case(seed, rigid=rigid, stiffness=stiffness, mu=mu)
    check_conditions(case, step(*case[:3], H))


@rigid_or_gripper
@pytest.mark.parametrize("seed", range(6))
def test_natural_map_of_two_points_has_its_slope(seed: int, rigid: bool) -> None:
    held, material, motion, _ = random_case(seed, rigid=rigid, points=2)
    held = held._replace(gap=-1e-2 * held.gap)  # contact is made in the step
    n, rng = len(motion.velocity), np.random.default_rng(seed)
    axes = np.vstack([[up, tangent(up), np.cross(up, tangent(up))] for up in held.normal])
    compliance = np.linalg.inv(held.mass + H * np.diag(material.viscous) / 2)
    problem = _conditions(held, material, motion, axes, compliance, H)
    mobility = mobility_of(problem)
    for point, push in enumerate(problem.push):
        own = mobility[n + 3 * point :, n + 3 * point :][:3, :3]
        assert push == pytest.approx(H * own[0, 0])
        assert problem.slide[point] == pytest.approx(np.linalg.eigvalsh(own[1:, 1:])[-1])

    def mapped(impulse: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        velocity = motion.velocity + problem.reach.T @ impulse
        lack, slope = np.empty(n + 6), np.empty((n + 6, n + 6))
        stretch = problem.yielding @ impulse[n:]
        natural_map(problem, velocity, stretch, impulse, mobility, 0.5, lack, slope)
        return lack, slope

    at = rng.normal(size=n + 6) * 1e-3
    differences = [(mapped(at + e)[0] - mapped(at - e)[0]) / 2e-8 for e in 1e-8 * np.eye(n + 6)]
    np.testing.assert_allclose(mapped(at)[1].T, differences, rtol=1e-3, atol=1e-4)
