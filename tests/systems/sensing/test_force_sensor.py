"""Force sensors: signs, cross-talk, filter and converter, the wrench at a tip, the zero."""

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
from pydrake.systems.framework import Context, DiagramBuilder
from pydrake.systems.primitives import LogVectorOutput, RandomSource, TrajectorySource
from pydrake.trajectories import PiecewisePolynomial

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.sensing.force_rate import (
    ForceRate,
    ForceRateParams,
    ForceRateSensor,
    ForceRateSensorParams,
    MovingAverage,
)
from chamfer.systems.sensing.force_sensor import (
    BaseSensorParams,
    ForceInWorld,
    ForceSensor,
    ForceSensorParams,
    LoadCellParams,
    Tare,
    WrenchSensorParams,
    base_gauges,
    gauges,
)

forces = arrays(float, 3, elements=st.floats(-100, 100))
samples = arrays(float, 3, elements=st.floats(0, 1))
cross_talks = st.floats(-0.4, 0.9)

NOTHING: dict[str, Any] = dict.fromkeys(
    ("noise", "bias", "drift", "bandwidth", "delay", "resolution", "full_scale", "tare"), 0.0
)
IDEAL = ForceSensorParams(**NOTHING, cross_talk=0.0, position=(0.0, 0.0, 0.0))
CELL = LoadCellParams(**NOTHING, axis=(1.0, 0.0, 0.0))
PERIOD, STEP = 0.005, 0.001
UNCOUPLED = tuple(map(tuple, np.eye(6).tolist()))


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


@given(force=forces, point=samples)
def test_six_axes_read_force_and_moment(force: np.ndarray, point: np.ndarray) -> None:
    position = (0.1, -0.2, 0.3)
    params = replace(IDEAL, cross_talk=UNCOUPLED, position=position)
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


@given(force=forces, noise=samples)
def test_noise_is_bounded(force: np.ndarray, noise: np.ndarray) -> None:
    found = read(replace(IDEAL, noise=0.5), force, noise)
    np.testing.assert_allclose(found, -force + (noise - 0.5), rtol=0, atol=1e-12)


def test_moments_take_the_noise_by_a_lever() -> None:
    six = replace(IDEAL, cross_talk=UNCOUPLED, decoupling=True, radius=0.02, noise=0.5)
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


@pytest.mark.parametrize("steps", [0.0, 1.0, 3.0, 3.0 - 1e-10, 2.25, 0.5])
def test_a_delay_interpolates_between_steps(steps: float) -> None:
    params = replace(IDEAL, delay=steps * STEP)
    assert make(params).CreateDefaultContext().get_discrete_state(0).size() == 3 * math.ceil(steps)
    found = logged(params, [0.0, 0.0095, 1.0], [0.0, 1.0, 1.0], 0.02)
    late = np.arange(len(found)) - 10 - steps  # the jump is seen with the tenth sample
    np.testing.assert_allclose(found, np.clip(late + 1, 0, 1), atol=1e-9)


def test_a_tare_takes_the_bias_off() -> None:
    biased = replace(IDEAL, bias=1.5, tare=0.1)
    # A push that begins behind the last of the 20 samples is none of the bias.
    found = logged(biased, [0.0, 0.0965, 1.0], [0.0, 4.0, 4.0], 0.3)
    np.testing.assert_allclose(found[:97], 0.0, atol=1e-12)
    np.testing.assert_allclose(found[97:], 4.0, atol=1e-12)
    noisy = logged(replace(biased, noise=0.5), [0.0, 1.0], [0.0, 0.0], 0.3)
    assert not noisy[:96].any()
    # The mean of 20 samples of a uniform distribution: within four standard errors.
    assert abs(noisy[101::5].mean()) < 4 * (1 / math.sqrt(12)) * math.sqrt(1 / 20 + 1 / 40)


def test_drift_is_a_random_walk() -> None:
    found = logged(replace(IDEAL, drift=2.0), [0.0, 100.0], [0.0, 0.0], 8.0)[::5]
    steps = np.diff(found) / (2.0 * math.sqrt(PERIOD))
    assert steps.std() == pytest.approx(1.0, rel=0.08)
    assert abs(np.corrcoef(steps[1:], steps[:-1])[0, 1]) < 0.1


