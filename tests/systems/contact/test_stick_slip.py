"""Sticking friction and contact against closed forms, scipy, and the conditions they solve."""

import math
from itertools import pairwise
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from models.joint_friction import JointFrictionParams
from systems.contact.stick_slip import Frozen, Material, Motion, Moved, advance

H = 1e-4  # s
FAR = 1e3  # m, a gap that is never closed
UP = np.array([0.0, 0.0, 1.0])
seeds = st.integers(0, 2**32 - 1)


@pytest.fixture(scope="module", autouse=True)
def compiled() -> None:
    """Compile before any test: it would exceed the time that one example may take."""
    advance(free(1.0), made_of(1), at_rest(1), H, 1)


def free(mass: object, force: object = 0.0) -> Frozen:
    """An arm far away from any surface."""
    matrix = np.atleast_2d(np.array(mass, dtype=float))
    n = len(matrix)
    u = np.broadcast_to(np.array(force, dtype=float), (n,)).copy()
    return Frozen(matrix, u, np.zeros((3, n)), FAR, UP)


def block(mass: float, force: tuple[float, float, float], gap: float) -> Frozen:
    """A point mass above a table."""
    return Frozen(mass * np.eye(3), np.array(force), np.eye(3), gap, UP)


def made_of(
    n: int,
    *,
    coulomb: float = 0.0,
    breakaway: float = 1.0,
    viscous: float = 0.0,
    stiffness: float = 1e4,
    damping: float = 0.0,
    mu: float = 0.0,
) -> Material:
    return Material(
        np.full(n, coulomb), breakaway, 0.02, np.full(n, viscous), stiffness, damping, mu
    )


def moving(*velocity: float) -> Motion:
    v = np.array(velocity)
    return Motion(v, np.zeros(len(v)), np.zeros(len(v)), np.zeros(3))


def at_rest(n: int) -> Motion:
    return moving(*[0.0] * n)._replace(stuck=np.ones(n))


def orders(errors: list[float]) -> list[float]:
    """Return by which powers of two the errors shrink."""
    return [math.log2(first / second) for first, second in pairwise(errors)]


# --- Joints -------------------------------------------------------------------------------------


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_held_below_breakaway_stays_exactly_at_rest(sign: float) -> None:
    rough = made_of(1, coulomb=2.0, breakaway=1.5)
    done = advance(free(0.3, 2.999 * sign), rough, at_rest(1), H, 100_000)
    assert done.motion.velocity[0] == 0.0
    assert done.displacement[0] == 0.0
    assert done.dissipated == 0.0
    assert done.motion.stuck[0] == 1.0
    assert done.dry_friction[0] == pytest.approx(-2.999 * sign, rel=1e-12)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_above_breakaway_it_moves(sign: float) -> None:
    rough = made_of(1, coulomb=2.0, breakaway=1.5)
    done = advance(free(0.3, 3.001 * sign), rough, at_rest(1), H, 1)
    assert done.motion.velocity[0] == pytest.approx(sign * H * 0.001 / 0.3, rel=1e-9)
    assert done.motion.stuck[0] == 0.0
    # Once it moves the friction falls off: it runs away.
    done = advance(free(0.3, 3.001 * sign), rough, at_rest(1), H, 20_000)
    assert sign * done.motion.velocity[0] > 4.0
    assert done.dry_friction[0] == pytest.approx(-2.0 * sign, rel=1e-12)


def test_between_coulomb_and_breakaway_both_rest_and_motion_go_on() -> None:
    rough, pulled = made_of(1, coulomb=2.0, breakaway=1.5), free(0.5, 2.5)
    assert advance(pulled, rough, at_rest(1), H, 1000).motion.velocity[0] == 0.0
    gone = advance(pulled, rough, moving(1.0), H, 1000)
    assert gone.motion.velocity[0] == pytest.approx(1.0 + 0.1 * (2.5 - 2.0) / 0.5, rel=1e-12)


@pytest.mark.parametrize("speed", [-0.05, -0.01, 0.003, 0.02, 0.5])
def test_moving_friction_is_the_law_of_the_model(speed: float) -> None:
    law = JointFrictionParams(coulomb=(2.0,), breakaway=1.5, stribeck=0.02, viscous=(0.0,))
    done = advance(free(10.0), made_of(1, coulomb=2.0, breakaway=1.5), moving(speed), H, 1)
    expected = -math.copysign(law.dry(np.array([speed]))[0], speed)
    assert done.dry_friction[0] == pytest.approx(expected, rel=1e-12)
    assert done.motion.velocity[0] == pytest.approx(speed + H * expected / 10.0, rel=1e-12)


