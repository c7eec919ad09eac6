"""The PID of eq. (2) against its closed-form responses and python-control."""

from collections.abc import Callable

import control
import numpy as np
import pytest
from pydrake.systems.primitives import LinearSystem

from chamfer.systems.servo.pid import PidParams, make_pid

Respond = Callable[..., np.ndarray]
PAPER = PidParams()
TEXTBOOK = PidParams(proportional=2.0, integral=3.0, derivative=0.5, filter=40.0)
CASES = [
    pytest.param(PAPER, np.linspace(0.0, 1e-3, 21), id="paper"),
    pytest.param(TEXTBOOK, np.linspace(0.0, 0.5, 21), id="textbook"),
]


@pytest.mark.parametrize(("params", "times"), CASES)
def test_answers_a_step_in_closed_form(
    respond: Respond, params: PidParams, times: np.ndarray
) -> None:
    decay = np.exp(-params.filter * times)
    expected = (
        params.proportional + params.integral * times + params.derivative * params.filter * decay
    )
    np.testing.assert_allclose(respond(make_pid(params), 1.0, 0.0, times), expected, rtol=1e-8)


@pytest.mark.parametrize(("params", "times"), CASES)
def test_answers_a_ramp_in_closed_form(
    respond: Respond, params: PidParams, times: np.ndarray
) -> None:
    expected = (
        params.proportional * times
        + params.integral * times**2 / 2
        + params.derivative * (1.0 - np.exp(-params.filter * times))
    )
    np.testing.assert_allclose(
        respond(make_pid(params), 0.0, 1.0, times), expected, rtol=1e-7, atol=1e-12
    )


@pytest.mark.parametrize("params", [PAPER, TEXTBOOK], ids=["paper", "textbook"])
def test_has_the_frequency_response_of_equation_2(params: PidParams) -> None:
    s = control.tf("s")
    n = params.filter
    equation = params.proportional + params.integral / s + params.derivative * n / (1 + n / s)
    block = make_pid(params)
    frequencies = np.geomspace(1e-2, 1e3, 60) * n / 40
    np.testing.assert_allclose(
        control.ss(block.A(), block.B(), block.C(), block.D())(1j * frequencies),
        equation(1j * frequencies),
        rtol=1e-9,
    )


def test_each_gain_acts_alone(respond: Respond) -> None:
    times = np.linspace(0.0, 1.0, 6)
    none = {"proportional": 0.0, "integral": 0.0, "derivative": 0.0, "filter": 10.0}

    def step(**gain: float) -> np.ndarray:
        return respond(make_pid(PidParams(**{**none, **gain})), 1.0, 0.0, times)

    np.testing.assert_allclose(step(proportional=2.0), np.full(6, 2.0), atol=1e-9)
    np.testing.assert_allclose(step(integral=2.0), 2.0 * times, atol=1e-9)
    np.testing.assert_allclose(step(derivative=2.0), 20.0 * np.exp(-10 * times), atol=1e-8)


def test_starts_at_rest() -> None:
    block = make_pid(PAPER)
    context = block.CreateDefaultContext()
    block.get_input_port().FixValue(context, [0.0])
    assert block.get_output_port().Eval(context)[0] == 0.0


def test_is_one_linear_block_that_feeds_through() -> None:
    block = make_pid(PAPER)
    assert isinstance(block, LinearSystem)
    assert block.get_name() == "controller"
    assert (block.get_input_port().size(), block.get_output_port().size()) == (1, 1)
    assert block.HasAnyDirectFeedthrough()


def test_defaults_are_the_gains_of_equation_2() -> None:
    assert PidParams() == PidParams(
        proportional=341.0, integral=21903.0, derivative=-0.00853, filter=39971.0
    )


@pytest.mark.parametrize("field", ["proportional", "integral", "derivative"])
@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_gains_have_to_be_finite(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"^{field} is {value}, allowed: a finite number$"):
        PidParams(**{field: value})


@pytest.mark.parametrize("value", [0.0, -1.0, float("nan"), float("inf")])
def test_filter_has_to_be_positive(value: float) -> None:
    with pytest.raises(ValueError, match=rf"^filter is {value}, allowed: a finite number > 0$"):
        PidParams(filter=value)
