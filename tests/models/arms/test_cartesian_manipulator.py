"""The sampled manipulator against scipy's discretisation, closed forms and exact rationals."""

import math
from fractions import Fraction
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.linalg import expm
from scipy.signal import cont2discrete

from chamfer.models.arms.cartesian_manipulator import (
    CartesianManipulatorParams,
    cartesian_kinematics,
    sampled_dynamics,
)
from chamfer.models.validation import ParameterError

HEAVY = CartesianManipulatorParams(mass=3.0, damping=7.0)


def continuous(params: CartesianManipulatorParams, d: int) -> tuple[np.ndarray, np.ndarray]:
    """Return A and B of (5-7), written down row by row."""
    A, B = np.zeros((2 * d, 2 * d)), np.zeros((2 * d, d))
    for i in range(d):
        A[i, d + i] = 1.0
        A[d + i, d + i] = -params.damping / params.mass
        B[d + i, i] = 1 / params.mass
    return A, B


# Discretisation


@pytest.mark.parametrize("step", [1e-4, 1e-3, 0.05, 0.5, 4.0])
@pytest.mark.parametrize("d", [2, 3])
@pytest.mark.parametrize("params", [CartesianManipulatorParams(), HEAVY])
def test_is_the_zero_order_hold(params: CartesianManipulatorParams, d: int, step: float) -> None:
    A, B = continuous(params, d)
    states, inputs = B.shape
    C, D = np.eye(states), np.zeros((states, inputs))
    expected_A, expected_B, *_ = cont2discrete((A, B, C, D), step, method="zoh")
    found = sampled_dynamics(params, step, dimension=d)
    np.testing.assert_allclose(found.A, expected_A, rtol=1e-12, atol=1e-15)
    np.testing.assert_allclose(found.B, expected_B, rtol=1e-12, atol=1e-18)


@given(
    mass=st.floats(0.1, 10.0),
    damping=st.floats(0.0, 50.0),
    step=st.floats(1e-4, 0.1),
)
def test_is_the_matrix_exponential(mass: float, damping: float, step: float) -> None:
    params = CartesianManipulatorParams(mass=mass, damping=damping)
    A, B = continuous(params, 2)
    both = np.zeros((6, 6))
    both[:4, :4], both[:4, 4:] = A, B
    found = sampled_dynamics(params, step, dimension=2)
    np.testing.assert_allclose(np.hstack(found), expm(both * step)[:4], rtol=1e-11, atol=1e-16)


@given(exponent=st.floats(-9, 1.3), step=st.sampled_from([1e-3, 1.0]))
def test_position_is_exact_for_any_damping(exponent: float, step: float) -> None:
    # (z - 1 + exp(-z)) / z^2 by its series in exact arithmetic: no digit cancels, not even for
    # almost no damping, and both branches meet.
    z = 10**exponent
    exact, term = Fraction(0), Fraction(1, 2)
    for k in range(3, 120):
        exact += term
        term *= -Fraction(z) / k
    params = CartesianManipulatorParams(mass=1.0, damping=z / step)
    found = sampled_dynamics(params, step, dimension=2).B[0, 0] / step**2
    assert found == pytest.approx(float(exact), rel=1e-14, abs=0)


def test_free_flight_and_constant_force() -> None:
    # Without damping it is a fall, with it the velocity tends to u / b.
    undamped = CartesianManipulatorParams(mass=2.0, damping=0.0)
    A, B = sampled_dynamics(undamped, 3.0, dimension=2)
    np.testing.assert_array_equal(A @ [1.0, 0, 0.5, 0] + B @ [4.0, 0], [1 + 1.5 + 9, 0, 6.5, 0])
    A, B = sampled_dynamics(CartesianManipulatorParams(), 1e3, dimension=2)
    moved = A @ [0, 0, 1.0, 0] + B @ [0, 5.0]
    # m v / b further from the speed it had; behind u t / b by m / b of its own.
    np.testing.assert_allclose(moved, [0.05, 0.5 * (1e3 - 0.05), 0, 0.5], rtol=1e-13, atol=1e-300)


def test_two_steps_are_one_twice_as_long() -> None:
    A, B = sampled_dynamics(HEAVY, 0.02, dimension=3)
    twice = sampled_dynamics(HEAVY, 0.04, dimension=3)
    np.testing.assert_allclose(A @ A, twice.A, rtol=1e-13)
    np.testing.assert_allclose(A @ B + B, twice.B, rtol=1e-13)


def test_axes_are_decoupled() -> None:
    A, B = sampled_dynamics(HEAVY, 0.02, dimension=3)
    for i in range(3):
        others = [j for j in range(6) if j % 3 != i]
        assert not np.any(A[np.ix_([i, i + 3], others)])
        assert not np.any(B[[i, i + 3]][:, [j for j in range(3) if j != i]])


@pytest.mark.parametrize("step", [0.0, -1e-3, math.nan, math.inf])
def test_step_has_to_be_positive(step: float) -> None:
    with pytest.raises(ParameterError, match=rf"^step is {step}, allowed: a finite number > 0$"):
        sampled_dynamics(CartesianManipulatorParams(), step, dimension=2)


# Parameters


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"mass": 0.0}, "mass is 0.0, allowed: a finite number > 0"),
        ({"mass": math.inf}, "mass is inf, allowed: a finite number > 0"),
        ({"damping": -1.0}, "damping is -1.0, allowed: a finite number >= 0"),
        ({"damping": math.nan}, "damping is nan, allowed: a finite number >= 0"),
    ],
)
def test_parameters(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        CartesianManipulatorParams(**changes)
    assert str(caught.value) == message


# Kinematics


@pytest.mark.parametrize(("dimension", "axes"), [(2, ("x", "y")), (3, ("x", "y", "z"))])
def test_joints_are_the_endpoint(dimension: int, axes: tuple[str, ...]) -> None:
    kinematics = cartesian_kinematics(dimension)
    assert kinematics.joint_names == kinematics.coordinates == axes
    assert kinematics.coordinate_units == ("m",) * dimension
    assert kinematics.num_joints == kinematics.num_coordinates == dimension
    q = np.array([0.3, -0.7, 2.0])[:dimension]
    np.testing.assert_array_equal(kinematics.endpoint(q), q)
    np.testing.assert_array_equal(kinematics.jacobian(q), np.eye(dimension))


@pytest.mark.parametrize("dimension", [2, 3])
def test_jacobian_is_the_complex_step(dimension: int) -> None:
    kinematics, step = cartesian_kinematics(dimension), 1e-30
    q = np.array([0.3, -0.7, 2.0])[:dimension]
    columns = [kinematics.endpoint(q + 1j * step * axis).imag / step for axis in np.eye(dimension)]
    np.testing.assert_array_equal(np.transpose(columns), kinematics.jacobian(q + 1j * step))


def test_endpoint_is_a_value_of_its_own() -> None:
    # Positions are often a view into a Context.
    q = np.array([1.0, 2.0])
    x = cartesian_kinematics(2).endpoint(q)
    q[0] = 5.0
    assert x[0] == 1.0


@pytest.mark.parametrize("dimension", [0, 1, 4])
def test_dimension_is_2_or_3(dimension: int) -> None:
    with pytest.raises(ParameterError, match=rf"^dimension is {dimension}, allowed: 2, 3$"):
        cartesian_kinematics(dimension)
