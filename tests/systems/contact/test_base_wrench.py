"""The base's wrench on an arm, against the momentum of Drake's plant."""

import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from chamfer.models.arms.adept_wrist import ADEPT_WRIST
from chamfer.models.arms.arm import Arm
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.systems.contact.arm_dynamics import ArmDynamics, base_wrench, pose

STEP = 1e-5  # s, of the momentum's difference


@pytest.mark.parametrize("arm", [ADEPT_WRIST, PUMA_250], ids=lambda arm: arm.name)
@pytest.mark.parametrize("seed", range(3))
def test_base_carries_weight_and_change_of_momentum(arm: Arm, seed: int) -> None:
    rng, n = np.random.default_rng(seed), arm.num_joints
    q = rng.uniform(-1.5, 1.5, n)
    v, acceleration = rng.uniform(-2, 2, (2, n))
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(arm.urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    context = plant.CreateDefaultContext()
    momenta = []
    for time in (-STEP, STEP):
        moved = q + time * v + time**2 / 2 * acceleration
        plant.SetPositionsAndVelocities(context, np.append(moved, v + time * acceleration))
        momentum = plant.CalcSpatialMomentumInWorldAboutPoint(context, np.zeros(3))
        momenta.append(np.append(momentum.rotational(), momentum.translational()))
    plant.SetPositions(context, q)
    weight = plant.CalcTotalMass(context) * np.array([0.0, 0.0, 9.81])
    centre = plant.CalcCenterOfMassPositionInWorld(context)
    expected = np.append(np.cross(centre, weight), weight)
    expected += (momenta[1] - momenta[0]) / (2 * STEP)
    chain = ArmDynamics(arm).chain
    found = base_wrench(chain, pose(chain, q), v, acceleration)
    np.testing.assert_allclose(found, expected, rtol=0, atol=2e-6)
