"""The sliding contact in the plane against closed forms and other solvers."""

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq

from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.graphs import Parabola, Wave
from chamfer.models.surfaces.rounds import Circle
from chamfer.models.surfaces.surface import Surface
from chamfer.systems.contact.sliding_contact import FREE, SLIP, STICK, Touch, advance

Motion = Callable[[float], tuple[Sequence[float], Sequence[float]]]

THESIS = Parabola()
ROUGH = SurfaceFriction()
SOFT = 100 * np.eye(2)
FLAT = Parabola(coefficient=0.0)


@dataclass(frozen=True)
class Case:
    surface: Surface
    friction: SurfaceFriction
    stiffness: np.ndarray

    def follow(
        self, motion: Motion, times: Sequence[float], previous: Touch | None = None
    ) -> list[Touch]:
        touches = []
        for time in times:
            position, velocity = map(np.array, motion(time))
            previous = advance(
                self.surface,
                self.friction,
                self.stiffness,
                previous,
                position.astype(float),
                velocity.astype(float),
            )
            touches.append(previous)
        return touches


def thesis_motion(t: float) -> tuple[Sequence[float], Sequence[float]]:
    """Return (5-4)."""
    return ((0.2 * t, -0.1), (0.2, 0.0)) if t < 15 else ((3.0, -0.1), (0.0, 0.0))


THESIS_CASE = Case(THESIS, ROUGH, SOFT)


# The thesis' simulation (section 5.2)


@pytest.mark.parametrize("step", [0.05, 0.001])
def test_breakaway_of_the_thesis(step: float) -> None:
    times = [i * step for i in range(round(1 / step) + 1)]
    touches = THESIS_CASE.follow(thesis_motion, times)
    for time, touch in zip(times, touches, strict=True):
        # The tangential spring force 100 * 0.2 t is below mu N = 100 * 0.1 until 0.5 s.
        assert touch.mode == (STICK if time < 0.5 - 1e-12 else SLIP)
        if touch.mode == STICK:
            np.testing.assert_array_equal(touch.velocity, 0)
            np.testing.assert_allclose(touch.point, 0, atol=1e-15)
            np.testing.assert_allclose(touch.force, [-20 * time, 10], rtol=1e-13)
            np.testing.assert_allclose(touch.force_rate, [-20, 0], rtol=1e-13)
    # At the instant of breakaway it slides: s = v / (1 - (1 + mu^2) N / (k R)).
    first = touches[round(0.5 / step)]
    np.testing.assert_allclose(first.point, 0, atol=1e-15)
    np.testing.assert_allclose(first.velocity, [0.2 / (1 + 2 * 10 / 100 / 10), 0], atol=1e-13)


def test_end_of_the_thesis_slide() -> None:
    touch = THESIS_CASE.follow(thesis_motion, [0.0, 0.4, *np.arange(0.5, 14.99, 0.05), 15.0])[-1]
    np.testing.assert_allclose(touch.point, [2.378, 0.283], atol=5e-4)
    np.testing.assert_allclose(touch.force, [-62.2, 38.3], atol=5e-2)
    angle = math.degrees(math.atan2(touch.normal[1], touch.normal[0]))
    assert angle == pytest.approx(103.38, abs=5e-3)
    # The nominal endpoint has stopped.
    assert touch.mode == STICK
    np.testing.assert_array_equal(touch.velocity, 0)
    np.testing.assert_array_equal(touch.force_rate, 0)


def held_x(case: Case, nominal: np.ndarray, direction: int, low: float, high: float) -> float:
    """Return x of the point where a slide towards +-x just holds, from the cone's side."""
    surface = case.surface

    def point(x: float) -> np.ndarray:
        return np.array([x, -surface.level(np.array([x, 0.0]))])

    def miss(x: float) -> float:
        p = point(x)
        a, b = surface.gradient(p)
        along, up = np.array([b, -a]) * direction, np.array([a, b])
        return float((case.stiffness @ (p - nominal)) @ (along + case.friction.at(p) * up))

    return brentq(miss, low, high, xtol=1e-15, rtol=1e-15)


