"""Impedance control of arms with six and with eight joints."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from pydrake.math import RigidTransform

from chamfer.models.arms.urdf_arm import chosen_arm
from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import ArmModel, Placement, ToolParams
from chamfer.systems.force.impedance_controller import (
    ImpedanceController,
    ImpedanceControllerParams,
)
from chamfer.systems.pose import pose_vector

Array = np.ndarray

FILE = Path(__file__).parents[2] / "models/arms/six_joints.urdf"
TOOL = ToolParams(
    mass=0.4,
    centre_of_mass=(-0.05, 0.02, 0.01),
    inertia=(1e-3, 1e-3, 1e-3),
    frame=Placement(position=(0.0, 0.0, 0.1), rpy=(0.0, -1.2, 0.4)),
)
BASE = Placement(position=(0.3, -0.2, 0.1), rpy=(0.1, -0.2, 2.5)).transform
SIX = ArmModel(BASE, TOOL, chosen_arm(str(FILE), None))
BENT = np.array([0.2, 0.5, 1.2, -0.6, 0.7, 0.3])
PARAMS = ImpedanceControllerParams(
    stiffness=(300.0, 400.0, 500.0),
    rotational_stiffness=(20.0, 30.0, 40.0),
    torque_limits=(1e6,) * 6,
)


@pytest.fixture(scope="module")
def eight(tmp_path_factory: pytest.TempPathFactory) -> ArmModel:
    text = FILE.read_text(encoding="utf-8")
    for name in ("column", "neck"):
        text = text.replace(f'name="{name}" type="fixed"', f'name="{name}" type="revolute"')
    path = tmp_path_factory.mktemp("arm") / "eight.urdf"
    path.write_text(text, encoding="utf-8")
    return ArmModel(BASE, TOOL, chosen_arm(str(path), None))


def test_six_joints_carry_eq_1_and_gravity_alone() -> None:
    controller = ImpedanceController(SIX, BENT, PARAMS)
    assert controller.null_damping == 0.0
    X_WD = SIX.evaluate(BENT).X_WT
    q = BENT + np.array([0.0, 0.02, -0.03, 0.01, 0.0, 0.02])
    v = np.array([0.1, -0.2, 0.3, 0.1, -0.1, 0.2])
    now = SIX.evaluate(q)
    result = controller.step(pose_vector(X_WD), np.concatenate([q, v]), pose_vector(X_WD))
    assert result.shape == (19,)
    R = X_WD.rotation().matrix()
    turn = (X_WD.rotation().inverse() @ now.X_WT.rotation()).ToAngleAxis()
    error = turn.angle() * turn.axis()
    slip = np.concatenate([R.T @ part for part in np.split(now.J_V_WT @ v, 2)])
    damping = controller.damping @ slip
    # Equal enough for the moment of unequal stiffnesses: to second order of the angle.
    moment = np.array(PARAMS.rotational_stiffness) * error + damping[:3]
    force = PARAMS.stiffness * (R.T @ (now.X_WT.translation() - X_WD.translation())) + damping[3:]
    wrench = np.concatenate([R @ moment, R @ force])
    expected = now.gravity - now.J_V_WT.T @ wrench
    np.testing.assert_allclose(result[:6], expected, rtol=0, atol=0.02)
    assert np.abs(expected - now.gravity).max() > 2
    np.testing.assert_allclose(result[6:13], pose_vector(now.X_WT), rtol=0, atol=1e-12)
    np.testing.assert_array_equal(result[13:], 0.0)


def test_six_joints_saturate_one_by_one() -> None:
    rest = SIX.evaluate(BENT)
    tight = np.abs(rest.gravity) + 1e-9
    tight[2] /= 2
    params = replace(PARAMS, torque_limits=tuple(tight.tolist()))
    here = pose_vector(rest.X_WT)
    result = ImpedanceController(SIX, BENT, params).step(here, np.append(BENT, np.zeros(6)), here)
    np.testing.assert_array_equal(result[13:] != 0, [False, False, True, False, False, False])
    assert abs(result[2]) == pytest.approx(tight[2])


def test_eight_joints_go_to_their_rest_posture_without_moving_the_tool(eight: ArmModel) -> None:
    posture = np.insert(BENT, [0, 4], [0.1, 0.2])
    params = replace(PARAMS, torque_limits=(1e6,) * 8, null_stiffness=8.0)
    controller = ImpedanceController(eight, posture, params)
    q = posture + np.linspace(-0.3, 0.3, 8)
    now = eight.evaluate(q)
    here = pose_vector(now.X_WT)
    result = controller.step(here, np.append(q, np.zeros(8)), here)
    null = result[:8] - now.gravity
    acceleration = np.linalg.solve(now.mass, null)
    straight = np.linalg.solve(now.mass, 8.0 * (posture - q))
    moved = np.linalg.norm(now.J_V_WT @ acceleration) / np.linalg.norm(now.J_V_WT @ straight)
    assert moved < 1e-4
    assert acceleration @ (posture - q) > 1.0  # towards the rest posture


def test_every_own_motion_of_eight_joints_is_damped_enough(eight: ArmModel) -> None:
    posture = np.insert(BENT, [0, 4], [0.1, 0.2])
    params = replace(PARAMS, torque_limits=(1e6,) * 8, null_stiffness=8.0)
    damping = ImpedanceController(eight, posture, params).null_damping
    rest = eight.evaluate(posture)
    free = np.linalg.svd(rest.J_V_WT)[2][6:].T
    inertias = np.linalg.eigvalsh(free.T @ rest.mass @ free)
    assert inertias[1] > 2 * inertias[0]
    ratios = damping / (2 * np.sqrt(8.0 * inertias))
    assert ratios.min() == pytest.approx(0.7)
    with pytest.raises(ParameterError, match=r"^null_damping_ratio is 30.0, allowed: more than"):
        ImpedanceController(eight, posture, replace(params, null_damping_ratio=30.0))


def test_the_law_is_written_for_the_posture_s_joints() -> None:
    with pytest.raises(ParameterError, match=r"^rest posture is .*, allowed: between \(-3.142, "):
        ImpedanceController(SIX, np.zeros(7), PARAMS)
    with pytest.raises(ParameterError, match=r"^torque_limits is .*, allowed: 6 finite numbers"):
        ImpedanceController(SIX, BENT, replace(PARAMS, torque_limits=(1.0,) * 7))


def test_a_pose_without_a_posture_near_it_is_searched() -> None:
    X_WT = SIX.evaluate(BENT).X_WT
    for near in (None, BENT + 0.05):
        found = SIX.evaluate(SIX.joint_positions(X_WT, near)).X_WT
        assert found.IsNearlyEqualTo(X_WT, 1e-9)
    with pytest.raises(ParameterError, match="within reach"):
        SIX.joint_positions(RigidTransform([9.0, 0.0, 0.0]), None)
