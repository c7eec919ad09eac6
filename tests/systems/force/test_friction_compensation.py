"""Friction compensation: its lag in closed form, and what it does to a plant with friction."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.primitives import AffineSystem, ConstantVectorSource

from chamfer.models.validation import ParameterError
from chamfer.systems.force.friction_compensation import (
    FrictionCompensation,
    FrictionCompensationParams,
)

COMMAND = np.array([3.0, -1.0])
FRICTION = np.array([0.75, -0.2])
PERIOD = 0.005


class Driven:
    """The block with a plant that a test computes: the base torque of every tick."""

    def __init__(self, bandwidth: float, joints: int = 2, period: float = PERIOD) -> None:
        params = FrictionCompensationParams(bandwidth=bandwidth)
        self.block = FrictionCompensation(params, joints=joints, period=period)
        self.simulator = Simulator(self.block)
        self.context: Any = self.simulator.get_mutable_context()
        self.period = period
        self.ticks = 0

    def command(self, torque: Any) -> np.ndarray:
        """Set the command; return the torque that comes of it at once."""
        self.block.GetInputPort("command").FixValue(self.context, torque)
        return self.torque

    def tick(self, base_torque: Any) -> np.ndarray:
        """Run the next tick and return the torque after it."""
        self.block.GetInputPort("base_torque").FixValue(self.context, base_torque)
        self.simulator.AdvanceTo(self.ticks * self.period)
        self.simulator.AdvancePendingEvents()
        self.ticks += 1
        return self.torque

    @property
    def torque(self) -> np.ndarray:
        found: np.ndarray = self.block.GetOutputPort("torque").Eval(self.context).copy()
        return found


def with_ideal_plant(bandwidth: float, ticks: int, period: float = PERIOD) -> np.ndarray:
    """Return the torques over the ticks where constant friction is taken from each."""
    driven = Driven(bandwidth, period=period)
    torques = [driven.command(COMMAND)]
    for _ in range(ticks):
        torques.append(driven.tick(torques[-1] - FRICTION))
    return np.array(torques)


@settings(max_examples=25)
@given(bandwidth=st.floats(0.5, 100.0), period=st.sampled_from([0.001, 0.005, 0.02]))
def test_lag_in_closed_form(bandwidth: float, period: float) -> None:
    torques = with_ideal_plant(bandwidth, 20, period)
    times = period * np.arange(21)
    grown = 1 - np.exp(-2 * math.pi * bandwidth * times)
    expected = COMMAND + np.outer(grown, FRICTION)
    np.testing.assert_allclose(torques, expected, rtol=0, atol=1e-12)


def test_friction_is_made_up_for() -> None:
    torques = with_ideal_plant(10.0, 200)
    np.testing.assert_array_equal(torques[0], COMMAND)
    np.testing.assert_allclose(torques[-1], COMMAND + FRICTION, rtol=0, atol=1e-12)
    # At its bandwidth of 10 Hz the lag's time constant is 16 ms: 3.2 ticks.
    reached = (torques[:, 0] - COMMAND[0]) / FRICTION[0]
    assert reached[3] < 1 - math.exp(-1) < reached[4]


def test_links_get_the_command_in_a_sampled_loop() -> None:
    builder = DiagramBuilder()
    params = FrictionCompensationParams(bandwidth=20.0)
    block = builder.AddSystem(FrictionCompensation(params, joints=2, period=PERIOD))
    command = builder.AddSystem(ConstantVectorSource(COMMAND))
    # The sensor shows what was transmitted over the last period, torque less friction.
    links = builder.AddSystem(
        AffineSystem(
            A=np.zeros((2, 2)),
            B=np.eye(2),
            f0=-FRICTION,
            C=np.eye(2),
            D=np.zeros((2, 2)),
            y0=np.zeros(2),
            time_period=PERIOD,
        )
    )
    builder.Connect(command.get_output_port(), block.GetInputPort("command"))
    builder.Connect(links.get_output_port(), block.GetInputPort("base_torque"))
    builder.Connect(block.GetOutputPort("torque"), links.get_input_port())
    simulator = Simulator(builder.Build())
    transmitted = links.GetMyMutableContextFromRoot(simulator.get_mutable_context())
    transmitted.SetDiscreteState(COMMAND - FRICTION)
    for ticks in range(60):
        simulator.AdvanceTo(ticks * PERIOD)
        simulator.AdvancePendingEvents()
        # The links step after the compensation's tick of the same instant.
        left = math.exp(-2 * math.pi * 20.0 * PERIOD * (ticks + 1))
        np.testing.assert_allclose(
            transmitted.get_discrete_state_vector().value(),
            COMMAND - left * FRICTION,
            rtol=0,
            atol=1e-12,
        )


def test_follows_a_change_of_the_command_at_once() -> None:
    driven = Driven(10.0)
    driven.command(COMMAND)
    for _ in range(300):
        driven.tick(driven.torque - FRICTION)
    np.testing.assert_allclose(
        driven.command([-8.0, 5.0]), np.array([-8.0, 5.0]) + FRICTION, rtol=0, atol=1e-12
    )


def test_without_friction_nothing_is_added() -> None:
    driven = Driven(10.0)
    driven.command(COMMAND)
    for _ in range(10):
        np.testing.assert_array_equal(driven.tick(COMMAND), COMMAND)


def test_friction_of_one_joint_stays_there() -> None:
    driven = Driven(10.0, joints=3)
    driven.command([0.0, 0.0, 0.0])
    torque = driven.tick([0.0, -0.5, 0.0])
    assert torque[1] == pytest.approx(0.5 * (1 - math.exp(-0.1 * math.pi)), abs=1e-15)
    assert torque[0] == torque[2] == 0.0


def test_estimate_is_held_between_ticks() -> None:
    driven = Driven(10.0)
    driven.command(COMMAND)
    after = driven.tick(COMMAND - FRICTION)
    driven.block.GetInputPort("base_torque").FixValue(driven.context, [9.0, 9.0])
    driven.simulator.AdvanceTo(0.0049)
    np.testing.assert_array_equal(driven.torque, after)


def test_only_the_command_feeds_through() -> None:
    block = Driven(10.0).block
    through = {
        block.get_input_port(i).get_name()
        for i in range(block.num_input_ports())
        if block.HasDirectFeedthrough(i, 0)
    }
    assert through == {"command"}
    assert [block.get_input_port(i).size() for i in range(2)] == [2, 2]
    assert block.GetOutputPort("torque").size() == 2


def test_the_estimate_of_a_joint_that_is_to_stand_is_kept() -> None:
    driven = Driven(10.0)
    driven.command(COMMAND)
    moving = driven.block.GetInputPort("moving")
    moving.FixValue(driven.context, [1.0, 1.0])
    for _ in range(200):
        driven.tick(driven.torque - FRICTION)
    np.testing.assert_allclose(driven.torque, COMMAND + FRICTION, rtol=0, atol=1e-12)
    moving.FixValue(driven.context, [1.0, 0.0])
    for _ in range(30):
        # Both stick: what they are given does not reach the links.
        driven.tick([0.0, 0.0])
    added = driven.torque - COMMAND
    assert added[1] == pytest.approx(FRICTION[1], abs=1e-12)
    assert added[0] > 2 * COMMAND[0]


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_base_torque_has_to_be_finite(bad: float) -> None:
    driven = Driven(10.0)
    driven.command(COMMAND)
    with pytest.raises(
        ParameterError, match=rf"^base_torque is \[1.0, {bad}\], allowed: finite numbers$"
    ):
        driven.tick([1.0, bad])


@pytest.mark.parametrize("bandwidth", [0.0, math.nan])
def test_parameters(bandwidth: float) -> None:
    with pytest.raises(ParameterError) as caught:
        FrictionCompensationParams(bandwidth=bandwidth)
    assert str(caught.value) == f"bandwidth is {bandwidth}, allowed: a finite number > 0"


def test_only_some_joints_may_be_compensated() -> None:
    params = FrictionCompensationParams(bandwidth=20.0, joints=(1,))
    block = FrictionCompensation(params, joints=2, period=PERIOD)
    context = block.CreateDefaultContext()
    block.GetInputPort("command").FixValue(context, COMMAND)
    block.GetInputPort("base_torque").FixValue(context, COMMAND - FRICTION)
    simulator = Simulator(block, context)
    simulator.AdvanceTo(0.5)
    found = block.GetOutputPort("torque").Eval(context)
    assert found[0] == COMMAND[0]
    assert abs(found[1] - COMMAND[1]) > 0.1
    for joints in ((2,), (1, 1)):
        wrong = FrictionCompensationParams(bandwidth=20.0, joints=joints)
        with pytest.raises(ParameterError, match=r"^joints is .* different indices below 2"):
            FrictionCompensation(wrong, joints=2, period=PERIOD)
