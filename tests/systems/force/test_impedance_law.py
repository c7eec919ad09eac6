"""Damping design, stability of sampled modes, and the rotational springs."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from chamfer.systems.force.impedance_controller import (
    all_finite,
    gradient,
    modal_damping,
    rotation_vector,
    stable_damping_ratios,
)

Array = np.ndarray

seeds = st.integers(0, 2**32 - 1)


def positive(rng: np.random.Generator, n: int) -> Array:
    root = rng.standard_normal((n, n))
    return root @ root.T + 0.2 * np.eye(n)


# Damping


def test_damping_of_one_mode() -> None:
    damping, frequencies = modal_damping(np.array([[700.0]]), np.array([[2.0]]), 0.7)
    assert frequencies[0] == pytest.approx(math.sqrt(350), rel=1e-12)
    assert damping[0, 0] == pytest.approx(2 * 0.7 * math.sqrt(700 * 2.0), rel=1e-12)


@given(seed=seeds, ratio=st.floats(0.1, 0.9))
def test_every_mode_has_the_ratio(seed: int, ratio: float) -> None:
    rng = np.random.default_rng(seed)
    stiffness, inertia = positive(rng, 6), positive(rng, 6)
    damping, frequencies = modal_damping(stiffness, inertia, ratio)
    np.testing.assert_allclose(damping, damping.T, rtol=0, atol=1e-9 * np.abs(damping).max())
    inverse = np.linalg.inv(inertia)
    system = np.block([[np.zeros((6, 6)), np.eye(6)], [-inverse @ stiffness, -inverse @ damping]])
    poles = np.linalg.eigvals(system)
    np.testing.assert_allclose(-poles.real / np.abs(poles), ratio, rtol=1e-5)
    found = np.sort(np.abs(poles))[::2]
    np.testing.assert_allclose(found, frequencies, rtol=1e-6)


# Stability of a sampled mode


def one_period(frequency: float, ratio: float, period: float, steps: int) -> float:
    """Spectral radius over a period with the force held and v before x."""
    h = period / steps
    k, d = frequency**2, 2 * ratio * frequency
    columns = []
    for x, v in ((1.0, 0.0), (0.0, 1.0)):
        force = -k * x - d * v
        for _ in range(steps):
            v += h * force
            x += h * v
        columns.append((x, v))
    return float(np.abs(np.linalg.eigvals(np.transpose(columns))).max())


frequencies = st.floats(1.0, 1000.0)
steps = st.sampled_from([1, 2, 3, 50])


@given(frequency=frequencies, part=st.floats(0.02, 0.98), n=steps, product=st.floats(0.01, 1.4))
def test_stable_between_the_bounds(frequency: float, part: float, n: int, product: float) -> None:
    period = product / frequency
    low, high = stable_damping_ratios(frequency, period)
    assert low < high
    assert one_period(frequency, low + part * (high - low), period, n) < 1


@given(frequency=frequencies, excess=st.floats(1.01, 3.0), product=st.floats(0.01, 1.4))
def test_unstable_above_the_upper_bound(frequency: float, excess: float, product: float) -> None:
    period = product / frequency
    _, high = stable_damping_ratios(frequency, period)
    assert one_period(frequency, excess * high, period, 1) > 1
    # With more steps the bound is 2 Lambda/period less a part of the stiffness' share.
    for n in (2, 50):
        exact = (2 - product**2 / (2 * n)) / (2 * product)
        assert one_period(frequency, excess * exact, period, n) > 1
        assert high <= exact


@given(frequency=frequencies, part=st.floats(0.0, 0.95), product=st.floats(0.1, 1.4))
def test_unstable_below_the_lower_bound(frequency: float, part: float, product: float) -> None:
    period = product / frequency
    low, _ = stable_damping_ratios(frequency, period)
    assert one_period(frequency, part * low, period, 1000) > 1


@given(frequency=frequencies, product=st.floats(math.sqrt(2) * 1.0001, 5.0))
def test_no_damping_is_enough_for_a_mode_that_is_too_fast(
    frequency: float, product: float
) -> None:
    low, high = stable_damping_ratios(frequency, product / frequency)
    assert not low < high


def test_bound_is_twice_the_inertia_over_the_period() -> None:
    mass, frequency, period = 0.4, 20.0, 1e-4
    _, high = stable_damping_ratios(frequency, period)
    assert 2 * high * frequency * mass == pytest.approx(2 * mass / period, rel=1e-5)


# Rotation

angles = st.floats(0.0, math.pi)


def quaternion(rotation: Rotation) -> Array:
    return np.asarray(rotation.as_quat(scalar_first=True))


def direction(seed: int) -> Array:
    vector = np.random.default_rng(seed).standard_normal(3)
    return np.asarray(vector / np.linalg.norm(vector))


@settings(deadline=None)  # the first call compiles
@given(seed=seeds, angle=angles, signs=st.tuples(*2 * [st.sampled_from([-1, 1])]))
def test_rotation_vector_in_the_first_axes(
    seed: int, angle: float, signs: tuple[int, int]
) -> None:
    vector = angle * direction(seed)
    start = Rotation.random(rng=np.random.default_rng(seed))
    end = start * Rotation.from_rotvec(vector)
    found = rotation_vector(signs[0] * quaternion(start), signs[1] * quaternion(end))
    assert np.linalg.norm(found) <= math.pi + 1e-12
    if angle < math.pi - 1e-6:
        np.testing.assert_allclose(found, vector, rtol=0, atol=1e-9)
    else:
        turned = (Rotation.from_rotvec(found) * Rotation.from_rotvec(-vector)).magnitude()
        assert turned < 1e-9


@pytest.mark.parametrize("axis", range(3))
def test_half_a_turn(axis: int) -> None:
    end = np.zeros(4)
    end[1 + axis] = 1.0
    found = rotation_vector(np.array([1.0, 0.0, 0.0, 0.0]), end)
    np.testing.assert_allclose(np.abs(found), math.pi * end[1:], rtol=0, atol=1e-15)


def test_no_rotation() -> None:
    same = np.array([0.5, -0.5, 0.5, 0.5])
    np.testing.assert_array_equal(rotation_vector(same, same), np.zeros(3))
    np.testing.assert_array_equal(rotation_vector(same, -same), np.zeros(3))


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1e-4, 1.9e-3, 2.1e-3, 0.3, 1.5, 3.0, math.pi - 1e-6])
def test_moment_is_the_gradient_of_the_energy(angle: float) -> None:
    stiffness = np.array([2.0, 5.0, 11.0])
    vector = angle * direction(3)
    end = Rotation.from_rotvec(vector)

    def energy(turned: Rotation) -> float:
        return float(stiffness @ rotation_vector(np.eye(4)[0], quaternion(turned)) ** 2 / 2)

    step = 1e-6
    # Turned about the axes of the desired pose, in which the moment is told.
    turns = [Rotation.from_rotvec(step * axis) for axis in np.eye(3)]
    slope = [(energy(turn * end) - energy(turn.inv() * end)) / (2 * step) for turn in turns]
    if angle < math.pi - 1e-5:
        np.testing.assert_allclose(gradient(vector, stiffness * vector), slope, rtol=0, atol=1e-7)
    assert np.isfinite(gradient(vector, stiffness * vector)).all()


@settings(deadline=None)  # the first call compiles
@given(seed=seeds, angle=angles)
def test_equal_springs_pull_along_the_rotation(seed: int, angle: float) -> None:
    vector = angle * direction(seed)
    np.testing.assert_allclose(gradient(vector, 5.0 * vector), 5.0 * vector, rtol=0, atol=1e-12)


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
def test_finite(bad: float) -> None:
    good = [np.ones(14), np.ones(7), np.full(6, 1e308)]
    assert all_finite(*good)
    for i, vector in enumerate(good):
        for k in (0, len(vector) - 1):
            spoilt = [value.copy() for value in good]
            spoilt[i][k] = bad
            assert not all_finite(*spoilt)
