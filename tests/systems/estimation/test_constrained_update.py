"""The constrained update: its closed form, the thesis' gain, and where nothing is defined."""

import math
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from chamfer.systems.estimation.normal_filter import (
    constrained_gain,
    constrained_update,
    newton_multiplier,
)

Array = np.ndarray
seeds = st.integers(0, 2**32 - 1)
dimensions = st.sampled_from([2, 3])
scales = st.floats(-6, 3).map(lambda exponent: 10.0**exponent)


class Case(NamedTuple):
    normal: Array
    covariance: Array
    measured: Array
    noise: Array


@pytest.fixture(scope="package")
def draw(
    random_unit: Callable[..., Array], random_covariance: Callable[..., Array]
) -> Callable[..., Case]:
    """Return a function that draws a prior and a measurement in any direction."""

    def case(seed: int, d: int, prior: float = 1.0, noise: float = 1.0) -> Case:
        random = np.random.default_rng(seed)
        return Case(
            random_unit(random, d),
            random_covariance(random, d, prior),
            random_unit(random, d),
            random_covariance(random, d, noise),
        )

    return case


def ordinary(case: Case) -> tuple[Array, float, float]:
    """Return what a Kalman filter without the constraint estimates, its length, and s."""
    e = case.measured - case.normal
    S_inverse = np.linalg.inv(case.covariance + case.noise)
    raw = case.normal + case.covariance @ S_inverse @ e
    return raw, float(np.linalg.norm(raw)), float(e @ S_inverse @ e)


def of_gain(case: Case, G: Array) -> Array:
    """Return the covariance after an update with any gain (4-23)."""
    left = np.eye(len(case.normal)) - G
    return np.asarray(left @ case.covariance @ left.T + G @ case.noise @ G.T)


def multiplier_of(case: Case) -> float:
    _, length, s = ordinary(case)
    return (length - 1) / s


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("seed", range(12))
def test_no_gain_of_unit_length_has_a_smaller_trace(
    draw: Callable[..., Case], d: int, seed: int
) -> None:
    case = draw(seed, d)
    e = case.measured - case.normal
    found = minimize(
        lambda G: float(np.trace(of_gain(case, G.reshape(d, d)))),
        np.zeros(d * d),  # it keeps the prior, which is of unit length
        method="SLSQP",
        constraints={
            "type": "eq",
            "fun": lambda G: float(np.sum((case.normal + G.reshape(d, d) @ e) ** 2)) - 1,
        },
        options={"ftol": 1e-13, "maxiter": 500},
    )
    assert found.success
    updated = constrained_update(*case)
    least = float(np.trace(updated.covariance))
    assert least <= found.fun + 1e-9
    assert least == pytest.approx(found.fun, rel=1e-6)
    np.testing.assert_allclose(
        updated.normal, case.normal + found.x.reshape(d, d) @ e, rtol=0, atol=1e-3
    )


@settings(deadline=None)  # the first call compiles
@given(seed=seeds, d=dimensions, prior=scales, noise=scales)
def test_is_the_ordinary_update_normalised(
    draw: Callable[..., Case], seed: int, d: int, prior: float, noise: float
) -> None:
    case = draw(seed, d, prior, noise)
    raw, length, _ = ordinary(case)
    if length > 1e-3:
        updated = constrained_update(*case)
        np.testing.assert_allclose(updated.normal, raw / length, rtol=0, atol=1e-9)


@settings(deadline=None)  # the first call compiles
@given(seed=seeds, d=dimensions, prior=scales, noise=scales)
def test_unit_length_and_a_covariance(
    draw: Callable[..., Case], seed: int, d: int, prior: float, noise: float
) -> None:
    case = draw(seed, d, prior, noise)
    before = [array.copy() for array in case]
    updated = constrained_update(*case)
    assert abs(float(np.linalg.norm(updated.normal)) - 1) < 1e-14
    np.testing.assert_array_equal(updated.covariance, updated.covariance.T)
    largest = float(np.linalg.eigvalsh(case.covariance)[-1])
    assert np.linalg.eigvalsh(updated.covariance)[0] >= -1e-13 * largest
    # No gain at all keeps the constraint too, so that the best is no worse.
    assert np.trace(updated.covariance) <= np.trace(case.covariance) * (1 + 1e-9)
    for array, kept in zip(case, before, strict=True):
        np.testing.assert_array_equal(array, kept)


