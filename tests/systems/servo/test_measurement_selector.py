"""What of an error is let through to a controller."""

import numpy as np
import pytest

from chamfer.models.validation import ParameterError
from chamfer.systems.servo.measurement_selector import MeasurementSelector

ERROR = np.array([3.0, -2.0, 1.0])


def through(opened: tuple[float, float], valid: float = 1.0) -> tuple[np.ndarray, float]:
    block = MeasurementSelector(3)
    context = block.CreateDefaultContext()
    block.GetInputPort("error").FixValue(context, ERROR)
    block.GetInputPort("valid").FixValue(context, [valid])
    block.GetInputPort("open").FixValue(context, opened)
    error = block.GetOutputPort("error").Eval(context)
    return error, float(block.GetOutputPort("valid").Eval(context)[0])


def test_open_it_is_not_there() -> None:
    error, valid = through((1.0, 1.0))
    np.testing.assert_array_equal(error, ERROR)
    assert valid == 1


def test_shut_nothing_is_valid() -> None:
    assert through((0.0, 1.0))[1] == 0


def test_what_is_not_valid_stays_so() -> None:
    assert through((1.0, 1.0), valid=0.0)[1] == 0


def test_the_first_axis_may_be_left_out() -> None:
    error, valid = through((1.0, 0.0))
    np.testing.assert_array_equal(error, [0.0, -2.0, 1.0])
    assert valid == 1


def test_refused() -> None:
    with pytest.raises(ParameterError, match="size is 0, allowed: a whole number >= 1"):
        MeasurementSelector(0)
