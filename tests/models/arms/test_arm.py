"""The arms that touch: kinematics and URDF describe the same machine, and poses by hand."""

import itertools
import math
import re
from functools import cache
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from pydrake.geometry import Box, Cylinder
from pydrake.math import RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph, MultibodyPlant
from pydrake.multibody.tree import PrismaticJoint
from pydrake.systems.framework import DiagramBuilder

from chamfer.models.arms.adept_one import (
    ADEPT_ONE,
    LENGTH_1,
    LENGTH_2,
)
from chamfer.models.arms.adept_wrist import (
    ADEPT_WRIST,
    gripper_points,
)
from chamfer.models.arms.arm import Arm, Elbow
from chamfer.models.arms.planar_two_link import (
    PLANAR_TWO_LINK,
    two_link_angles,
)
from chamfer.models.arms.puma_250 import FOREARM, PUMA_250, UPPER_ARM
from chamfer.models.validation import ParameterError

ARMS = (PLANAR_TWO_LINK, PUMA_250, ADEPT_ONE, ADEPT_WRIST)
ELBOW_JOINT = {PLANAR_TWO_LINK.name: 1, PUMA_250.name: 2, ADEPT_ONE.name: 1, ADEPT_WRIST.name: 1}
ROTOR_INERTIAS = {
    PLANAR_TWO_LINK.name: (0.0, 0.0),
    PUMA_250.name: (0.1, 0.1, 0.05),
    ADEPT_ONE.name: (0.3, 0.1, 0.0, 0.015),
    ADEPT_WRIST.name: (0.3, 0.1, 0.0, 0.015, 0.02, 0.01, 0.005),
}


