"""The WAM with a tool: frames, masses, and what the parameters may be."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.common.value import AbstractValue
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import BodyIndex

from chamfer.models.arms import wam
from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import (
    ArmModel,
    Placement,
    ToolParams,
    TruePose,
    add_arm,
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
    roll, pitch, yaw = placement.rpy

    def turn(axis: int, angle: float) -> Array:
        R = np.eye(3)
        i, j = [(1, 2), (2, 0), (0, 1)][axis]
        R[i, i] = R[j, j] = math.cos(angle)
        R[i, j], R[j, i] = -math.sin(angle), math.sin(angle)
        return R

    T = np.eye(4)
    T[:3, :3] = turn(2, yaw) @ turn(1, pitch) @ turn(0, roll)
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


def test_states_do_not_depend_on_what_was_asked_before() -> None:
    first = MODEL.evaluate(BENT)
    copies = [np.array(value) for value in first[1:]]
    MODEL.evaluate(BENT + 0.1)
    for value, copy, again in zip(first[1:], copies, MODEL.evaluate(BENT)[1:], strict=True):
        np.testing.assert_array_equal(value, copy)
        np.testing.assert_array_equal(again, copy)


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


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"mass": 0.0}, "mass is 0.0, allowed: a finite number > 0"),
        (
            {"centre_of_mass": (0.0, math.nan, 0.0)},
            "centre_of_mass is (0.0, nan, 0.0), allowed: three finite numbers",
        ),
        ({"inertia": (1.0, 1.0)}, "inertia is (1.0, 1.0), allowed: three finite numbers"),
        (
            {"inertia": (1.0, 1.0, 2.1)},
            "inertia is (1.0, 1.0, 2.1), allowed: three numbers > 0, none more than the others'"
            " sum",
        ),
        (
            {"inertia": (1.0, 1.0, 0.0)},
            "inertia is (1.0, 1.0, 0.0), allowed: three numbers > 0, none more than the others'"
            " sum",
        ),
    ],
)
def test_tools_that_cannot_be(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as caught:
        replace(TOOL, **change)
    assert str(caught.value) == message


@pytest.mark.parametrize("name", ["position", "rpy"])
@pytest.mark.parametrize("value", [(0.0, 0.0), (0.0, math.inf, 0.0)])
def test_placements_are_finite(name: str, value: tuple[float, ...]) -> None:
    with pytest.raises(ParameterError, match=f"^{name} is .*, allowed: three finite numbers$"):
        Placement(**{name: value})  # type: ignore[arg-type]
