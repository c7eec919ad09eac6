"""Equations of motion and the base's wrench against Drake's plant."""

import dataclasses
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import Context

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.adept_wrist import ADEPT_WRIST
from chamfer.models.arms.arm import Arm
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.arm_dynamics import ArmDynamics, base_wrench, pose

ARMS = (PLANAR_TWO_LINK, PUMA_250, ADEPT_ONE, ADEPT_WRIST)
OFFSET = (0.03, -0.05, 0.07)


def load(arm: Arm) -> tuple[MultibodyPlant, Context]:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(arm.urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return plant, plant.CreateDefaultContext()


PLANTS = {arm.name: load(arm) for arm in ARMS}
WITH_OFFSET = {arm.name: ArmDynamics(arm, contact_offset=OFFSET) for arm in ARMS}

angles = st.floats(-math.pi, math.pi)
rates = st.floats(-3.0, 3.0)


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
@given(data=st.data())
def test_equations_of_motion_are_those_of_the_multibody_plant(
    arm: Arm, data: st.DataObject
) -> None:
    plant, context = PLANTS[arm.name]
    q, v = (data.draw(arrays(float, arm.num_joints, elements=one)) for one in (angles, rates))
    plant.SetPositionsAndVelocities(context, np.concatenate([q, v]))
    found = WITH_OFFSET[arm.name].evaluate(q, v)
    bias = plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context)
    world, endpoint = plant.world_frame(), plant.GetFrameByName("endpoint")
    jacobian = plant.CalcJacobianTranslationalVelocity(
        context, JacobianWrtVariable.kV, endpoint, np.array(OFFSET), world, world
    )
    expected = (plant.CalcMassMatrix(context), bias, jacobian)
    for value, drakes in zip((found.mass, found.bias, found.J_v_WC), expected, strict=True):
        np.testing.assert_allclose(value, drakes, rtol=0, atol=1e-11)
    X_WE = endpoint.CalcPoseInWorld(context)
    np.testing.assert_allclose(found.R_WE, X_WE.rotation().matrix(), rtol=0, atol=1e-12)
    np.testing.assert_allclose(found.p_WC, X_WE @ np.array(OFFSET), rtol=0, atol=1e-12)


def test_only_chains_have_equations_of_motion(tmp_path: Path) -> None:
    branched = tmp_path / "branched.urdf"
    links = "".join(f'<link name="{name}"/>' for name in ("base", "one", "two", "endpoint"))
    joints = "".join(
        f'<joint name="to_{child}" type="{kind}"><parent link="base"/><child link="{child}"/>'
        '<axis xyz="0 0 1"/></joint>'
        for child, kind in (("one", "continuous"), ("two", "continuous"), ("endpoint", "fixed"))
    )
    branched.write_text(f'<robot name="branched">{links}{joints}</robot>')
    with pytest.raises(ParameterError, match=r"^urdf is .*, allowed: a chain of revolute and"):
        ArmDynamics(dataclasses.replace(PUMA_250, urdf=branched))


STEP = 1e-5  # s, of the momentum's difference


@pytest.mark.parametrize("arm", [ADEPT_WRIST, PUMA_250], ids=lambda arm: arm.name)
@pytest.mark.parametrize("seed", range(3))
def test_base_carries_weight_and_change_of_momentum(arm: Arm, seed: int) -> None:
    rng, n = np.random.default_rng(seed), arm.num_joints
    q = rng.uniform(-1.5, 1.5, n)
    v, acceleration = rng.uniform(-2, 2, (2, n))
    plant, context = PLANTS[arm.name]
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
