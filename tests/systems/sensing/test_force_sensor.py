"""The force sensors: signs, cross-talk and its removal, noise."""

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

from models.validation import ParameterError
from systems.sensing.force_sensor import ForceSensor, ForceSensorParams, LoadCell, LoadCellParams

forces = arrays(float, 3, elements=st.floats(-100, 100))
samples = arrays(float, 3, elements=st.floats(0, 1))
cross_talks = st.floats(-0.4, 0.9)


def read(
    params: ForceSensorParams, force: Any, noise: Any = None, *, coordinates: int = 3
) -> np.ndarray:
    sensor = ForceSensor(params, coordinates=coordinates)
    context = sensor.CreateDefaultContext()
    sensor.GetInputPort("contact_force").FixValue(context, force)
    if noise is not None:
        sensor.GetInputPort("noise").FixValue(context, noise)
    found: np.ndarray = sensor.GetOutputPort("measured_force").Eval(context)
    return found


def weigh(
    params: LoadCellParams, direction: Any, force: Any, noise: float | None = None
) -> np.ndarray:
    cell = LoadCell(params, np.array(direction))
    context = cell.CreateDefaultContext()
    cell.GetInputPort("tool_force").FixValue(context, force)
    if noise is not None:
        cell.GetInputPort("noise").FixValue(context, [noise])
    found: np.ndarray = cell.GetOutputPort("measured_force").Eval(context)
    return found


# Wrist sensor


def test_reads_what_the_arm_does_to_the_surface() -> None:
    # The surface pushes up, so the arm pushes down.
    found = read(ForceSensorParams(), (1.0, -2.0, 15.0))
    np.testing.assert_array_equal(found, [-1.0, 2.0, -15.0])


@pytest.mark.parametrize(
    ("coordinates", "expected"),
    [
        (1, [-1.0]),
        (2, [-1.0, 2.0]),
        (3, [-1.0, 2.0, -15.0]),
        (4, [-1.0, 2.0, -15.0, 0.0]),  # x, y, z and an angle, whose torque is not measured
        (6, [-1.0, 2.0, -15.0, 0.0, 0.0, 0.0]),
    ],
)
def test_has_the_size_of_the_endpoint_vector(coordinates: int, expected: list[float]) -> None:
    for decoupling in (False, True):
        params = ForceSensorParams(decoupling=decoupling)
        found = read(params, (1.0, -2.0, 15.0), coordinates=coordinates)
        np.testing.assert_array_equal(found, expected)


def test_angle_has_no_noise() -> None:
    params = ForceSensorParams(noise=0.5, cross_talk=0.1)
    found = read(params, (0.0, 0.0, 0.0), (1.0, 0.0, 0.75), coordinates=4)
    np.testing.assert_allclose(found, [0.5, -0.5, 0.25, 0.0], rtol=0, atol=1e-15)


@given(force=forces, cross_talk=cross_talks)
def test_each_direction_leaks_into_the_others(force: np.ndarray, cross_talk: float) -> None:
    found = read(ForceSensorParams(cross_talk=cross_talk), force)
    x, y, z = force.tolist()
    expected = [
        -(x + cross_talk * (y + z)),
        -(y + cross_talk * (x + z)),
        -(z + cross_talk * (x + y)),
    ]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_friction_disturbs_the_normal_reading() -> None:
    # Section 3.3: of 2 N along the surface a tenth is read as normal force.
    found = read(ForceSensorParams(cross_talk=0.1), (2.0, 0.0, 20.0))
    assert found[2] == pytest.approx(-20.2, abs=1e-12)


@given(force=forces, cross_talk=cross_talks)
def test_decoupling_gives_the_true_force(force: np.ndarray, cross_talk: float) -> None:
    params = ForceSensorParams(cross_talk=cross_talk, decoupling=True)
    np.testing.assert_allclose(read(params, force), -force, rtol=0, atol=1e-10)