@pytest.mark.parametrize("step", [0.5, 0.05, 0.01])
def test_slide_is_exact_for_any_step(step: float) -> None:
    times = np.arange(0, 14.99, step)
    for time, touch in zip(times, THESIS_CASE.follow(thesis_motion, times), strict=True):
        if time > 0.5:
            nominal = np.array(thesis_motion(time)[0])
            x = held_x(THESIS_CASE, nominal, 1, -0.1, nominal[0])
            np.testing.assert_allclose(touch.point, [x, 0.05 * x * x], atol=1e-12)


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("step", [0.04, 0.01])
def test_slide_over_waves_with_a_skew_stiffness(direction: int, step: float) -> None:
    case = Case(
        Wave(amplitude=0.01, wavelength=0.9),
        SurfaceFriction(coefficient=0.5, ripple=0.05, wavelength=0.7),
        np.array([[110.0, 25.0], [25.0, 80.0]]),
    )

    def motion(t: float) -> tuple[Sequence[float], Sequence[float]]:
        depth, rate = -0.1 - 0.01 * math.sin(t), -0.01 * math.cos(t)
        return (direction * 0.2 * t, depth), (direction * 0.2, rate)

    times = np.arange(0, 6, step)
    touches = case.follow(motion, times)
    slides = 0
    for time, touch in zip(times, touches, strict=True):
        if time < 1:
            continue

        def there(at: float) -> np.ndarray:
            nominal = np.array(motion(at)[0])
            ends = sorted((nominal[0] - 0.12 * direction, nominal[0] + 0.03 * direction))
            x = held_x(case, nominal, direction, *ends)
            return np.array([x, -case.surface.level(np.array([x, 0.0]))])

        np.testing.assert_allclose(touch.point, there(time), atol=1e-12)
        assert touch.mode == SLIP
        moved = (there(time + 1e-5) - there(time - 1e-5)) / 2e-5
        np.testing.assert_allclose(touch.velocity, moved, atol=1e-8)
        slides += 1
    assert slides > 100


def test_velocity_falls_along_the_thesis_surface() -> None:
    touches = THESIS_CASE.follow(thesis_motion, np.arange(0, 14.999, 0.02))
    speeds = [float(np.linalg.norm(touch.velocity)) for touch in touches if touch.mode == SLIP]
    assert all(b < a for a, b in itertools.pairwise(speeds))
    assert speeds[0] == pytest.approx(0.196, abs=5e-4)
    assert speeds[-1] == pytest.approx(0.1355, abs=5e-4)


# Flat surfaces: closed forms


@given(
    mu=st.floats(0, 1.5),
    depth=st.floats(0.01, 0.2),
    sink=st.floats(-0.05, 0.05),
    speed=st.floats(-0.5, 0.5),
    stiff=st.tuples(st.floats(50, 200), st.floats(-30, 30), st.floats(50, 200)),
)
def test_flat_surface(
    mu: float, depth: float, sink: float, speed: float, stiff: tuple[float, float, float]
) -> None:
    a, b, c = stiff
    case = Case(FLAT, SurfaceFriction(coefficient=mu), np.array([[a, b], [b, c]]))
    start = advance(FLAT, case.friction, case.stiffness, None, np.array([0, -depth]), np.zeros(2))
    # Landed without tangential force: a x = b * -depth.
    np.testing.assert_allclose(start.point, [-b * depth / a, 0], atol=1e-15)
    np.testing.assert_allclose(start.force, [0, (c - b * b / a) * depth], atol=1e-12)
    # To one side as far as the tip of the cone, and then as far again.
    sign = math.copysign(1.0, speed)
    far = np.array([sign * 3.0, -depth])
    touch = advance(FLAT, case.friction, case.stiffness, start, far, np.array([speed, -sink]))
    # F = K (x - far, depth) with F_x = -sign mu F_y; the normal force is positive there.
    cone = a + sign * mu * b
    x = far[0] - (b + sign * mu * c) * depth / cone
    if not cone > 1 or (b * (x - far[0]) + c * depth) < 1e-3 or sign * (x - start.point[0]) < 0:
        return
    np.testing.assert_allclose(touch.point, [x, 0], atol=1e-12)
    v = speed + (b + sign * mu * c) * -sink / cone if speed or sink else 0.0
    expected = v if sign * v > 1e-9 or mu <= 1e-9 else 0.0
    np.testing.assert_allclose(touch.velocity, [expected, 0], atol=1e-8)