def test_resting_joint_is_held_by_breakaway_whatever_its_last_velocity() -> None:
    rough = made_of(1, coulomb=2.0, breakaway=1.5)
    # Moving fast into a stop: Coulomb friction stops it, breakaway then holds it.
    stopped = advance(free(1.0), rough, moving(1.9e-4), H, 1)
    assert stopped.motion.velocity[0] == 0.0
    held = advance(free(1.0, 2.9), rough, stopped.motion, H, 100)
    assert held.displacement[0] == 0.0


def test_stopping_distance() -> None:
    mass, coulomb, v0 = 0.7, 2.1, 0.6
    exact = mass * v0**2 / (2 * coulomb)
    errors = []
    for h in (4e-4, 2e-4, 1e-4):
        done = advance(free(mass), made_of(1, coulomb=coulomb), moving(v0), h, round(0.4 / h))
        assert done.motion.velocity[0] == 0.0
        # The sum of velocities that shrink by f h / m a step, all of them too small by v0 h / 2.
        assert done.displacement[0] == pytest.approx(exact - v0 * h / 2, rel=1e-9)
        errors.append(exact - done.displacement[0])
        assert done.dissipated == pytest.approx(coulomb * done.displacement[0], rel=1e-9)
    np.testing.assert_allclose(orders(errors), 1.0, atol=1e-6)


def test_viscous_decay() -> None:
    mass, viscous, v0, duration = 0.5, 2.0, 3.0, 0.4
    exact = v0 * math.exp(-viscous * duration / mass)
    errors = []
    for h in (4e-4, 2e-4, 1e-4):
        count = round(duration / h)
        done = advance(free(mass), made_of(1, viscous=viscous), moving(v0), h, count)
        found = done.motion.velocity[0]
        assert found == pytest.approx(v0 / (1 + h * viscous / mass) ** count, rel=1e-9)
        errors.append(found - exact)
        # What friction took is what is missing, but for the steps' own losses.
        lost = mass * (v0**2 - found**2) / 2
        assert done.dissipated == pytest.approx(lost, rel=5 * h * viscous / mass)
    np.testing.assert_allclose(orders(errors), 1.0, atol=0.01)


def test_coupled_joints_decay_together() -> None:
    mass = np.array([[2.0, 0.7, 0.1], [0.7, 1.0, -0.2], [0.1, -0.2, 0.5]])
    viscous, v0 = np.array([1.0, 3.0, 0.4]), np.array([1.0, -2.0, 0.5])
    exact = expm(-np.linalg.solve(mass, np.diag(viscous)) * 0.3) @ v0
    errors = []
    for h in (4e-4, 2e-4, 1e-4):
        material = made_of(3)._replace(viscous=viscous)
        found = advance(free(mass), material, moving(*v0), h, round(0.3 / h)).motion.velocity
        errors.append(float(np.linalg.norm(found - exact)))
    assert errors[-1] < 2e-4
    np.testing.assert_allclose(orders(errors), 1.0, atol=0.01)


def test_without_friction_the_equations_of_motion_are_left() -> None:
    mass = np.array([[2.0, 0.7], [0.7, 1.0]])
    u = np.array([0.3, -0.8])
    done = advance(free(mass, u), made_of(2), at_rest(2), H, 1000)
    acceleration = np.linalg.solve(mass, u)
    np.testing.assert_allclose(done.motion.velocity, 0.1 * acceleration, rtol=1e-9)
    distance = H**2 * 1000 * 1001 / 2
    np.testing.assert_allclose(done.displacement, distance * acceleration, rtol=1e-9)
    assert done.dissipated == 0.0


def test_one_joint_sticks_while_the_other_moves() -> None:
    mass = np.array([[2.0, 0.5], [0.5, 1.0]])
    material = made_of(2)._replace(coulomb=np.array([10.0, 0.1]))
    done = advance(free(mass, [0.0, 3.0]), material, at_rest(2), H, 1000)
    assert done.motion.velocity[0] == done.displacement[0] == 0.0
    assert done.motion.velocity[1] == pytest.approx(0.1 * 2.9 / 1.0, rel=1e-9)
    # The held joint carries what the other's acceleration asks of it.
    assert done.dry_friction[0] == pytest.approx(0.5 * 2.9, rel=1e-6)
    np.testing.assert_array_equal(done.motion.stuck, [1, 0])