@given(force=forces, noise=samples, cross_talk=cross_talks)
def test_decoupling_acts_on_the_reading(
    force: np.ndarray, noise: np.ndarray, cross_talk: float
) -> None:
    # Of cross-talk and noise, so it takes the noise along; solved here, not inverted.
    raw = read(ForceSensorParams(cross_talk=cross_talk, noise=0.5), force, noise)
    undone = read(
        ForceSensorParams(cross_talk=cross_talk, noise=0.5, decoupling=True), force, noise
    )
    matrix = cross_talk * np.ones((3, 3))
    np.fill_diagonal(matrix, 1.0)
    np.testing.assert_allclose(matrix @ undone, raw, rtol=0, atol=1e-10)


@given(force=forces, noise=samples)
def test_noise_is_bounded(force: np.ndarray, noise: np.ndarray) -> None:
    found = read(ForceSensorParams(noise=0.5), force, noise)
    np.testing.assert_allclose(found, -force + (noise - 0.5), rtol=0, atol=1e-12)
    assert np.abs(found + force).max() <= 0.5 + 1e-12


def noisy_readings(seed: int) -> np.ndarray:
    """Return 4000 readings at rest of a sensor with a noise of 0.5 N, shape (4000, 3)."""
    builder = DiagramBuilder()
    force = builder.AddSystem(ConstantVectorSource([3.0, 0.0, -7.0]))
    random = builder.AddSystem(RandomSource(RandomDistribution.kUniform, 3, 0.005))
    sensor = builder.AddSystem(ForceSensor(ForceSensorParams(noise=0.5)))
    builder.Connect(force.get_output_port(), sensor.GetInputPort("contact_force"))
    builder.Connect(random.get_output_port(), sensor.GetInputPort("noise"))
    logger = LogVectorOutput(sensor.GetOutputPort("measured_force"), builder, 0.005)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(seed))
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(19.9975)
    found: np.ndarray = logger.FindLog(simulator.get_context()).data().T.copy()
    return found


def test_noise_of_many_samples() -> None:
    readings = noisy_readings(3)
    assert readings.shape == (4000, 3)
    noise = readings - [-3.0, 0.0, 7.0]
    assert np.abs(noise).max() <= 0.5
    # Five standard errors of the mean of a uniform distribution, 1 / sqrt(12) wide.
    np.testing.assert_allclose(noise.mean(axis=0), 0, atol=5 / math.sqrt(12 * 4000))
    np.testing.assert_allclose(noise.std(axis=0), 1 / math.sqrt(12), rtol=0.05)
    assert np.abs(np.corrcoef(noise.T) - np.eye(3)).max() < 5 / math.sqrt(4000)


