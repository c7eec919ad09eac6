"""What a sample says of the normal, the update of unit length, and the thesis' filter."""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import brentq, minimize

from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.graphs import Parabola, Wave
from chamfer.models.surfaces.surface import Surface
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.sliding_contact import SLIP
from chamfer.systems.estimation.normal_filter import (
    ConstrainedFilter,
    NormalStatus,
    ObserverKind,
    ResolvedSurfaceObserverParams,
    Sample,
    constrained_gain,
    constrained_update,
    instantaneous_normal,
    newton_multiplier,
    rotation_between,
    tangential_deviation,
)

Array = np.ndarray
seeds = st.integers(0, 2**32 - 1)
dimensions = st.sampled_from([2, 3])
sizes = st.floats(1e-3, 1e3)


def tangent(random: np.random.Generator, normal: Array) -> Array:
    vector = random.standard_normal(len(normal))
    vector -= (vector @ normal) * normal
    return np.asarray(vector / np.linalg.norm(vector))


@given(seed=seeds, d=dimensions, push=sizes, speed=sizes, mu=st.floats(0, 20))
def test_normal_does_not_depend_on_friction(
    slides: Any, seed: int, d: int, push: float, speed: float, mu: float
) -> None:
    random = np.random.default_rng(seed)
    n = slides.unit(random, d)
    t = tangent(random, n)
    force = push * n - mu * push * t  # (4-1)
    found = instantaneous_normal(force, speed * t, 1.0, 0.05, np.zeros(d))
    np.testing.assert_allclose(found.normal, n, rtol=0, atol=1e-12 * (1 + mu))


@given(seed=seeds, d=dimensions)
def test_prior_divides_the_force(slides: Any, seed: int, d: int) -> None:
    random = np.random.default_rng(seed)
    F, v = random.standard_normal(d), random.standard_normal(d)
    prior = slides.unit(random, d)
    own = instantaneous_normal(F, v, 0.1, 0.2, np.zeros(d))
    n, u = instantaneous_normal(F, v, 0.1, 0.2, prior)
    np.testing.assert_array_equal(n, own.normal)
    push = abs(prior @ F)
    drag = math.sqrt(F @ F - push**2)
    by_velocity = 0.2 / math.sqrt(3) * (push + drag) / (math.sqrt(v @ v) * push)
    assert u == pytest.approx(math.hypot(0.1 / (math.sqrt(3) * push), by_velocity), rel=1e-9)
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


scales = st.floats(-6, 3).map(lambda exponent: 10.0**exponent)


class Case(NamedTuple):
    normal: Array
    covariance: Array
    measured: Array
    noise: Array


@pytest.fixture(scope="package")
def draw(slides: Any) -> Callable[..., Case]:
    """Return a function that draws a prior and a measurement in any direction."""

    def case(seed: int, d: int, prior: float = 1.0, noise: float = 1.0) -> Case:
        random = np.random.default_rng(seed)
        return Case(
            slides.unit(random, d),
            slides.covariance(random, d, prior),
            slides.unit(random, d),
            slides.covariance(random, d, noise),
        )

    return case


def of_gain(case: Case, G: Array) -> Array:
    """Return the covariance after an update with any gain (4-23)."""
    left = np.eye(len(case.normal)) - G
    return np.asarray(left @ case.covariance @ left.T + G @ case.noise @ G.T)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("seed", range(3))
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


@given(seed=seeds, d=dimensions)
def test_newtons_multiplier_gives_the_same(draw: Callable[..., Case], seed: int, d: int) -> None:
    case = draw(seed, d)
    G = constrained_gain(*case, newton_multiplier(*case))
    normal = case.normal + G @ (case.measured - case.normal)
    # Near the pole the gain is large, and its rounding too.
    close = 1e-9 * max(1.0, float(np.abs(G).max()))
    np.testing.assert_allclose(normal, constrained_update(*case).normal, rtol=0, atol=close)


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("seed", range(2))
class TestSpecialCases:
    def test_agreement(self, draw: Callable[..., Case], d: int, seed: int) -> None:
        case = draw(seed, d)._replace(measured=draw(seed, d).normal)
        updated = constrained_update(*case)
        np.testing.assert_allclose(updated.normal, case.normal, rtol=0, atol=1e-15)
        expected = np.linalg.inv(np.linalg.inv(case.covariance) + np.linalg.inv(case.noise))
        np.testing.assert_allclose(updated.covariance, expected, rtol=1e-9, atol=1e-12)
        assert newton_multiplier(*case) == 0.0

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


