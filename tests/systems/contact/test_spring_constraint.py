import math
from typing import Any

import numpy as np
import pytest

from chamfer.models.validation import ParameterError
from chamfer.systems.contact.spring_constraint import SpringConstraint, SpringConstraintParams


def wrench(displacement: dict[int, float], **params: Any) -> list[float]:
    block = SpringConstraint(SpringConstraintParams(**params))
    context = block.CreateDefaultContext()
    value = np.zeros(6)
    for index, x in displacement.items():
        value[index] = x
    block.GetInputPort("displacement").FixValue(context, value)
    found: list[float] = block.GetOutputPort("wrench").Eval(context).tolist()
    return found


@pytest.mark.parametrize(
    ("sides", "x", "force"),
    [
        ("both", 0.002, -2.0),
        ("both", -0.002, 2.0),
        ("one", 0.002, -2.0),
        ("one", -0.002, 0.0),
        ("none", 0.002, 0.0),
        ("none", -0.002, 0.0),
    ],
)
@pytest.mark.parametrize("index", [0, 3, 5])
def test_it_pushes_back_along_its_axis_on_its_sides(
    index: int, sides: str, x: float, force: float
) -> None:
    found = wrench({index: x, (index + 1) % 6: 0.5}, index=index, sides=sides, stiffness=1000.0)
    expected = np.zeros(6)
    expected[index] = force
    np.testing.assert_allclose(found, expected, atol=1e-15)


@pytest.mark.parametrize(("x", "force"), [(0.0005, 0.0), (0.001, 0.0), (0.003, -2.0), (-1.0, 0.0)])
def test_a_stop_begins_where_it_is(x: float, force: float) -> None:
    found = wrench({3: x}, index=3, sides="one", stiffness=1000.0, stop_at=0.001)
    assert found[3] == pytest.approx(force, abs=1e-12)


def test_the_wrench_follows_a_changed_displacement() -> None:
    block = SpringConstraint(SpringConstraintParams(index=3, stiffness=1000.0))
    context = block.CreateDefaultContext()
    for x in (0.001, 0.002):
        block.GetInputPort("displacement").FixValue(context, [0, 0, 0, x, 0, 0])
        assert block.GetOutputPort("wrench").Eval(context)[3] == pytest.approx(-1000 * x)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"sides": "left"}, "sides is 'left', allowed: none, both, one"),
        ({"stiffness": -1.0}, "stiffness is -1.0, allowed: a finite number >= 0"),
        ({"stop_at": math.nan}, "stop_at is nan, allowed: a finite number"),
        ({"index": 6}, "index is 6, allowed: a whole number from 0 to 5"),
        ({"index": -1}, "index is -1, allowed: a whole number from 0 to 5"),
        ({"index": 3.5}, "index is 3.5, allowed: a whole number from 0 to 5"),
    ],
)
def test_parameters_out_of_range_are_refused(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        SpringConstraintParams(**values)


def test_without_an_index_there_is_no_constraint() -> None:
    with pytest.raises(ParameterError, match=r"^index is None, allowed: a whole number from 0 to"):
        SpringConstraint(SpringConstraintParams())


@pytest.mark.parametrize("sides", ["none", "both", "one"])
def test_a_displacement_that_is_not_finite_is_named(sides: str) -> None:
    with pytest.raises(ParameterError, match="displacement is nan, allowed: a finite number"):
        wrench({3: math.nan}, index=3, sides=sides)
