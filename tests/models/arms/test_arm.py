"""What holds for every arm: its kinematics and its URDF describe the same machine."""

import dataclasses
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import JacobianWrtVariable
from pydrake.systems.framework import DiagramBuilder

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.adept_wrist import ADEPT_WRIST
from chamfer.models.arms.arm import Arm, Elbow, Kinematics
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import FOREARM, PUMA_250, UPPER_ARM

ARMS = (PLANAR_TWO_LINK, PUMA_250, ADEPT_ONE, ADEPT_WRIST)
ELBOW_JOINT = {PLANAR_TWO_LINK.name: 1, PUMA_250.name: 2, ADEPT_ONE.name: 1, ADEPT_WRIST.name: 1}
ROTOR_INERTIAS = {
    PLANAR_TWO_LINK.name: (0.0, 0.0),
    PUMA_250.name: (0.1, 0.1, 0.05),
    ADEPT_ONE.name: (0.3, 0.1, 0.0, 0.015),
    ADEPT_WRIST.name: (0.3, 0.1, 0.0, 0.015, 0.02, 0.01, 0.005),
}


class LoadedArm(NamedTuple):
    arm: Arm
    diagram: Any  # owns the plant
    plant: MultibodyPlant
    context: Any

    def set_positions(self, seed: int) -> np.ndarray:
        q = np.random.default_rng(seed).uniform(-np.pi, np.pi, self.arm.num_joints)
        self.plant.SetPositions(self.context, q)
        return q


