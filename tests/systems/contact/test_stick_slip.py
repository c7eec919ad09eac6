"""Sticking friction and contact against closed forms and scipy."""

import math
from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import solve_ivp
from scipy.linalg import expm

from chamfer.models.arms.arm import JointFrictionParams
from chamfer.systems.contact.stick_slip import Held, Material, Motion

H = 1e-4  # s
FAR = 1e3  # m, a gap that is never closed
UP = np.array([0.0, 0.0, 1.0])


def held(mass: Any, force: Any, jacobian: Any, gap: float, mu: float = 0.0) -> Held:
    none = np.zeros((3, 3))
    one = np.array
    return Held(
        mass, force, one([jacobian]), one([gap]), one([UP]), one([mu]), True, none, none, none[0]
    )


def free(mass: object, force: object = 0.0) -> Held:
    """An arm far away from any surface."""
    matrix = np.atleast_2d(np.array(mass, dtype=float))
    n = len(matrix)
    u = np.broadcast_to(np.array(force, dtype=float), (n,)).copy()
    return held(matrix, u, np.zeros((3, n)), FAR)


def block(mass: float, force: tuple[float, float, float], gap: float, mu: float = 0.0) -> Held:
    """A point mass above a table."""
    return held(mass * np.eye(3), np.array(force), np.eye(3), gap, mu)


def made_of(
    n: int,
    *,
    coulomb: float = 0.0,
    breakaway: float = 1.0,
    viscous: float = 0.0,
    stiffness: float = 1e4,
    damping: float = 0.0,
) -> Material:
    spring, damper = np.array([stiffness]), np.array([damping])
    return Material(np.full(n, coulomb), breakaway, 0.02, np.full(n, viscous), spring, damper)


def moving(*velocity: float) -> Motion:
    v = np.array(velocity)
    return Motion(v, np.zeros(len(v)), np.zeros(len(v)), np.zeros((1, 3)))


def at_rest(n: int) -> Motion:
    return moving(*[0.0] * n)._replace(stuck=np.ones(n))


def orders(errors: list[float]) -> list[float]:
    """Return by which powers of two the errors shrink."""
    return [math.log2(first / second) for first, second in pairwise(errors)]


# --- Joints -------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_held_below_breakaway_stays_exactly_at_rest(take_steps: Any, sign: float) -> None:
    rough = made_of(1, coulomb=2.0, breakaway=1.5)
    done = take_steps(free(0.3, 2.999 * sign), rough, at_rest(1), H, 20_000)
    assert done.motion.velocity[0] == 0.0
    assert done.displacement[0] == 0.0
    assert done.dissipated == 0.0
    assert done.motion.stuck[0] == 1.0
    assert done.dry_friction[0] == pytest.approx(-2.999 * sign, rel=1e-12)


@pytest.mark.parametrize("sign", [-1.0, 1.0])
def test_above_breakaway_it_moves(take_steps: Any, sign: float) -> None:
    rough = made_of(1, coulomb=2.0, breakaway=1.5)
    done = take_steps(free(0.3, 3.001 * sign), rough, at_rest(1), H, 1)
    assert done.motion.velocity[0] == pytest.approx(sign * H * 0.001 / 0.3, rel=1e-9)
    assert done.motion.stuck[0] == 0.0
    # Once it moves the friction falls off: it runs away.
    done = take_steps(free(0.3, 3.001 * sign), rough, at_rest(1), H, 20_000)
    assert sign * done.motion.velocity[0] > 4.0
    assert done.dry_friction[0] == pytest.approx(-2.0 * sign, rel=1e-12)


def test_between_coulomb_and_breakaway_both_rest_and_motion_go_on(take_steps: Any) -> None:
    rough, pulled = made_of(1, coulomb=2.0, breakaway=1.5), free(0.5, 2.5)
    assert take_steps(pulled, rough, at_rest(1), H, 1000).motion.velocity[0] == 0.0
    gone = take_steps(pulled, rough, moving(1.0), H, 1000)
    assert gone.motion.velocity[0] == pytest.approx(1.0 + 0.1 * (2.5 - 2.0) / 0.5, rel=1e-12)


