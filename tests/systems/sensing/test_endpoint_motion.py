"""The endpoint's motion against differences of the kinematics."""

import numpy as np
import pytest

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.arm import Arm
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.systems.sensing.encoders import EndpointMotion


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
