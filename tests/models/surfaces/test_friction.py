"""Friction from place to place."""

import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.validation import ParameterError

VARIED = SurfaceFriction(
    coefficient=0.9, ripple=0.2, wavelength=0.7, jump=-0.5, jump_at=0.3, jump_width=0.05
)


def test_the_same_everywhere_by_default() -> None:
    friction = SurfaceFriction()
    for p in (np.zeros(2), np.array([5.0, -3.0, 1.0])):
        assert friction.at(p) == 1.0
        np.testing.assert_array_equal(friction.gradient(p), np.zeros(len(p)))


@pytest.mark.parametrize(
    ("x", "value"), [(0.0, 0.8), (0.25, 1.1), (0.5, 0.8), (0.75, 0.5), (1.25, 0.5)]
)
def test_ripple(x: float, value: float) -> None:
    friction = SurfaceFriction(coefficient=0.8, ripple=0.3)
    if x == 1.25:
        friction = dataclasses.replace(friction, wavelength=5 / 3)
    assert friction.at(np.array([x, 9.0])) == pytest.approx(value, abs=1e-15)


def test_jump() -> None:
    friction = SurfaceFriction(coefficient=1.0, jump=-0.4, jump_at=2.0, jump_width=0.1)
    values = [friction.at(np.array([x, 0.0])) for x in (-5.0, 1.8, 2.0, 2.2, 9.0)]
    done = 0.5 * (1 - math.tanh(2))  # of the jump, two widths before its middle
    expected = [1.0, 1 - 0.4 * done, 0.8, 0.6 + 0.4 * done, 0.6]
    np.testing.assert_allclose(values, expected, atol=1e-15)
    assert values[1] - values[3] == pytest.approx(0.96 * 0.4, abs=2e-3)


@given(x=st.floats(-1, 1), d=st.sampled_from([2, 3]))
def test_gradient(x: float, d: int) -> None:
    p, across = np.full(d, x), np.eye(d)
    differences = [
        (VARIED.at(p + 1e-6 * axis) - VARIED.at(p - 1e-6 * axis)) / 2e-6 for axis in across
    ]
    np.testing.assert_allclose(VARIED.gradient(p), differences, atol=1e-7)


@given(
    x=st.floats(-20, 20),
    ripple=st.floats(0, 1),
    jump=st.floats(-2, 2),
    width=st.floats(1e-3, 1),
)
def test_never_negative(x: float, ripple: float, jump: float, width: float) -> None:
    least = ripple - min(jump, 0.0)
    friction = SurfaceFriction(coefficient=least, ripple=ripple, jump=jump, jump_width=width)
    assert friction.at(np.array([x, 0.0])) >= 0


@pytest.mark.parametrize(
    ("changes", "allowed"),
    [
        ({"coefficient": -0.1}, "a finite number >= 0, so that friction is nowhere negative"),
        ({"coefficient": math.nan}, "a finite number >= 0, so that friction is nowhere negative"),
        ({"coefficient": math.inf}, "a finite number >= 0, so that friction is nowhere negative"),
        ({"ripple": -0.1}, "a finite number >= 0"),
        ({"wavelength": 0.0}, "a finite number > 0"),
        ({"jump": math.nan}, "a finite number"),
        ({"jump_at": math.inf}, "a finite number"),
        ({"jump_width": 0.0}, "a finite number > 0"),
    ],
)
def test_errors(changes: dict[str, float], allowed: str) -> None:
    ((name, value),) = changes.items()
    message = re.escape(f"{name} is {value!r}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        SurfaceFriction(**changes)


def test_ripple_and_jump_count_together() -> None:
    allowed = re.escape("coefficient is 0.6, allowed: a finite number >= 0.7, so that")
    with pytest.raises(ParameterError, match=f"^{allowed}"):
        SurfaceFriction(coefficient=0.6, ripple=0.2, jump=-0.5)
    SurfaceFriction(coefficient=0.7, ripple=0.2, jump=-0.5)
    SurfaceFriction(coefficient=0.2, ripple=0.2, jump=0.5)