# --- Contact ------------------------------------------------------------------------------------


def test_undamped_bounce_is_half_a_sine() -> None:
    mass, stiffness, speed = 2.0, 1e4, 0.3
    frequency = math.sqrt(stiffness / mass)
    errors = []
    for h in (8e-5, 4e-5, 2e-5, 1e-5):
        wall = made_of(3, stiffness=stiffness)
        done = advance(
            block(mass, (0.0, 0.0, 0.0), 0.0),
            wall,
            moving(0.0, 0.0, -speed),
            h,
            round(1.1 * math.pi / frequency / h),
        )
        assert done.impact_speed == pytest.approx(speed, rel=1e-12)
        assert done.gap > 0
        np.testing.assert_array_equal(done.force, np.zeros(3))
        peak, rebound = done.peak_force, done.motion.velocity[2]
        errors.append([speed * math.sqrt(stiffness * mass) - peak, speed - rebound])
    assert errors[-1][0] < 1e-3 * speed * math.sqrt(stiffness * mass)
    assert errors[-1][1] < 2e-3 * speed
    for column in zip(*errors, strict=True):
        np.testing.assert_allclose(orders(list(column)), 1.0, atol=0.05)


@pytest.mark.parametrize(("stiffness", "damping"), [(1e4, 20.0), (3e4, 150.0)])
def test_damped_bounce(stiffness: float, damping: float) -> None:
    mass, speed, start, duration = 2.24, 0.33, 5e-3, 0.08

    def push(gap: float, rate: float) -> float:
        return max(0.0, -stiffness * gap - damping * rate)

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
        done = advance(
            block(mass, (0.0, 0.0, 0.0), start),
            made_of(3, stiffness=stiffness, damping=damping),
            moving(0.0, 0.0, -speed),
            h,
            round(duration / h),
        )
        rebound = done.motion.velocity[2]
        errors.append([peak - done.peak_force, exact.y[1, -1] - rebound])
        lost = mass * (speed**2 - rebound**2) / 2
        assert (1 - 800 * h) * lost < done.dissipated <= lost
    np.testing.assert_allclose(errors[-1], 0.0, atol=5e-3 * peak)
    for column in zip(*errors, strict=True):
        np.testing.assert_allclose(orders(list(column)), 1.0, atol=0.15)


def test_weight_rests_on_the_spring() -> None:
    pressed = block(1.5, (0.0, 0.0, -15.0), 0.0)
    done = advance(
        pressed, made_of(3, stiffness=5e3, damping=100.0), moving(0.0, 0.0, 0.0), H, 10_000
    )
    np.testing.assert_allclose(done.force, [0, 0, 15.0], rtol=1e-9, atol=1e-12)
    assert done.gap == pytest.approx(-15.0 / 5e3, rel=1e-9)
    assert abs(done.approach_speed) < 1e-10
    assert done.displacement[2] == pytest.approx(-3e-3, rel=1e-9)


def test_surface_does_not_pull() -> None:
    # Torn off faster than the damper lets the spring follow.
    done = advance(
        block(1.0, (0.0, 0.0, 0.0), -1e-3),
        made_of(3, damping=100.0),
        moving(0.0, 0.0, 1.0),
        H,
        1,
    )
    np.testing.assert_array_equal(done.force, np.zeros(3))
    assert done.motion.velocity[2] == 1.0
    assert (done.peak_force, done.impact_speed) == (0.0, 0.0)


def test_impact_speed_is_of_contact_made_in_these_steps() -> None:
    table = made_of(3, damping=20.0)
    falling = moving(0.0, 0.0, -0.4)
    first = advance(block(1.0, (0.0, 0.0, 0.0), 2e-3), table, falling, H, 20)
    assert first.impact_speed == 0.0 or first.force[2] > 0
    landed = advance(block(1.0, (0.0, 0.0, 0.0), 2e-3), table, falling, H, 60)
    assert landed.impact_speed == pytest.approx(0.4, rel=1e-12)
    # In contact already, nothing new is made.
    still = advance(block(1.0, (0.0, 0.0, -9.0), landed.gap), table, landed.motion, H, 5)
    assert still.force[2] > 0
    assert still.impact_speed == 0.0


# --- Friction of the surface --------------------------------------------------------------------