OBLIQUE = {
    2: ((150.0, 40.0), (40.0, 80.0)),
    3: ((150.0, 40.0, 0.0), (40.0, 80.0, 10.0), (0.0, 10.0, 120.0)),
}


def literal_step(n: Array, P: Array, sample: Sample, params: Any) -> tuple[Array, Array]:
    """Return the thesis' step, equation by equation; the multiplier by bisection."""
    d, K = len(n), np.array(params.stiffness)
    T, rho = params.period, params.smallest_radius
    v = sample.nominal_velocity + np.linalg.solve(K, sample.force_rate)  # (4-3)
    F, speed = sample.force, np.linalg.norm(v)
    N = F - v * (v @ F) / (v @ v)  # (4-6)
    push, drag = np.linalg.norm(N), np.linalg.norm(F - N)
    u_F, u_Fdot, k_min = params.force_noise, params.force_rate_noise, np.linalg.eigvalsh(K)[0]
    u = math.hypot(  # (4-18)
        u_F / (math.sqrt(3) * push),
        u_Fdot / (k_min * math.sqrt(3)) * (push + drag) / (speed * push),
    )
    Q = (speed * T / rho) ** 2 / 3 * np.eye(d)  # (4-20)
    R = u**2 / 3 * np.eye(d)  # (4-21)
    P_d, e = P + Q, N / push - n  # (4-24)

    def gain(multiplier: float) -> Array:  # (4-26)
        left = P_d - multiplier * np.outer(n, e)
        return np.asarray(left @ np.linalg.inv(P_d + R + multiplier * np.outer(e, e)))

    s = e @ np.linalg.inv(P_d + R) @ e
    multiplier = brentq(
        lambda m: np.linalg.norm(n + gain(m) @ e) - 1, -0.9 / s, 9 / s, xtol=1e-14 / s, rtol=1e-14
    )
    G = gain(multiplier)
    left = np.eye(d) - G
    return n + G @ e, left @ P_d @ left.T + G @ R @ G.T


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("solver", ["closed_form", "newton"])
def test_a_long_run_as_printed(d: int, solver: Any) -> None:
    params = ResolvedSurfaceObserverParams(
        kind="thesis",
        stiffness=OBLIQUE[d],
        force_noise=0.8,
        force_rate_noise=4.0,
        smallest_radius=0.6,
        initial_deviation=0.15,
        period=0.04,
    )
    observer = ConstrainedFilter(params, solver)
    random = np.random.default_rng(d)
    n, P = np.eye(d)[-1], 0.15**2 * np.eye(d)
    memory = observer.start(n)
    for _ in range(100):
        force = 10 * (np.eye(d)[-1] + 0.3 * random.standard_normal(d))
        sample = Sample(
            force, 5 * random.standard_normal(d), np.zeros(d), 0.3 * random.standard_normal(d)
        )
        n, P = literal_step(n, P, sample, params)
        found = observer.update(memory, sample)
        memory = found.memory
        np.testing.assert_allclose(found.normal, n, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.covariance, P, rtol=0, atol=1e-9)
        assert found.status is NormalStatus.MEASURED


