"""A motion from rest to rest that can be told to stop."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context

from chamfer.models.validation import ParameterError
from chamfer.systems.force.desired_pose import StoppableMotion

Array = np.ndarray

START = np.array([0.1, -0.2, 0.3])
GOAL = RigidTransform(RollPitchYaw(0.3, -0.2, 0.1), np.array([0.5, 0.0, 0.2]))
DURATION, PERIOD = 2.0, 0.25


def motion() -> StoppableMotion:
    return StoppableMotion(START, GOAL, DURATION, PERIOD)


def pose(block: StoppableMotion, context: Context) -> Array:
    return np.array(block.GetOutputPort("desired_pose").Eval(context))


def velocity(block: StoppableMotion, context: Context) -> Array:
    return np.array(block.GetOutputPort("desired_velocity").Eval(context))


def at(time: float) -> tuple[Array, Array]:
    """Pose and velocity at a time, with nothing that stops it."""
    block = motion()
    context = block.CreateDefaultContext()
    context.SetTime(time)
    return pose(block, context), velocity(block, context)


@given(time=st.floats(0.0, 3.0))
@settings(max_examples=50, deadline=None)
def test_cubic_from_rest_to_rest_on_a_line(time: float) -> None:
    found, rate = at(time)
    s = min(time / DURATION, 1.0)
    way = GOAL.translation() - START
    np.testing.assert_allclose(found[4:], START + (3 * s**2 - 2 * s**3) * way, rtol=0, atol=1e-12)
    np.testing.assert_allclose(rate[3:], 6 * s * (1 - s) / DURATION * way, rtol=0, atol=1e-12)


@pytest.mark.parametrize("time", [0.0, 0.7, 2.0, 3.0])
def test_the_orientation_is_the_goals_all_along(time: float) -> None:
    found, rate = at(time)
    np.testing.assert_allclose(found[:4], GOAL.rotation().ToQuaternion().wxyz(), atol=1e-15)
    assert not rate[:3].any()


@pytest.mark.parametrize("time", np.linspace(0.05, 2.95, 24))
def test_velocity_is_the_derivative_of_the_pose(time: float) -> None:
    step = 1e-5
    between = (at(time + step)[0] - at(time - step)[0]) / (2 * step)
    np.testing.assert_allclose(at(time)[1][3:], between[4:], rtol=0, atol=1e-6)


@pytest.mark.parametrize("time", [0.0, DURATION, 5.0])
def test_at_rest_before_and_behind(time: float) -> None:
    found, rate = at(time)
    np.testing.assert_allclose(found[4:], GOAL.translation() if time else START, atol=1e-15)
    np.testing.assert_allclose(rate, 0.0, atol=1e-15)


def stopped(when: float, *, back: bool) -> tuple[StoppableMotion, Simulator]:
    """A motion that is told to stop shortly before a time, and maybe to go on afterwards."""
    block = motion()
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    stop = block.GetInputPort("stop")
    stop.FixValue(context, [0.0])
    if when > 0.1:
        simulator.AdvanceTo(when - 0.1)
    stop.FixValue(context, [1.0])
    simulator.AdvanceTo(when + 0.1)
    stop.FixValue(context, [0.0 if back else 1.0])
    return block, simulator


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("when", [0.0, 0.75, 1.75, 2.5])
def test_stops_where_it_is_for_good(when: float, back: bool) -> None:
    block, simulator = stopped(when, back=back)
    for time in (when + 0.1, when + 0.3, when + 1.7, when + 5.0):
        simulator.AdvanceTo(time)
        context = simulator.get_context()
        np.testing.assert_allclose(pose(block, context), at(when)[0], rtol=0, atol=1e-12)
        assert not velocity(block, context).any()


def test_looks_once_a_period() -> None:
    block = motion()
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    block.GetInputPort("stop").FixValue(context, [0.0])
    simulator.AdvanceTo(0.76)
    block.GetInputPort("stop").FixValue(context, [1.0])
    simulator.AdvanceTo(0.99)
    np.testing.assert_allclose(pose(block, context), at(0.99)[0], rtol=0, atol=1e-12)
    assert velocity(block, context)[3] > 0.1
    simulator.AdvanceTo(1.5)
    np.testing.assert_allclose(pose(block, context), at(1.0)[0], rtol=0, atol=1e-12)


@pytest.mark.parametrize("stop", [None, 0.0, 0.49, math.nan])
def test_goes_on_when_it_is_not_told(stop: float | None) -> None:
    block = motion()
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    if stop is not None:
        block.GetInputPort("stop").FixValue(context, [stop])
    simulator.AdvanceTo(1.3)
    np.testing.assert_allclose(pose(block, context), at(1.3)[0], rtol=0, atol=1e-12)


def test_a_stop_has_no_effect_but_at_a_look() -> None:
    block = motion()
    assert not block.HasAnyDirectFeedthrough()


@pytest.mark.parametrize("name", ["duration", "period"])
@pytest.mark.parametrize("value", [0.0, -1.0, math.nan, math.inf])
def test_times_that_cannot_be(name: str, value: float) -> None:
    times = {"duration": DURATION, "period": PERIOD, name: value}
    with pytest.raises(ParameterError, match=rf"^{name} is {value}, allowed: a finite number > 0"):
        StoppableMotion(START, GOAL, **times)


@pytest.mark.parametrize("start", [[0.0, 0.0], [0.0, math.nan, 0.0], [[0.0, 0.0, 0.0]]])
def test_starts_that_cannot_be(start: list[float]) -> None:
    with pytest.raises(ParameterError) as caught:
        StoppableMotion(np.array(start), GOAL, DURATION, PERIOD)
    assert str(caught.value) == f"p_WT is {start}, allowed: three finite numbers"