def test_reversal_sticks_until_friction_has_turned_round() -> None:
    case = Case(FLAT, SurfaceFriction(coefficient=0.5), SOFT)

    def motion(t: float) -> tuple[Sequence[float], Sequence[float]]:
        return ((t, -0.1), (1, 0)) if t < 1 else ((2 - t, -0.1), (-1, 0))

    times = np.arange(0, 2.0001, 0.01)
    touches = case.follow(motion, times)
    for time, touch in zip(times, touches, strict=True):
        if 0.0501 < time < 0.999:
            expected, mode = time - 0.05, SLIP
        elif 1.001 < time < 1.0999:  # 2 mu N / k from the end
            expected, mode = 0.95, STICK
        elif time > 1.1001:
            expected, mode = 2 - time + 0.05, SLIP
        else:
            continue
        # The slide to the right may end up to one step before the turn.
        assert touch.point[0] == pytest.approx(expected, abs=1e-2 if mode == STICK else 1e-12)
        assert touch.mode == mode
        assert touch.velocity[0] == pytest.approx({SLIP: math.copysign(1, 1 - time)}.get(mode, 0))


def test_contact_is_lost_and_made_again() -> None:
    case = Case(FLAT, SurfaceFriction(coefficient=0.3), SOFT)

    def motion(t: float) -> tuple[Sequence[float], Sequence[float]]:
        return (0.2 * t, -0.05 * math.cos(t)), (0.2, 0.05 * math.sin(t))

    times = np.arange(0, 7, 0.01)
    touches = case.follow(motion, times)
    for time, touch in zip(times, touches, strict=True):
        position, velocity = motion(time)
        if position[1] >= 0:
            assert touch.mode == FREE
            np.testing.assert_array_equal(touch.point, position)
            np.testing.assert_array_equal(touch.velocity, velocity)
            for zero in (touch.force, touch.force_rate, touch.normal):
                np.testing.assert_array_equal(zero, 0)
        else:
            assert touch.mode in (STICK, SLIP)
            assert touch.force[1] == pytest.approx(-100 * position[1], abs=1e-12)
    returned = next(i for i in range(1, len(times)) if touches[i].mode and not touches[i - 1].mode)
    assert times[returned] == pytest.approx(1.5 * math.pi, abs=0.011)
    assert touches[returned].force[0] == pytest.approx(0, abs=1e-13)
    assert touches[returned].point[0] == pytest.approx(0.2 * times[returned], abs=1e-13)


@pytest.mark.parametrize("height", [0.0, 1e-300, 0.1])
def test_no_contact_above_the_surface(height: float) -> None:
    touch = advance(FLAT, ROUGH, SOFT, None, np.array([0.3, height]), np.array([0.0, -1.0]))
    assert touch.mode == FREE
    below = advance(FLAT, ROUGH, SOFT, touch, np.array([0.3, -1e-6]), np.array([0.0, -1.0]))
    assert below.mode == STICK
    np.testing.assert_allclose(below.force_rate, [0, 100], atol=1e-12)


def test_hangs_on_a_ball_until_the_pull_leaves_the_cone() -> None:
    """The nominal endpoint outside of the material still presses the tip to a round surface."""
    case = Case(Circle(centre=(0.0, -1.0), radius=1.0), SurfaceFriction(coefficient=20.0), SOFT)
    start = case.follow(lambda _: ((0.0, -0.01), (0.0, 0.0)), [0.0])[0]
    hanging = case.follow(lambda _: ((0.3, -0.04), (0.0, 0.0)), [0.0], start)[0]
    assert case.surface.level(np.array([0.3, -0.04])) > 0
    assert hanging.mode == STICK
    np.testing.assert_allclose(hanging.force, [-30, 4], atol=1e-12)
    lost = case.follow(lambda _: ((0.3, 0.01), (0.0, 0.0)), [0.0], hanging)[0]
    assert lost.mode == FREE


def test_contact_lost_in_a_bowl_is_made_on_its_other_side() -> None:
    case = Case(Circle(centre=(0.0, 1.0), radius=1.0, inside=True), ROUGH, SOFT)
    left = case.follow(lambda _: ((-1.01, 1.0), (0.0, 0.0)), [0.0])[0]
    np.testing.assert_allclose(left.point, [-1, 1], atol=1e-14)
    right = case.follow(lambda _: ((1.02, 1.0), (0.0, 0.0)), [0.0], left)[0]
    np.testing.assert_allclose(right.point, [1, 1], atol=1e-14)
    np.testing.assert_allclose(right.force, [-2, 0], atol=1e-12)


# Friction that changes on the way


