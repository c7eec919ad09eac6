"""Stiffness and damping of a gripper, and what is refused."""

import math
from typing import Any

import pytest

from chamfer.models.arms.gripper import GripperParams
from chamfer.models.validation import ParameterError


def test_one_number_an_axis_each_or_a_matrix() -> None:
    same, own = GripperParams(stiffness=50.0), GripperParams(stiffness=(3.0, 4.0), damping=2.0)
    assert same.matrix(2) == ((50.0, 0.0), (0.0, 50.0))
    assert same.matrix(3)[2] == (0.0, 0.0, 50.0)
    assert same.damping_matrix(2) == ((0.0, 0.0), (0.0, 0.0))
    assert own.matrix(2) == ((3.0, 0.0), (0.0, 4.0))
    assert own.damping_matrix(3)[1] == (0.0, 2.0, 0.0)
    rows = ((3.0, 1.0), (1.0, 4.0))
    assert GripperParams(stiffness=rows).matrix(2) == rows


@pytest.mark.parametrize(
    ("values", "named"),
    [
        ({"stiffness": 0.0}, "stiffness is 0.0, allowed: a number > 0, or positive definite"),
        ({"stiffness": (1.0, -1.0)}, "stiffness is (1.0, -1.0), allowed: a number > 0"),
        ({"stiffness": math.inf}, "stiffness is inf, allowed: a finite number"),
        ({"stiffness": ((1.0, 2.0), (2.0, 1.0))}, "stiffness is ((1.0, 2.0), (2.0, 1.0))"),
        ({"stiffness": ((1.0, 0.5), (0.4, 1.0))}, "stiffness is ((1.0, 0.5), (0.4, 1.0))"),
        ({"stiffness": ((1.0, 0.5), (0.4,))}, "stiffness is ((1.0, 0.5), (0.4,))"),
        ({"stiffness": (1.0,)}, "stiffness is (1.0,), allowed: one number, 2 or 3"),
        ({"damping": -1.0}, "damping is -1.0, allowed: a number >= 0, or positive semidefinite"),
        ({"damping": (math.nan, 0.0)}, "damping is (nan, 0.0), allowed: a finite number"),
    ],
)
def test_what_is_no_gripper_is_refused(values: dict[str, Any], named: str) -> None:
    with pytest.raises(ParameterError) as caught:
        GripperParams(**values)
    assert str(caught.value).startswith(named)


def test_other_dimensions_are_refused() -> None:
    with pytest.raises(ParameterError, match=r"^stiffness is .*, allowed: .*3 rows$"):
        GripperParams(stiffness=(1.0, 2.0)).matrix(3)
