"""Equations of motion against closed forms, potential energy and derivatives of the point."""

import dataclasses
import math
import re
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
from chamfer.systems.contact.arm_dynamics import ArmDynamics

ARMS = (PLANAR_TWO_LINK, PUMA_250, ADEPT_ONE)
OFFSET = (0.03, -0.05, 0.07)
GRAVITY = 9.81

PLANAR = ArmDynamics(PLANAR_TWO_LINK)
DYNAMICS = {arm.name: ArmDynamics(arm) for arm in ARMS}
WEIGHTLESS = {arm.name: ArmDynamics(arm, gravity=False) for arm in ARMS}


def load(arm: Arm) -> tuple[MultibodyPlant, Context]:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(arm.urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return plant, plant.CreateDefaultContext()


PLANTS = {arm.name: load(arm) for arm in ARMS}
WITH_OFFSET = {arm.name: ArmDynamics(arm, contact_offset=OFFSET) for arm in ARMS}

every_arm = pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
angles = st.floats(-math.pi, math.pi)
rates = st.floats(-3.0, 3.0)


def poses(arm: Arm) -> st.SearchStrategy[np.ndarray]:
    return arrays(float, arm.num_joints, elements=angles)


def speeds(arm: Arm) -> st.SearchStrategy[np.ndarray]:
    return arrays(float, arm.num_joints, elements=rates)


def potential_energy(arm: Arm, q: np.ndarray) -> float:
    """From the masses and their distances along the links in the URDF, J."""
    if arm is PUMA_250:
        upper, fore = math.sin(q[1]), math.sin(q[1] + q[2])
        return GRAVITY * (2.3 * 0.08 * upper + 1.2 * (0.2032 * upper + 0.15 * fore))
    return -GRAVITY * 6.0 * q[2] if arm is ADEPT_ONE else 0.0


@given(q1=angles, q2=angles, v1=rates, v2=rates)
def test_planar_arm_in_closed_form(q1: float, q2: float, v1: float, v2: float) -> None:
    # Uniform rods of 1 m, 2 kg and 1 kg.
    m1, m2 = 2.0, 1.0
    a1, a2, a3 = m1 / 3 + m2 / 12 + m2 * 5 / 4, m2 / 2, m2 / 3
    c2, h = math.cos(q2), a2 * math.sin(q2)
    found = PLANAR.evaluate(np.array([q1, q2]), np.array([v1, v2]))
    mass = [[a1 + 2 * a2 * c2, a3 + a2 * c2], [a3 + a2 * c2, a3]]
    np.testing.assert_allclose(found.mass, mass, rtol=0, atol=1e-12)
    coriolis = [-h * (2 * v1 * v2 + v2**2), h * v1**2]
    np.testing.assert_allclose(found.bias, coriolis, rtol=0, atol=1e-11)


@every_arm
@given(data=st.data())
def test_equations_of_motion_are_those_of_the_multibody_plant(
    arm: Arm, data: st.DataObject
) -> None:
    plant, context = PLANTS[arm.name]
    q, v = data.draw(poses(arm)), data.draw(speeds(arm))
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


@every_arm
@given(data=st.data())
def test_gravity_torque_is_the_gradient_of_the_potential(arm: Arm, data: st.DataObject) -> None:
    q, step = data.draw(poses(arm)), 1e-5
    gradient = [
        (potential_energy(arm, q + step * axis) - potential_energy(arm, q - step * axis))
        / (2 * step)
        for axis in np.eye(arm.num_joints)
    ]
    found = DYNAMICS[arm.name].gravity_torque(q)
    np.testing.assert_allclose(found, gradient, rtol=0, atol=1e-7)


def test_quill_is_held_against_its_weight() -> None:
    found = DYNAMICS[ADEPT_ONE.name].gravity_torque(np.array([0.3, 1.0, 0.5, 0.0]))
    np.testing.assert_allclose(found, [0, 0, -6 * GRAVITY, 0], rtol=0, atol=1e-9)


@every_arm
@given(data=st.data())
def test_gravity_is_added_to_what_motion_needs(arm: Arm, data: st.DataObject) -> None:
    q, v = data.draw(poses(arm)), data.draw(speeds(arm))
    heavy, light = DYNAMICS[arm.name], WEIGHTLESS[arm.name]
    np.testing.assert_allclose(
        heavy.evaluate(q, v).bias - light.evaluate(q, v).bias,
        heavy.gravity_torque(q),
        rtol=0,
        atol=1e-9,
    )
    np.testing.assert_array_equal(light.gravity_torque(q), np.zeros(arm.num_joints))
    np.testing.assert_array_equal(heavy.evaluate(q, v).mass, light.evaluate(q, v).mass)


@every_arm
@given(data=st.data())
def test_motion_without_torque_keeps_the_kinetic_energy(arm: Arm, data: st.DataObject) -> None:
    dynamics = WEIGHTLESS[arm.name]
    q, v, step = data.draw(poses(arm)), data.draw(speeds(arm)), 1e-5
    state = dynamics.evaluate(q, v)
    later, earlier = (dynamics.evaluate(q + sign * step * v, v).mass for sign in (1, -1))
    # v' M v' / 2 changes by v M v' + v M' v / 2, of which M v' is minus the bias.
    power = -v @ state.bias + v @ (later - earlier) @ v / (4 * step)
    assert power == pytest.approx(0.0, abs=1e-7 * (1 + v @ v) ** 1.5)


@every_arm
@given(data=st.data())
def test_reversed_motion_needs_the_same_torque(arm: Arm, data: st.DataObject) -> None:
    q, v = data.draw(poses(arm)), data.draw(speeds(arm))
    dynamics = DYNAMICS[arm.name]
    np.testing.assert_allclose(
        dynamics.evaluate(q, v).bias, dynamics.evaluate(q, -v).bias, rtol=0, atol=1e-10
    )


@every_arm
@given(data=st.data())
def test_tip_and_its_jacobian(arm: Arm, data: st.DataObject) -> None:
    q = data.draw(poses(arm))
    state = DYNAMICS[arm.name].evaluate(q, np.zeros(arm.num_joints))
    axes = min(arm.num_coordinates, 3)
    np.testing.assert_allclose(state.p_WC[:axes], arm.endpoint(q)[:axes], rtol=0, atol=1e-12)
    np.testing.assert_allclose(state.J_v_WC[:axes], arm.jacobian(q)[:axes], rtol=0, atol=1e-12)
    np.testing.assert_allclose(state.J_v_WC[axes:], 0.0, atol=1e-12)


@every_arm
@given(data=st.data())
def test_contact_offset_moves_the_point(arm: Arm, data: st.DataObject) -> None:
    q, zero = data.draw(poses(arm)), np.zeros(arm.num_joints)
    plain, offset = DYNAMICS[arm.name].evaluate(q, zero), WITH_OFFSET[arm.name].evaluate(q, zero)
    np.testing.assert_allclose(
        offset.p_WC - plain.p_WC, plain.R_WE @ np.array(OFFSET), rtol=0, atol=1e-12
    )
    np.testing.assert_array_equal(offset.mass, plain.mass)
    np.testing.assert_array_equal(offset.bias, plain.bias)


@every_arm
@given(data=st.data())
def test_jacobian_is_the_derivative_of_the_point(arm: Arm, data: st.DataObject) -> None:
    q, zero, step = data.draw(poses(arm)), np.zeros(arm.num_joints), 1e-6
    dynamics = WITH_OFFSET[arm.name]
    columns = [
        (
            dynamics.evaluate(q + step * axis, zero).p_WC
            - dynamics.evaluate(q - step * axis, zero).p_WC
        )
        / (2 * step)
        for axis in np.eye(arm.num_joints)
    ]
    found = dynamics.evaluate(q, zero).J_v_WC
    np.testing.assert_allclose(found, np.transpose(columns), rtol=0, atol=1e-8)


def turn(axis: str, angle: float) -> np.ndarray:
    c, s = math.cos(angle), math.sin(angle)
    if axis == "z":
        return np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    return np.array([[c, 0, -s], [0, 1, 0], [s, 0, c]])  # about -y, as the Puma's shoulder


@given(q1=angles, q2=angles, q3=angles, q4=angles)
def test_orientation_of_the_endpoint(q1: float, q2: float, q3: float, q4: float) -> None:
    for arm, q, expected in (
        (PLANAR_TWO_LINK, [q1, q2], turn("z", q1 + q2)),
        (PUMA_250, [q1, q2, q3], turn("z", q1) @ turn("-y", q2 + q3)),
        (ADEPT_ONE, [q1, q2, q3, q4], turn("z", q1 + q2 + q4)),
    ):
        found = DYNAMICS[arm.name].evaluate(np.array(q), np.zeros(len(q))).R_WE
        np.testing.assert_allclose(found, expected, rtol=0, atol=1e-12)


@every_arm
def test_states_do_not_depend_on_what_was_asked_before(arm: Arm) -> None:
    rng = np.random.default_rng(3)
    dynamics = ArmDynamics(arm)
    q, v = rng.normal(size=arm.num_joints), rng.normal(size=arm.num_joints)
    first = dynamics.evaluate(q, v)
    copies = [value.copy() for value in first]
    dynamics.evaluate(q + 1, v - 1)
    dynamics.gravity_torque(q + 2)
    for value, copy, again in zip(first, copies, dynamics.evaluate(q, v), strict=True):
        np.testing.assert_array_equal(value, copy)
        np.testing.assert_array_equal(again, copy)


@every_arm
def test_shapes(arm: Arm) -> None:
    n = arm.num_joints
    state = ArmDynamics(arm).evaluate(np.full(n, 0.3), np.zeros(n))
    shapes = [value.shape for value in state]
    assert shapes == [(n, n), (n,), (3, 3), (3,), (3, n)]
    assert ArmDynamics(arm).gravity_torque(np.zeros(n)).shape == (n,)


@pytest.mark.parametrize("offset", [(math.nan, 0.0, 0.0), (0.0, 0.0, math.inf)])
def test_offset_has_to_be_finite(offset: tuple[float, float, float]) -> None:
    message = re.escape(f"contact_offset is {offset}, allowed: three finite numbers")
    with pytest.raises(ParameterError, match=f"^{message}$"):
        ArmDynamics(PLANAR_TWO_LINK, contact_offset=offset)


def test_arms_urdf_decides() -> None:
    other = dataclasses.replace(PUMA_250, urdf=ADEPT_ONE.urdf)
    assert ArmDynamics(other).evaluate(np.zeros(4), np.zeros(4)).mass.shape == (4, 4)


@pytest.mark.parametrize("seed", range(3))
def test_seven_joints_against_multibody_plant(seed: int) -> None:
    plant, context = load(ADEPT_WRIST)
    q, v = np.random.default_rng(seed).uniform(-1.5, 1.5, (2, 7))
    plant.SetPositions(context, q)
    plant.SetVelocities(context, v)
    found = ArmDynamics(ADEPT_WRIST).evaluate(q, v)
    np.testing.assert_allclose(found.mass, plant.CalcMassMatrix(context), rtol=0, atol=1e-12)
    bias = plant.CalcBiasTerm(context) - plant.CalcGravityGeneralizedForces(context)
    np.testing.assert_allclose(found.bias, bias, rtol=0, atol=1e-11)