@pytest.mark.parametrize("step", [0.01, 0.001])
def test_drop_of_the_friction_makes_the_point_jump(step: float) -> None:
    friction = SurfaceFriction(coefficient=1.0, jump=-0.6, jump_at=0.3, jump_width=0.002)
    case = Case(THESIS, friction, SOFT)
    times = np.arange(0, 4, step)
    touches = case.follow(thesis_motion, times)
    jumps = 0
    for i in range(1, len(times)):
        if times[i] < 0.5 + step:
            continue
        before, after = touches[i - 1].point[0], touches[i].point[0]
        # The first place ahead, on a fine grid, where the pull is inside of the cone.
        xs = before + np.arange(1, 400_000 if after - before > 0.02 else 4000) * 1e-6
        ys = 0.05 * xs**2
        slopes = 0.1 * xs
        fx, fy = 100 * (xs - 0.2 * times[i]), 100 * (ys + 0.1)
        along, up = fx + slopes * fy, fy - slopes * fx
        mu = 1.0 - 0.3 * (1 + np.tanh((xs - 0.3) / 0.002))
        held = xs[int(np.argmax(-along <= mu * up))]
        assert held - 1.1e-6 <= after <= held + 1e-9
        jumps += after - before > 0.02
    assert jumps == 1


def test_jump_at_the_instant_when_friction_just_holds() -> None:
    friction = SurfaceFriction(coefficient=1.0, jump=-0.4, jump_at=0.3, jump_width=0.002)
    start = np.array([0.3, 0.0])  # mu = 0.8 here and falls by 100/m, N mu' > k
    up, rest = np.array([0.0, 1.0]), np.zeros(2)
    before = Touch(start, rest, rest, rest, up, STICK)
    position = np.array([0.38, -0.1])
    still = advance(FLAT, friction, SOFT, before, position, rest)
    assert still.mode == STICK
    np.testing.assert_array_equal(still.point, start)
    jumped = advance(FLAT, friction, SOFT, before, position, np.array([0.2, 0.0]))
    np.testing.assert_allclose(jumped.point, [0.32, 0.0], atol=1e-8)
    assert jumped.mode == SLIP
    np.testing.assert_allclose(jumped.velocity, [0.2, 0.0], atol=1e-5)


@pytest.mark.parametrize("step", [0.3, 0.17, 0.05])
def test_the_first_of_several_places_where_friction_holds(step: float) -> None:
    friction = SurfaceFriction(coefficient=0.8, ripple=0.3, wavelength=0.1)
    case = Case(FLAT, friction, SOFT)
    times = np.arange(0, 6, step)
    touches = case.follow(lambda t: ((0.2 * t, -0.1), (0.2, 0.0)), times)
    for i in range(1, len(times)):
        before, after = touches[i - 1].point[0], touches[i].point[0]
        xs = before + np.arange(0, 300_000) * 1e-6
        held = 100 * (0.2 * times[i] - xs) <= 10 * (0.8 + 0.3 * np.sin(20 * np.pi * xs)) + 1e-9
        assert after == pytest.approx(xs[int(np.argmax(held))], abs=1.1e-6)


def test_rise_of_the_friction_sticks() -> None:
    friction = SurfaceFriction(coefficient=0.4, jump=0.6, jump_at=0.3, jump_width=1e-3)
    case = Case(FLAT, friction, SOFT)
    touches = case.follow(lambda t: ((0.2 * t, -0.1), (0.2, 0.0)), np.arange(0, 4, 0.01))
    x = np.array([touch.point[0] for touch in touches])
    assert np.all(np.diff(x) >= 0)
    # In the rise it creeps: k (v_nom - v) = N mu'(x) v.
    creeping = [t for t in touches if t.mode == SLIP and abs(t.point[0] - 0.3) < 1e-3]
    assert len(creeping) > 10
    for touch in creeping:
        rise = 0.3 / 1e-3 / math.cosh((touch.point[0] - 0.3) / 1e-3) ** 2
        assert touch.velocity[0] == pytest.approx(0.2 / (1 + 0.1 * rise), rel=1e-9)
    assert x[-1] == pytest.approx(0.2 * 3.99 - 0.1, abs=1e-9)


def test_mode_of_the_first_touch_without_friction_at_rest() -> None:
    case = Case(FLAT, replace(ROUGH, coefficient=0.0), SOFT)
    still = case.follow(lambda _: ((0.1, -0.1), (0.0, 0.0)), [0.0])[0]
    moving = case.follow(lambda _: ((0.1, -0.1), (0.3, 0.2)), [0.0])[0]
    assert (still.mode, moving.mode) == (STICK, SLIP)
    np.testing.assert_allclose(moving.velocity, [0.3, 0.0], atol=1e-14)
