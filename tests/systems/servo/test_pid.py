import math
from collections.abc import Sequence

import control
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import Adder, ConstantVectorSource, DiscreteTimeDelay, LinearSystem
from scipy.signal import lfilter

from chamfer.systems.servo.pid import PidParams, make_pid
from chamfer.systems.servo.sampled_pid import PidGains, SampledPid, SampledPidParams, tuned_gains
from chamfer.systems.servo.settling import SettlingPlant, sample_plant

PAPER = PidParams()
TEXTBOOK = PidParams(proportional=2.0, integral=3.0, derivative=0.5, filter=40.0)


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


def test_defaults_are_the_gains_of_equation_2() -> None:
    assert PidParams() == PidParams(
        proportional=341.0, integral=21903.0, derivative=-0.00853, filter=39971.0
    )


PERIOD = 1 / 80
NAN = math.nan

numbers = st.floats(-5.0, 5.0)
gains = st.floats(0.0, 10.0)


def answer(
    axes: Sequence[PidGains],
    errors: Sequence[Sequence[float]],
    valid: Sequence[float] | None = None,
    period: float = PERIOD,
) -> np.ndarray:
    """What the block puts out after every one of its ticks, shape (ticks, axes)."""
    block = SampledPid(SampledPidParams(axes=tuple(axes), period=period))
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    found = []
    for k, error in enumerate(errors):
        block.GetInputPort("error").FixValue(context, error)
        if valid is not None:
            block.GetInputPort("valid").FixValue(context, [valid[k]])
        simulator.AdvanceTo((k + 0.5) * period)
        found.append(np.array(block.GetOutputPort("compensation").Eval(context)))
    return np.array(found)


def single(gain: PidGains, errors: Sequence[float], **more: Sequence[float]) -> np.ndarray:
    return answer([gain], [[error] for error in errors], **more)[:, 0]  # type: ignore[arg-type]


def difference_equation(gain: PidGains, errors: Sequence[float], period: float) -> np.ndarray:
    """C(z) = P + I T z/(z - 1) + D (z - 1)/(T z); there is no difference at the first sample."""
    integral, derivative = gain.integral * period, gain.derivative / period
    numerator = [gain.proportional + integral + derivative, -gain.proportional - 2 * derivative]
    filtered = lfilter([*numerator, derivative], [1.0, -1.0], errors)
    filtered[0] -= derivative * errors[0]
    return np.asarray(filtered)


# The law


@settings(max_examples=30, deadline=None)
@given(
    gain=st.builds(PidGains, proportional=gains, integral=gains, derivative=gains),
    errors=st.lists(numbers, min_size=1, max_size=20),
    period=st.sampled_from([PERIOD, 0.1, 1.0]),
)
def test_is_the_difference_equation(gain: PidGains, errors: list[float], period: float) -> None:
    found = answer([gain], [[error] for error in errors], period=period)[:, 0]
    expected = difference_equation(gain, errors, period)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-8)


def test_every_axis_has_gains_of_its_own() -> None:
    axes = [
        PidGains(proportional=1.0, integral=0.0),
        PidGains(proportional=0.0, integral=80.0),
        PidGains(proportional=0.0, integral=0.0, derivative=PERIOD),
    ]
    found = answer(axes, [[1.0, 2.0, 3.0], [4.0, 5.0, 7.0]])
    np.testing.assert_allclose(found, [[1.0, 2.0, 0.0], [4.0, 7.0, 4.0]], rtol=1e-12)


def test_acts_at_its_ticks_only_and_at_the_first_at_once() -> None:
    block = SampledPid(SampledPidParams(axes=(PidGains(proportional=1.0, integral=0.0),)))
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    output = block.GetOutputPort("compensation")
    block.GetInputPort("error").FixValue(context, [1.0])
    assert output.Eval(context)[0] == 0.0
    simulator.AdvanceTo(0.5 * PERIOD)
    assert output.Eval(context)[0] == 1.0
    block.GetInputPort("error").FixValue(context, [2.0])
    simulator.AdvanceTo(0.9 * PERIOD)
    assert output.Eval(context)[0] == 1.0
    simulator.AdvanceTo(1.1 * PERIOD)
    assert output.Eval(context)[0] == 2.0
    assert not block.HasAnyDirectFeedthrough()


