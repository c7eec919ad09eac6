"""The force's rate against a ramp, the filter's closed form and the noise that comes through."""

import math
import re

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from chamfer.models.validation import ParameterError
from chamfer.systems.sensing.force_rate import ForceRate, ForceRateParams

PARAMS = ForceRateParams(time_constant=0.1)
PERIOD = 0.005  # s


def test_rate_of_a_ramp() -> None:
    builder = DiagramBuilder()
    slope = np.array([[3.0], [-7.0]])
    ramp = PiecewisePolynomial.FirstOrderHold([0.0, 5.0], np.hstack([0 * slope, 5 * slope]))
    source = builder.AddSystem(TrajectorySource(ramp))
    block = builder.AddSystem(ForceRate(PARAMS, dimension=2, period=PERIOD))
    builder.Connect(source.get_output_port(), block.get_input_port())
    log = LogVectorOutput(block.get_output_port(), builder, PERIOD)
    diagram = builder.Build()
    simulator = Simulator(diagram)
    simulator.AdvanceTo(1.0)
    data = log.FindLog(simulator.get_context())
    time, rate = data.sample_times(), data.data().T
    # The sampled filter's exact answer: the rate approaches the slope with the time constant.
    expected = (1 - np.exp(-time / PARAMS.time_constant))[:, None] * slope.T
    np.testing.assert_allclose(rate[1:-1], expected[1:-1], atol=1e-9)


def test_noise_gain() -> None:
    noise = np.random.default_rng(1).normal(size=200_000)
    filtered, rates = 0.0, np.empty_like(noise)
    for k, force in enumerate(noise.tolist()):
        step = PARAMS.share(PERIOD) * (force - filtered)
        filtered, rates[k] = filtered + step, step / PERIOD
    assert np.std(rates[1000:]) == pytest.approx(PARAMS.noise_gain(PERIOD), rel=0.01)


def test_not_finite() -> None:
    block = ForceRate(PARAMS, dimension=2, period=PERIOD)
    context = block.CreateDefaultContext()
    block.get_input_port().FixValue(context, [0.0, math.nan])
    message = re.escape("measured_force is [0.0, nan], allowed: finite numbers")
    with pytest.raises(ParameterError, match=message):
        block.get_output_port().Eval(context)
