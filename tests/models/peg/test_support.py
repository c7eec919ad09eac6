"""Supports, and two of them in series."""

import math
import re

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.models.peg.support import OpenSupport, Support, in_series
from chamfer.models.validation import ParameterError

ARM = Support(centre_distance=0.0)


@pytest.mark.parametrize("depth", [0.0, 0.012, 0.04])
def test_two_arms_of_the_reference(depth: float) -> None:
    got = in_series(ARM, ARM, depth)
    assert got.lateral_stiffness == pytest.approx(1 / (1 / 200 + depth**2 / 10))
    assert got.angular_stiffness == pytest.approx(2.5)
    assert got.centre_distance == pytest.approx(depth / 2)


def compliance(support: Support, height: float) -> NDArray[np.float64]:
    """Return lateral and angular motion of the tip for a unit of force and of moment there."""
    a = height
    return np.array(
        [
            [1 / support.lateral_stiffness + a**2 / support.angular_stiffness, 0.0],
            [a / support.angular_stiffness, 1 / support.angular_stiffness],
        ]
    ) + np.array([[0.0, a / support.angular_stiffness], [0.0, 0.0]])


def test_compliances_at_the_tip_add() -> None:
    peg = Support(lateral_stiffness=300.0, angular_stiffness=4.0, centre_distance=0.03)
    hole = Support(lateral_stiffness=700.0, angular_stiffness=9.0, centre_distance=0.05)
    depth = 0.02
    both = in_series(peg, hole, depth)
    expected = compliance(peg, 0.03) + compliance(hole, depth - 0.05)
    np.testing.assert_allclose(compliance(both, both.centre_distance), expected, rtol=1e-12)


def test_no_slope_at_a_remote_centre_and_the_largest_in_between() -> None:
    support = Support()
    assert ARM.tilt_per_error == 0.0
    assert Support(centre_distance=1e6).tilt_per_error == pytest.approx(0.0, abs=2e-6)
    at = support.worst_centre_distance
    assert at == pytest.approx(math.sqrt(5 / 400))
    largest = Support(centre_distance=at).tilt_per_error
    assert largest == pytest.approx(1 / (2 * math.sqrt(5 / 400)))
    for distance in np.linspace(0.0, 1.0, 101).tolist():
        assert Support(centre_distance=distance).tilt_per_error <= largest * (1 + 1e-12)


@pytest.mark.parametrize(
    ("name", "value", "allowed"),
    [
        ("lateral_stiffness", 0.0, "a finite number > 0"),
        ("angular_stiffness", math.nan, "a finite number > 0"),
        ("centre_distance", math.inf, "a finite number"),
    ],
)
def test_errors(name: str, value: float, allowed: str) -> None:
    message = re.escape(f"{name} is {value!r}, allowed: {allowed}")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        Support(**{name: value})


def test_what_is_left_open_is_derived() -> None:
    assert OpenSupport().over(ARM) == ARM
    said = OpenSupport(angular_stiffness=7.0).over(ARM)
    assert said == Support(angular_stiffness=7.0, centre_distance=0.0)
    at_tip = OpenSupport(centre_distance=0.0).over(Support())
    assert at_tip.centre_distance == 0.0


@pytest.mark.parametrize("name", ["lateral_stiffness", "angular_stiffness", "centre_distance"])
def test_what_is_said_is_checked(name: str) -> None:
    with pytest.raises(ParameterError, match=rf"^{name} is nan, allowed: a finite number"):
        OpenSupport(**{name: math.nan})