# What is not measured


ALL = PidGains(proportional=2.0, integral=8.0, derivative=0.25)


@settings(max_examples=30, deadline=None)
@given(
    before=st.lists(numbers, min_size=1, max_size=4),
    gap=st.lists(st.sampled_from([1e3, NAN, math.inf, -math.inf]), min_size=1, max_size=4),
    after=st.lists(numbers, min_size=1, max_size=4),
)
def test_holds_over_a_gap_and_goes_on_without_a_kick(
    before: list[float], gap: list[float], after: list[float]
) -> None:
    valid = [1.0] * len(before) + [0.0] * len(gap) + [1.0] * len(after)
    found = single(ALL, before + gap + after, valid=valid)
    n, m = len(before), len(before) + len(gap)
    assert (found[n:m] == found[n - 1]).all()
    # As if the law had started anew with the integral part that it had.
    earned = ALL.integral * PERIOD * sum(before)
    expected = earned + difference_equation(ALL, after, PERIOD)
    np.testing.assert_allclose(found[m:], expected, rtol=1e-9, atol=1e-8)


# Limits


@settings(max_examples=30, deadline=None)
@given(
    gain=st.builds(
        PidGains, proportional=gains, integral=gains, derivative=gains, limit=st.just(1.0)
    ),
    errors=st.lists(numbers, min_size=1, max_size=12),
    last=st.floats(0.01, 5.0),
)
def test_keeps_the_limit_and_leaves_it_at_once(
    gain: PidGains, errors: list[float], last: float
) -> None:
    # However long an error lasted: when it has turned, the total is inside again, by its part.
    for sign in (1.0, -1.0):
        held = [sign * max(abs(error), 0.01) for error in errors]
        found = single(gain, [*held, -sign * last])
        assert (np.abs(found) <= 1.0).all()
        back = (gain.proportional + gain.integral * PERIOD) * last
        assert sign * found[-1] <= 1.0 - min(back, 2.0) + 1e-9


def test_the_integral_part_does_not_grow_beyond_the_limit() -> None:
    gain = PidGains(proportional=1.0, integral=80.0, limit=10.0)
    found = single(gain, [3.0] * 9 + [-1.0] * 3)
    # The third sample would make 9 + 3 > 10: it is not added. Then 6 - 1 - 1, and one less a time.
    np.testing.assert_allclose(found, [6.0, 9.0, *[9.0] * 7, 4.0, 3.0, 2.0], rtol=1e-12)


def test_a_falling_error_does_not_wind_it_up_behind_the_derivative() -> None:
    gain = PidGains(proportional=0.0, integral=80.0, derivative=20 * PERIOD, limit=10.0)
    found = single(gain, [9.0, 8.0, 8.0, -1.0, -1.0])
    # At the second sample 9 + 8 - 20 is inside the limits; 17 alone is not.
    np.testing.assert_allclose(found, [9.0, -10.0, 10.0, -10.0, 9.0], rtol=1e-12)


# In a loop


