"""What one sample says: the normal (4-6), (4-7), and its uncertainty (4-18)."""

import math
from collections.abc import Callable

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chamfer.systems.estimation.normal_filter import (
    instantaneous_normal,
    project_out,
    uncertainty,
)

Array = np.ndarray
seeds = st.integers(0, 2**32 - 1)
dimensions = st.sampled_from([2, 3])
sizes = st.floats(1e-3, 1e3)


def tangent(random: np.random.Generator, normal: Array) -> Array:
    vector = random.standard_normal(len(normal))
    vector -= (vector @ normal) * normal
    return np.asarray(vector / np.linalg.norm(vector))


@settings(deadline=None)  # the first call compiles
@given(seed=seeds, d=dimensions, push=sizes, speed=sizes, mu=st.floats(0, 20))
def test_normal_does_not_depend_on_friction(
    random_unit: Callable[..., Array], seed: int, d: int, push: float, speed: float, mu: float
) -> None:
    random = np.random.default_rng(seed)
    n = random_unit(random, d)
    t = tangent(random, n)
    force = push * n - mu * push * t  # (4-1)
    N = project_out(force, speed * t)
    np.testing.assert_allclose(N, push * n, rtol=0, atol=1e-12 * push * (1 + mu))
    found = instantaneous_normal(force, speed * t, 1.0, 0.05, np.zeros(d))
    np.testing.assert_allclose(found.normal, n, rtol=0, atol=1e-12 * (1 + mu))


@settings(deadline=None)  # the first call compiles
@given(seed=seeds, d=dimensions)
def test_projection(seed: int, d: int) -> None:
    # (4-6) as it is written, for any force and velocity.
    random = np.random.default_rng(seed)
    F, v = random.standard_normal(d), random.standard_normal(d)
    N = project_out(F, v)
    literal = (np.eye(d) - np.outer(v, v) / (v @ v)) @ F
    np.testing.assert_allclose(N, literal, rtol=0, atol=1e-13)
    assert abs(N @ v) < 1e-12  # (4-4)


@settings(deadline=None)  # the first call compiles
@given(seed=seeds, d=dimensions, u_F=sizes, u_v=sizes)
def test_uncertainty_as_printed(seed: int, d: int, u_F: float, u_v: float) -> None:
    # (4-18) with |N| and |F - N| written out.
    random = np.random.default_rng(seed)
    F, v = random.standard_normal(d), random.standard_normal(d)
    N = project_out(F, v)
    a, b = np.linalg.norm(N), np.linalg.norm(F - N)
    by_force = u_F / (math.sqrt(3) * a)
    by_velocity = u_v / math.sqrt(3) * (a + b) / math.sqrt((v @ v) * (N @ N))
    expected = math.sqrt(by_force**2 + by_velocity**2)
    found = instantaneous_normal(F, v, u_F, u_v, np.zeros(d))
    assert found.uncertainty == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("mu", [0.0, 0.5, 1.0])
def test_uncertainty_in_space_by_sampling(mu: float) -> None:
    """Where the errors go in space, to first order.

    Along the velocity the normal is off by dv_n / |v|; across it by dF_b / |N|, and by
    dv_b |F - N| / (|v| |N|). The squares of both velocity errors add to 1 + (|F - N| / |N|)^2;
    (4-18) takes the square of the sum, and is exact without friction.
    """
    random = np.random.default_rng(3)
    push, speed, u_F, u_v, count = 20.0, 0.5, 0.4, 0.01, 20_000
    n, t, b = np.array([0.0, 0.0, 1.0]), np.array([1.0, 0.0, 0.0]), np.array([0.0, 1.0, 0.0])
    F, v = push * n - mu * push * t, speed * t
    found = np.array(
        [
            instantaneous_normal(
                F + u_F / math.sqrt(3) * dF, v + u_v / math.sqrt(3) * dv, u_F, u_v, np.zeros(3)
            ).normal
            for dF, dv in random.standard_normal((count, 2, 3))
        ]
    )
    along, across = float(np.mean((found @ t) ** 2)), float(np.mean((found @ b) ** 2))
    by_force, by_velocity = (u_F / push) ** 2 / 3, (u_v / speed) ** 2 / 3
    # A sample variance of 20 000 is known to 1 %; five of these.
    assert along == pytest.approx(by_velocity, rel=0.05)
    assert across == pytest.approx(by_force + mu**2 * by_velocity, rel=0.05)
    u = uncertainty(push, mu * push, speed, u_F, u_v)
    assert u**2 == pytest.approx(by_force + (1 + mu) ** 2 * by_velocity, rel=1e-12)
    assert u**2 > 0.95 * (along + across)
    if mu == 0:
        assert u**2 == pytest.approx(along + across, rel=0.05)