@settings(deadline=None)  # the first call compiles
@given(seed=seeds, d=dimensions)
def test_gain_gives_the_same(draw: Callable[..., Case], seed: int, d: int) -> None:
    # (4-26), (4-27) and (4-23), with the multiplier as Newton's method finds it.
    case = draw(seed, d)
    multiplier = newton_multiplier(*case)
    assert multiplier == pytest.approx(multiplier_of(case), rel=1e-9, abs=1e-12)
    G = constrained_gain(*case, multiplier)
    updated = constrained_update(*case)
    # Near the pole the gain is large, and its rounding too.
    size = max(1.0, float(np.abs(G).max()))
    normal = case.normal + G @ (case.measured - case.normal)
    np.testing.assert_allclose(normal, updated.normal, rtol=0, atol=1e-9 * size)
    expected = of_gain(case, G)
    np.testing.assert_allclose(updated.covariance, expected, rtol=0, atol=1e-9 * size**2)


@settings(deadline=None)  # the first call compiles
@given(seed=seeds, d=dimensions)
def test_gain_is_stationary(draw: Callable[..., Case], seed: int, d: int) -> None:
    # The derivative of tr P+ + lambda (|n + G e|^2 - 1) by G, halved, and by differences.
    case = draw(seed, d)
    e = case.measured - case.normal
    multiplier = multiplier_of(case)
    G = constrained_gain(*case, multiplier)

    def lagrangian(G: Array) -> float:
        square = float(np.sum((case.normal + G @ e) ** 2))
        return float(np.trace(of_gain(case, G))) + multiplier * (square - 1)

    h = 1e-4
    for i in range(d):
        for j in range(d):
            step = np.zeros((d, d))
            step[i, j] = h
            slope = (lagrangian(G + step) - lagrangian(G - step)) / (2 * h)
            scale = 1 + float(np.abs(G).max()) * np.abs(case.covariance + case.noise).max()
            assert abs(slope) < 1e-6 * scale * (1 + abs(multiplier))


def contradicting(length: float, d: int = 3) -> Case:
    """Return a measurement against a prior as uncertain, with an ordinary update that long."""
    angle = math.acos(length)  # half of the one between them
    normal, measured = np.zeros(d), np.zeros(d)
    normal[:2] = math.cos(angle), math.sin(angle)
    measured[:2] = math.cos(angle), -math.sin(angle)
    return Case(normal, 0.04 * np.eye(d), measured, 0.04 * np.eye(d))


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("length", [0.9, 0.7, 0.59, 0.57, 0.5, 0.2, 0.05, 1e-3])
def test_newton_converges_also_where_its_first_step_crosses_the_pole(
    length: float, d: int
) -> None:
    case = contradicting(length, d)
    e = case.measured - case.normal
    assert ordinary(case)[1] == pytest.approx(length, rel=1e-9)
    s = ordinary(case)[2]

    def constraint(multiplier: float) -> float:
        G = constrained_gain(*case, multiplier)
        return float(np.sum((case.normal + G @ e) ** 2)) - 1

    h = 1e-6 / s
    slope = (constraint(h) - constraint(-h)) / (2 * h)
    crosses = 1 - s * constraint(0.0) / slope < 0
    assert crosses == (length < 1 / math.sqrt(3))
    multiplier = newton_multiplier(*case)
    assert 1 + multiplier * s > 0
    assert multiplier == pytest.approx((length - 1) / s, rel=1e-9)


def test_of_two_opposite_estimates_the_antipode_is_worse() -> None:
    case = contradicting(0.5)
    _, length, s = ordinary(case)
    best = constrained_update(*case)
    G = constrained_gain(*case, -(length + 1) / s)
    np.testing.assert_allclose(
        case.normal + G @ (case.measured - case.normal), -best.normal, rtol=0, atol=1e-12
    )
    assert np.trace(of_gain(case, G)) > 1.5 * np.trace(best.covariance)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("seed", range(5))
