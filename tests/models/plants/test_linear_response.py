import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.models.plants.linear_response import fastest_mode, free_response


@given(count=st.integers(1, 70), size=st.integers(1, 5), seed=st.integers(0, 1000))
def test_states_are_the_powers_times_the_initial_state(count: int, size: int, seed: int) -> None:
    generator = np.random.default_rng(seed)
    transition = generator.normal(size=(size, size)) / (2 * size)
    initial = generator.normal(size=size)
    found = free_response(transition, initial, count)
    assert found.shape == (size, count)
    state = initial
    for k in range(count):
        np.testing.assert_allclose(found[:, k], state, rtol=1e-9, atol=1e-12)
        state = transition @ state


def test_a_rotation_keeps_its_radius_for_long() -> None:
    angle = 1e-3
    rotation = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
    found = free_response(rotation, np.array([0.0, 1.0]), 100_000)
    np.testing.assert_allclose(found[0], np.sin(angle * np.arange(100_000)), atol=1e-9)


def test_powers_beyond_the_count_are_not_formed() -> None:
    with np.errstate(over="raise"):
        found = free_response(np.array([[1e30]]), np.ones(1), 9)
    assert found[0, -1] == pytest.approx(1e240)


@pytest.mark.parametrize(
    ("sizes", "fastest"),
    [
        ([1.0, 0.02, 9.0], 50.0),
        ([1.0, 0.005, 9.0], 1.0),  # too small to be seen, whatever is constant
        ([0.001, 0.0, 1.0], 1.0),
    ],
)
def test_the_fastest_mode_is_one_that_shows(sizes: list[float], fastest: float) -> None:
    turned = np.array([[1.0, 2.0, 0.0], [0.0, 1.0, 3.0], [1.0, 0.0, 1.0]])  # other coordinates
    dynamics = turned @ np.diag([-1.0, -50.0, 0.0]) @ np.linalg.inv(turned)
    output, initial = np.ones(3) @ np.linalg.inv(turned), turned @ np.array(sizes)
    assert fastest_mode(dynamics, output, initial) == pytest.approx(fastest)


@pytest.mark.parametrize(
    ("dynamics", "fastest"),
    [
        ([[0.0, 1.0], [-100.0, -2.0]], 10.0),  # an oscillation: how far its pole is from zero
        ([[0.0, 0.0], [0.0, 0.0]], 0.0),  # what stands still
        ([[-3.0, 1.0], [0.0, -3.0]], 3.0),  # poles that coincide
    ],
)
def test_modes_that_are_not_alone(dynamics: list[list[float]], fastest: float) -> None:
    found = fastest_mode(np.array(dynamics), np.array([1.0, 0.0]), np.ones(2))
    assert found == pytest.approx(fastest)