def test_what_it_reads_at_rest() -> None:
    biased = replace(IDEAL, noise=0.5, resolution=0.1, bias=-2.0)
    assert (biased.rest_noise, biased.rest_bias) == (0.55, 2.0)
    assert replace(biased, tare=0.1).rest_bias == 0.0


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


@pytest.mark.filterwarnings("ignore:invalid value")
@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_what_is_not_finite_is_stopped(bad: float) -> None:
    for params in (IDEAL, CELL):
        with pytest.raises(ParameterError, match=r"^measured force is \[.*\], allowed: finite n"):
            read(params, (bad, 0.0, 0.0))
    with pytest.raises(ParameterError, match=r"^measured force is "):
        read(replace(IDEAL, noise=0.5), (0.0, 0.0, 0.0), (0.5, 0.5, bad))


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


COUPLED = tuple(map(tuple, (np.eye(6) + 0.01 * np.arange(36).reshape(6, 6)).tolist()))
WRENCH = np.array([0.1, -0.2, 0.3, 4.0, 5.0, -6.0])  # N m above N


def read_wrench(params: WrenchSensorParams, wrench: Any = WRENCH) -> Any:
    """What the computer makes of a wrench on the tip."""
    sensor = ForceSensor(params, params.gauges, step=0.001, period=0.01)
    context = sensor.CreateDefaultContext()
    sensor.GetInputPort("tool_force").FixValue(context, wrench)
    return params.undoing @ sensor.GetOutputPort("reading").Eval(context)


def six_axes(**fields: Any) -> WrenchSensorParams:
    return WrenchSensorParams(
        **{**NOTHING, "cross_talk": UNCOUPLED, "origin": (0.0,) * 3, **fields}
    )


@pytest.mark.parametrize("origin", [(0.0, 0.0, 0.0), (0.01, -0.02, 0.1)])
def test_an_ideal_sensor_reads_the_wrench_at_the_tip(origin: Any) -> None:
    np.testing.assert_allclose(read_wrench(six_axes(origin=origin)), WRENCH, atol=1e-12)
    decoupled = six_axes(origin=origin, cross_talk=COUPLED, decoupling=True)
    np.testing.assert_allclose(read_wrench(decoupled), WRENCH, atol=1e-12)


def test_a_sensor_feels_moments_about_its_own_origin() -> None:
    p = np.array([0.01, -0.02, 0.1])
    felt = -six_axes(origin=tuple(p)).gauges.pick_up @ WRENCH
    np.testing.assert_allclose(felt[:3], WRENCH[3:])
    np.testing.assert_allclose(felt[3:], WRENCH[:3] - np.cross(p, WRENCH[3:]))
    # So a force's bias is a moment at the tip.
    off = read_wrench(six_axes(origin=tuple(p), bias=(1.0, 2.0, 3.0, 0.0, 0.0, 0.0))) - WRENCH
    np.testing.assert_allclose(off, [*np.cross(p, [1.0, 2.0, 3.0]), 1.0, 2.0, 3.0], atol=1e-12)


def test_a_bias_is_that_of_every_force_or_of_each_channel() -> None:
    alike = read_wrench(six_axes(bias=0.5, radius=0.02)) - WRENCH
    np.testing.assert_allclose(alike, [0.01] * 3 + [0.5] * 3)
    with pytest.raises(
        ParameterError, match=r"^bias is \(1\.0, 2\.0\), allowed: one number, or 6$"
    ):
        read_wrench(six_axes(bias=(1.0, 2.0)))


TARE_PERIOD = 0.25  # s, a binary fraction


def zeroed(port: str, *ticks: tuple[int, Any]) -> list[np.ndarray]:
    """Return what a port shows a period after each force, of which 1 tells to take the zero."""
    tare = Tare(period=TARE_PERIOD, size=len(ticks[0][1]))
    simulator = Simulator(tare)
    context: Context = simulator.get_mutable_context()
    seen = []
    for told, force in ticks:
        tare.GetInputPort("force").FixValue(context, np.array(force, dtype=float))
        tare.GetInputPort("tare").FixValue(context, np.array([float(told)]))
        simulator.AdvanceTo(context.get_time() + TARE_PERIOD)
        seen.append(tare.GetOutputPort(port).Eval(context).copy())
    return seen