@pytest.mark.parametrize("mu", [0.0, 1.0])
def test_uncertainty_in_the_plane_by_sampling(mu: float) -> None:
    # The only direction is along the velocity: the force's error decides about the length alone.
    random = np.random.default_rng(4)
    push, speed, u_F, u_v, count = 20.0, 0.5, 1.0, 0.01, 20_000
    n, t = np.array([0.0, 1.0]), np.array([1.0, 0.0])
    F, v = push * n - mu * push * t, speed * t
    found = np.array(
        [
            instantaneous_normal(
                F + u_F / math.sqrt(3) * dF, v + u_v / math.sqrt(3) * dv, u_F, u_v, np.zeros(2)
            ).normal
            for dF, dv in random.standard_normal((count, 2, 2))
        ]
    )
    angle = np.arctan2(found @ t, found @ n)
    assert float(np.mean(angle**2)) == pytest.approx((u_v / speed) ** 2 / 3, rel=0.05)
    assert uncertainty(push, mu * push, speed, u_F, u_v) > np.std(angle)


@settings(deadline=None)  # the first call compiles
@given(seed=seeds, d=dimensions, factor=sizes)
def test_scaling(seed: int, d: int, factor: float) -> None:
    random = np.random.default_rng(seed)
    F, v, none = random.standard_normal(d), random.standard_normal(d), np.zeros(d)
    n, u = instantaneous_normal(F, v, 0.1, 0.2, none)
    for found in (
        instantaneous_normal(factor * F, v, factor * 0.1, 0.2, none),
        instantaneous_normal(F, factor * v, 0.1, factor * 0.2, none),
        instantaneous_normal(F, -v, 0.1, 0.2, none),
    ):
        np.testing.assert_allclose(found.normal, n, rtol=0, atol=1e-9)
        assert found.uncertainty == pytest.approx(u, rel=1e-9)
    doubled = instantaneous_normal(F, v, 0.2, 0.4, none)
    assert doubled.uncertainty == pytest.approx(2 * u, rel=1e-12)


@settings(deadline=None)  # the first call compiles
@given(seed=seeds, d=dimensions)
def test_turned_axes_turn_the_normal(
    random_rotation: Callable[..., Array], seed: int, d: int
) -> None:
    random = np.random.default_rng(seed)
    R, F, v = random_rotation(random, d), random.standard_normal(d), random.standard_normal(d)
    n, u = instantaneous_normal(F, v, 0.1, 0.2, np.zeros(d))
    found = instantaneous_normal(R @ F, R @ v, 0.1, 0.2, np.zeros(d))
    np.testing.assert_allclose(found.normal, R @ n, rtol=0, atol=1e-9)
    assert found.uncertainty == pytest.approx(u, rel=1e-9)


@settings(deadline=None)  # the first call compiles
@given(seed=seeds, d=dimensions)
def test_prior_divides_the_force(random_unit: Callable[..., Array], seed: int, d: int) -> None:
    random = np.random.default_rng(seed)
    F, v = random.standard_normal(d), random.standard_normal(d)
    prior = random_unit(random, d)
    own = instantaneous_normal(F, v, 0.1, 0.2, np.zeros(d))
    n, u = instantaneous_normal(F, v, 0.1, 0.2, prior)
    np.testing.assert_array_equal(n, own.normal)
    a = abs(prior @ F)
    b = math.sqrt(F @ F - a**2)
    assert u == pytest.approx(uncertainty(a, b, math.sqrt(v @ v), 0.1, 0.2), rel=1e-9)
    # The sample's own normal divides it as the thesis does.
    same = instantaneous_normal(F, v, 0.1, 0.2, own.normal)
    assert same.uncertainty == pytest.approx(own.uncertainty, rel=1e-6)


def undefined(d: int) -> list[tuple[Array, Array]]:
    first, second = np.eye(d)[0], np.eye(d)[1]
    oblique = 1.7 * first + 0.3 * second
    return [
        (np.zeros(d), np.zeros(d)),
        (first, np.zeros(d)),
        (np.zeros(d), first),
        (2 * first, first),
        (-2 * first, first),
        (oblique / 3, oblique),
        (1e-30 * oblique, 1e12 * oblique),
        (oblique, np.full(d, 1e-200)),  # whose square is zero
        (oblique, np.full(d, 1e200)),  # whose square is infinite
    ]


@pytest.mark.parametrize(("force", "velocity"), [*undefined(2), *undefined(3)])
@pytest.mark.parametrize("with_prior", [False, True])
@pytest.mark.filterwarnings("error")
def test_no_normal(force: Array, velocity: Array, with_prior: bool) -> None:
    d = len(force)
    prior = np.eye(d)[1] if with_prior else np.zeros(d)
    n, u = instantaneous_normal(force, velocity, 1.0, 0.05, prior)
    np.testing.assert_array_equal(n, np.zeros(d))
    assert u == math.inf
    np.testing.assert_array_equal(project_out(force, velocity), np.zeros(d))


def test_no_normal_if_the_prior_is_across_the_force() -> None:
    F, v = np.array([0.0, 5.0]), np.array([1.0, 0.0])
    n, u = instantaneous_normal(F, v, 1.0, 0.05, np.array([1.0, 0.0]))
    np.testing.assert_array_equal(n, [0.0, 0.0])
    assert u == math.inf


def test_a_perfect_sensor_is_certain() -> None:
    n, u = instantaneous_normal(np.array([-4.0, 4.0]), np.array([0.1, 0.0]), 0.0, 0.0, np.zeros(2))
    np.testing.assert_allclose(n, [0.0, 1.0], rtol=0, atol=1e-15)
    assert u == 0.0
