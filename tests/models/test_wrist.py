"""The compliant wrist: kinematics and inertia as Drake has them, springs by hand."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RigidBody

from models.validation import ParameterError
from models.wrist import (
    ORDER,
    SIZE,
    WristParams,
    add_wrist,
    in_joint_order,
    tip_displacement,
    tip_pose,
)

PARAMS = WristParams(
    stiffness=(10.0, 20.0, 30.0, 1e3, 2e3, 3e3),
    damping_ratio=0.5,
    mass=0.4,
    inertia=9e-4,
    centre_of_mass=0.03,
)
SIX = st.tuples(*[st.floats(-1.5, 1.5)] * 3, *[st.floats(-1, 1)] * 3)


def wrist() -> tuple[MultibodyPlant, RigidBody]:
    plant = MultibodyPlant(0.001)
    held = add_wrist(plant, plant.world_frame(), PARAMS)
    plant.Finalize()
    assert plant.num_positions(held.instance) == SIZE
    return plant, held.body


@settings(deadline=None, max_examples=30)
@given(displacement=SIX)
def test_the_joints_put_the_tip_where_its_pose_is(displacement: tuple[float, ...]) -> None:
    plant, body = wrist()
    context = plant.CreateDefaultContext()
    q = np.array(displacement)
    plant.SetPositions(context, in_joint_order() @ q)
    assert plant.EvalBodyPoseInWorld(context, body).IsNearlyEqualTo(tip_pose(q), 1e-9)


def test_a_displacement_turns_about_the_carriers_x_last() -> None:
    X = tip_pose(np.array([0.1, 0.2, 0.3, 1.0, 2.0, 3.0]))
    R = RotationMatrix.MakeXRotation(0.1).multiply(
        RotationMatrix.MakeYRotation(0.2).multiply(RotationMatrix.MakeZRotation(0.3))
    )
    assert X.IsNearlyEqualTo(RigidTransform(R, [1.0, 2.0, 3.0]), 1e-12)


@given(displacement=SIX)
def test_a_poses_displacement_is_that_of_which_it_was_made(
    displacement: tuple[float, ...],
) -> None:
    q = np.array(displacement)
    np.testing.assert_allclose(tip_displacement(tip_pose(q)), q, atol=1e-9)


def test_joint_order_is_a_permutation_of_every_block() -> None:
    single, double = in_joint_order(), in_joint_order(2)
    assert (single @ np.arange(6.0)).tolist() == [3, 4, 5, 0, 1, 2] == list(ORDER)
    assert (double @ np.arange(12.0)).tolist() == [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]
    np.testing.assert_array_equal(double.T @ double, np.eye(12))


def test_the_tool_has_its_inertia_about_the_tip_and_no_weight() -> None:
    plant, body = wrist()
    inertia = body.default_spatial_inertia()
    assert inertia.get_mass() == pytest.approx(0.4)
    np.testing.assert_allclose(inertia.get_com(), [0.0, 0.0, 0.03])
    about_tip = inertia.CalcRotationalInertia().CopyToFullMatrix3()
    np.testing.assert_allclose(about_tip, 9e-4 * np.eye(3), atol=1e-12)
    context = plant.CreateDefaultContext()
    assert not plant.CalcGravityGeneralizedForces(context).any()
    assert plant.CalcTotalMass(context) == pytest.approx(0.4)


def test_the_law_is_springs_and_dampers_in_joint_order() -> None:
    # 2 zeta sqrt(k m)
    rotary = [math.sqrt(k * 9e-4) for k in (10, 20, 30)]
    linear = [math.sqrt(k * 0.4) for k in (1e3, 2e3, 3e3)]
    np.testing.assert_allclose(PARAMS.damping, [*rotary, *linear])
    lack, rates = np.arange(1.0, 7.0), np.arange(2.0, 8.0)
    forces = PARAMS.law @ in_joint_order(2) @ [*lack, *rates]
    expected = np.array(PARAMS.stiffness) * lack + np.array(PARAMS.damping) * rates
    np.testing.assert_allclose(in_joint_order().T @ forces, expected)


@pytest.mark.parametrize("index", range(SIZE))
def test_the_longest_step_is_a_part_of_the_fastest_springs_radian(index: int) -> None:
    slow = [1.0] * SIZE
    slow[index] = 1e4
    inertia = 9e-4 if index < 3 else 0.4
    found = WristParams(stiffness=tuple(slow), mass=0.4, inertia=9e-4).longest_step
    assert found == pytest.approx(0.6 * math.sqrt(inertia / max(1e4, 1.0)))


@pytest.mark.parametrize("arm", [0.0, 0.01, 0.03])
def test_the_least_inertia_is_that_of_a_body(arm: float) -> None:
    # What is below, Drake refuses as no body's.
    least = 2 * 0.3 * arm**2 or 1e-6
    plant = MultibodyPlant(0.001)
    params = WristParams(centre_of_mass=arm, inertia=least * (1 + 1e-6))
    add_wrist(plant, plant.world_frame(), params)
    plant.Finalize()
    if arm:
        with pytest.raises(ParameterError, match=r"^inertia is .*, allowed: more than 2"):
            WristParams(centre_of_mass=arm, inertia=least * (1 - 1e-6))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"mass": 0.0}, "mass is 0.0, allowed: a finite number > 0"),
        ({"inertia": math.nan}, "inertia is nan, allowed: a finite number > 0"),
        ({"damping_ratio": -1.0}, "damping_ratio is -1.0, allowed: a finite number > 0"),
        ({"centre_of_mass": -0.1}, "centre_of_mass is -0.1, allowed: a finite number >= 0"),
        ({"inertia": 2e-4}, "inertia is 0.0002, allowed: more than 2 mass arm^2, 0.00024"),
        *[
            ({"stiffness": x}, f"stiffness is {x}, allowed: six finite numbers > 0")
            for x in ((1.0,) * 5, (0.0,) + (1.0,) * 5, (1.0,) * 5 + (math.inf,))
        ],
    ],
)
def test_refuses(values: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError) as refused:
        WristParams(**values)
    assert str(refused.value) == message