class TestSpecialCases:
    def test_agreement(self, draw: Callable[..., Case], d: int, seed: int) -> None:
        case = draw(seed, d)._replace(measured=draw(seed, d).normal)
        updated = constrained_update(*case)
        np.testing.assert_allclose(updated.normal, case.normal, rtol=0, atol=1e-15)
        expected = np.linalg.inv(np.linalg.inv(case.covariance) + np.linalg.inv(case.noise))
        np.testing.assert_allclose(updated.covariance, expected, rtol=1e-9, atol=1e-12)
        assert newton_multiplier(*case) == 0.0

    def test_exact_measurement(self, draw: Callable[..., Case], d: int, seed: int) -> None:
        updated = constrained_update(*draw(seed, d)._replace(noise=np.zeros((d, d))))
        np.testing.assert_allclose(updated.normal, draw(seed, d).measured, rtol=0, atol=1e-12)
        np.testing.assert_allclose(updated.covariance, np.zeros((d, d)), rtol=0, atol=1e-12)

    def test_certain_prior(self, draw: Callable[..., Case], d: int, seed: int) -> None:
        updated = constrained_update(*draw(seed, d)._replace(covariance=np.zeros((d, d))))
        np.testing.assert_allclose(updated.normal, draw(seed, d).normal, rtol=0, atol=1e-15)
        np.testing.assert_allclose(updated.covariance, np.zeros((d, d)), rtol=0, atol=1e-30)

    def test_nothing_uncertain(self, draw: Callable[..., Case], d: int, seed: int) -> None:
        zeros = np.zeros((d, d))
        case = draw(seed, d)._replace(covariance=zeros, noise=zeros)
        updated = constrained_update(*case)
        np.testing.assert_array_equal(updated.normal, case.normal)
        np.testing.assert_array_equal(updated.covariance, zeros)
        with pytest.raises(ArithmeticError, match="neither the prior nor the measurement"):
            newton_multiplier(*case)

    def test_contradiction(self, draw: Callable[..., Case], d: int, seed: int) -> None:
        # Also where rounding leaves a direction, which means nothing.
        n = draw(seed, d).normal
        for P in (0.04 * np.eye(d), draw(seed, d).covariance):
            updated = constrained_update(n, P, -n, P.copy())
            np.testing.assert_array_equal(updated.normal, n)
            np.testing.assert_array_equal(updated.covariance, P)

    @pytest.mark.parametrize("noise", [1e20, 1e100, 1e300])
    def test_useless_measurement(
        self, draw: Callable[..., Case], d: int, seed: int, noise: float
    ) -> None:
        case = draw(seed, d)._replace(noise=noise * np.eye(d))
        updated = constrained_update(*case)
        np.testing.assert_allclose(updated.normal, case.normal, rtol=0, atol=1e-15)
        np.testing.assert_allclose(updated.covariance, case.covariance, rtol=1e-13, atol=1e-16)

    @pytest.mark.parametrize("size", [1e-8, 1e-12, 1e-15, 1e-16])
    def test_difference_within_rounding(
        self, draw: Callable[..., Case], d: int, seed: int, size: float
    ) -> None:
        # The rounding of a length, about 1e-16, over such a difference is not small.
        n = draw(seed, d).normal
        measured = n + size * np.random.default_rng(seed).standard_normal(d)
        measured /= np.linalg.norm(measured)
        P = 0.01 * np.eye(d)
        updated = constrained_update(n, P, measured, 0.02 * np.eye(d))
        np.testing.assert_allclose(updated.normal, n, rtol=0, atol=3 * size)
        assert np.linalg.eigvalsh(updated.covariance)[-1] <= 0.01 * (1 + 1e-9)
        flat = np.eye(d) - np.outer(n, n)
        np.testing.assert_allclose(
            flat @ updated.covariance @ flat, 0.02 / 3 * flat, rtol=0, atol=1e-7
        )


@settings(deadline=None)  # the first call compiles
@given(seed=seeds, d=dimensions)
def test_turned_axes_turn_the_update(
    draw: Callable[..., Case], random_rotation: Callable[..., Array], seed: int, d: int
) -> None:
    case = draw(seed, d)
    if ordinary(case)[1] < 1e-2:
        return
    R = random_rotation(np.random.default_rng(seed), d)
    turned = Case(
        R @ case.normal, R @ case.covariance @ R.T, R @ case.measured, R @ case.noise @ R.T
    )
    expected, found = constrained_update(*case), constrained_update(*turned)
    np.testing.assert_allclose(found.normal, R @ expected.normal, rtol=0, atol=1e-9)
    np.testing.assert_allclose(found.covariance, R @ expected.covariance @ R.T, rtol=0, atol=1e-9)