@pytest.mark.parametrize("speed", [-0.05, -0.01, 0.003, 0.02, 0.5])
def test_moving_friction_is_the_law_of_the_model(take_steps: Any, speed: float) -> None:
    law = JointFrictionParams(coulomb=(2.0,), breakaway=1.5, stribeck=0.02, viscous=(0.0,))
    done = take_steps(free(10.0), made_of(1, coulomb=2.0, breakaway=1.5), moving(speed), H, 1)
    expected = -math.copysign(law.dry(np.array([speed]))[0], speed)
    assert done.dry_friction[0] == pytest.approx(expected, rel=1e-12)
    assert done.motion.velocity[0] == pytest.approx(speed + H * expected / 10.0, rel=1e-12)


def test_resting_joint_is_held_by_breakaway_whatever_its_last_velocity(take_steps: Any) -> None:
    rough = made_of(1, coulomb=2.0, breakaway=1.5)
    # Moving fast into a stop: Coulomb friction stops it, breakaway then holds it.
    stopped = take_steps(free(1.0), rough, moving(1.9e-4), H, 1)
    assert stopped.motion.velocity[0] == 0.0
    held = take_steps(free(1.0, 2.9), rough, stopped.motion, H, 100)
    assert held.displacement[0] == 0.0


def test_stopping_distance(take_steps: Any) -> None:
    mass, coulomb, v0 = 0.7, 2.1, 0.6
    exact = mass * v0**2 / (2 * coulomb)
    for h in (4e-4, 3.7e-4, 1e-4):
        done = take_steps(free(mass), made_of(1, coulomb=coulomb), moving(v0), h, round(0.4 / h))
        assert done.motion.velocity[0] == 0.0
        # Exact but in the last step, in which it stops before the end.
        assert done.displacement[0] == pytest.approx(exact, abs=coulomb * h**2 / mass / 4)
        assert done.dissipated == pytest.approx(mass * v0**2 / 2, rel=1e-9)


def test_viscous_decay(take_steps: Any) -> None:
    mass, viscous, v0, duration = 0.5, 2.0, 3.0, 0.4
    exact = v0 * math.exp(-viscous * duration / mass)
    errors = []
    for h in (4e-3, 2e-3, 1e-3):
        count = round(duration / h)
        done = take_steps(free(mass), made_of(1, viscous=viscous), moving(v0), h, count)
        found, half = done.motion.velocity[0], h * viscous / mass / 2
        assert found == pytest.approx(v0 * ((1 - half) / (1 + half)) ** count, rel=1e-9)
        errors.append(exact - found)
        assert done.dissipated == pytest.approx(mass * (v0**2 - found**2) / 2, rel=1e-9)
    np.testing.assert_allclose(orders(errors), 2.0, atol=0.01)


def test_coupled_joints_decay_together(take_steps: Any) -> None:
    mass = np.array([[2.0, 0.7, 0.1], [0.7, 1.0, -0.2], [0.1, -0.2, 0.5]])
    viscous, v0 = np.array([1.0, 3.0, 0.4]), np.array([1.0, -2.0, 0.5])
    exact = expm(-np.linalg.solve(mass, np.diag(viscous)) * 0.3) @ v0
    errors = []
    for h in (4e-3, 2e-3, 1e-3):
        material = made_of(3)._replace(viscous=viscous)
        found = take_steps(free(mass), material, moving(*v0), h, round(0.3 / h)).motion.velocity
        errors.append(float(np.linalg.norm(found - exact)))
    assert errors[-1] < 1e-5
    np.testing.assert_allclose(orders(errors), 2.0, atol=0.01)


def test_without_friction_the_equations_of_motion_are_left(take_steps: Any) -> None:
    mass = np.array([[2.0, 0.7], [0.7, 1.0]])
    u = np.array([0.3, -0.8])
    done = take_steps(free(mass, u), made_of(2), at_rest(2), H, 1000)
    acceleration = np.linalg.solve(mass, u)
    np.testing.assert_allclose(done.motion.velocity, 0.1 * acceleration, rtol=1e-9)
    np.testing.assert_allclose(done.displacement, 0.1**2 / 2 * acceleration, rtol=1e-9)
    assert done.dissipated == 0.0


