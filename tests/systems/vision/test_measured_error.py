"""The measured error: resolution, latency, loss of sight and noise, each alone."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context, DiagramBuilder
from pydrake.systems.primitives import TrajectorySource, ZeroOrderHold
from pydrake.trajectories import PiecewisePolynomial

from chamfer.systems.vision.measured_error import MeasuredError, MeasuredErrorParams


def fix(block: MeasuredError, context: Context, **ports: list[float]) -> None:
    for name, value in ports.items():
        block.GetInputPort(name).FixValue(context, value)


def measure(params: MeasuredErrorParams, **ports: list[float]) -> list[float]:
    """Return the error for constant inputs; only without latency."""
    block = MeasuredError(params)
    context = block.CreateDefaultContext()
    fix(block, context, **ports)
    error: list[float] = block.GetOutputPort("error").Eval(context).tolist()
    return error


@settings(deadline=None)
@given(
    error=st.floats(-10, 10),
    resolution=st.sampled_from([0.0, 0.005, 0.3]),
    noise=st.sampled_from([0.0, 0.002, 0.5]),
    sample=st.floats(0, 1, exclude_max=True),
)
def test_is_never_off_by_more_than_its_bound(
    error: float, resolution: float, noise: float, sample: float
) -> None:
    params = MeasuredErrorParams(resolution=resolution, noise=noise)
    (measured,) = measure(
        params, desired_trajectory=[error], actual_trajectory=[0.0], noise=[sample]
    )
    assert abs(measured - error) <= params.bound + 1e-12
    if resolution:
        assert measured / resolution == pytest.approx(round(measured / resolution), abs=1e-9)


def test_each_axis_is_desired_minus_actual_shifted_by_noise_of_its_own() -> None:
    measured = measure(
        MeasuredErrorParams(size=3, noise=0.2),
        desired_trajectory=[1.0, 2.0, -0.5],
        actual_trajectory=[0.25, 5.0, -0.5],
        noise=[0.0, 0.75, 1.0],
    )
    assert measured == pytest.approx([0.75 - 0.2, -3.0 + 0.1, 0.2], abs=1e-15)
    assert MeasuredErrorParams(resolution=0.25, noise=0.5).bound == 0.625


def test_noise_without_a_source_is_an_error_and_a_source_without_noise_is_not() -> None:
    trajectories = {"desired_trajectory": [1.0], "actual_trajectory": [0.0]}
    with pytest.raises(RuntimeError, match="noise"):
        measure(MeasuredErrorParams(noise=0.1), **trajectories)
    assert measure(MeasuredErrorParams(), noise=[0.9], **trajectories) == [1.0]


@pytest.mark.parametrize(
    ("visible", "seen"), [(0.0, False), (0.49, False), (0.5, True), (1.0, True), (math.nan, False)]
)
def test_is_nan_while_invisible(visible: float, seen: bool) -> None:
    error = measure(
        MeasuredErrorParams(size=2, resolution=0.25),
        desired_trajectory=[1.0, 0.5 if seen else math.nan],
        actual_trajectory=[0.0, 0.0],
        visible=[visible],
    )
    if seen:
        assert error == [1.0, 0.5]
    else:
        assert np.isnan(error).all()


@pytest.mark.parametrize("port", ["desired_trajectory", "actual_trajectory"])
@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_input_that_is_not_finite_raises_with_name_and_time(port: str, value: float) -> None:
    block = MeasuredError(MeasuredErrorParams(size=2))
    block.set_name("computer vision")
    context = block.CreateDefaultContext()
    context.SetTime(1.25)
    inputs = {"desired_trajectory": [1.0, 1.0], "actual_trajectory": [0.0, 0.0]}
    fix(block, context, **{**inputs, port: [0.0, value]})
    with pytest.raises(
        ValueError,
        match=r"^computer vision: desired_trajectory minus actual_trajectory is .* "
        r"at t = 1\.25 s, must be finite$",
    ):
        block.GetOutputPort("error").Eval(context)


def arrivals(params: MeasuredErrorParams, count: int) -> list[float]:
    """Return the error as a block that samples at the camera's instants gets them.

    The true error at sample k is k; the part is out of sight at samples 5 and 6.
    """
    builder = DiagramBuilder()
    block = builder.AddSystem(MeasuredError(params))
    end = (count + 1) * params.period
    ramp = PiecewisePolynomial.FirstOrderHold([0.0, end], [[0.0, count + 1.0]])
    gap = np.array([0.0, 4.5, 6.5, count + 1]) * params.period
    visible = PiecewisePolynomial.ZeroOrderHold(gap, [[1.0, 0.0, 1.0, 1.0]])
    zero = PiecewisePolynomial([[0.0]])
    for name, trajectory in (
        ("desired_trajectory", ramp),
        ("actual_trajectory", zero),
        ("visible", visible),
    ):
        source = builder.AddSystem(TrajectorySource(trajectory))
        builder.Connect(source.get_output_port(), block.GetInputPort(name))
    hold = builder.AddSystem(ZeroOrderHold(params.period, 1))
    builder.Connect(block.GetOutputPort("error"), hold.get_input_port())
    simulator = Simulator(builder.Build())
    received = []
    for k in range(count):
        simulator.AdvanceTo(k * params.period)
        simulator.AdvancePendingEvents()
        context = hold.GetMyContextFromRoot(simulator.get_context())
        received.append(float(hold.get_output_port().Eval(context)[0]))
    return received


@pytest.mark.parametrize(
    ("share", "delay"),
    [(0.0, 0), (0.1, 1), (0.999, 1), (1.0, 1), (1.001, 2), (1.5, 2), (2.0, 2), (3.2, 4)],
)
def test_latency_is_whole_samples_rounded_up(share: float, delay: int) -> None:
    period = 1 / 80
    params = MeasuredErrorParams(period=period, latency=share * period)
    assert params.delay_samples == delay
    for k, error in enumerate(arrivals(params, 14)):
        taken = k - delay
        if taken < 0 or taken in (5, 6):
            assert math.isnan(error)
        else:
            assert error == pytest.approx(taken)


@given(period=st.sampled_from([1 / 80, 1 / 30, 1 / 60, 0.1, 1e-3, 0.7]), count=st.integers(0, 500))
def test_latency_of_whole_periods_is_not_rounded_up_further(period: float, count: int) -> None:
    assert MeasuredErrorParams(period=period, latency=count * period).delay_samples == count


def test_late_errors_keep_their_axes_and_are_held_between_samples() -> None:
    block = MeasuredError(MeasuredErrorParams(size=2, period=0.1, latency=0.2))
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    port = block.GetOutputPort("error")
    for k in range(6):
        fix(block, context, desired_trajectory=[k, 10.0 + k], actual_trajectory=[0.0, 0.0])
        simulator.AdvanceTo(k * 0.1)
        simulator.AdvancePendingEvents()
        after = port.Eval(context).copy()
        fix(block, context, desired_trajectory=[99.0, 99.0])
        simulator.AdvanceTo(k * 0.1 + 0.06)
        np.testing.assert_array_equal(port.Eval(context), after)
        # After its own update the block already shows what the next sample will get.
        if k >= 1:
            np.testing.assert_array_equal(after, [k - 1, 9.0 + k])
        else:
            assert np.isnan(after).all()


@pytest.mark.parametrize(("latency", "through"), [(0.0, True), (0.001, False)])
def test_feeds_through_only_without_latency(latency: float, through: bool) -> None:
    block = MeasuredError(MeasuredErrorParams(size=2, latency=latency))
    assert block.HasAnyDirectFeedthrough() == through
    for i in range(block.num_input_ports()):
        for j in range(block.num_output_ports()):
            assert block.HasDirectFeedthrough(i, j) == through