def test_mean_is_taken_off_until_the_next_zero() -> None:
    first = [
        (0, (0, 0, 0)),
        *((1, (x, 0, -x)) for x in (1, 2, 6)),
        (0, (3.5, 1, -3)),
        (0, (0,) * 3),
    ]
    # A second zero has nothing of the first.
    found = zeroed("tared_force", *first, (1, (8, 8, 8)), (1, (8, 8, 8)), (0, (8, 8, 9)))
    expected = [*[(0, 0, 0)] * 4, (0.5, 1, 0), (-3, 0, 3), *[(0, 0, 0)] * 2, (0, 0, 1)]
    np.testing.assert_allclose(found, expected, atol=1e-12)


def test_spread_is_the_standard_deviation_of_the_readings_of_the_last_zero() -> None:
    ticks = (1, 100.0), (1, 104.0), (1, 108.0), (0, 500.0), (1, 7.0), (1, 9.0), (0, 0.0)
    seen = zeroed("spread", *((told, [x, -x, 0, 0, 2 * x, 1.0]) for told, x in ticks))
    assert not seen[0].any()
    assert seen[2] == pytest.approx([4.0, 4.0, 0.0, 0.0, 8.0, 0.0])
    np.testing.assert_array_equal(seen[3], seen[2])
    assert seen[-1] == pytest.approx([2**0.5, 2**0.5, 0.0, 0.0, 8**0.5, 0.0])


EXACT = {"force_noise": 0.0, "force_rate_noise": 0.0}


def measure(
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
    force, rate = measure(ForceRateSensorParams(**EXACT), (-2.0, 15.0), (0.5, 3.0))
    np.testing.assert_array_equal(force, [2.0, -15.0])
    np.testing.assert_array_equal(rate, [-0.5, -3.0])


@pytest.mark.parametrize("dimension", [2, 3])
def test_every_sample_has_a_place_of_its_own(dimension: int) -> None:
    params = ForceRateSensorParams(force_noise=math.sqrt(3), force_rate_noise=10 * math.sqrt(3))
    zero, samples = np.zeros(dimension), np.arange(1.0, 2 * dimension + 1)
    force, rate = measure(params, zero, zero, samples)
    np.testing.assert_allclose(force, samples[:dimension], rtol=1e-14)
    np.testing.assert_allclose(rate, 10 * samples[dimension:], rtol=1e-14)


def test_stops_what_is_not_finite() -> None:
    fine, bad = (0.0, 0.0), math.nan
    for inputs, name in (
        (((1.0, bad), fine), "measured force"),
        ((fine, (bad, 1.0)), "measured force rate"),
        ((fine, fine, (bad, 0.0, 0.0, 0.0)), "measured force"),
        ((fine, fine, (0.0, 0.0, 0.0, bad)), "measured force rate"),
    ):
        params = ForceRateSensorParams(**({} if len(inputs) > 2 else EXACT))
        with pytest.raises(ParameterError, match=rf"^{name} is \[.*nan.*\], allowed: finite num"):
            measure(params, *inputs)


PARAMS = ForceRateParams(time_constant=0.1)


def shown(block: Any, signal: PiecewisePolynomial, period: float, until: float) -> Any:
    """Return the log of a block that is fed a signal."""
    builder = DiagramBuilder()
    source = builder.AddSystem(TrajectorySource(signal))
    builder.AddSystem(block)
    builder.Connect(source.get_output_port(), block.get_input_port())
    log = LogVectorOutput(block.get_output_port(), builder, period)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(until)
    return log.FindLog(simulator.get_context())


def test_rate_of_a_ramp() -> None:
    slope = np.array([[3.0], [-7.0]])
    ramp = PiecewisePolynomial.FirstOrderHold([0.0, 5.0], np.hstack([0 * slope, 5 * slope]))
    data = shown(ForceRate(PARAMS, dimension=2, period=PERIOD), ramp, PERIOD, 1.0)
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


@pytest.mark.parametrize("samples", [1, 2, 5])
def test_mean_of_the_last_samples_or_of_those_that_there_were(samples: int) -> None:
    signal = np.random.default_rng(0).standard_normal((3, 20))
    steps = PiecewisePolynomial.ZeroOrderHold(0.25 * (np.arange(20) - 0.5), signal)
    block = MovingAverage(samples=samples, period=0.25, size=3)
    found = shown(block, steps, 0.25, 0.25 * 18).data()
    for k in range(found.shape[1]):
        expected = signal[:, max(k - samples + 1, 0) : k + 1].mean(axis=1)
        np.testing.assert_allclose(found[:, k], expected, rtol=0, atol=1e-14)