def moving(d: int, **changes: Any) -> Sample:
    """Return a sample of a slide along the first axis, force and rates as given."""
    fields = {
        "force": 20 * np.eye(d)[-1],
        "force_rate": np.zeros(d),
        "nominal_position": np.zeros(d),
        "nominal_velocity": 0.2 * np.eye(d)[0],
    }
    return Sample(**{**fields, **changes})


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("kind", ["gated", "prior_weights"])
def test_halted_and_gated_nothing_changes(slides: Any, d: int, kind: ObserverKind) -> None:
    observer, halt = slides.observer(d, kind=kind), 1e-3 * np.eye(d)[0]
    slide = slides.disturb(20 * [moving(d)], 1)
    halted = slides.disturb(100 * [moving(d, nominal_velocity=halt)], 0)
    before, after = (slides.follow(observer, one) for one in (slide, slide + halted))
    np.testing.assert_array_equal(after.memory, before.memory)
    np.testing.assert_array_equal(after.normals[-1], before.normals[-1])
    np.testing.assert_array_equal(after.covariances[-1], before.covariances[-1])
    assert set(after.statuses[20:]) == {NormalStatus.HALTED}
    faster = observer.update(before.memory, moving(d, nominal_velocity=1.01 * halt))
    assert faster.status is not NormalStatus.HALTED


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(
    ("force", "velocity", "status"),
    [
        (2.9, 0.2, NormalStatus.NO_CONTACT),
        (20.0, 0.099, NormalStatus.STUCK),
        (0.0, 0.2, NormalStatus.NO_CONTACT),
    ],
)
def test_without_a_measurement_only_the_covariance_grows(
    slides: Any, d: int, force: float, velocity: float, status: NormalStatus
) -> None:
    observer = slides.observer(d, kind="gated")
    memory = slides.follow(observer, slides.disturb(20 * [moving(d)], 1)).memory
    before = observer.update(memory, moving(d, nominal_velocity=np.zeros(d)))
    rate = np.full(d, 0.01)
    sample = moving(
        d, force=force * np.eye(d)[-1], nominal_velocity=velocity * np.eye(d)[0], force_rate=rate
    )
    found = observer.update(memory, sample)
    assert found.status is status
    np.testing.assert_array_equal(found.normal, before.normal)
    v = sample.nominal_velocity + rate / 100
    Q = (v @ v) * (0.05 / 0.75) ** 2 / 3 * np.eye(d)
    np.testing.assert_allclose(found.covariance - before.covariance, Q, rtol=1e-9, atol=1e-15)


@pytest.mark.parametrize("kind", ["gated", "prior_weights"])
def test_sample_or_prior_divides_the_force(slides: Any, kind: ObserverKind) -> None:
    observer, sample, n = slides.observer(2, kind=kind), moving(2), np.array([0.6, 0.8])
    prior = n if kind == "prior_weights" else np.zeros(2)
    up, u = instantaneous_normal(sample.force, sample.nominal_velocity, 1.0, 0.05, prior)
    P = (0.1**2 + (0.2 * 0.05 / 0.75) ** 2 / 3) * np.eye(2)
    expected = constrained_update(n, P, up, u**2 / 3 * np.eye(2))
    found = observer.update(observer.start(n), sample)
    np.testing.assert_allclose(found.covariance, expected.covariance, rtol=1e-9)


NONE = {"force_noise": 0.0, "force_rate_noise": 0.0}


@pytest.mark.parametrize("kind", ["thesis", "gated"])
def test_statuses_of_exact_samples(slides: Any, kind: ObserverKind) -> None:
    observer = slides.observer(2, kind=kind, **NONE)
    memory = observer.start(np.array([0.0, 1.0]))

    def status(**changes: Any) -> NormalStatus:
        return observer.update(memory, moving(2, **changes)).status

    still = np.array([-20.0, 0.0])  # K times the nominal velocity, so that the point stays
    assert status() is NormalStatus.MEASURED
    assert status(force_rate=still) is NormalStatus.STUCK
    assert status(force_rate=still * (1 + 1e-10)) is NormalStatus.STUCK  # rounding
    assert status(force_rate=still * (1 + 1e-8)) is NormalStatus.MEASURED
    assert status(force=np.zeros(2)) is NormalStatus.NO_CONTACT
    assert status(force=np.array([3.0, 0.0])) is NormalStatus.UNDEFINED
    assert status(nominal_velocity=np.zeros(2)) is (
        NormalStatus.HALTED if kind == "gated" else NormalStatus.STUCK
    )


