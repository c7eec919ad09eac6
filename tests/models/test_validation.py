"""Parameter checks: what passes, and the one line when it does not."""

import math
import pickle
from dataclasses import dataclass

import pytest

from chamfer.models.validation import (
    ParameterError,
    require_between,
    require_finite,
    require_not_negative,
    require_one_of,
    require_positive,
    require_same,
    require_whole,
    shown,
)


@dataclass(frozen=True)
class Params:
    mass: float = 1.0
    form: str = "position"


NOT_FINITE = (math.nan, math.inf, -math.inf)


@pytest.mark.parametrize(
    ("require", "good", "bad", "allowed"),
    [
        (require_finite, (-1.0, 0.0, 1e300), NOT_FINITE, "a finite number"),
        (require_positive, (5e-324, 1.0), (0.0, -0.0, -1.0, *NOT_FINITE), "a finite number > 0"),
        (require_not_negative, (0.0, 1.0), (-5e-324, -1.0, *NOT_FINITE), "a finite number >= 0"),
        (require_whole, (1, 9), (0, -1, 1.5, *NOT_FINITE), "a whole number >= 1"),
    ],
)
def test_number(require, good: tuple[float, ...], bad: tuple[float, ...], allowed: str) -> None:
    for value in good:
        require(Params(mass=value), "mass")
    for value in bad:
        with pytest.raises(ParameterError) as raised:
            require(Params(mass=value), "mass")
        assert str(raised.value) == f"mass is {value}, allowed: {allowed}"
        assert raised.value.name == "mass"


def test_every_named_field_is_checked() -> None:
    @dataclass(frozen=True)
    class Two:
        first: float = 1.0
        second: float = -1.0

    with pytest.raises(ParameterError, match=r"^second is -1\.0"):
        require_positive(Two(), "first", "second")


def test_limits() -> None:
    require_positive(Params(mass=2.0), "mass", most=2.0)
    with pytest.raises(ParameterError, match=r"^mass is 2\.5, allowed: .* > 0 and <= 2$"):
        require_positive(Params(mass=2.5), "mass", most=2.0)
    require_between(Params(mass=2.0), 1.0, 2.0, "mass")
    for mass in (0.5, 2.5, math.nan):
        with pytest.raises(ParameterError, match=r"allowed: a number from 1 to 2$"):
            require_between(Params(mass=mass), 1.0, 2.0, "mass")


def test_a_large_value_is_shown_in_a_line_at_once() -> None:
    value: tuple[object, ...] = (0.0,) * 10**6
    for _ in range(5):
        value = (value,) * 10
    assert len(shown(value)) < 1000
    assert shown("x" * 10**6) == f"'{'x' * 27}...{'x' * 28}'"


def test_one_of() -> None:
    require_one_of(Params(), "form", ("velocity", "position"))
    with pytest.raises(ParameterError) as raised:
        require_one_of(Params(form="place"), "form", iter(("velocity", "position")))
    assert str(raised.value) == "form is 'place', allowed: velocity, position"


def test_what_nothing_reads_is_as_it_was() -> None:
    require_same(Params(mass=2.0), Params, "arm", "form", why="it doesn't move")
    with pytest.raises(ParameterError) as raised:
        require_same(Params(mass=2.0), Params, "arm", "form", "mass", why="it doesn't move")
    assert str(raised.value) == f"arm.mass is 2.0, allowed: {Params.mass}, it doesn't move"


def test_comes_whole_from_another_process() -> None:
    sent = ParameterError("mass", -1.0, "a number > 0")
    found = pickle.loads(pickle.dumps(sent))
    assert (found.name, found.value, found.allowed) == ("mass", -1.0, "a number > 0")
    assert str(found) == str(sent)
