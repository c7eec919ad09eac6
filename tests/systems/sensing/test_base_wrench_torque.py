"""The torques that a base sensor shows, against momentum and weight by Drake's plant."""

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from models.arms.adept_wrist import ADEPT_WRIST
from models.arms.arm import Arm
from models.arms.puma_250 import PUMA_250
from systems.contact.arm_dynamics import ArmDynamics
from systems.sensing.base_wrench_torque import BaseWrenchTorque

STEP = 1e-5  # s, of the momentum's difference


def base_wrench(arm: Arm, q: np.ndarray, v: np.ndarray, force: np.ndarray) -> np.ndarray:
    """What the base gives an arm whose joints keep their speeds while a force acts on its tip."""
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(arm.urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    momenta = []
    for sign in (-1.0, 1.0):
        plant.SetPositionsAndVelocities(context, np.concatenate([q + sign * STEP * v, v]))
        momentum = plant.CalcSpatialMomentumInWorldAboutPoint(context, np.zeros(3))
        momenta.append(np.concatenate([momentum.rotational(), momentum.translational()]))
    plant.SetPositionsAndVelocities(context, np.concatenate([q, v]))
    weight = plant.CalcTotalMass(context) * np.array([0.0, 0.0, -9.81])
    centre = plant.CalcCenterOfMassPositionInWorld(context)
    tip = plant.GetFrameByName("endpoint").CalcPoseInWorld(context).translation()
    outer = np.concatenate([np.cross(centre, weight) + np.cross(tip, force), weight + force])
    change: np.ndarray = (momenta[1] - momenta[0]) / (2 * STEP)
    return change - outer


@pytest.mark.parametrize("arm", [ADEPT_WRIST, PUMA_250], ids=lambda arm: arm.name)
@pytest.mark.parametrize("seed", range(4))
def test_torques_are_those_that_move_the_arm_and_push(arm: Arm, seed: int) -> None:
    rng, n = np.random.default_rng(seed), arm.num_joints
    q, v = rng.uniform(-1.5, 1.5, n), rng.uniform(-2, 2, n)
    force = rng.uniform(-20, 20, 3)
    dynamics = ArmDynamics(arm)
    block = BaseWrenchTorque(dynamics)
    context = block.CreateDefaultContext()
    block.GetInputPort("base_wrench").FixValue(context, base_wrench(arm, q, v, force))
    block.GetInputPort("encoders").FixValue(context, np.concatenate([q, v]))
    state = dynamics.evaluate(q, v)
    expected = state.bias - state.J_v_WC.T @ force
    found = block.GetOutputPort("base_torque").Eval(context)
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6)
