"""Encoders: counts, velocities, homing, and the endpoint's motion."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common import RandomDistribution, RandomGenerator
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder, LeafSystem
from pydrake.systems.primitives import (
    LogVectorOutput,
    RandomSource,
    TrajectorySource,
    ZeroOrderHold,
)
from pydrake.trajectories import PiecewisePolynomial

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.arm import Arm
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.models.validation import ParameterError
from chamfer.systems.sensing.computation_delay import ComputationDelay
from chamfer.systems.sensing.encoders import (
    EncoderParams,
    Encoders,
    EndpointMotion,
    Homing,
    HomingParams,
    linear_encoders,
)

PERIOD = 0.005


def read(params: EncoderParams, motion: Any, q: Any = (0.0, 0.0)) -> np.ndarray:
    block = Encoders(params, np.array(q), period=PERIOD)
    context = block.CreateDefaultContext()
    block.GetInputPort("motion").FixValue(context, motion)
    found: np.ndarray = block.GetOutputPort("encoders").Eval(context)
    return found


def follow(params: EncoderParams, speed: float, until: float) -> np.ndarray:
    """What is shown at each tick of a joint that moves at a constant speed from 0."""
    builder = DiagramBuilder()
    path = PiecewisePolynomial.FirstOrderHold(
        [0.0, until + 1], [[0.0, speed * (until + 1)], [speed, speed]]
    )
    motion = builder.AddSystem(TrajectorySource(path, 0, False))
    block = builder.AddSystem(Encoders(params, np.zeros(1), period=PERIOD))
    builder.Connect(motion.get_output_port(), block.GetInputPort("motion"))
    logger = LogVectorOutput(block.GetOutputPort("encoders"), builder, PERIOD)
    simulator = Simulator(builder.Build())
    simulator.AdvanceTo(until)
    found: np.ndarray = logger.FindLog(simulator.get_context()).data().T.copy()
    return found


@given(q=st.lists(st.floats(-3, 3), min_size=2, max_size=2))
def test_positions_are_whole_counts(q: list[float]) -> None:
    found = read(EncoderParams(counts=(100.0, 0.0), velocity="exact", bandwidth=0.0), [*q, 5, -6])
    assert found[0] * 100 == pytest.approx(round(q[0] * 100), abs=1e-9)
    assert abs(found[0] - q[0]) <= 0.005 + 1e-12
    np.testing.assert_array_equal(found[1:], [q[1], 5, -6])


def test_a_differenced_velocity_is_the_mean_of_a_period() -> None:
    params = EncoderParams(counts=0.0, velocity="differenced", bandwidth=0.0)
    found = follow(params, 0.3, 0.1)
    # A row is of the tick at its time; the joint is taken to have been at rest before.
    np.testing.assert_allclose(found[:, 0], 0.3 * PERIOD * np.arange(len(found)), atol=1e-12)
    np.testing.assert_allclose(found[1:, 1], 0.3, atol=1e-9)


def test_a_tracking_filter_has_its_poles_and_no_lag_in_velocity() -> None:
    params = EncoderParams(counts=0.0, velocity="tracked", bandwidth=20.0)
    error = 1 - follow(params, 1.0, 0.5)[:, 1]
    pole = math.exp(-2 * math.pi * 20 * PERIOD)
    # Both poles at p: (a + b k) p^k, from the second sample on.
    k = np.arange(1, 25)
    scaled = error[1:25] / pole**k
    np.testing.assert_allclose(np.diff(scaled, 2), 0.0, atol=1e-6)
    assert abs(error[-1]) < 1e-9


@pytest.mark.parametrize(
    ("velocity", "bandwidth"),
    [("exact", 0.0), ("differenced", 0.0), ("differenced", 20.0), ("tracked", 20.0)],
)
def test_the_sampled_model_shows_what_the_block_shows(velocity: Any, bandwidth: float) -> None:
    params = EncoderParams(counts=0.0, velocity=velocity, bandwidth=bandwidth)
    block = Encoders(params, np.zeros(2), period=PERIOD)
    context = block.CreateDefaultContext()
    model = linear_encoders(params, 2, period=PERIOD, beside=1)
    x = np.zeros(len(model.A))
    for motion in np.random.default_rng(0).normal(size=(4, 4)):
        block.GetInputPort("motion").FixValue(context, motion)
        u = np.append(motion, 7.0)
        shown = block.GetOutputPort("encoders").Eval(context)
        np.testing.assert_allclose(model.C @ x + model.D @ u, [*shown, 7.0], atol=1e-9)
        x = model.A @ x + model.B @ u
        if velocity != "exact":
            after = block.EvalUniquePeriodicDiscreteUpdate(context)
            context.SetDiscreteState(after)


@pytest.mark.parametrize("velocity", ["differenced", "tracked"])
def test_it_starts_at_rest(velocity: Any) -> None:
    params = EncoderParams(counts=1000.0, velocity=velocity, bandwidth=20.0)
    found = read(params, [0.12345, -1.0, 0.0, 0.0], q=(0.12345, -1.0))
    np.testing.assert_allclose(found, [0.123, -1.0, 0.0, 0.0], atol=1e-12)


def test_counts_are_for_each_joint() -> None:
    params = EncoderParams(counts=(1.0, 2.0, 3.0), velocity="exact", bandwidth=0.0)
    with pytest.raises(ParameterError, match=r"^counts is .*, allowed: 2 numbers, or one for all"):
        read(params, np.zeros(4))
    assert not params.exact
    assert EncoderParams(counts=0.0, velocity="exact", bandwidth=0.0).exact


HOMING_PERIOD = 0.25  # s, a binary fraction
START = np.array([1.0, -2.0])
PARAMS = HomingParams(zero_error=(0.1, -0.2), mark_distance=(0.3, -0.3), settle=1.0)


def shown(homing: Homing, motions: list[list[float]]) -> tuple[np.ndarray, list[float]]:
    """Return what is shown a period after each motion, shape (steps, 2n), and whether homed."""
    simulator = Simulator(homing)
    context = simulator.get_mutable_context()
    rows, homed = [], []
    for motion in motions:
        homing.GetInputPort("motion").FixValue(context, np.array(motion))
        simulator.AdvanceTo(context.get_time() + HOMING_PERIOD)
        rows.append(homing.GetOutputPort("encoders").Eval(context))
        homed.append(homing.GetOutputPort("homed").Eval(context)[0])
    return np.array(rows), homed


def test_without_marks_zeros_stay_unknown() -> None:
    rows, homed = shown(Homing(PARAMS, START, period=HOMING_PERIOD), [[1.2, -2.2, 0.5, 0.6]] * 8)
    # 1.2 and -2.2 are short of the marks at 1.3 and -2.3.
    assert rows == pytest.approx(np.tile([1.3, -2.4, 0.5, 0.6], (8, 1)))
    assert not any(homed)


def test_zero_is_taken_over_gradually_behind_each_mark() -> None:
    first = [[1.0, -2.0, 0.0, 0.0], [1.4, -2.0, 0.0, 0.0]]
    rows, homed = shown(
        Homing(PARAMS, START, period=HOMING_PERIOD), first + [[1.4, -2.4, 0.0, 0.0]] * 8
    )
    errors = rows[:, :2] - np.array([m[:2] for m in first + [[1.4, -2.4]] * 8])
    assert errors[0] == pytest.approx([0.1, -0.2])
    assert np.all(np.diff(errors[:, 0]) <= 0)
    assert np.all(np.diff(errors[:, 1]) >= 0)
    # Halfway at half the time: the mark was passed in the second step, and in the third.
    assert errors[3, 0] == pytest.approx(0.1 * (1 - 0.75**3 * (10 - 15 * 0.75 + 6 * 0.75**2)))
    assert errors[-1] == pytest.approx([0.0, 0.0])
    assert homed[0] == homed[3] == 0.0
    assert homed[-1] == 1.0


@pytest.mark.parametrize("arm", [PLANAR_TWO_LINK, PUMA_250, ADEPT_ONE], ids=lambda arm: arm.name)
def test_position_and_velocity(arm: Arm) -> None:
    n, d = arm.num_joints, min(arm.num_coordinates, 3)
    q, v = np.random.default_rng(0).uniform(-1, 1, (2, n))
    block = EndpointMotion(arm, dimension=d)
    context = block.CreateDefaultContext()
    block.get_input_port().FixValue(context, [*q, *v])
    x, rate = np.split(block.GetOutputPort("endpoint_motion").Eval(context), 2)
    np.testing.assert_array_equal(x, arm.endpoint(q))
    step = 1e-6
    difference = (arm.endpoint(q + step * v) - arm.endpoint(q - step * v)) / (2 * step)
    np.testing.assert_allclose(rate, difference, atol=1e-8)
    nominal = block.GetOutputPort("nominal_motion").Eval(context)
    np.testing.assert_array_equal(nominal, [*x[:d], *rate[:d]])


STEP = 0.001


class Ticker(LeafSystem):
    """Puts out 3, 6, 9, ... from its ticks on, as the controller does."""

    def __init__(self) -> None:
        super().__init__()
        count = self.DeclareDiscreteState([0.0])
        self.DeclareStateOutputPort("torque", count)

        def tick(context: Any, state: Any) -> None:
            values = state.get_mutable_discrete_state()
            values.set_value([values.value()[0] + 3])

        self.DeclarePeriodicUnrestrictedUpdateEvent(PERIOD, 0.0, tick)


def held(delay: float, jitter: float = 0.0, until: float = 0.0505) -> np.ndarray:
    """What the plant holds in each of its steps, in thirds."""
    builder = DiagramBuilder()
    ticker = builder.AddSystem(Ticker())
    block = builder.AddSystem(
        ComputationDelay(1, delay=delay, jitter=jitter, period=PERIOD, step=STEP)
    )
    plant = builder.AddSystem(ZeroOrderHold(STEP, 1))  # for a step, as the plant does
    noise = builder.AddSystem(RandomSource(RandomDistribution.kUniform, 1, PERIOD))
    builder.Connect(ticker.get_output_port(), block.GetInputPort("command"))
    builder.Connect(noise.get_output_port(), block.GetInputPort("jitter"))
    builder.Connect(block.get_output_port(), plant.get_input_port())
    logger = LogVectorOutput(plant.get_output_port(), builder, STEP)
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    diagram.SetRandomContext(context, RandomGenerator(1))
    simulator = Simulator(diagram, context)
    simulator.AdvanceTo(until)
    found: np.ndarray = logger.FindLog(simulator.get_context()).data()[0, 1:] / 3
    return found


@pytest.mark.parametrize(
    ("delay", "expected"),
    [
        (0.0, [1, 1, 1, 1, 1]),
        (0.002, [0, 0, 1, 1, 1]),
        (0.0025, [0, 0, 0.5, 1, 1]),
        (0.0001, [0.9, 1, 1, 1, 1]),
        (0.005, [0, 0, 0, 0, 0]),
    ],
)
def test_a_torque_waits_for_its_delay(delay: float, expected: list[float]) -> None:
    found = held(delay)
    # 5 steps a period, in the k-th of which the torques k - 1 and k are applied
    for k in range(10):
        np.testing.assert_allclose(found[5 * k : 5 * k + 5] - k, expected, atol=1e-9)


def test_jitter_is_uniform_about_the_delay() -> None:
    # The impulse of each period shows its delay.
    found = held(0.0025, 0.001, until=10.0)
    rows = found[: len(found) // 5 * 5].reshape(-1, 5)
    late = PERIOD - STEP * (rows - np.arange(len(rows))[:, np.newaxis]).sum(axis=1)
    assert late.min() >= 0.0015 - 1e-9
    assert late.max() <= 0.0035 + 1e-9
    assert late.mean() == pytest.approx(0.0025, abs=6e-5)
    assert late.std() == pytest.approx(0.001 / np.sqrt(3), rel=0.05)
