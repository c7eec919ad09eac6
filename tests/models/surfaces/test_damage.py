"""The damage limits of appendix C."""

import math
import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from chamfer.models.surfaces.damage import (
    IMPACT_SPEEDS,
    SAFE_SPEED,
    SCRATCH_FORCE,
    impact_speed_limit,
)
from chamfer.models.validation import ParameterError


def test_published_numbers() -> None:
    assert SCRATCH_FORCE == 5.0
    assert SAFE_SPEED == 0.20
    for mass, speed in ((14, 0.99), (28, 0.99), (85, 0.63), (140, 0.44), (185, 0.44)):
        assert impact_speed_limit(mass * 1e-3) == pytest.approx(speed, rel=1e-12)


def test_between_and_beyond_the_masses_tested() -> None:
    assert impact_speed_limit(0.0565) == pytest.approx((0.99 + 0.63) / 2)
    assert impact_speed_limit(0.1125) == pytest.approx((0.63 + 0.44) / 2)
    assert impact_speed_limit(0.020) == pytest.approx(0.99)
    assert impact_speed_limit(1e-9) == 0.99
    assert impact_speed_limit(1e9) == 0.44


masses = st.floats(1e-4, 1.0)


@given(light=masses, heavy=masses)
def test_a_heavier_nugget_has_to_be_slower(light: float, heavy: float) -> None:
    light, heavy = sorted((light, heavy))
    assert impact_speed_limit(light) >= impact_speed_limit(heavy)


def test_safe_speed_is_below_half_of_every_limit() -> None:
    assert min(speed for _, speed in IMPACT_SPEEDS) / 2 > SAFE_SPEED


@pytest.mark.parametrize("mass", [0.0, -0.1, math.nan, math.inf])
def test_mass_has_to_be_positive(mass: float) -> None:
    message = re.escape(f"mass is {mass}, allowed: a finite number > 0")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        impact_speed_limit(mass)