@pytest.fixture(scope="module", params=ARMS, ids=lambda arm: arm.name)
def loaded(request: pytest.FixtureRequest) -> LoadedArm:
    arm = request.param
    builder = DiagramBuilder()
    plant, _ = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    Parser(plant).AddModels(str(arm.urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    diagram = builder.Build()
    return LoadedArm(arm, diagram, plant, plant.CreateDefaultContext())


def poses(arm: Arm) -> st.SearchStrategy[np.ndarray]:
    return arrays(float, arm.num_joints, elements=st.floats(-np.pi, np.pi))


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
@given(data=st.data())
def test_jacobian_is_the_derivative(arm: Arm, data: st.DataObject) -> None:
    q = data.draw(poses(arm))
    step = 1e-30
    columns = [arm.endpoint(q + 1j * step * axis).imag / step for axis in np.eye(arm.num_joints)]
    found = arm.jacobian(q)
    assert found.dtype == float
    np.testing.assert_allclose(found, np.transpose(columns), rtol=0, atol=1e-12)


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
@given(data=st.data())
def test_jacobian_takes_complex_positions(arm: Arm, data: st.DataObject) -> None:
    q, rate = data.draw(poses(arm)), data.draw(poses(arm))
    step = 1e-30
    change = arm.jacobian(q + 1j * step * rate).imag / step
    h = 1e-6
    expected = (arm.jacobian(q + h * rate) - arm.jacobian(q - h * rate)) / (2 * h)
    np.testing.assert_allclose(change, expected, rtol=0, atol=1e-7)


@pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)
@pytest.mark.parametrize("elbow", ["negative", "positive"])
@given(data=st.data())
def test_inverse_finds_the_pose_again(arm: Arm, elbow: Elbow, data: st.DataObject) -> None:
    q = data.draw(poses(arm))
    k = ELBOW_JOINT[arm.name]
    sign = 1 if elbow == "positive" else -1
    q[k] = sign * np.clip(abs(q[k]), 0.01, np.pi - 0.01)
    if arm is PUMA_250 and UPPER_ARM * np.cos(q[1]) + FOREARM * np.cos(q[1] + q[2]) < 0.01:
        # The inverse faces the tip: this pose, mirrored to the front, is the one it finds.
        q[1], q[2] = np.pi - q[1], -q[2]
        sign = -sign
        if UPPER_ARM * np.cos(q[1]) + FOREARM * np.cos(q[1] + q[2]) < 0.01:
            return  # above the waist
    x = arm.endpoint(q)
    same: Elbow = "positive" if sign > 0 else "negative"
    other: Elbow = "negative" if sign > 0 else "positive"
    found = arm.joint_positions(x, same)
    difference = np.remainder(found - q + np.pi, 2 * np.pi) - np.pi
    np.testing.assert_allclose(difference, 0, atol=1e-9)
    np.testing.assert_allclose(arm.endpoint(found), x, rtol=0, atol=1e-12)
    mirrored = arm.joint_positions(x, other)
    assert np.sign(mirrored[k]) == -np.sign(found[k]) == -sign
    np.testing.assert_allclose(arm.endpoint(mirrored), x, rtol=0, atol=1e-12)


def test_names_and_sizes_agree(loaded: LoadedArm) -> None:
    arm, _, plant, _ = loaded
    n = plant.num_positions()
    assert arm.num_joints == arm.num_coordinates == len(arm.coordinate_units) == n
    assert plant.num_velocities() == plant.num_actuators() == n
    assert arm.joint_names == tuple(f"joint_{i + 1}" for i in range(n))
    assert [plant.GetJointByName(name).position_start() for name in arm.joint_names] == [*range(n)]
    actuators = [plant.GetJointActuatorByName(f"{name}_motor") for name in arm.joint_names]
    assert [actuator.input_start() for actuator in actuators] == [*range(n)]
    assert [actuator.joint().name() for actuator in actuators] == list(arm.joint_names)


@pytest.mark.parametrize("seed", range(5))
def test_urdf_puts_the_tip_where_the_kinematics_do(loaded: LoadedArm, seed: int) -> None:
    arm, _, plant, context = loaded
    q = loaded.set_positions(seed)
    x = arm.endpoint(q)
    tip = plant.GetFrameByName("endpoint")
    p_WE = plant.CalcPointsPositions(context, tip, np.zeros(3), plant.world_frame()).ravel()
    expected = np.zeros(3)
    expected[: min(len(x), 3)] = x[:3]
    np.testing.assert_allclose(p_WE, expected, rtol=0, atol=1e-12)
    if "phi" in arm.coordinates:
        c, s = np.cos(x[3]), np.sin(x[3])
        R_WE = tip.CalcRotationMatrixInWorld(context).matrix()
        np.testing.assert_allclose(R_WE, [[c, -s, 0], [s, c, 0], [0, 0, 1]], rtol=0, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_urdf_has_the_same_jacobian(loaded: LoadedArm, seed: int) -> None:
    arm, _, plant, context = loaded
    q = loaded.set_positions(seed)
    world, tip = plant.world_frame(), plant.GetFrameByName("endpoint")
    spatial = plant.CalcJacobianSpatialVelocity(
        context, JacobianWrtVariable.kV, tip, np.zeros(3), world, world
    )
    rows = {"phi": spatial[2], "x": spatial[3], "y": spatial[4], "z": spatial[5]}
    known = [i for i, name in enumerate(arm.coordinates) if name in rows]  # no angles' rates
    expected = np.array([rows[arm.coordinates[i]] for i in known])
    np.testing.assert_allclose(arm.jacobian(q)[known], expected, rtol=0, atol=1e-12)


@pytest.mark.parametrize("seed", range(5))
def test_mass_matrix_is_symmetric_and_positive(loaded: LoadedArm, seed: int) -> None:
    loaded.set_positions(seed)
    mass = loaded.plant.CalcMassMatrix(loaded.context)
    np.testing.assert_allclose(mass, mass.T, rtol=0, atol=1e-12)
    assert np.linalg.eigvalsh(mass).min() > 1e-3


def test_mass_matrix_includes_the_rotors(loaded: LoadedArm) -> None:
    arm, _, plant, _ = loaded
    context = plant.CreateDefaultContext()
    with_rotors = plant.CalcMassMatrix(context)
    for name in arm.joint_names:
        plant.GetJointActuatorByName(f"{name}_motor").SetRotorInertia(context, 0.0)
    rotors = with_rotors - plant.CalcMassMatrix(context)
    np.testing.assert_allclose(rotors, np.diag(ROTOR_INERTIAS[arm.name]), rtol=0, atol=1e-12)


def test_joints_are_free_and_nothing_collides(loaded: LoadedArm) -> None:
    arm, _, plant, _ = loaded
    assert np.all(np.isinf(plant.GetPositionLowerLimits()))
    assert np.all(np.isinf(plant.GetPositionUpperLimits()))
    assert np.all(np.isinf(plant.GetEffortUpperLimits()))
    for name in arm.joint_names:
        np.testing.assert_array_equal(plant.GetJointByName(name).default_damping_vector(), 0.0)
    assert plant.num_collision_geometries() == 0
    for name in ("base", "link_1", "link_2", "endpoint"):
        assert plant.GetVisualGeometriesForBody(plant.GetBodyByName(name))


def test_kinematics_tells_nothing_of_masses() -> None:
    # It is what a controller is given.
    assert all(isinstance(arm, Kinematics) for arm in ARMS)
    told = {field.name for field in dataclasses.fields(Kinematics)}
    only_arms = {field.name for field in dataclasses.fields(Arm)} - told
    assert only_arms == {"urdf", "joint_positions", "assumed", "note"}


def test_arm_is_frozen_and_by_keyword() -> None:
    with pytest.raises(dataclasses.FrozenInstanceError):
        PUMA_250.assumed = False  # type: ignore[misc]
    with pytest.raises(TypeError):
        Arm("arm")  # type: ignore[misc, call-arg]
