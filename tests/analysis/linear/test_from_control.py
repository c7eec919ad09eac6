from typing import Any

import control
import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.primitives import LinearSystem, MatrixGain

from chamfer.analysis.linear.from_control import from_control
from chamfer.analysis.linear.to_control import to_control
from chamfer.models.validation import ParameterError


@pytest.mark.parametrize("dt", [0, 0.05])
def test_there_and_back_nothing_changes(dt: float) -> None:
    there = control.ss([[-0.5, 1], [0, -0.25]], [[0, 1], [2, 0]], [[1, 1]], [[0, 0.5]], dt)
    there.name = "plant"
    block = from_control(there)
    assert block.get_name() == "plant"
    back = to_control(block)
    for name in ("A", "B", "C", "D"):
        assert np.array_equal(getattr(back, name), getattr(there, name))
    assert (back.dt, back.name) == (dt, "plant")


def test_a_transfer_function_answers_as_python_control_says() -> None:
    lag = control.tf([2.0], [0.5, 1.0])
    block = from_control(lag)
    assert isinstance(block, LinearSystem)
    assert block.time_period() == 0.0
    context = block.CreateDefaultContext()
    block.get_input_port().FixValue(context, [1.0])
    Simulator(block, context).AdvanceTo(0.7)
    expected = control.step_response(lag, [0.0, 0.7]).outputs[-1]
    assert block.get_output_port().Eval(context)[0] == pytest.approx(expected, rel=1e-3)


def test_a_gain_needs_no_states() -> None:
    block = from_control(control.tf([3.0], [1.0]))
    assert isinstance(block, MatrixGain)
    assert np.array_equal(block.D(), [[3.0]])


@pytest.mark.parametrize(
    ("system", "message"),
    [
        (control.tf([1, 0, 0], [1, 1]), r"^zeros is 2, allowed: at most as many as poles, 1$"),
        (control.tf([1], [1, 1], True), r"^dt is True, allowed: a period"),
        (control.ss([[np.nan]], [[1]], [[1]], 0), r"^system is .*, allowed: finite real numbers"),
        (control.frd([1, 2], [1, 2]), r"^system is 'FrequencyResponseData', allowed: a StateSp"),
        (
            control.tf([[[1], [1]]], [[[1, 1], [1, 2]]]),
            r"^transfer function is .*, allowed: one input and one output",
        ),
        (1.0, r"^system is 'float', allowed"),
    ],
)
def test_what_is_no_block_is_refused_in_one_line(system: Any, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        from_control(system)