@cache
def load(arm: Arm) -> tuple[MultibodyPlant, Any, Any]:
    """Return the plant, its geometry, and the diagram that owns them."""
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, time_step=0.0)
    Parser(plant).AddModels(str(arm.urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return plant, scene_graph, builder.Build()


def at(arm: Arm, q: Any) -> tuple[MultibodyPlant, Any]:
    plant, _, _ = load(arm)
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, q)
    return plant, context


every_arm = pytest.mark.parametrize("arm", ARMS, ids=lambda arm: arm.name)


def poses(arm: Arm) -> st.SearchStrategy[np.ndarray]:
    return arrays(float, arm.num_joints, elements=st.floats(-np.pi, np.pi))


@every_arm
@given(data=st.data())
def test_jacobian_is_the_derivative(arm: Arm, data: st.DataObject) -> None:
    q = data.draw(poses(arm))
    step = 1e-30
    columns = [arm.endpoint(q + 1j * step * axis).imag / step for axis in np.eye(arm.num_joints)]
    found = arm.jacobian(q)
    assert found.dtype == float
    np.testing.assert_allclose(found, np.transpose(columns), rtol=0, atol=1e-12)


@every_arm
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


@every_arm
def test_names_and_sizes_agree(arm: Arm) -> None:
    plant, _, _ = load(arm)
    n = plant.num_positions()
    assert arm.num_joints == arm.num_coordinates == len(arm.coordinate_units) == n
    assert plant.num_velocities() == plant.num_actuators() == n
    assert arm.joint_names == tuple(f"joint_{i + 1}" for i in range(n))
    joints = [plant.GetJointByName(name) for name in arm.joint_names]
    assert [joint.position_start() for joint in joints] == [*range(n)]
    slides = ["m" if isinstance(joint, PrismaticJoint) else "rad" for joint in joints]
    assert list(arm.joint_units) == slides
    actuators = [plant.GetJointActuatorByName(f"{name}_motor") for name in arm.joint_names]
    assert [actuator.input_start() for actuator in actuators] == [*range(n)]
    assert [actuator.joint().name() for actuator in actuators] == list(arm.joint_names)


@every_arm
@given(data=st.data())
def test_urdf_puts_the_tip_where_the_kinematics_do(arm: Arm, data: st.DataObject) -> None:
    q = data.draw(poses(arm))
    plant, context = at(arm, q)
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


@every_arm
def test_mass_matrix_includes_the_rotors(arm: Arm) -> None:
    plant, context = at(arm, np.zeros(arm.num_joints))
    with_rotors = plant.CalcMassMatrix(context)
    for name in arm.joint_names:
        plant.GetJointActuatorByName(f"{name}_motor").SetRotorInertia(context, 0.0)
    rotors = with_rotors - plant.CalcMassMatrix(context)
    np.testing.assert_allclose(rotors, np.diag(ROTOR_INERTIAS[arm.name]), rtol=0, atol=1e-12)


@every_arm
def test_joints_are_free_and_nothing_collides(arm: Arm) -> None:
    plant, _, _ = load(arm)
    assert np.all(np.isinf(plant.GetPositionLowerLimits()))
    assert np.all(np.isinf(plant.GetPositionUpperLimits()))
    assert np.all(np.isinf(plant.GetEffortUpperLimits()))
    for name in arm.joint_names:
        np.testing.assert_array_equal(plant.GetJointByName(name).default_damping_vector(), 0.0)
    assert plant.num_collision_geometries() == 0
    for name in ("base", "link_1", "link_2", "endpoint"):
        assert plant.GetVisualGeometriesForBody(plant.GetBodyByName(name))


def test_planar_links_of_unequal_length_leave_a_hole() -> None:
    asked = np.array([0.5, 0.0])
    with pytest.raises(ParameterError, match=r"more than 1 m and less than 3 m from the pivot$"):
        two_link_angles(0.5, 0.0, (2.0, 1.0), "positive", asked, "the pivot")
    q1, q2 = two_link_angles(2.0, 1.0, (2.0, 1.0), "positive", asked, "the pivot")
    assert (q1, q2) == pytest.approx((0.0, math.pi / 2), abs=1e-15)


@pytest.mark.parametrize("q2", [-2.0, -0.9, 0.0, 0.5, math.pi / 2, 3.0])
def test_planar_mass_matrix_of_two_rods(q2: float) -> None:
    m1, m2 = 2.0, 1.0
    a1, a2, a3 = m1 / 3 + m2 / 12 + m2 * 5 / 4, m2 / 2, m2 / 3
    c2 = math.cos(q2)
    expected = [[a1 + 2 * a2 * c2, a3 + a2 * c2], [a3 + a2 * c2, a3]]
    plant, context = at(PLANAR_TWO_LINK, [0.7, q2])
    np.testing.assert_allclose(plant.CalcMassMatrix(context), expected, rtol=1e-12)


def test_puma_weight_of_the_stretched_arm() -> None:
    # Shoulder and elbow lift the arm when their angles grow, so that its weight turns them back.
    forearm = 1.2 * 0.15
    shoulder = 2.3 * 0.08 + 1.2 * 0.2032 + forearm
    plant, context = at(PUMA_250, np.zeros(3))
    found = plant.CalcGravityGeneralizedForces(context)
    np.testing.assert_allclose(found, [0, -9.81 * shoulder, -9.81 * forearm], rtol=0, atol=1e-9)


@pytest.mark.parametrize("q2", [-1.5, 0.0, 0.8])
def test_adept_mass_matrix(q2: float) -> None:
    quill_and_payload, turning = 6.0, 0.0002 + 0.005
    c2 = math.cos(q2)
    second = 0.15 + 9 * 0.15**2 + quill_and_payload * LENGTH_2**2 + turning
    coupling = LENGTH_1 * (9 * 0.15 + quill_and_payload * LENGTH_2) * c2
    first = 0.25 + 12 * 0.2**2 + (9 + quill_and_payload) * LENGTH_1**2
    expected = [
        [first + second + 2 * coupling + 0.3, second + coupling, 0, 0.005],
        [second + coupling, second + 0.1, 0, 0.005],
        [0, 0, 6, 0],
        [0.005, 0.005, 0, 0.02],
    ]
    plant, context = at(ADEPT_ONE, [0.4, q2, 0.5, -0.3])
    np.testing.assert_allclose(plant.CalcMassMatrix(context), expected, rtol=0, atol=1e-12)


X = np.array([0.45, 0.25, 0.3, 0.7, 0.2, -0.3, 0.4])


def test_wrist_urdf_turns_the_nugget_as_the_angles_say() -> None:
    plant, context = at(ADEPT_WRIST, ADEPT_WRIST.joint_positions(X, "positive"))
    X_WE = plant.GetFrameByName("endpoint").CalcPoseInWorld(context)
    yaw, pitch, roll = X[3:6]
    expected = RollPitchYaw(roll, pitch, yaw).ToRotationMatrix().matrix()
    np.testing.assert_allclose(X_WE.rotation().matrix(), expected, rtol=0, atol=1e-14)


def test_gripper_points_are_the_corners_of_what_is_drawn() -> None:
    plant, context = at(ADEPT_WRIST, ADEPT_WRIST.joint_positions(X, "positive"))
    inspector = load(ADEPT_WRIST)[1].model_inspector()
    boxes, fork = [], []
    for name in ("link_5", "link_6", "link_7"):
        body = plant.GetBodyByName(name)
        for geometry in plant.GetVisualGeometriesForBody(body):
            X_WG = body.EvalPoseInWorld(context) @ inspector.GetPoseInFrame(geometry)
            shape = inspector.GetShape(geometry)
            if isinstance(shape, Box):
                half = np.array([shape.width(), shape.depth(), shape.height()]) / 2
                boxes += [X_WG @ (signs * half) for signs in itertools.product((-1, 1), repeat=3)]
            elif isinstance(shape, Cylinder):
                fork.append((X_WG.inverse(), shape.radius(), shape.length()))
    found = gripper_points(X[np.newaxis])[0]
    apart = np.linalg.norm(found[:, np.newaxis] - np.array(boxes), axis=2)
    assert len(boxes) == 24
    np.testing.assert_allclose(apart.min(axis=0), 0.0, atol=1e-12)
    ((X_GW, radius, length),) = fork
    round_about = (X_GW @ found[apart.min(axis=1) > 1e-9].T).T
    assert len(round_about) == len(found) - 24
    np.testing.assert_allclose(np.hypot(*round_about[:, :2].T), radius, atol=1e-12)
    np.testing.assert_allclose(np.abs(round_about[:, 2]), length / 2, atol=1e-12)


@pytest.mark.parametrize(
    ("arm", "q", "tip"),
    [
        (PLANAR_TWO_LINK, (0, 90), (1, 1)),
        (PLANAR_TWO_LINK, (30, 30), ((math.sqrt(3) + 1) / 2, (1 + math.sqrt(3)) / 2)),
        # Stretched ahead: l3 + l5 out, l2 + l4 to the right; then the forearm above the shoulder.
        (PUMA_250, (0, 0, 0), (0.5432, -0.0110, 0.3429)),
        (PUMA_250, (90, 0, 90), (0.0110, 0.2032, 0.6829)),
        # Stretched along x it reaches 0.800 m, not the 0.4627 m of the misprint.
        (ADEPT_ONE, (0, 0, 0, 0), (0.8, 0, 0.877, 0)),
        (ADEPT_ONE, (90, -90, 0, 45), (0.375, 0.425, 0.877, math.pi / 4)),
    ],
)
def test_tips_by_hand(arm: Arm, q: tuple[float, ...], tip: tuple[float, ...]) -> None:
    np.testing.assert_allclose(arm.endpoint(np.radians(q)), tip, rtol=0, atol=1e-15)


NAN, INF = math.nan, math.inf
PLANAR_REACH = "more than 0 m and less than 2 m from the base"
WAIST = "more than 0.011 m from the waist's axis"
SHOULDER = "more than 0.1368 m and less than 0.5432 m from the shoulder, in its plane"
ADEPT_REACH = "more than 0.05 m and less than 0.8 m from the base's axis"


@pytest.mark.parametrize("elbow", ["negative", "positive"])
@pytest.mark.parametrize(
    ("arm", "allowed", "tips"),
    [
        # The farthest point of the crucible is exactly at the edge of the reach.
        (PLANAR_TWO_LINK, PLANAR_REACH, [(1.6, -1.2), (0.0, 0.0), (0.0, 2.5), (NAN, 1.0)]),
        (PUMA_250, WAIST, [(0.0, 0.0, 0.7), (0.0, 0.011, 0.7), (NAN, 0.3, 0.3)]),
        (
            PUMA_250,
            SHOULDER,
            [(0.5432, -0.011, 0.3429), (0.1368, -0.011, 0.3429), (0.3, 0.0, NAN)],
        ),
        (
            ADEPT_ONE,
            ADEPT_REACH,
            [(0.8, 0.0, 0.4, 0.0), (0.0, -0.05, 0.4, 0.0), (0.7, 0.7, 0.4, 1.0)],
        ),
        (ADEPT_ONE, "finite numbers", [(0.5, 0.3, NAN, 0.0), (0.5, 0.3, 0.4, INF)]),
        (ADEPT_WRIST, f"the mount {ADEPT_REACH}", [(0.8, 0.0, 0.3, 0.0, 0.0, 0.0, -0.1)]),
        (ADEPT_WRIST, "finite numbers", [(0.5, 0.1, 0.3, 0.0, NAN, 0.0, 0.0)]),
    ],
)
def test_out_of_reach_or_singular(
    arm: Arm, allowed: str, tips: list[tuple[float, ...]], elbow: Elbow
) -> None:
    for tip in tips:
        message = re.escape(f"endpoint is {tip}, allowed: {allowed}")
        with pytest.raises(ParameterError, match=f"^{message}$"):
            arm.joint_positions(np.array(tip), elbow)
