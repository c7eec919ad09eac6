"""An arm with a tool: frames, masses, a wrench on it, and what its joints' friction is there."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex, RotationalInertia, SpatialInertia
from pydrake.systems.framework import DiagramBuilder
from scipy.spatial.transform import Rotation

from chamfer.models.arms import wam
from chamfer.systems.force.arm_model import (
    ArmModel,
    Placement,
    ToolForce,
    ToolParams,
    TruePose,
    add_arm,
    tool_friction,
)
from chamfer.systems.pose import pose_vector

Array = np.ndarray

BASE = Placement(position=(0.3, -0.2, 0.1), rpy=(0.1, -0.2, 2.5))
TOOL = ToolParams(
    mass=0.4,
    centre_of_mass=(-0.05, 0.02, 0.01),
    inertia=(1e-4, 3e-4, 3.5e-4),
    frame=Placement(position=(0.01, -0.02, 0.12), rpy=(0.3, -1.2, 0.4)),
)
BENT = np.array([0.2, 0.7, -0.3, 1.7, 0.2, -0.9, 0.4])
MODEL = ArmModel(BASE.transform, TOOL)
GRAVITY = 9.81

poses = st.lists(st.floats(-0.5, 0.5), min_size=7, max_size=7).map(lambda m: BENT + np.array(m))


def matrix(placement: Placement) -> Array:
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("xyz", placement.rpy).as_matrix()
    T[:3, 3] = placement.position
    return T


def tool_pose(q: Array) -> Array:
    T = np.eye(4)
    T[:3, :3], T[:3, 3] = wam.pose(q)
    return matrix(BASE) @ T @ matrix(TOOL.frame)


@given(q=poses)
def test_tool_frame_is_base_arm_and_tool_after_each_other(q: Array) -> None:
    np.testing.assert_allclose(
        MODEL.evaluate(q).X_WT.GetAsMatrix4(), tool_pose(q), rtol=0, atol=1e-12
    )


@given(q=poses)
def test_jacobian_is_that_of_the_tool_frames_origin(q: Array) -> None:
    J = wam.jacobian(q)
    R_WB = matrix(BASE)[:3, :3]
    lever = wam.pose(q)[0] @ np.array(TOOL.frame.position)
    angular, linear = J[:3], J[3:] + np.cross(J[:3].T, lever).T
    expected = np.vstack([R_WB @ angular, R_WB @ linear])
    np.testing.assert_allclose(MODEL.evaluate(q).J_V_WT, expected, rtol=0, atol=1e-12)


@given(q=poses)
def test_tool_adds_its_weight_and_inertia(q: Array) -> None:
    light = replace(TOOL, mass=1e-9, inertia=(1e-12, 1e-12, 1e-12))
    without, tool = ArmModel(BASE.transform, light).evaluate(q), MODEL.evaluate(q)
    R = tool.X_WT.rotation().matrix()
    lever = R @ np.array(TOOL.centre_of_mass)
    angular = tool.J_V_WT[:3]
    linear = tool.J_V_WT[3:] + np.cross(angular.T, lever).T
    weight = TOOL.mass * GRAVITY * linear[2]
    np.testing.assert_allclose(tool.gravity - without.gravity, weight, rtol=0, atol=1e-7)
    own = R @ np.diag(TOOL.inertia) @ R.T
    mass = TOOL.mass * linear.T @ linear + angular.T @ own @ angular
    np.testing.assert_allclose(tool.mass - without.mass, mass, rtol=0, atol=1e-7)


@given(q=poses)
def test_joint_positions_put_the_tool_there(q: Array) -> None:
    X_WT = RigidTransform(tool_pose(q))
    found = MODEL.joint_positions(X_WT, BENT)
    np.testing.assert_allclose(tool_pose(found), X_WT.GetAsMatrix4(), rtol=0, atol=1e-9)


def test_two_arms_in_one_plant() -> None:
    plant = MultibodyPlant(0.001)
    first = add_arm(plant, RigidTransform(), TOOL, name="first")
    second = add_arm(plant, RigidTransform([1.0, 0, 0]), TOOL, name="second", mass_scale=1.1)
    plant.Finalize()
    assert plant.num_positions() == 14
    assert plant.GetModelInstanceName(first) == "first::wam"
    context = plant.CreateDefaultContext()
    links = sum(plant.GetBodyByName(f"link_{i + 1}", first).default_mass() for i in range(7))
    assert links == pytest.approx(19.45876, abs=1e-9)
    masses = [plant.CalcTotalMass(context, [instance]) for instance in (first, second)]
    assert masses == pytest.approx([links + TOOL.mass, 1.1 * links + TOOL.mass], abs=1e-9)


def test_true_pose_is_that_of_its_body() -> None:
    block = TruePose(BodyIndex(2))
    assert block.get_output_port().size() == 7
    context = block.CreateDefaultContext()
    poses = [
        RigidTransform(RollPitchYaw(0.1 * k, 0.2, -0.3), [k, 2.0 * k, 1.0]) for k in range(1, 5)
    ]
    block.get_input_port().FixValue(context, AbstractValue.Make(poses))
    np.testing.assert_array_equal(block.get_output_port().Eval(context), pose_vector(poses[2]))


WRENCH = np.array([0.1, -0.2, 0.3, 4.0, -5.0, 6.0])  # N m above N


def two_bodies() -> MultibodyPlant:
    """Two free bodies, without weight, whose centres of mass are away from their origins."""
    plant = MultibodyPlant(0.0)
    plant.mutable_gravity_field().set_gravity_vector([0.0, 0.0, 0.0])
    for name in ("other", "tool"):
        inertia = SpatialInertia.MakeFromCentralInertia(
            2.0, np.array([0.0, 0.0, 0.05]), RotationalInertia(0.1, 0.2, 0.25)
        )
        plant.AddRigidBody(name, inertia)
    plant.Finalize()
    return plant


def test_the_wrench_acts_on_the_body_at_its_origin_in_the_worlds_axes() -> None:
    builder = DiagramBuilder()
    plant: Any = builder.AddSystem(two_bodies())
    tool = plant.GetBodyByName("tool")
    block = builder.AddSystem(ToolForce(tool.index()))
    builder.Connect(block.get_output_port(), plant.get_applied_spatial_force_input_port())
    builder.ExportInput(block.GetInputPort("wrench"), "wrench")
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    inside = plant.GetMyMutableContextFromRoot(context)
    X_WB = RigidTransform(RollPitchYaw(0.3, -0.5, 1.2), [0.4, 0.5, 0.6])
    plant.SetFreeBodyPose(inside, tool, X_WB)
    diagram.GetInputPort("wrench").FixValue(context, WRENCH)
    A_WB = plant.EvalBodySpatialAccelerationInWorld(inside, tool)
    R, arm = X_WB.rotation().matrix(), X_WB.rotation() @ np.array([0.0, 0.0, 0.05])
    about = R @ np.diag([0.1, 0.2, 0.25]) @ R.T
    moment = WRENCH[:3] - np.cross(arm, WRENCH[3:])  # about the centre of mass
    turning = np.linalg.solve(about, moment)
    np.testing.assert_allclose(A_WB.rotational(), turning, atol=1e-9)
    expected = WRENCH[3:] / 2.0 - np.cross(turning, arm)
    np.testing.assert_allclose(A_WB.translational(), expected, atol=1e-9)
    still = plant.EvalBodySpatialAccelerationInWorld(inside, plant.GetBodyByName("other"))
    np.testing.assert_allclose(still.get_coeffs(), 0.0, atol=1e-12)


# A slide along x, and a joint about z at a lever of 0.5 m behind the tool: rows rad/s above m/s.
JACOBIAN = np.zeros((6, 2))
JACOBIAN[3, 0] = 1.0
JACOBIAN[2, 1], JACOBIAN[4, 1] = 1.0, 0.5


def test_what_one_joint_turns_is_held_by_its_friction_over_the_lever() -> None:
    held, wound = tool_friction(JACOBIAN, np.array([3.0, 0.2]))
    assert np.allclose(held[[2, 3, 4]], [0.2, 3.0, 0.4])
    assert np.isinf(held[[0, 1, 5]]).all()
    # What slides takes the power of its joints; the one of least norm that makes 1 m/s across
    # turns with 0.5/1.25 rad/s.
    assert np.allclose(wound[[3, 4]], [3.0, 0.2 * 0.5 / 1.25])
