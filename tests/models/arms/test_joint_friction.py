"""The joints' friction law against its closed form and its limits."""

import dataclasses
import math
import re

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.models.arms.arm import JointFrictionParams
from chamfer.models.validation import ParameterError

PARAMS = JointFrictionParams(coulomb=(2.0, 0.5), breakaway=1.4, stribeck=0.1, viscous=(1.0, 0.0))
speeds = st.floats(-10.0, 10.0)


def test_breakaway_fades_to_coulomb() -> None:
    np.testing.assert_allclose(PARAMS.dry(np.zeros(2)), [2.8, 0.7], rtol=1e-15)
    np.testing.assert_allclose(PARAMS.dry(np.full(2, 1e3)), [2.0, 0.5], rtol=1e-15)
    # At the Stribeck speed 1/e of the excess is left.
    expected = np.array([2.0, 0.5]) * (1 + 0.4 / math.e)
    np.testing.assert_allclose(PARAMS.dry(np.array([0.1, -0.1])), expected, rtol=1e-15)


@given(slow=speeds, fast=speeds)
def test_falls_with_the_speed_within_its_limits(slow: float, fast: float) -> None:
    slow, fast = sorted((slow, fast), key=abs)
    more, less = PARAMS.dry(np.array([slow, slow])), PARAMS.dry(np.array([fast, fast]))
    assert np.all(more >= less)
    assert np.all(less >= PARAMS.coulomb)
    assert np.all(more <= 1.4 * np.array(PARAMS.coulomb) * (1 + 1e-15))
    np.testing.assert_array_equal(more, PARAMS.dry(np.array([-slow, -slow])))


def test_without_excess_is_constant() -> None:
    plain = JointFrictionParams(coulomb=(3.0,), breakaway=1.0, viscous=(0.0,))
    np.testing.assert_array_equal(plain.dry(np.linspace(-1, 1, 9)[:, None]), np.full((9, 1), 3.0))


def test_takes_a_whole_history() -> None:
    history = np.linspace(-0.3, 0.3, 14).reshape(7, 2)
    expected = [PARAMS.dry(row) for row in history]
    np.testing.assert_array_equal(PARAMS.dry(history), expected)


def test_viscous_friction_is_not_part_of_it() -> None:
    other = dataclasses.replace(PARAMS, viscous=(9.0, 9.0))
    np.testing.assert_array_equal(other.dry(np.ones(2)), PARAMS.dry(np.ones(2)))


MANY = "finite numbers >= 0, one a joint"


@pytest.mark.parametrize(
    ("changes", "allowed"),
    [
        ({"coulomb": (-1.0, 0.0)}, MANY),
        ({"coulomb": (math.nan, 0.0)}, MANY),
        ({"coulomb": (1.0, math.inf)}, MANY),
        ({"coulomb": ()}, MANY),
        ({"viscous": (0.0, -1e-9)}, MANY),
        ({"viscous": (math.nan, 1.0)}, MANY),
        ({"viscous": ()}, MANY),
        ({"viscous": (1.0,)}, "2 numbers"),
        ({"viscous": (1.0, 1.0, 1.0)}, "2 numbers"),
        ({"breakaway": 0.99}, "a finite number >= 1"),
        ({"breakaway": math.nan}, "a finite number >= 1"),
        ({"breakaway": math.inf}, "a finite number >= 1"),
        ({"stribeck": 0.0}, "a finite number > 0"),
        ({"stribeck": math.nan}, "a finite number > 0"),
        ({"stribeck": math.inf}, "a finite number > 0"),
    ],
)
def test_errors(changes: dict[str, object], allowed: str) -> None:
    ((name, value),) = changes.items()
    message = re.escape(f"{name} is {value!r}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        dataclasses.replace(PARAMS, **changes)


def test_params_are_frozen_and_by_keyword() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        PARAMS.stribeck = 1.0  # type: ignore[misc]
    with pytest.raises(TypeError):
        JointFrictionParams((1.0,), viscous=(1.0,))  # type: ignore[misc]
