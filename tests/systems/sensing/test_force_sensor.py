"""The force sensors: signs, cross-talk and its removal, and what filter and converter do."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.common import RandomDistribution, RandomGenerator
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import (
    ConstantVectorSource,
    LogVectorOutput,
    RandomSource,
    TrajectorySource,
)
from pydrake.trajectories import PiecewisePolynomial

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.sensing.force_sensor import (
    BaseSensorParams,
    ForceInWorld,
    ForceSensor,
    ForceSensorParams,
    LoadCellParams,
    base_gauges,
    gauges,
)

forces = arrays(float, 3, elements=st.floats(-100, 100))
samples = arrays(float, 3, elements=st.floats(0, 1))
cross_talks = st.floats(-0.4, 0.9)

NOTHING: dict[str, float] = dict.fromkeys(
    ("noise", "bias", "drift", "bandwidth", "delay", "resolution", "full_scale", "tare"), 0.0
)
IDEAL = ForceSensorParams(**NOTHING, cross_talk=0.0, position=(0.0, 0.0, 0.0))
CELL = LoadCellParams(**NOTHING, axis=(1.0, 0.0, 0.0))
PERIOD, STEP = 0.005, 0.001


def make(params: Any, contact_point: Any = (0.0, 0.0, 0.0)) -> ForceSensor:
    return ForceSensor(params, gauges(params, contact_point), step=STEP, period=PERIOD)


def read(
    params: Any, force: Any, noise: Any = None, contact_point: Any = (0.0, 0.0, 0.0)
) -> np.ndarray:
    sensor = make(params, contact_point)
    context = sensor.CreateDefaultContext()
    sensor.GetInputPort("tool_force").FixValue(context, force)
    if noise is not None:
        sensor.GetInputPort("noise").FixValue(context, noise)
    found: np.ndarray = sensor.GetOutputPort("reading").Eval(context)
    return found


def logged(params: Any, times: list[float], pushes: list[float], until: float) -> np.ndarray:
    """Readings along z, every millisecond, of a push along -z that jumps at the given times."""
    builder = DiagramBuilder()
    values = np.zeros((3, len(times)))
    values[2] = -np.array(pushes)
    force = builder.AddSystem(
        TrajectorySource(PiecewisePolynomial.ZeroOrderHold(times, values), 0, False)
    )
    sensor = builder.AddSystem(make(params))
    builder.Connect(force.get_output_port(), sensor.GetInputPort("tool_force"))
    for i, (port, kind) in enumerate(
        (("noise", RandomDistribution.kUniform), ("drift", RandomDistribution.kGaussian))
    ):
        random = builder.AddNamedSystem(f"{i}", RandomSource(kind, 3, PERIOD))
        builder.Connect(random.get_output_port(), sensor.GetInputPort(port))
    logger = LogVectorOutput(sensor.GetOutputPort("reading"), builder, STEP)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(3))
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(until)
    found: np.ndarray = logger.FindLog(simulator.get_context()).data()[2].copy()
    return found


# Gauges


@given(force=forces, cross_talk=cross_talks)
def test_each_direction_leaks_into_the_others(force: np.ndarray, cross_talk: float) -> None:
    found = read(replace(IDEAL, cross_talk=cross_talk), force)
    x, y, z = force.tolist()
    expected = [
        -(x + cross_talk * (y + z)),
        -(y + cross_talk * (x + z)),
        -(z + cross_talk * (x + y)),
    ]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


def test_friction_disturbs_the_normal_reading() -> None:
    # Section 3.3: of 2 N along the surface a tenth is read as normal force.
    found = read(replace(IDEAL, cross_talk=0.1), (2.0, 0.0, 20.0))
    assert found[2] == pytest.approx(-20.2, abs=1e-12)


@given(force=forces, cross_talk=cross_talks, noise=samples)
def test_decoupling_solves_for_the_force(
    force: np.ndarray, cross_talk: float, noise: np.ndarray
) -> None:
    params = replace(IDEAL, cross_talk=cross_talk, decoupling=True)
    np.testing.assert_allclose(params.undoing @ read(params, force), -force, rtol=0, atol=1e-9)
    matrix = cross_talk * np.ones((3, 3))
    np.fill_diagonal(matrix, 1.0)
    np.testing.assert_allclose(matrix @ (params.undoing @ noise), noise, rtol=0, atol=1e-9)


@given(force=forces, point=samples)
def test_six_axes_read_force_and_moment(force: np.ndarray, point: np.ndarray) -> None:
    position = (0.1, -0.2, 0.3)
    params = replace(IDEAL, cross_talk=tuple(map(tuple, np.eye(6).tolist())), position=position)
    found = read(params, force, contact_point=tuple(point.tolist()))
    np.testing.assert_allclose(found[:3], -force, rtol=0, atol=1e-12)
    moment = np.cross(point - position, -force)
    np.testing.assert_allclose(found[3:], moment, rtol=0, atol=1e-9)


@given(force=forces)
def test_a_full_matrix_is_undone_with_the_moments(force: np.ndarray) -> None:
    matrix = np.eye(6) + 0.1 * np.arange(36).reshape(6, 6) / 36
    params = replace(
        IDEAL, cross_talk=tuple(map(tuple, matrix.tolist())), position=(0.0, 0.0, 0.1)
    )
    raw = read(params, force)
    wrench = np.concatenate([-force, np.cross([0.0, 0.0, -0.1], -force)])
    np.testing.assert_allclose(raw, matrix @ wrench, rtol=0, atol=1e-9)
    np.testing.assert_allclose(params.undoing @ raw, raw[:3], rtol=0, atol=0)
    undone = replace(params, decoupling=True).undoing @ raw
    np.testing.assert_allclose(undone, -force, rtol=0, atol=1e-8)


def test_a_load_cell_reads_along_its_axis_only() -> None:
    # The surface pushes back into the arm along -axis.
    assert read(CELL, (-5.0, 40.0, -30.0)) == [5.0]
    oblique = replace(CELL, axis=(0.0, 3.0, 4.0))
    assert read(oblique, (9.0, 1.0, 2.0)) == pytest.approx([-(0.6 + 1.6)], abs=1e-12)


# Filter and converter


@given(force=forces, noise=samples)
def test_noise_is_bounded(force: np.ndarray, noise: np.ndarray) -> None:
    found = read(replace(IDEAL, noise=0.5), force, noise)
    np.testing.assert_allclose(found, -force + (noise - 0.5), rtol=0, atol=1e-12)


def test_moments_take_the_noise_by_a_lever() -> None:
    matrix = tuple(map(tuple, np.eye(6).tolist()))
    six = replace(IDEAL, cross_talk=matrix, decoupling=True, radius=0.02, noise=0.5)
    np.testing.assert_allclose(read(six, np.zeros(3), np.ones(6)), [*3 * [0.5], *3 * [0.01]])


@given(force=st.floats(-30, 30))
def test_the_converter_rounds_and_saturates(force: float) -> None:
    params = replace(IDEAL, resolution=0.25, full_scale=20.0, bias=0.1)
    found = read(params, (0.0, 0.0, -force))[2]
    assert found == pytest.approx(0.25 * round(np.clip(force + 0.1, -20, 20) / 0.25), abs=1e-12)


def test_the_filter_follows_with_its_time_constant() -> None:
    found = logged(replace(IDEAL, bandwidth=10.0), [0.0, 1e-6, 1.0], [0.0, 1.0, 1.0], 0.06)
    ticks = np.arange(len(found))
    # The value of a sample is taken to have lasted the step before it.
    np.testing.assert_allclose(found, 1 - np.exp(-2 * math.pi * 10 * STEP * ticks), atol=1e-9)


@pytest.mark.parametrize("steps", [1.0, 3.0, 2.25, 0.5])
def test_a_delay_interpolates_between_steps(steps: float) -> None:
    found = logged(replace(IDEAL, delay=steps * STEP), [0.0, 0.0095, 1.0], [0.0, 1.0, 1.0], 0.02)
    late = np.arange(len(found)) - 10 - steps  # the jump is seen with the tenth sample
    np.testing.assert_allclose(found, np.clip(late + 1, 0, 1), atol=1e-9)


def test_a_tare_takes_the_bias_off() -> None:
    biased = replace(IDEAL, bias=1.5, tare=0.1)
    found = logged(biased, [0.0, 0.2005, 1.0], [0.0, 4.0, 4.0], 0.3)
    np.testing.assert_allclose(found[:201], 0.0, atol=1e-12)
    np.testing.assert_allclose(found[201:], 4.0, atol=1e-12)
    noisy = logged(replace(biased, noise=0.5), [0.0, 1.0], [0.0, 0.0], 0.3)
    assert not noisy[:96].any()
    # The mean of 20 samples of a uniform distribution: within four standard errors.
    assert abs(noisy[101::5].mean()) < 4 * (1 / math.sqrt(12)) * math.sqrt(1 / 20 + 1 / 40)


def test_drift_is_a_random_walk() -> None:
    found = logged(replace(IDEAL, drift=2.0), [0.0, 100.0], [0.0, 0.0], 8.0)[::5]
    steps = np.diff(found) / (2.0 * math.sqrt(PERIOD))
    assert steps.std() == pytest.approx(1.0, rel=0.08)
    assert abs(np.corrcoef(steps[1:], steps[:-1])[0, 1]) < 0.1


def test_the_noise_is_new_each_period_and_the_seeds() -> None:
    found = logged(replace(IDEAL, noise=0.5), [0.0, 100.0], [7.0, 7.0], 4.0)
    np.testing.assert_array_equal(np.ptp(found[1:].reshape(-1, 5), axis=1), 0.0)
    noise = found[2::5] - 7.0
    assert np.abs(noise).max() <= 0.5
    assert noise.std() == pytest.approx(1 / math.sqrt(12), rel=0.05)
    again = logged(replace(IDEAL, noise=0.5), [0.0, 100.0], [7.0, 7.0], 4.0)
    np.testing.assert_array_equal(found, again)


def test_what_it_reads_at_rest() -> None:
    biased = replace(IDEAL, noise=0.5, resolution=0.1, bias=-2.0)
    assert (biased.rest_noise, biased.rest_bias) == (0.55, 2.0)
    assert replace(biased, tare=0.1).rest_bias == 0.0


# In the world's axes


def world(q: Any, reading: Any, *, dynamics: ArmDynamics, params: Any = IDEAL) -> np.ndarray:
    m = dynamics.arm.num_coordinates
    block = ForceInWorld(dynamics, params.undoing, coordinates=m)
    context = block.CreateDefaultContext()
    block.GetInputPort("reading").FixValue(context, reading)
    block.GetInputPort("encoders").FixValue(context, [*q, *np.ones(len(q))])
    found: np.ndarray = block.GetOutputPort("measured_force").Eval(context)
    return found


def test_the_reading_turns_with_the_arm() -> None:
    planar = ArmDynamics(PLANAR_TWO_LINK)
    found = world((0.5, 0.4), (1.0, 2.0, 9.0), dynamics=planar)
    c, s = math.cos(0.9), math.sin(0.9)
    np.testing.assert_allclose(found, [c - 2 * s, s + 2 * c], atol=1e-12)


def test_angles_read_nothing() -> None:
    adept = ArmDynamics(ADEPT_ONE)
    found = world((0.3, 0.2, 0.1, -0.5), (1.0, 2.0, 9.0), dynamics=adept)
    np.testing.assert_allclose(found, [1.0, 2.0, 9.0, 0.0], atol=1e-12)


# Refusals


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_finite_is_stopped(bad: float) -> None:
    for params in (IDEAL, CELL):
        with pytest.raises(ParameterError, match=r"^measured force is \[.*\], allowed: finite n"):
            read(params, (bad, 0.0, 0.0))
    with pytest.raises(ParameterError, match=r"^measured force is "):
        read(replace(IDEAL, noise=0.5), (0.0, 0.0, 0.0), (0.5, 0.5, bad))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"noise": -0.5}, "noise is -0.5, allowed: a finite number >= 0"),
        ({"full_scale": math.nan}, "full_scale is nan, allowed: a finite number >= 0"),
        ({"bias": math.inf}, "bias is inf, allowed: a finite number"),
        ({"cross_talk": 1.0}, "cross_talk is 1.0, allowed: more than -0.5 and less than 1"),
        ({"cross_talk": -0.5}, "cross_talk is -0.5, allowed: more than -0.5 and less than 1"),
        ({"cross_talk": math.nan}, "cross_talk is nan, allowed: more than -0.5 and less than 1"),
        ({"cross_talk": ((1.0,),)}, "cross_talk is ((1.0,),), allowed: a number, or a regular"),
        ({"cross_talk": 6 * (6 * (1.0,),)}, "cross_talk is ((1.0, 1.0, 1.0, 1.0, 1.0, 1.0), "),
        ({"position": (0.0, 0.0, 0.1)}, "position is (0.0, 0.0, 0.1), allowed: 0 unless cross_ta"),
        ({"radius": 0.1}, "radius is 0.1, allowed: 0.05 unless a 6 x 6 cross-talk is undone"),
    ],
)
def test_parameters_of_the_wrist_sensor(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        replace(IDEAL, **changes)
    assert str(caught.value).startswith(message)


def test_the_cells_axis_has_to_be_one() -> None:
    with pytest.raises(ParameterError, match=r"^axis is \[0.0, 0.0, 0.0\], allowed: a finite ve"):
        LoadCellParams(axis=(0.0, 0.0, 0.0))


def test_what_is_open_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"^noise is None"):
        make(replace(IDEAL, noise=None))
    with pytest.raises(ParameterError, match=r"^delay is 2.0, allowed: at most 1 s"):
        make(replace(IDEAL, delay=2.0))


def test_an_ideal_sensor_has_no_events() -> None:
    assert make(IDEAL).HasAnyDirectFeedthrough()
    builder = DiagramBuilder()
    source = builder.AddSystem(ConstantVectorSource(np.zeros(3)))
    sensor = builder.AddSystem(make(IDEAL))
    builder.Connect(source.get_output_port(), sensor.GetInputPort("tool_force"))
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(0.1)
    assert simulator.get_num_discrete_updates() == 0


def test_sensor_under_the_base_reads_moments_and_forces_of_the_base_on_the_arm() -> None:
    params = BaseSensorParams(**{**NOTHING, "bias": 2.0, "resolution": 0.5}, radius=0.1)
    sensor = ForceSensor(params, base_gauges(params), step=STEP, period=PERIOD)
    context = sensor.CreateDefaultContext()
    sensor.GetInputPort("tool_force").FixValue(context, [10.0, -20.0, 0.32, 5.2, 0.0, 300.0])
    found = sensor.GetOutputPort("reading").Eval(context)
    # a moment's bias and resolution are the forces' times the radius
    np.testing.assert_allclose(found, [10.2, -19.8, 0.5, 7.0, 2.0, 302.0], rtol=0, atol=1e-12)
    with pytest.raises(ParameterError, match=r"^tare is 1.0, allowed: 0"):
        BaseSensorParams(tare=1.0)