@given(seed=st.integers(0, 2**32 - 1), d=dimensions, exponent=st.floats(-16, 0))
def test_rotation_between(slides: Any, seed: int, d: int, exponent: float) -> None:
    random = np.random.default_rng(seed)
    a = slides.unit(random, d)
    b = a + 10.0**exponent * random.standard_normal(d)
    b /= np.linalg.norm(b)
    R = rotation_between(a, b)
    size = 1 / (1 + a @ b)
    np.testing.assert_allclose(R @ a, b, rtol=0, atol=1e-14 * size)
    np.testing.assert_allclose(R @ R.T, np.eye(d), rtol=0, atol=1e-14 * size)
    assert np.linalg.det(R) == pytest.approx(1, abs=1e-13 * size)
    # The smallest: the angle of R is the one between the vectors.
    cosine = np.trace(R) / 2 if d == 2 else (np.trace(R) - 1) / 2
    assert cosine == pytest.approx(a @ b, abs=1e-13 * size)


def test_rotation_between_opposite_vectors() -> None:
    a = np.array([0.0, 0.6, 0.8])
    with pytest.raises(ParameterError, match=r"^predicted_normal is .*less than a half turn from"):
        rotation_between(a, -a)


def test_prediction_turns_the_covariance_along(slides: Any) -> None:
    random = np.random.default_rng(5)
    observer = slides.observer(3, kind="gated")
    before, after = slides.unit(random, 3), slides.unit(random, 3)
    P = np.diag([0.04, 0.01, 0.09])  # the filter's own is hardly ever so uneven
    memory = np.concatenate([slides.unit(random, 3), P.ravel(), before])
    halt = moving(3, nominal_velocity=np.zeros(3))
    kept = observer.update(memory, halt)
    turned = observer.update(memory, halt._replace(predicted_normal=after))
    R = rotation_between(before, after)
    np.testing.assert_allclose(turned.normal, R @ kept.normal, rtol=0, atol=1e-12)
    expected = R @ kept.covariance @ R.T
    np.testing.assert_allclose(turned.covariance, expected, rtol=0, atol=1e-14)
    assert np.abs(expected - kept.covariance).max() > 0.01


def test_tangential_deviation() -> None:
    n = np.array([0.0, 0.6, 0.8])
    across, other = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.8, -0.6])
    P = 9 * np.outer(n, n) + 0.04 * np.outer(across, across) + 0.01 * np.outer(other, other)
    assert tangential_deviation(n, P) == pytest.approx(0.2, rel=1e-12)
    n, t = np.array([0.6, 0.8]), np.array([0.8, -0.6])
    P = 9 * np.outer(n, n) + 0.04 * np.outer(t, t)
    assert tangential_deviation(n, P) == pytest.approx(0.2, rel=1e-12)
    for d in (2, 3):
        assert tangential_deviation(np.eye(d)[0], -1e-20 * np.eye(d)) == 0.0


@pytest.mark.parametrize(
    "surface", [Wave(wavelengths=(2.0,)), Parabola(coefficients=(0.05, -0.2))]
)
@pytest.mark.parametrize("kind", ["thesis", "gated"])
def test_exact_without_noise(slides: Any, surface: Surface, kind: ObserverKind) -> None:
    # Section 5.2.2, Fig. 5-5: the estimate is exact and P zero, whatever the friction.
    d, friction = surface.dimension, SurfaceFriction(coefficient=0.5, ripple=0.3)
    slide = slides.make(surface, slides.lead(d, heading=0.4), 6.0, friction=friction)
    found = slides.follow(slides.observer(d, kind=kind, **NONE), slide.samples)
    sliding = slide.modes == SLIP
    assert np.count_nonzero(sliding) > 60
    assert np.degrees(slides.angles(found.normals, slide.normals)[sliding].max()) < 1e-9
    assert np.abs(found.covariances[sliding]).max() < 1e-25
    assert np.all(found.statuses[sliding] == NormalStatus.MEASURED)
