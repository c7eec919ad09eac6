"""The sliding contact against closed forms, the laws it has to keep, and other solvers."""

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.framework import Context
from scipy.integrate import solve_ivp

from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.graphs import Parabola, Wave
from chamfer.models.surfaces.rounds import Circle, Sphere
from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.sliding_contact import (
    FREE,
    SLIP,
    STICK,
    SlidingContact,
    SlidingContactParams,
    Touch,
    advance,
)

Motion = Callable[[float], tuple[Sequence[float], Sequence[float]]]

THESIS = Parabola()
ROUGH = SurfaceFriction()
SOFT = 100 * np.eye(2)
FLAT = Parabola(coefficients=(0.0,))


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


def test_drop_of_the_friction_makes_the_point_jump() -> None:
    step = 0.01
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


SKEW = np.array([[120.0, 20.0, 10.0], [20.0, 90.0, -15.0], [10.0, -15.0, 100.0]])
VARIED = SurfaceFriction(coefficient=0.6, ripple=0.15, wavelength=0.8)
FLAT_SHEET = Parabola(coefficients=(0.0, 0.0))
seeds = st.integers(0, 2**32 - 1)


SURFACES: list[Surface] = [
    THESIS,
    Wave(amplitudes=(0.02,), wavelengths=(0.6,)),
    Circle(centre=(0.0, -0.6), radius=0.6),
    Circle(centre=(0.0, 0.6), radius=0.6, inside=True),
    FLAT_SHEET,
    Parabola(coefficients=(0.3, -0.2)),
    Wave(amplitudes=(0.01, 0.015), wavelengths=(0.6, 0.5)),
    Sphere(centre=(0.0, 0.0, -0.6), radius=0.6),
    Sphere(centre=(0.0, 0.0, 0.6), radius=0.6, inside=True),
]
NAMES = [f"{type(s).__name__}{i}" for i, s in enumerate(SURFACES)]
FRICTIONS = [
    SurfaceFriction(coefficient=0.0),
    SurfaceFriction(coefficient=1e-7),
    SurfaceFriction(coefficient=0.02),
    SurfaceFriction(coefficient=0.3, ripple=0.1, wavelength=0.3),
    SurfaceFriction(coefficient=1.0, jump=-0.7, jump_at=0.02, jump_width=0.005),
]


def random_motion(seed: int, d: int) -> Motion:
    """Return a smooth motion near the origin, mostly below 0 in the last coordinate."""
    rng = np.random.default_rng(seed)
    size, speed, phase = rng.uniform(0, 1, (3, d)) * np.array([[0.15], [3.0], [6.0]])
    size[-1] *= 0.5
    middle = np.zeros(d)
    middle[-1] = -0.03

    def motion(t: float) -> tuple[Sequence[float], Sequence[float]]:
        angle = speed * t + phase
        return list(middle + size * np.sin(angle)), list(size * speed * np.cos(angle))

    return motion


def check(case: Case, touch: Touch, position: np.ndarray, velocity: np.ndarray) -> None:
    surface, K = case.surface, case.stiffness
    if touch.mode == FREE:
        assert surface.level(touch.point) >= 0
        np.testing.assert_array_equal(touch.point, position)
        return
    assert surface.level(touch.point) == pytest.approx(0, abs=1e-13)
    gradient = surface.gradient(touch.point)
    np.testing.assert_allclose(touch.normal, gradient / np.linalg.norm(gradient), atol=1e-15)
    np.testing.assert_allclose(touch.force, K @ (touch.point - position), atol=1e-12)
    np.testing.assert_allclose(touch.force_rate, K @ (touch.velocity - velocity), atol=1e-9)
    push = touch.force @ touch.normal
    tangential = touch.force - push * touch.normal
    mu = case.friction.at(touch.point)
    assert push >= -1e-12
    assert np.linalg.norm(tangential) <= mu * push + 1e-10
    assert touch.force @ touch.velocity <= 1e-10
    if touch.mode == STICK:
        np.testing.assert_array_equal(touch.velocity, 0)
        return
    v = touch.velocity
    assert np.linalg.norm(v) > 0
    assert abs(touch.normal @ v) <= 1e-9 * np.linalg.norm(v)
    assert np.linalg.norm(tangential) == pytest.approx(mu * push, abs=1e-10)
    # (4-6), what an observer makes of the force and the velocity
    if mu > 0:
        found = touch.force - v * (v @ touch.force) / (v @ v)
        np.testing.assert_allclose(found, push * touch.normal, atol=1e-9)