ANGLES = [0.0, 0.3, math.pi / 4, 2.0, -math.pi / 4, -3.0]
MASS, WEIGHT, MU = 2.0, 20.0, 0.4
TABLE = made_of(3, damping=200.0, mu=MU)


def sliding_block(force: float, angle: float) -> Frozen:
    """A block in vertical balance on the table, pushed along it."""
    return block(MASS, (force * math.cos(angle), force * math.sin(angle), -WEIGHT), -WEIGHT / 1e4)


@pytest.mark.parametrize("angle", ANGLES)
def test_sliding_block_is_slowed_by_mu_n(angle: float) -> None:
    way = np.array([math.cos(angle), math.sin(angle), 0.0])
    done = advance(sliding_block(0.0, angle), TABLE, moving(*(1.0 * way)), H, 1000)
    np.testing.assert_allclose(
        done.motion.velocity, (1.0 - 0.1 * MU * WEIGHT / MASS) * way, rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(done.force, WEIGHT * UP - MU * WEIGHT * way, rtol=0, atol=1e-6)
    assert done.slip_speed == pytest.approx(0.6, abs=1e-9)
    lost = MASS * (1.0 - 0.6**2) / 2
    assert done.dissipated == pytest.approx(lost, rel=1e-3)


@pytest.mark.parametrize("angle", ANGLES)
def test_sliding_block_stops(angle: float) -> None:
    way = np.array([math.cos(angle), math.sin(angle), 0.0])
    done = advance(sliding_block(0.0, angle), TABLE, moving(*(0.5 * way)), H, 5000)
    np.testing.assert_allclose(done.motion.velocity, 0.0, rtol=0, atol=1e-12)
    exact = MASS * 0.5**2 / (2 * MU * WEIGHT)
    assert done.displacement @ way == pytest.approx(exact - 0.5 * H / 2, abs=1e-8)


@pytest.mark.parametrize("angle", ANGLES)
def test_block_sticks_below_mu_n_and_slides_above(angle: float) -> None:
    way = np.array([math.cos(angle), math.sin(angle), 0.0])
    still = moving(0.0, 0.0, 0.0)
    below = advance(sliding_block(0.99 * MU * WEIGHT, angle), TABLE, still, H, 2000)
    np.testing.assert_allclose(below.displacement, 0.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        below.force, WEIGHT * UP - 0.99 * MU * WEIGHT * way, rtol=0, atol=1e-7
    )
    above = advance(sliding_block(1.5 * MU * WEIGHT, angle), TABLE, still, H, 2000)
    speed = 0.2 * 0.5 * MU * WEIGHT / MASS
    np.testing.assert_allclose(above.motion.velocity, speed * way, rtol=0, atol=1e-8)


@pytest.mark.parametrize("angle", ANGLES)
def test_a_carriage_sticks_whatever_its_direction(angle: float) -> None:
    # One joint along the table: its two tangents see the same motion.
    way = np.array([[math.cos(angle)], [math.sin(angle)], [0.0]])
    rail = Frozen(np.eye(1), np.array([3.0]), way, -1e-3, UP)
    table = made_of(1, mu=1.0)
    held = advance(rail, table, moving(0.0), H, 200)
    np.testing.assert_allclose(held.displacement, 0.0, atol=1e-14)
    np.testing.assert_allclose(held.force, 10 * UP - 3 * way[:, 0], rtol=0, atol=1e-9)
    slowed = advance(rail, table, moving(0.1), H, 1000)
    assert slowed.motion.velocity[0] == pytest.approx(0.0, abs=1e-12)
    assert slowed.displacement[0] == pytest.approx(0.1**2 / (2 * 7.0), rel=0.01)
    assert slowed.dissipated == pytest.approx((10 - 3 + 3) * slowed.displacement[0], rel=0.01)


def test_surface_without_friction_does_not_hold() -> None:
    done = advance(
        sliding_block(5.0, 0.7), made_of(3, damping=200.0), moving(0.0, 0.0, 0.0), H, 100
    )
    assert math.hypot(*done.motion.velocity[:2]) == pytest.approx(0.01 * 5.0 / MASS, rel=1e-9)
    np.testing.assert_allclose(done.force[:2], 0.0, atol=1e-15)


# --- The conditions, on random arms -------------------------------------------------------------


class Case(NamedTuple):
    frozen: Frozen
    material: Material
    motion: Motion


def random_case(seed: int, *, driven: bool = True) -> Case:
    """An arm of 1 to 4 joints near a surface, with every kind of friction; some joints at rest."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))

    def conditioned(rows: int, least: float) -> np.ndarray:
        u, _, vt = np.linalg.svd(rng.normal(size=(rows, n)), full_matrices=False)
        return u @ np.diag(rng.uniform(least, 1.0, len(vt))) @ vt

    root = conditioned(n, 0.5)
    normal = rng.normal(size=3)
    normal /= np.linalg.norm(normal)
    jacobian = conditioned(3, 0.4)
    if n == 2:  # a planar arm on a surface at right angles to its plane
        plane, _ = np.linalg.qr(rng.normal(size=(3, 2)))
        jacobian = plane @ conditioned(2, 0.4)
        normal = plane @ [math.cos(1.0), math.sin(1.0)]
    stuck = rng.integers(0, 2, n).astype(float)
    return Case(
        Frozen(
            10 ** rng.uniform(-1, 1) * root @ root.T,
            rng.normal(size=n) * 5 * driven,
            jacobian,
            rng.uniform(-1e-3, 1e-4),
            normal,
        ),
        Material(
            rng.uniform(0, 2, n),
            rng.uniform(1, 2),
            0.02,
            rng.uniform(0, 2, n),
            10 ** rng.uniform(3, 4.5),
            10 ** rng.uniform(0, 2),
            rng.uniform(0, 1),
        ),
        Motion(
            np.where(stuck, 0.0, rng.normal(size=n) * 10 ** rng.uniform(-3, 0)),
            stuck,
            rng.normal(size=n) * 1e-5,
            rng.normal(size=3) * 1e-5,
        ),
    )


def check_conditions(case: Case, done: Moved) -> None:
    frozen, material, motion = case
    mass, force, J, gap, normal = frozen
    v, p_joint, p = done.motion.velocity, done.motion.joint_impulse, done.motion.impulse
    speeds = 1e-3 + np.linalg.norm(motion.velocity)
    # Equations of motion.
    left = (mass + H * np.diag(material.viscous)) @ v
    right = mass @ motion.velocity + H * force + p_joint + J.T @ p
    np.testing.assert_allclose(left, right, rtol=0, atol=1e-6 * speeds * np.linalg.norm(mass))
    # Joints: held within the bound, else the bound against the motion.
    fading = np.where(motion.stuck, 1.0, np.exp(-((motion.velocity / material.stribeck) ** 2)))
    bounds = H * material.coulomb * (1 + (material.breakaway - 1) * fading)
    for speed, impulse, bound, stuck in zip(v, p_joint, bounds, done.motion.stuck, strict=True):
        if abs(impulse) < bound:
            assert speed == 0.0
            assert stuck == 1.0
        else:
            assert abs(impulse) == pytest.approx(bound, rel=1e-12)
            assert impulse * speed <= 1e-7 * bound * speeds
            assert stuck == 0.0
    # Contact: the spring and damper, pushing only.
    p_n, v_n = normal @ p, normal @ J @ v
    after = gap + H * v_n
    pushed = H * max(0.0, -material.stiffness * after - material.damping * v_n)
    assert p_n == pytest.approx(
        pushed, rel=1e-7, abs=1e-7 * H * (H * material.stiffness + material.damping) * speeds
    )
    # The surface's friction: within the cone, sticking inside it, against the slip on it.
    p_t, v_t = p - p_n * normal, J @ v - v_n * normal
    held, slip = float(np.linalg.norm(p_t)), float(np.linalg.norm(v_t))
    bound = material.mu * p_n
    assert held <= bound * (1 + 1e-12) + 1e-18
    if held < bound * (1 - 1e-9):
        assert slip < 1e-6 * speeds
    else:
        assert p_t @ v_t == pytest.approx(-held * slip, abs=1e-6 * held * speeds)
    # What is reported.
    np.testing.assert_allclose(done.displacement, H * v, rtol=1e-12)
    np.testing.assert_allclose(done.force, p / H, rtol=1e-12)
    np.testing.assert_allclose(done.dry_friction, p_joint / H, rtol=1e-12)
    assert done.gap == pytest.approx(after, abs=1e-15)
    assert done.approach_speed == pytest.approx(-v_n, abs=1e-12)
    assert done.slip_speed == pytest.approx(slip, abs=1e-12)
    assert done.peak_force == pytest.approx(p_n / H, abs=1e-9)


@given(seed=seeds)
def test_one_step_satisfies_its_conditions(seed: int) -> None:
    case = random_case(seed)
    check_conditions(case, advance(*case, H, 1))


@given(seed=seeds)
def test_solution_does_not_depend_on_where_it_starts(seed: int) -> None:
    case = random_case(seed)
    n = len(case.frozen.force)
    cold = case.motion._replace(joint_impulse=np.zeros(n), impulse=np.zeros(3))
    warm, cool = advance(*case, H, 1), advance(*case[:2], cold, H, 1)
    scale = 1e-3 + np.linalg.norm(case.motion.velocity)
    np.testing.assert_allclose(
        warm.motion.velocity, cool.motion.velocity, rtol=0, atol=1e-5 * scale
    )
    # Where joints and tip all stick the share of each is open, but not the surface's push.
    pushes = [case.frozen.normal @ done.force for done in (warm, cool)]
    assert pushes[0] == pytest.approx(pushes[1], rel=1e-4, abs=1e-4)


def energy(case: Case, velocity: np.ndarray, gap: float) -> float:
    kinetic = velocity @ case.frozen.mass @ velocity / 2
    return float(kinetic + case.material.stiffness * min(gap, 0.0) ** 2 / 2)


@given(seed=seeds)
def test_friction_and_contact_only_take_energy(seed: int) -> None:
    case = random_case(seed, driven=False)
    frozen, motion = case.frozen, case.motion
    before = start = energy(case, motion.velocity, frozen.gap)
    tolerance = 1e-9 * start + 1e-15
    for _ in range(40):
        done = advance(frozen, case.material, motion, H, 1)
        after = energy(case, done.motion.velocity, done.gap)
        assert after <= before + tolerance
        assert -tolerance <= done.dissipated <= before - after + tolerance
        frozen, motion, before = frozen._replace(gap=done.gap), done.motion, after


@pytest.mark.parametrize("seed", range(5))
def test_all_that_is_lost_is_dissipated_as_steps_shrink(seed: int) -> None:
    case = random_case(seed, driven=False)
    motion = case.motion._replace(joint_impulse=np.zeros_like(case.motion.stuck))
    motion = motion._replace(impulse=np.zeros(3), velocity=motion.velocity + 0.1)
    missing = []
    for h in (4e-5, 1e-5):
        done = advance(case.frozen, case.material, motion, h, round(4e-3 / h))
        lost = energy(case, motion.velocity, case.frozen.gap)
        lost -= energy(case, done.motion.velocity, done.gap)
        missing.append(lost - done.dissipated)
    assert 0 <= missing[1] < 0.05 * lost
    assert missing[1] == pytest.approx(missing[0] / 4, rel=0.3)


@given(seed=seeds)
def test_steps_together_and_one_by_one(seed: int) -> None:
    case = random_case(seed)
    frozen, motion = case.frozen, case.motion
    together = advance(*case, H, 12)
    displacement, peak, dissipated = 0.0, 0.0, 0.0
    for _ in range(12):
        done = advance(frozen, case.material, motion, H, 1)
        displacement = displacement + done.displacement
        peak, dissipated = max(peak, done.peak_force), dissipated + done.dissipated
        frozen, motion = frozen._replace(gap=done.gap), done.motion
    np.testing.assert_allclose(together.motion.velocity, motion.velocity, rtol=0, atol=1e-7)
    np.testing.assert_allclose(together.displacement, displacement, rtol=0, atol=1e-9)
    np.testing.assert_allclose(together.force, done.force, rtol=1e-5, atol=1e-4)
    assert together.peak_force == pytest.approx(peak, rel=1e-5, abs=1e-4)
    assert together.dissipated == pytest.approx(dissipated, rel=1e-5, abs=1e-9)
    assert together.gap == pytest.approx(frozen.gap, abs=1e-9)


def test_inputs_are_left_alone() -> None:
    case = random_case(7)
    copies = [np.copy(value) for value in (*case.frozen, *case.material, *case.motion)]
    advance(*case, H, 10)
    for value, copy in zip((*case.frozen, *case.material, *case.motion), copies, strict=True):
        np.testing.assert_array_equal(value, copy)


def test_same_bytes_every_time() -> None:
    case = random_case(11)
    first, second = advance(*case, H, 100), advance(*case, H, 100)
    assert first.motion.velocity.tobytes() == second.motion.velocity.tobytes()
    assert first.force.tobytes() == second.force.tobytes()
    assert first[4:] == second[4:]
