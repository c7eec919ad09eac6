"""The torques that a base sensor shows are those that the equations of motion ask for."""

import numpy as np
import pytest

from chamfer.models.arms.adept_wrist import ADEPT_WRIST
from chamfer.models.arms.arm import Arm
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.systems.contact.arm_dynamics import ArmDynamics, base_wrench, pose
from chamfer.systems.force.friction_compensation import BaseWrenchTorque


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
