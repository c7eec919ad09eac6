"""Friction compensation: its lag in closed form, the joints that move, the base's sensor."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.analysis import Simulator

from chamfer.models.arms.adept_wrist import ADEPT_WRIST
from chamfer.models.arms.arm import Arm
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.systems.contact.arm_dynamics import ArmDynamics, base_wrench, pose
from chamfer.systems.force.friction_compensation import (
    BaseWrenchTorque,
    FrictionCompensation,
    FrictionCompensationParams,
    JointsToMove,
)

COMMAND = np.array([3.0, -1.0])
FRICTION = np.array([0.75, -0.2])
PERIOD = 0.005


def compensation(driven: Any, bandwidth: float, period: float = PERIOD) -> Any:
    params = FrictionCompensationParams(bandwidth=bandwidth)
    block = FrictionCompensation(params, joints=2, period=period)
    return driven(block, period, "torque", command=COMMAND)


@settings(max_examples=25)
@given(bandwidth=st.floats(0.5, 100.0), period=st.sampled_from([0.001, 0.005, 0.02]))
def test_lag_in_closed_form(driven: Any, bandwidth: float, period: float) -> None:
    block = compensation(driven, bandwidth, period)
    torques = [block.read("torque")]
    for _ in range(20):  # constant friction is taken from each
        torques.append(block.tick(base_torque=torques[-1] - FRICTION))
    times = period * np.arange(21)
    grown = 1 - np.exp(-2 * math.pi * bandwidth * times)
    expected = COMMAND + np.outer(grown, FRICTION)
    np.testing.assert_allclose(torques, expected, rtol=0, atol=1e-12)


def test_the_estimate_of_a_joint_that_is_to_stand_is_kept(driven: Any) -> None:
    block = compensation(driven, 10.0)
    torque = block.read("torque")
    for _ in range(200):
        torque = block.tick(base_torque=torque - FRICTION, moving=[1.0, 1.0])
    np.testing.assert_allclose(torque, COMMAND + FRICTION, rtol=0, atol=1e-12)
    for _ in range(30):
        # Both stick: what they are given does not reach the links.
        torque = block.tick(base_torque=[0.0, 0.0], moving=[1.0, 0.0])
    added = torque - COMMAND
    assert added[1] == pytest.approx(FRICTION[1], abs=1e-12)
    assert added[0] > 2 * COMMAND[0]


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


Q = np.array([0.3, 1.1, 0.35, -0.4, 0.3, 0.3, 0.0])
REST = 1e-3


def moving(desired: np.ndarray, rest_speed: float = REST) -> list[float]:
    """Return what the block says at Q, with encoders that say so of joints that move."""
    block = JointsToMove(ADEPT_WRIST, rest_speed=rest_speed)
    context = block.CreateDefaultContext()
    block.GetInputPort("encoders").FixValue(context, [*Q, *np.ones(7)])
    block.GetInputPort("desired_velocity").FixValue(context, desired)
    found: list[float] = block.GetOutputPort("moving").Eval(context).tolist()
    return found


@pytest.mark.parametrize("joint", range(7))
def test_a_joint_moves_from_the_rest_speed_on(joint: int) -> None:
    jacobian = ADEPT_WRIST.jacobian(Q)
    for share, expected in ((-1.1, 1.0), (1.1, 1.0), (0.9, 0.0), (0.0, 0.0)):
        speeds = np.zeros(7)
        speeds[joint] = share * REST
        found = moving(jacobian @ speeds)
        assert found[joint] == expected
        assert sum(found) == expected


@pytest.mark.parametrize("arm", [ADEPT_WRIST, PUMA_250], ids=lambda arm: arm.name)
@pytest.mark.parametrize("seed", range(4))
def test_torques_are_those_that_move_the_arm_and_push(arm: Arm, seed: int) -> None:
    rng, n = np.random.default_rng(seed), arm.num_joints
    q, v = rng.uniform(-1.5, 1.5, n), rng.uniform(-2, 2, n)
    force = rng.uniform(-20, 20, 3)
    dynamics = ArmDynamics(arm)
    block = BaseWrenchTorque(dynamics)
    context = block.CreateDefaultContext()
    chain = dynamics.chain
    wrench = base_wrench(chain, pose(chain, q), v, np.zeros(n))
    tip = dynamics.evaluate(q, v).p_WC
    wrench -= np.append(np.cross(tip, force), force)
    block.GetInputPort("base_wrench").FixValue(context, wrench)
    block.GetInputPort("encoders").FixValue(context, np.concatenate([q, v]))
    state = dynamics.evaluate(q, v)
    expected = state.bias - state.J_v_WC.T @ force
    found = block.GetOutputPort("base_torque").Eval(context)
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)