@pytest.mark.parametrize("latency", [0, 2])
def test_a_loop_with_a_lag_is_that_of_python_control(latency: int) -> None:
    gain = PidGains(proportional=1.5, integral=9.0, derivative=0.02)
    lag, count = 0.2, 60
    plant = LinearSystem([[-1 / lag]], [[1 / lag]], [[1.0]], [[0.0]])
    builder = DiagramBuilder()
    pid = builder.AddSystem(SampledPid(SampledPidParams(axes=(gain,))))
    builder.AddSystem(plant)
    goal = builder.AddSystem(ConstantVectorSource([1.0]))
    # Minus the output, as old as an image.
    less = builder.AddSystem(LinearSystem([], [], [], [[-1.0]]))
    error = builder.AddSystem(Adder(2, 1))
    builder.Connect(pid.GetOutputPort("compensation"), plant.get_input_port())
    builder.Connect(plant.get_output_port(), less.get_input_port())
    measured = less.get_output_port()
    if latency:
        delay = builder.AddSystem(DiscreteTimeDelay(PERIOD, latency - 1, 1))
        builder.Connect(measured, delay.get_input_port())
        measured = delay.get_output_port()
    builder.Connect(goal.get_output_port(), error.get_input_port(0))
    builder.Connect(measured, error.get_input_port(1))
    builder.Connect(error.get_output_port(), pid.GetInputPort("error"))
    diagram = builder.Build()
    simulator = Simulator(diagram)
    found = []
    for k in range(count):
        simulator.AdvanceTo(k * PERIOD)
        context = plant.GetMyContextFromRoot(simulator.get_context())
        found.append(plant.get_output_port().Eval(context)[0])

    z = control.tf("z")
    z.dt = PERIOD
    law = gain.proportional + gain.integral * PERIOD * z / (z - 1)
    law += gain.derivative / PERIOD * (z - 1) / z
    sampled = control.sample_system(control.tf([1.0], [lag, 1.0]), PERIOD, "zoh")
    closed = control.feedback(law * sampled, 1 / z**latency)
    errors = np.ones(count)
    response = control.forced_response(closed, inputs=errors).outputs
    # The block knows no difference at its first sample, the transfer function that from 0.
    first = np.zeros(count)
    first[0] = gain.derivative / PERIOD
    kick = control.feedback(sampled, law / z**latency)
    response -= control.forced_response(kick, inputs=first).outputs
    np.testing.assert_allclose(found, response, rtol=0, atol=1e-5)


# Tuning


def lag_behind_dead_time(gain: float, tau: float, samples: int) -> SettlingPlant:
    plant = LinearSystem([[-1 / tau]], [[gain / tau]], [[1.0]], [[0.0]])
    return sample_plant(plant, PERIOD, delay_samples=samples)


@pytest.mark.parametrize("samples", [0, 2, 5])
@pytest.mark.parametrize("tau", [0.04, 0.125, 0.5, 2.0])
@pytest.mark.parametrize("closed_loop", [0.05, 0.3])
def test_tuning_is_simc_for_a_lag_behind_a_dead_time(
    samples: int, tau: float, closed_loop: float
) -> None:
    gain, theta = 2000.0, (samples + 0.5) * PERIOD  # half a period of the hold
    found = tuned_gains(
        lag_behind_dead_time(gain, tau, samples), closed_loop=closed_loop, period=PERIOD
    )
    proportional = tau / (gain * (closed_loop + theta))
    integral_time = min(tau, 4 * (closed_loop + theta))
    # The response is taken for straight between samples: 1.5 % at three samples a time constant.
    assert found.proportional == pytest.approx(proportional, rel=0.02 if tau < 0.1 else 0.002)
    assert found.integral == pytest.approx(proportional / integral_time, rel=0.01)
    assert found.derivative == 0.0


@pytest.mark.parametrize("closed_loop", [0.06, 0.2])
def test_tuned_loop_has_the_wanted_time_constant_and_a_good_margin(closed_loop: float) -> None:
    tau, samples = 0.125, 2
    found = tuned_gains(
        lag_behind_dead_time(1.0, tau, samples), closed_loop=closed_loop, period=PERIOD
    )
    z = control.tf("z")
    z.dt = PERIOD
    sampled = control.sample_system(control.tf([1.0], [tau, 1.0]), PERIOD, "zoh")
    loop = (found.proportional + found.integral * PERIOD * z / (z - 1)) * sampled / z**samples
    omega = np.linspace(0.1, math.pi / PERIOD, 2000)
    assert np.abs(1 / (1 + loop(np.exp(1j * omega * PERIOD)))).max() < 1.7  # SIMC: 1.59
    response = control.step_response(control.feedback(loop, 1), 1.5)
    arrived = np.interp(1 - math.exp(-1), response.outputs, response.time)
    theta = (samples + 0.5) * PERIOD
    assert arrived == pytest.approx(closed_loop + theta, rel=0.15)
    assert response.outputs.max() < 1.05


# What is refused
