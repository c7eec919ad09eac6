"""A force and its rate: measured, filtered and differenced, averaged."""

import math
from typing import Any

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from chamfer.models.validation import ParameterError
from chamfer.systems.sensing.force_rate import (
    ForceRate,
    ForceRateParams,
    ForceRateSensor,
    ForceRateSensorParams,
    MovingAverage,
)

EXACT = {"force_noise": 0.0, "force_rate_noise": 0.0}


def read(
    params: ForceRateSensorParams, force: Any, rate: Any, noise: Any = None
) -> tuple[np.ndarray, np.ndarray]:
    sensor = ForceRateSensor(params, dimension=len(force))
    context = sensor.CreateDefaultContext()
    sensor.GetInputPort("contact_force").FixValue(context, force)
    sensor.GetInputPort("contact_force_rate").FixValue(context, rate)
    if noise is not None:
        sensor.GetInputPort("noise").FixValue(context, noise)
    names = ("measured_force", "measured_force_rate")
    measured, measured_rate = (sensor.GetOutputPort(name).Eval(context) for name in names)
    return measured, measured_rate


def test_reads_what_the_arm_does_to_the_surface() -> None:
    # The surface pushes up ever harder, so the arm pushes down; no noise needs to be there.
    force, rate = read(ForceRateSensorParams(**EXACT), (-2.0, 15.0), (0.5, 3.0))
    np.testing.assert_array_equal(force, [2.0, -15.0])
    np.testing.assert_array_equal(rate, [-0.5, -3.0])


@pytest.mark.parametrize("dimension", [2, 3])
def test_every_sample_has_a_place_of_its_own(dimension: int) -> None:
    params = ForceRateSensorParams(force_noise=math.sqrt(3), force_rate_noise=10 * math.sqrt(3))
    zero, samples = np.zeros(dimension), np.arange(1.0, 2 * dimension + 1)
    force, rate = read(params, zero, zero, samples)
    np.testing.assert_allclose(force, samples[:dimension], rtol=1e-14)
    np.testing.assert_allclose(rate, 10 * samples[dimension:], rtol=1e-14)


@pytest.mark.parametrize("noisy", ["force_noise", "force_rate_noise"])
def test_one_noise_without_the_other(noisy: str) -> None:
    params = ForceRateSensorParams(**{**EXACT, noisy: math.sqrt(3)})
    found = read(params, (0.0, 0.0), (0.0, 0.0), [1.0, 2.0, 3.0, 4.0])
    expected = [[1.0, 2.0], [0.0, 0.0]] if noisy == "force_noise" else [[0.0, 0.0], [3.0, 4.0]]
    np.testing.assert_allclose(found, expected, rtol=1e-14)


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_stops_what_is_not_finite(bad: float) -> None:
    params, fine = ForceRateSensorParams(), (0.0, 0.0)
    with pytest.raises(ParameterError) as caught:
        read(ForceRateSensorParams(**EXACT), (1.0, bad), fine)
    assert str(caught.value) == f"measured force is [-1.0, {-bad}], allowed: finite numbers"
    with pytest.raises(ParameterError) as caught:
        read(ForceRateSensorParams(**EXACT), fine, (bad, 1.0))
    assert str(caught.value) == f"measured force rate is [{-bad}, -1.0], allowed: finite numbers"
    with pytest.raises(ParameterError, match=r"^measured force is "):
        read(params, fine, fine, (bad, 0.0, 0.0, 0.0))
    with pytest.raises(ParameterError, match=r"^measured force rate is "):
        read(params, fine, fine, (0.0, 0.0, 0.0, bad))


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


def means(samples: int, signal: np.ndarray) -> np.ndarray:
    """Return what the block makes of a signal, shape (size, n), a column a period of 0.25 s."""
    period = 0.25
    builder = DiagramBuilder()
    times = period * (np.arange(signal.shape[1]) - 0.5)  # steps between the samples
    source = builder.AddSystem(TrajectorySource(PiecewisePolynomial.ZeroOrderHold(times, signal)))
    block = builder.AddSystem(MovingAverage(samples=samples, period=period, size=len(signal)))
    builder.Connect(source.get_output_port(), block.get_input_port())
    log = LogVectorOutput(block.get_output_port(), builder, period)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(period * (signal.shape[1] - 2))
    found: np.ndarray = log.FindLog(simulator.get_context()).data().copy()
    return found


@pytest.mark.parametrize("samples", [1, 2, 5])
def test_mean_of_the_last_samples_or_of_those_that_there_were(samples: int) -> None:
    signal = np.random.default_rng(0).standard_normal((3, 20))
    found = means(samples, signal)
    for k in range(found.shape[1]):
        expected = signal[:, max(k - samples + 1, 0) : k + 1].mean(axis=1)
        np.testing.assert_allclose(found[:, k], expected, rtol=0, atol=1e-14)