def test_one_joint_sticks_while_the_other_moves(take_steps: Any) -> None:
    mass = np.array([[2.0, 0.5], [0.5, 1.0]])
    material = made_of(2)._replace(coulomb=np.array([10.0, 0.1]))
    done = take_steps(free(mass, [0.0, 3.0]), material, at_rest(2), H, 1000)
    assert done.motion.velocity[0] == done.displacement[0] == 0.0
    assert done.motion.velocity[1] == pytest.approx(0.1 * 2.9 / 1.0, rel=1e-9)
    # The held joint carries what the other's acceleration asks of it.
    assert done.dry_friction[0] == pytest.approx(0.5 * 2.9, rel=1e-6)
    np.testing.assert_array_equal(done.motion.stuck, [1, 0])


# --- Contact ------------------------------------------------------------------------------------


@pytest.mark.parametrize("start", [0.0, 1.7e-5])  # m, so that it touches in a step
def test_undamped_bounce_is_half_a_sine(take_steps: Any, start: float) -> None:
    mass, stiffness, speed = 2.0, 1e4, 0.3
    frequency = math.sqrt(stiffness / mass)
    errors = []
    for h in (4e-4, 2e-4, 1e-4):
        wall = made_of(3, stiffness=stiffness)
        count = round(1.1 * math.pi / frequency / h)
        falling = moving(0.0, 0.0, -speed)
        done = take_steps(block(mass, (0.0, 0.0, 0.0), start), wall, falling, h, count)
        assert done.impact_speed == pytest.approx(speed, rel=1e-12)
        assert done.gap > 0
        np.testing.assert_array_equal(done.force, np.zeros(3))
        assert done.motion.velocity[2] == pytest.approx(speed, rel=1e-12)
        assert abs(done.dissipated) < 1e-15
        errors.append(speed * math.sqrt(stiffness * mass) - done.peak_force)
    assert np.abs(errors[-1]) < 1e-4 * speed * math.sqrt(stiffness * mass)


@pytest.mark.parametrize(("stiffness", "damping"), [(1e4, 20.0), (3e4, 150.0)])
def test_damped_bounce(take_steps: Any, stiffness: float, damping: float) -> None:
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


@given(
    start=st.floats(1e-6, 5e-3),
    speed=st.floats(0.01, 3.0),
    stiffness=st.floats(3.0, 8.0),
    damping=st.floats(0.0, 4.0),
)
def test_no_force_across_a_gap(
    take_steps: Any, start: float, speed: float, stiffness: float, damping: float
) -> None:
    wall = made_of(3, stiffness=10**stiffness, damping=10**damping)
    falling = moving(0.0, 0.0, -speed)
    for count in range(1, 4):
        done = take_steps(block(2.0, (0.0, 0.0, 0.0), start), wall, falling, H, count)
        left = start - count * H * speed
        if abs(left) < 1e-12:  # rounding decides whether it touches
            break
        if left > 0:
            assert done.gap == pytest.approx(left, abs=1e-12)
            np.testing.assert_array_equal(done.force, np.zeros(3))
        else:  # at most what just closes the gap
            assert done.force[2] > 0.0
            assert done.gap <= 0.0 or done.motion.velocity[2] > 0.0
            break


def test_weight_rests_on_the_spring(take_steps: Any) -> None:
    pressed = block(1.5, (0.0, 0.0, -15.0), 0.0)
    done = take_steps(
        pressed, made_of(3, stiffness=5e3, damping=100.0), moving(0.0, 0.0, 0.0), H, 10_000
    )
    np.testing.assert_allclose(done.force, [0, 0, 15.0], rtol=1e-9, atol=1e-12)
    assert done.gap == pytest.approx(-15.0 / 5e3, rel=1e-9)
    assert abs(done.approach_speed) < 1e-10
    assert done.displacement[2] == pytest.approx(-3e-3, rel=1e-9)


