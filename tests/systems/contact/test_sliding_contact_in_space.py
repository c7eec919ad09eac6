"""The sliding contact on any surface: the laws it has to keep, and paths in space."""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.graphs import Parabola, Paraboloid, Wave, WavySheet
from chamfer.models.surfaces.nearest import nearest
from chamfer.models.surfaces.rounds import Circle, Sphere
from chamfer.models.surfaces.surface import Surface
from chamfer.systems.contact.sliding_contact import FREE, SLIP, STICK, Touch, advance

Motion = Callable[[float], tuple[Sequence[float], Sequence[float]]]

ROUGH = SurfaceFriction()
SKEW = np.array([[120.0, 20.0, 10.0], [20.0, 90.0, -15.0], [10.0, -15.0, 100.0]])
VARIED = SurfaceFriction(coefficient=0.6, ripple=0.15, wavelength=0.8)
THESIS = Parabola()
FLAT, FLAT_SHEET = Parabola(coefficient=0.0), Paraboloid(coefficients=(0.0, 0.0))
seeds = st.integers(0, 2**32 - 1)


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


# Laws that hold for any surface, friction, stiffness and motion


SURFACES: list[Surface] = [
    THESIS,
    Wave(amplitude=0.02, wavelength=0.6),
    Circle(centre=(0.0, -0.6), radius=0.6),
    Circle(centre=(0.0, 0.6), radius=0.6, inside=True),
    FLAT_SHEET,
    Paraboloid(coefficients=(0.3, -0.2)),
    WavySheet(amplitudes=(0.01, 0.015), wavelengths=(0.6, 0.5)),
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
@settings(max_examples=8, deadline=None)
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


def test_stays_at_rest_inside_the_cone() -> None:
    case = Case(SURFACES[6], SurfaceFriction(coefficient=0.5), SKEW)
    start = case.follow(lambda _: ((0.1, 0.05, -0.1), (0, 0, 0)), [0.0])[0]
    for direction in np.eye(3)[:2]:
        position = np.array([0.1, 0.05, -0.1]) + 0.01 * direction
        touch = advance(*_parts(case), start, position, direction)
        assert touch.mode == STICK
        np.testing.assert_array_equal(touch.point, start.point)
        np.testing.assert_array_equal(touch.velocity, 0)
        np.testing.assert_allclose(touch.force_rate, -SKEW @ direction, atol=1e-12)


def _parts(case: Case) -> tuple[Surface, SurfaceFriction, np.ndarray]:
    return case.surface, case.friction, case.stiffness


@pytest.mark.parametrize("stiffness", [100 * np.eye(3), SKEW], ids=["even", "skew"])
def test_lands_where_the_force_is_along_the_normal(stiffness: np.ndarray) -> None:
    surface, nominal = SURFACES[6], np.array([0.07, -0.03, -0.06])
    touch = advance(surface, ROUGH, stiffness, None, nominal, np.array([0.1, 0.2, 0.0]))
    assert touch.mode == STICK
    np.testing.assert_allclose(np.cross(touch.force, touch.normal), 0, atol=1e-12)
    even = np.allclose(stiffness, 100 * np.eye(3))
    assert np.allclose(touch.point, nearest(surface, nominal), atol=1e-9) == even


# Without friction


@pytest.mark.parametrize("surface", SURFACES[1::2], ids=NAMES[1::2])
def test_frictionless_motion(surface: Surface) -> None:
    d = surface.dimension
    case = Case(surface, SurfaceFriction(coefficient=0.0), SKEW[-d:, -d:])

    def motion(t: float) -> tuple[Sequence[float], Sequence[float]]:
        return [0.1 * t] * (d - 1) + [-0.08], [0.1] * (d - 1) + [0.0]

    before, now, after = case.follow(motion, [0.5 - 1e-5, 0.5, 0.5 + 1e-5])
    assert now.mode == SLIP
    np.testing.assert_allclose(now.force - (now.force @ now.normal) * now.normal, 0, atol=1e-11)
    np.testing.assert_allclose(now.velocity, (after.point - before.point) / 2e-5, atol=1e-8)


# Space


@dataclass(frozen=True)
class Turned:
    """A surface that is turned and moved."""

    surface: Surface
    rotation: np.ndarray
    offset: np.ndarray

    dimension = 3

    def _local(self, p: np.ndarray) -> np.ndarray:
        local: np.ndarray = self.rotation.T @ (p - self.offset)
        return local

    def level(self, p: np.ndarray) -> float:
        return self.surface.level(self._local(p))

    def gradient(self, p: np.ndarray) -> np.ndarray:
        gradient: np.ndarray = self.rotation @ self.surface.gradient(self._local(p))
        return gradient

    def hessian(self, p: np.ndarray) -> np.ndarray:
        hessian: np.ndarray = (
            self.rotation @ self.surface.hessian(self._local(p)) @ self.rotation.T
        )
        return hessian


def round_motion(t: float) -> tuple[Sequence[float], Sequence[float]]:
    position = (0.3 * math.sin(t), 0.25 * math.sin(1.3 * t), -0.08)
    return position, (0.3 * math.cos(t), 0.325 * math.cos(1.3 * t), 0.0)


SHEET = WavySheet(amplitudes=(0.03, 0.04), wavelengths=(1.1, 1.3))


@given(seed=seeds)
@settings(max_examples=10, deadline=None)
def test_turning_everything_turns_the_contact(seed: int) -> None:
    rng = np.random.default_rng(seed)
    R, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    offset = rng.uniform(-1, 1, 3)
    friction = SurfaceFriction(coefficient=0.6)
    case = Case(SHEET, friction, SKEW)
    K = R @ SKEW @ R.T
    turned = Case(Turned(SHEET, R, offset), friction, 0.5 * (K + K.T))

    def motion(t: float) -> tuple[Sequence[float], Sequence[float]]:
        position, velocity = map(np.array, round_motion(t))
        return list(R @ position + offset), list(R @ velocity)

    times = np.arange(0, 3, 0.05)
    for a, b in zip(case.follow(round_motion, times), turned.follow(motion, times), strict=True):
        assert a.mode == b.mode
        np.testing.assert_allclose(R @ a.point + offset, b.point, atol=1e-10)
        for name in ("velocity", "force", "force_rate", "normal"):
            np.testing.assert_allclose(R @ getattr(a, name), getattr(b, name), atol=1e-7)


@pytest.mark.parametrize(
    ("sheet", "curve"),
    [
        (Paraboloid(coefficients=(0.05, 0.3)), THESIS),
        (FLAT_SHEET, FLAT),
        (
            Sphere(centre=(0.0, 0.0, -0.6), radius=0.6),
            Circle(centre=(0.0, -0.6), radius=0.6),
        ),
    ],
)
def test_straight_slide_in_space_is_one_in_the_plane(sheet: Surface, curve: Surface) -> None:
    K = np.array([[110.0, 0.0, 20.0], [0.0, 70.0, 0.0], [20.0, 0.0, 90.0]])
    space = Case(sheet, VARIED, K)
    plane = Case(curve, VARIED, K[::2, ::2])

    def motion(t: float) -> tuple[Sequence[float], Sequence[float]]:
        return (0.3 * math.sin(t), -0.05), (0.3 * math.cos(t), 0.0)

    def spatial(t: float) -> tuple[Sequence[float], Sequence[float]]:
        (x, z), (u, w) = motion(t)
        return (x, 0.0, z), (u, 0.0, w)

    times = np.arange(0, 6, 0.02)
    modes = set()
    for a, b in zip(plane.follow(motion, times), space.follow(spatial, times), strict=True):
        assert a.mode == b.mode
        modes.add(a.mode)
        for name in ("point", "velocity", "force", "force_rate", "normal"):
            np.testing.assert_allclose(getattr(a, name), getattr(b, name)[::2], atol=1e-9)
            assert getattr(b, name)[1] == pytest.approx(0, abs=1e-12)
    assert {STICK, SLIP} <= modes


def slip_at(time: float, case: Case) -> Touch:
    touch = case.follow(round_motion, np.arange(0, time + 1e-9, 1e-3))[-1]
    assert touch.mode == SLIP
    return touch


@pytest.mark.parametrize("stiffness", [100 * np.eye(3), SKEW], ids=["even", "skew"])
def test_path_in_space_converges_with_the_square_of_the_step(stiffness: np.ndarray) -> None:
    case = Case(SHEET, VARIED, stiffness)
    begin = slip_at(0.5, case)

    def end(step: float) -> np.ndarray:
        times = 0.5 + step * np.arange(1, round(0.8 / step) + 1)
        return case.follow(round_motion, times, begin)[-1].point

    reference = end(1e-3)
    errors = [float(np.linalg.norm(end(step) - reference)) for step in (0.04, 0.02, 0.01)]
    assert errors[0] < 5e-5
    assert errors[0] / errors[1] == pytest.approx(4, rel=0.15)
    assert errors[1] / errors[2] == pytest.approx(4, rel=0.15)


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


def test_drag_in_space_follows_the_pursuit_curve() -> None:
    """On a plane the point is dragged at a constant distance: a tractrix, in closed form."""
    reach, speed = 0.05, 0.2  # m, mu N / k; m/s
    case = Case(FLAT_SHEET, SurfaceFriction(coefficient=0.5), 100 * np.eye(3))
    angle = 1.2  # rad, from the nominal motion to the string, at the begin
    start = np.array([-reach * math.cos(angle), -reach * math.sin(angle), 0.0])
    rest = np.zeros(3)
    up = np.array([0.0, 0.0, 1.0])
    begin = Touch(start, rest, rest, rest, up, STICK)
    times = np.arange(0, 1.0001, 1e-3)
    touches = case.follow(lambda t: ((speed * t, 0.0, -0.1), (speed, 0.0, 0.0)), times, begin)
    for time, touch in zip(times, touches, strict=True):
        now = 2 * math.atan(math.tan(angle / 2) * math.exp(-speed * time / reach))
        x = speed * time - reach * math.cos(now)
        y = -reach * math.sin(now)
        np.testing.assert_allclose(touch.point, [x, y, 0.0], atol=1e-6)
        v = speed * math.cos(now) * np.array([math.cos(now), math.sin(now), 0.0])
        np.testing.assert_allclose(touch.velocity, v, atol=1e-5)


def test_long_steps_in_space_do_not_swing() -> None:
    """Steps of many times the spring's tangential stretch."""
    case = Case(FLAT_SHEET, SurfaceFriction(coefficient=0.01), 100 * np.eye(3))

    def motion(t: float) -> tuple[Sequence[float], Sequence[float]]:
        return (t, 1e-4 * t, -0.01), (1.0, 1e-4, 0.0)

    touches = case.follow(motion, np.arange(0, 2, 0.01))
    for touch in touches[50:]:
        assert math.atan2(touch.velocity[1], touch.velocity[0]) == pytest.approx(1e-4, abs=1e-9)
