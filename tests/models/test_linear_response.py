import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from models.linear_response import free_response


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