@pytest.mark.parametrize("surface", SURFACES, ids=NAMES)
@given(seed=seeds, friction=st.sampled_from(FRICTIONS), skew=st.booleans())
@settings(max_examples=4, deadline=None)
def test_laws(surface: Surface, seed: int, friction: SurfaceFriction, skew: bool) -> None:
    d = surface.dimension
    case = Case(surface, friction, SKEW[-d:, -d:] if skew else 100 * np.eye(d))
    motion = random_motion(seed, d)
    previous = None
    for time in np.arange(0, 2, 0.04):
        position, velocity = map(np.array, motion(time))
        touch = advance(surface, friction, case.stiffness, previous, position, velocity)
        check(case, touch, position, velocity)
        # Once more at the same time changes nothing.
        again = advance(surface, friction, case.stiffness, touch, position, velocity)
        assert again.mode == touch.mode
        np.testing.assert_allclose(again.point, touch.point, atol=1e-11)
        np.testing.assert_allclose(again.velocity, touch.velocity, atol=1e-7)
        previous = touch


SHEET = Wave(amplitudes=(0.03, 0.04), wavelengths=(1.1, 1.3))


class Own:
    """A user's own class, of which nothing is compiled."""

    def __init__(self, surface: Surface) -> None:
        self.dimension, self.level = surface.dimension, surface.level
        self.gradient, self.hessian = surface.gradient, surface.hessian


@pytest.mark.parametrize("surface", [Wave(), SHEET], ids=["plane", "space"])
@pytest.mark.parametrize("friction", [VARIED, SurfaceFriction(coefficient=0.0)])
def test_surface_of_an_own_class(surface: Surface, friction: SurfaceFriction) -> None:
    d = surface.dimension
    cases = [Case(one, friction, SKEW[-d:, -d:]) for one in (surface, Own(surface))]
    known, own = (case.follow(random_motion(3, d), np.arange(0, 2, 0.04)) for case in cases)
    np.testing.assert_allclose([*map(row, own)], [*map(row, known)], atol=1e-12)


def test_too_deep_for_a_contact() -> None:
    message = re.escape("p is [0.0, -1.0], allowed: a point nearer to the surface than its radius")
    for surface in (Circle(), Own(Circle())):
        with pytest.raises(ParameterError, match=f"^{message}"):
            Case(surface, ROUGH, SOFT).follow(lambda _: ((0, -1), (0, 0)), [0.0])


def round_motion(t: float) -> tuple[Sequence[float], Sequence[float]]:
    position = (0.3 * math.sin(t), 0.25 * math.sin(1.3 * t), -0.08 - 0.01 * math.sin(t))
    return position, (0.3 * math.cos(t), 0.325 * math.cos(1.3 * t), -0.01 * math.cos(t))


def slip_at(time: float, case: Case) -> Touch:
    touch = case.follow(round_motion, np.arange(0, time + 1e-9, 1e-3))[-1]
    assert touch.mode == SLIP
    return touch


def test_path_in_space_against_an_integrator() -> None:
    """The speed from differences of the friction's excess, the way by a Runge-Kutta method."""
    case = Case(SHEET, VARIED, SKEW)

    def pulled(p: np.ndarray, t: float) -> tuple[np.ndarray, float]:
        gradient = SHEET.gradient(p)
        n = gradient / np.linalg.norm(gradient)
        force = SKEW @ (p - np.array(round_motion(t)[0]))
        tangential = force - (force @ n) * n
        return tangential, float(np.linalg.norm(tangential) - VARIED.at(p) * (force @ n))

    def velocity(t: float, p: np.ndarray) -> np.ndarray:
        tangential, _ = pulled(p, t)
        ahead = -tangential / np.linalg.norm(tangential)
        h = 1e-5
        in_time = pulled(p, t + h)[1] - pulled(p, t - h)[1]
        in_place = pulled(p + h * ahead, t)[1] - pulled(p - h * ahead, t)[1]
        return -in_time / in_place * ahead

    begin = slip_at(0.5, case)
    np.testing.assert_allclose(begin.velocity, velocity(0.5, begin.point), atol=1e-8)
    way = solve_ivp(velocity, (0.5, 1.0), begin.point, rtol=1e-9, atol=1e-11)
    end = case.follow(round_motion, 0.5 + np.arange(1, 501) * 1e-3, begin)[-1]
    np.testing.assert_allclose(end.point, way.y[:, -1], atol=1e-7)
    np.testing.assert_allclose(end.velocity, velocity(1.0, way.y[:, -1]), atol=1e-6)