def test_surface_does_not_pull(take_steps: Any) -> None:
    # Torn off faster than the damper lets the spring follow.
    done = take_steps(
        block(1.0, (0.0, 0.0, 0.0), -1e-3),
        made_of(3, damping=100.0),
        moving(0.0, 0.0, 1.0),
        H,
        1,
    )
    np.testing.assert_array_equal(done.force, np.zeros(3))
    assert done.motion.velocity[2] == 1.0
    assert (done.peak_force, done.impact_speed) == (0.0, 0.0)


def test_impact_speed_is_of_contact_made_in_these_steps(take_steps: Any) -> None:
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


# --- Friction of the surface --------------------------------------------------------------------

ANGLES = [0.0, 0.3, math.pi / 4, 2.0, -math.pi / 4, -3.0]
MASS, WEIGHT, MU = 2.0, 20.0, 0.4
TABLE = made_of(3, damping=200.0)


def sliding_block(force: float, angle: float, mu: float = MU) -> Held:
    """A block in vertical balance on the table, pushed along it."""
    pushed = (force * math.cos(angle), force * math.sin(angle), -WEIGHT)
    return block(MASS, pushed, -WEIGHT / 1e4, mu)


@pytest.mark.parametrize("angle", ANGLES)
def test_sliding_block_is_slowed_by_mu_n(take_steps: Any, angle: float) -> None:
    way = np.array([math.cos(angle), math.sin(angle), 0.0])
    done = take_steps(sliding_block(0.0, angle), TABLE, moving(*(1.0 * way)), H, 1000)
    np.testing.assert_allclose(
        done.motion.velocity, (1.0 - 0.1 * MU * WEIGHT / MASS) * way, rtol=0, atol=1e-9
    )
    np.testing.assert_allclose(done.force, WEIGHT * UP - MU * WEIGHT * way, rtol=0, atol=1e-6)
    assert done.slip_speed == pytest.approx(0.6, abs=1e-9)
    lost = MASS * (1.0 - 0.6**2) / 2
    assert done.dissipated == pytest.approx(lost, rel=1e-9)


@pytest.mark.parametrize("angle", ANGLES)
def test_sliding_block_stops(take_steps: Any, angle: float) -> None:
    way = np.array([math.cos(angle), math.sin(angle), 0.0])
    done = take_steps(sliding_block(0.0, angle), TABLE, moving(*(0.5 * way)), H, 5000)
    np.testing.assert_allclose(done.motion.velocity, 0.0, rtol=0, atol=1e-12)
    exact = MASS * 0.5**2 / (2 * MU * WEIGHT)
    assert done.displacement @ way == pytest.approx(exact, abs=1e-8)


@pytest.mark.parametrize("angle", ANGLES)
def test_block_sticks_below_mu_n_and_slides_above(take_steps: Any, angle: float) -> None:
    way = np.array([math.cos(angle), math.sin(angle), 0.0])
    still = moving(0.0, 0.0, 0.0)
    below = take_steps(sliding_block(0.99 * MU * WEIGHT, angle), TABLE, still, H, 2000)
    np.testing.assert_allclose(below.displacement, 0.0, rtol=0, atol=1e-12)
    np.testing.assert_allclose(
        below.force, WEIGHT * UP - 0.99 * MU * WEIGHT * way, rtol=0, atol=1e-7
    )
    above = take_steps(sliding_block(1.5 * MU * WEIGHT, angle), TABLE, still, H, 2000)
    speed = 0.2 * 0.5 * MU * WEIGHT / MASS
    np.testing.assert_allclose(above.motion.velocity, speed * way, rtol=0, atol=1e-8)


@pytest.mark.parametrize("angle", ANGLES)
def test_a_carriage_sticks_whatever_its_direction(take_steps: Any, angle: float) -> None:
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


def test_surface_without_friction_does_not_hold(take_steps: Any) -> None:
    done = take_steps(
        sliding_block(5.0, 0.7, mu=0.0), made_of(3, damping=200.0), moving(0.0, 0.0, 0.0), H, 100
    )
    assert math.hypot(*done.motion.velocity[:2]) == pytest.approx(0.01 * 5.0 / MASS, rel=1e-9)
    np.testing.assert_allclose(done.force[:2], 0.0, atol=1e-15)
