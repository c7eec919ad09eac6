"""The constrained filter step by step (section 4.3): its formulas, gates and predictions."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import brentq

from chamfer.models.surfaces.graphs import Parabola, Paraboloid
from chamfer.models.surfaces.rounds import Circle
from chamfer.models.validation import ParameterError
from chamfer.systems.estimation.normal_filter import (
    ConstrainedFilter,
    ConstrainedFilterParams,
    Sample,
    Status,
    rotation_between,
    tangential_deviation,
)

Array = np.ndarray
dimensions = st.sampled_from([2, 3])
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
def test_a_long_run_as_printed(slides: Any, d: int, solver: Any) -> None:
    params = ConstrainedFilterParams(
        stiffness=OBLIQUE[d],
        force_noise=0.8,
        force_rate_noise=4.0,
        smallest_radius=0.6,
        initial_deviation=0.15,
        period=0.04,
        solver=solver,
    )
    observer = ConstrainedFilter(params)
    random = np.random.default_rng(d)
    n, P = np.eye(d)[-1], 0.15**2 * np.eye(d)
    memory = observer.start(n)
    for _ in range(300):
        force = 10 * (np.eye(d)[-1] + 0.3 * random.standard_normal(d))
        sample = Sample(
            force, 5 * random.standard_normal(d), np.zeros(d), 0.3 * random.standard_normal(d)
        )
        n, P = literal_step(n, P, sample, params)
        found = observer.update(memory, sample)
        memory = found.memory
        np.testing.assert_allclose(found.normal, n, rtol=0, atol=1e-9)
        np.testing.assert_allclose(found.covariance, P, rtol=0, atol=1e-9)
        assert found.status is Status.MEASURED


kinds_of_sample = st.sampled_from(["slide", "noise", "no force", "no motion", "parallel", "large"])


@settings(deadline=None, max_examples=15)
@given(
    d=dimensions,
    seed=st.integers(0, 2**32 - 1),
    kinds=st.lists(kinds_of_sample, min_size=10, max_size=40),
    gated=st.booleans(),
    weights=st.sampled_from(["sample", "prior"]),
    solver=st.sampled_from(["closed_form", "newton"]),
    silent=st.booleans(),
)
@pytest.mark.filterwarnings("error")
def test_norm_and_covariance_over_random_runs(
    slides: Any, d: int, seed: int, kinds: list[str], silent: bool, **changes: Any
) -> None:
    noise = {"force_noise": 0.0, "force_rate_noise": 0.0} if silent else {}
    observer = ConstrainedFilter(ConstrainedFilterParams(**{**slides.told(d), **noise}, **changes))
    random = np.random.default_rng(seed)
    draw = random.standard_normal
    memory = observer.start(np.eye(d)[-1])
    for kind in 5 * kinds:
        force, velocity = 10 * draw(d), 0.3 * draw(d)
        samples = {
            "slide": Sample(10 * np.eye(d)[-1] + draw(d), 3 * draw(d), draw(d), velocity),
            "noise": Sample(0.5 * draw(d), 3 * draw(d), draw(d), np.zeros(d)),
            "no force": Sample(np.zeros(d), np.zeros(d), draw(d), velocity),
            "no motion": Sample(force, np.zeros(d), draw(d), np.zeros(d)),
            "parallel": Sample(force, np.zeros(d), draw(d), -0.05 * force),
            "large": Sample(1e6 * force, 1e6 * draw(d), draw(d), 1e6 * velocity),
        }
        found = observer.update(memory, samples[kind])
        memory = found.memory
        assert abs(float(np.linalg.norm(found.normal)) - 1) < 1e-12
        P = found.covariance
        largest = float(np.abs(P).max())
        np.testing.assert_allclose(P, P.T, rtol=0, atol=1e-15 * largest)
        assert np.linalg.eigvalsh(P)[0] >= -1e-13 * largest
        if kind in ("no force", "no motion", "parallel"):
            assert found.status is not Status.MEASURED


@pytest.mark.parametrize("d", [2, 3])
def test_newton_is_the_closed_form(slides: Any, d: int) -> None:
    surface = Parabola() if d == 2 else Paraboloid()
    samples = slides.disturb(slides.make(surface, slides.lead(d), 14.0).samples, 1)
    runs = [
        slides.follow(
            ConstrainedFilter(ConstrainedFilterParams(**slides.told(d), solver=solver)),
            samples,
        )
        for solver in ("closed_form", "newton")
    ]
    np.testing.assert_allclose(runs[1].normals, runs[0].normals, rtol=0, atol=1e-11)
    np.testing.assert_allclose(runs[1].covariances, runs[0].covariances, rtol=0, atol=1e-11)


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
@pytest.mark.parametrize("weights", ["sample", "prior"])
def test_halted_and_gated_nothing_changes(slides: Any, d: int, weights: Any) -> None:
    params = ConstrainedFilterParams(**slides.told(d), gated=True, weights=weights)
    halted = slides.disturb(
        100 * [moving(d, nominal_velocity=params.halt_speed * np.eye(d)[0])], 0
    )
    before = slides.follow(ConstrainedFilter(params), slides.disturb(20 * [moving(d)], 1))
    after = slides.follow(ConstrainedFilter(params), slides.disturb(20 * [moving(d)], 1) + halted)
    np.testing.assert_array_equal(after.memory, before.memory)
    np.testing.assert_array_equal(after.normals[-1], before.normals[-1])
    np.testing.assert_array_equal(after.covariances[-1], before.covariances[-1])
    assert set(after.statuses[20:]) == {Status.HALTED}
    faster = moving(d, nominal_velocity=1.01 * params.halt_speed * np.eye(d)[0])
    assert ConstrainedFilter(params).update(before.memory, faster).status is not Status.HALTED


def test_halted_and_not_gated_the_estimate_drifts(slides: Any) -> None:
    # Section 4.4.1 does not hold with noise: what the thesis' filter then measures is noise.
    slide = slides.make(
        Parabola(), slides.legs([0, -0.1], [(15.0, [0.2, 0]), (5.0, [0, 0])]), 20.0
    )
    drifts, gated = [], []
    for seed in range(12):
        samples = slides.disturb(slide.samples, seed)
        for found, is_gated in ((drifts, False), (gated, True)):
            run = slides.follow(
                ConstrainedFilter(ConstrainedFilterParams(**slides.told(2), gated=is_gated)),
                samples,
            )
            found.append(slides.angles(run.normals[-1:], run.normals[300:301])[0])
    assert 4 < math.degrees(math.sqrt(np.mean(np.square(drifts)))) < 12  # 7.4 deg over many
    assert gated == [0.0] * 12


@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize(
    ("force", "velocity", "status"),
    [(2.9, 0.2, Status.NO_CONTACT), (20.0, 0.099, Status.STUCK), (0.0, 0.2, Status.NO_CONTACT)],
)
def test_without_a_measurement_only_the_covariance_grows(
    slides: Any, d: int, force: float, velocity: float, status: Status
) -> None:
    params = ConstrainedFilterParams(**slides.told(d), gated=True)
    observer = ConstrainedFilter(params)
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


@pytest.mark.parametrize("gated", [False, True])
def test_statuses_of_exact_samples(slides: Any, gated: bool) -> None:
    observer = ConstrainedFilter(
        ConstrainedFilterParams(
            stiffness=slides.stiffness(2), force_noise=0.0, force_rate_noise=0.0, gated=gated
        )
    )
    memory = observer.start(np.array([0.0, 1.0]))

    def status(**changes: Any) -> Status:
        return observer.update(memory, moving(2, **changes)).status

    still = np.array([-20.0, 0.0])  # K times the nominal velocity, so that the point stays
    assert status() is Status.MEASURED
    assert status(force_rate=still) is Status.STUCK
    assert status(force_rate=still * (1 + 1e-10)) is Status.STUCK  # rounding
    assert status(force_rate=still * (1 + 1e-8)) is Status.MEASURED
    assert status(force=np.zeros(2)) is Status.NO_CONTACT
    assert status(force=np.array([3.0, 0.0])) is Status.UNDEFINED
    assert status(nominal_velocity=np.zeros(2)) is (Status.HALTED if gated else Status.STUCK)


# Predicted normals


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1), d=dimensions, exponent=st.floats(-16, 0))
def test_rotation_between(
    random_unit: Callable[..., Array], seed: int, d: int, exponent: float
) -> None:
    random = np.random.default_rng(seed)
    a = random_unit(random, d)
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


def test_predicted_surface_is_followed_without_lag(slides: Any) -> None:
    # In a bowl, with a bound that forbids to turn: exact samples then only confirm.
    slide = slides.make(Circle(centre=(0.0, 2.0), radius=2.0, inside=True), slides.lead(2), 6.0)
    observer = ConstrainedFilter(
        ConstrainedFilterParams(**slides.told(2), smallest_radius=1e3, gated=True)
    )
    touching = slice(4, None)
    lagging = slides.follow(observer, slide.samples[touching], slide.normals[4])
    assert np.degrees(slides.angles(lagging.normals, slide.normals[touching]).max()) > 5
    offset = 0.3  # only how the prediction turns counts
    R = np.array([[math.cos(offset), -math.sin(offset)], [math.sin(offset), math.cos(offset)]])
    for turn in (np.eye(2), R):
        samples = [
            sample._replace(predicted_normal=turn @ normal)
            for sample, normal in zip(
                slide.samples[touching], slide.normals[touching], strict=True
            )
        ]
        found = slides.follow(observer, samples, slide.normals[4])
        errors = slides.angles(found.normals, slide.normals[touching])
        assert errors.max() < 1e-9


def test_prediction_turns_the_covariance_along(
    slides: Any, random_unit: Callable[..., Array]
) -> None:
    random = np.random.default_rng(5)
    params = ConstrainedFilterParams(**slides.told(3), gated=True)
    observer = ConstrainedFilter(params)
    before, after = random_unit(random, 3), random_unit(random, 3)
    P = np.diag([0.04, 0.01, 0.09])  # the filter's own is hardly ever so uneven
    memory = np.concatenate([random_unit(random, 3), P.ravel(), before])
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