def test_long_steps_in_space_do_not_swing() -> None:
    """Steps of many times the spring's tangential stretch."""
    case = Case(FLAT_SHEET, SurfaceFriction(coefficient=0.01), 100 * np.eye(3))

    def motion(t: float) -> tuple[Sequence[float], Sequence[float]]:
        return (t, 1e-4 * t, -0.01), (1.0, 1e-4, 0.0)

    touches = case.follow(motion, np.arange(0, 2, 0.01))
    for touch in touches[50:]:
        assert math.atan2(touch.velocity[1], touch.velocity[0]) == pytest.approx(1e-4, abs=1e-9)


EVEN = ((100.0, 0.0, 0.0), (0.0, 100.0, 0.0), (0.0, 0.0, 100.0))
PORTS = ("contact_force", "contact_force_rate", "contact")


def flat_motion(t: float) -> np.ndarray:
    """Land, slide to the right and back, and leave."""
    depth, rate = -0.1 * math.sin(t), -0.1 * math.cos(t)
    return np.array([0.4 * math.sin(2 * t), depth, 0.8 * math.cos(2 * t), rate])


def spatial_motion(t: float) -> np.ndarray:
    x, y = 0.3 * math.sin(t), 0.2 * math.sin(2 * t)
    return np.array([x, y, -0.1, 0.3 * math.cos(t), 0.4 * math.cos(2 * t), 0.0])


def row(touch: Touch) -> np.ndarray:
    return np.concatenate((touch.point, touch.velocity, touch.normal, [touch.mode]))


@pytest.mark.parametrize(
    ("surface", "stiffness", "motion"),
    [
        (Parabola(), ((100.0, 20.0), (20.0, 80.0)), flat_motion),
        (Wave(amplitudes=(0.05, 0.05), wavelengths=(1.0, 1.0)), EVEN, spatial_motion),
    ],
    ids=["plane", "space"],
)
def test_block_is_the_pure_function_step_by_step(
    surface: Surface,
    stiffness: tuple[tuple[float, ...], ...],
    motion: Callable[[float], np.ndarray],
) -> None:
    friction = SurfaceFriction(coefficient=0.4, ripple=0.1)
    step = 1 / 64
    params = SlidingContactParams(stiffness=stiffness, friction=friction, step=step)
    contact = SlidingContact(surface, params)
    assert contact.GetUniquePeriodicDiscreteUpdateAttribute().period_sec() == step
    context = contact.CreateDefaultContext()
    d, previous, modes = surface.dimension, None, set()
    for i in range(321):
        nominal = motion(i * step)
        previous = advance(
            surface, friction, np.array(stiffness), previous, nominal[:d], nominal[d:]
        )
        modes.add(previous.mode)
        set_motion(contact, context, nominal)
        force, rate, packed = outputs(contact, context)
        np.testing.assert_allclose(packed, row(previous), atol=1e-8)
        np.testing.assert_allclose(force, previous.force, atol=1e-9)
        np.testing.assert_allclose(rate, previous.force_rate, atol=1e-6)
        context.SetDiscreteState(contact.EvalUniquePeriodicDiscreteUpdate(context))
    assert modes >= ({FREE, STICK, SLIP} if d == 2 else {STICK, SLIP})


def outputs(contact: SlidingContact, context: Context) -> list[np.ndarray]:
    return [contact.GetOutputPort(name).Eval(context).copy() for name in PORTS]


def set_motion(contact: SlidingContact, context: Context, values: Sequence[float]) -> None:
    contact.GetInputPort("nominal_motion").FixValue(context, values)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
@pytest.mark.parametrize("index", [0, 3])
def test_nominal_motion_that_is_not_finite(bad: float, index: int) -> None:
    contact = SlidingContact(Parabola(), SlidingContactParams())
    context = contact.CreateDefaultContext()
    motion = [0.0, -0.1, 0.2, 0.0]
    motion[index] = bad
    set_motion(contact, context, motion)
    message = re.escape(f"nominal_motion is {motion!r}, allowed: finite numbers")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        outputs(contact, context)
