"""The sensor of force and force rate: signs, and noise of the right length."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.common import RandomDistribution, RandomGenerator
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import ConstantVectorSource, LogVectorOutput, RandomSource

from chamfer.models.validation import ParameterError
from chamfer.systems.sensing.force_rate import ForceRateSensor, ForceRateSensorParams

EXACT = {"force_noise": 0.0, "force_rate_noise": 0.0}

vectors = arrays(float, 3, elements=st.floats(-100, 100))


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


@given(force=vectors, rate=vectors)
def test_without_noise_it_is_exact(force: np.ndarray, rate: np.ndarray) -> None:
    found = read(ForceRateSensorParams(**EXACT), force, rate)
    np.testing.assert_array_equal(found, (-force, -rate))


def test_without_noise_the_samples_are_not_read() -> None:
    found = read(ForceRateSensorParams(**EXACT), (1.0, 2.0), (3.0, 4.0), [math.nan] * 4)
    np.testing.assert_array_equal(found, [[-1.0, -2.0], [-3.0, -4.0]])


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


def noisy_readings(seed: int, dimension: int) -> np.ndarray:
    """Return 4000 readings of a constant contact with the published noise, shape (4000, 2d)."""
    builder = DiagramBuilder()
    sensor = builder.AddSystem(ForceRateSensor(ForceRateSensorParams(), dimension=dimension))
    random = builder.AddSystem(RandomSource(RandomDistribution.kGaussian, 2 * dimension, 0.05))
    builder.Connect(random.get_output_port(), sensor.GetInputPort("noise"))
    loggers = []
    for name, value in (("force", [3.0, -7.0, 2.0]), ("force_rate", [40.0, 10.0, -20.0])):
        source = builder.AddSystem(ConstantVectorSource(value[:dimension]))
        builder.Connect(source.get_output_port(), sensor.GetInputPort(f"contact_{name}"))
        loggers.append(LogVectorOutput(sensor.GetOutputPort(f"measured_{name}"), builder, 0.05))
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(seed))
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(199.975)
    return np.vstack([log.FindLog(simulator.get_context()).data() for log in loggers]).T


@pytest.mark.parametrize("dimension", [2, 3])
def test_noise_of_many_samples(dimension: int) -> None:
    readings = noisy_readings(3, dimension)
    count = 4000
    assert readings.shape == (count, 2 * dimension)
    truth = np.hstack([[-3.0, 7.0, -2.0][:dimension], [-40.0, -10.0, 20.0][:dimension]])
    deviation = np.repeat([1.0, 5.0], dimension) / math.sqrt(3)
    noise = (readings - truth) / deviation
    # Five standard errors each.
    np.testing.assert_allclose(noise.mean(axis=0), 0, atol=5 / math.sqrt(count))
    np.testing.assert_allclose(noise.std(axis=0), 1, atol=5 / math.sqrt(2 * count))
    np.testing.assert_allclose((noise**4).mean(axis=0), 3, atol=5 * math.sqrt(96 / count))
    apart = np.corrcoef(noise.T) - np.eye(2 * dimension)
    assert np.abs(apart).max() < 5 / math.sqrt(count)
    assert np.abs((noise[1:] * noise[:-1]).mean(axis=0)).max() < 5 / math.sqrt(count)


def test_noise_is_the_length_of_a_vector_in_space() -> None:
    noise = noisy_readings(4, 3) - [-3.0, 7.0, -2.0, -40.0, -10.0, 20.0]
    lengths = [np.sqrt((part**2).sum(axis=1).mean()) for part in np.hsplit(noise, 2)]
    np.testing.assert_allclose(lengths, [1.0, 5.0], rtol=0.05)


def test_seed_decides_the_noise() -> None:
    np.testing.assert_array_equal(noisy_readings(3, 2), noisy_readings(3, 2))
    assert not np.array_equal(noisy_readings(3, 2), noisy_readings(4, 2))


@pytest.mark.parametrize("dimension", [2, 3])
def test_ports(dimension: int) -> None:
    sensor = ForceRateSensor(ForceRateSensorParams(), dimension=dimension)
    inputs = [sensor.get_input_port(i) for i in range(sensor.num_input_ports())]
    outputs = [sensor.get_output_port(i) for i in range(sensor.num_output_ports())]
    assert [(port.get_name(), port.size()) for port in inputs] == [
        ("contact_force", dimension),
        ("contact_force_rate", dimension),
        ("noise", 2 * dimension),
    ]
    assert [(port.get_name(), port.size()) for port in outputs] == [
        ("measured_force", dimension),
        ("measured_force_rate", dimension),
    ]
    passes = [[sensor.HasDirectFeedthrough(i, j) for j in range(2)] for i in range(3)]
    assert passes == [[True, False], [False, True], [True, True]]


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


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"force_noise": -1.0}, "force_noise is -1.0, allowed: a finite number >= 0"),
        ({"force_noise": math.nan}, "force_noise is nan, allowed: a finite number >= 0"),
        ({"bias": (math.nan, 0.0)}, "bias is (nan, 0.0), allowed: finite numbers"),
        ({"force_rate_noise": -1.0}, "force_rate_noise is -1.0, allowed: a finite number >= 0"),
        ({"force_rate_noise": math.inf}, "force_rate_noise is inf, allowed: a finite number >= 0"),
    ],
)
def test_parameters(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        ForceRateSensorParams(**changes)
    assert str(caught.value) == message


def test_published_noise_is_the_default() -> None:
    params = ForceRateSensorParams()
    assert (params.force_noise, params.force_rate_noise) == (1.0, 5.0)


def test_bias_of_another_dimension_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"^bias is \(1.0,\), allowed: 2 numbers"):
        ForceRateSensor(ForceRateSensorParams(bias=(1.0,)), dimension=2)