def test_seed_decides_the_noise() -> None:
    np.testing.assert_array_equal(noisy_readings(3), noisy_readings(3))
    assert not np.array_equal(noisy_readings(3), noisy_readings(4))


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_wrist_sensor_stops_what_is_not_finite(bad: float) -> None:
    with pytest.raises(ParameterError, match=r"^measured force is \[.*\], allowed: finite num"):
        read(ForceSensorParams(), (0.0, bad, 0.0))
    with pytest.raises(ParameterError, match=r"^measured force is "):
        read(ForceSensorParams(noise=0.5), (0.0, 0.0, 0.0), (0.5, 0.5, bad))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"noise": -0.5}, "noise is -0.5, allowed: a finite number >= 0"),
        ({"noise": math.nan}, "noise is nan, allowed: a finite number >= 0"),
        ({"cross_talk": math.nan}, "cross_talk is nan, allowed: a finite number"),
        ({"cross_talk": 1.0}, "cross_talk is 1.0, allowed: more than -0.5 and less than 1"),
        ({"cross_talk": -0.5}, "cross_talk is -0.5, allowed: more than -0.5 and less than 1"),
    ],
)
def test_parameters_of_the_wrist_sensor(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        ForceSensorParams(**changes)
    assert str(caught.value) == message


# Load cell


def test_load_cell_reads_along_its_axis_only() -> None:
    params, down = LoadCellParams(axis=(1.0, 0.0, 0.0)), (0.0, 0.0, -1.0)
    # The surface pushes back into the arm along -axis: the arm pushes along its direction.
    np.testing.assert_array_equal(weigh(params, down, (-5.0, 0.0, 0.0)), [0.0, 0.0, -5.0])
    np.testing.assert_array_equal(weigh(params, down, (2.0, 0.0, 0.0)), [0.0, 0.0, 2.0])
    np.testing.assert_array_equal(weigh(params, down, (0.0, 40.0, -30.0)), np.zeros(3))


@given(force=forces)
def test_load_cell_with_oblique_vectors(force: np.ndarray) -> None:
    # Lengths of 5 and 3; only the directions count, and the result is along the second.
    params = LoadCellParams(axis=(0.0, 3.0, 4.0))
    reading = -(0.6 * force[1] + 0.8 * force[2])
    expected = reading * np.array([1.0, 2.0, -2.0]) / 3
    found = weigh(params, (1.0, 2.0, -2.0), force)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_load_cell_of_four_coordinates() -> None:
    found = weigh(LoadCellParams(axis=(0.0, 0.0, 1.0)), (0.0, 0.0, -1.0, 0.0), (9.0, 9.0, -4.0))
    np.testing.assert_array_equal(found, [0.0, 0.0, -4.0, 0.0])


@given(noise=st.floats(0, 1))
def test_noise_of_the_load_cell(noise: float) -> None:
    params = LoadCellParams(axis=(1.0, 0.0, 0.0), noise=0.25)
    found = weigh(params, (0.0, -1.0), (-5.0, 1.0, 0.0), noise)
    np.testing.assert_allclose(found, [0.0, -(5.0 + 0.5 * (noise - 0.5))], rtol=0, atol=1e-14)


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("bad", [math.nan, -math.inf])
def test_load_cell_stops_what_is_not_finite(bad: float) -> None:
    params, down = LoadCellParams(axis=(1.0, 0.0, 0.0), noise=0.25), (0.0, -1.0)
    with pytest.raises(ParameterError, match=r"^measured force is \[.*\], allowed: finite num"):
        weigh(params, down, (bad, 0.0, 0.0), 0.5)
    with pytest.raises(ParameterError, match=r"^measured force is "):
        weigh(params, down, (1.0, 0.0, 0.0), bad)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"axis": (0.0, 0.0, 0.0)}, "axis is [0.0, 0.0, 0.0], allowed: a finite vector"),
        ({"axis": (math.nan, 0.0, 0.0)}, "axis is [nan, 0.0, 0.0], allowed: a finite vector"),
        ({"noise": -1.0}, "noise is -1.0, allowed: a finite number >= 0"),
        ({"noise": math.inf}, "noise is inf, allowed: a finite number >= 0"),
    ],
)
def test_parameters_of_the_load_cell(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        LoadCellParams(**{"axis": (1.0, 0.0, 0.0), **changes})
    assert str(caught.value).startswith(message)
    assert "\n" not in str(caught.value)


def test_the_load_cells_direction_has_to_be_one() -> None:
    with pytest.raises(ParameterError, match=r"^direction is \[0.0, 0.0\], allowed: a finite vec"):
        weigh(LoadCellParams(axis=(1.0, 0.0, 0.0)), (0.0, 0.0), (1.0, 0.0, 0.0))


# Both


@pytest.mark.parametrize(
    ("sensor", "force", "sizes"),
    [
        (ForceSensor(ForceSensorParams(), coordinates=4), "contact_force", (3, 3, 4)),
        (
            LoadCell(LoadCellParams(axis=(1.0, 0.0, 0.0)), np.array([0.0, -1.0])),
            "tool_force",
            (3, 1, 2),
        ),
    ],
    ids=["wrist", "cell"],
)
def test_ports(sensor: Any, force: str, sizes: tuple[int, int, int]) -> None:
    found = (
        sensor.GetInputPort(force).size(),
        sensor.GetInputPort("noise").size(),
        sensor.GetOutputPort("measured_force").size(),
    )
    assert found == sizes
    assert sensor.HasAnyDirectFeedthrough()
