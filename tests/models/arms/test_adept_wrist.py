"""The Adept One with its wrist: what each of the wrist's joints does to the nugget."""

import math
import re

import numpy as np
import pytest
from pydrake.math import RollPitchYaw
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import MultibodyPlant

from chamfer.models.arms import adept_one
from chamfer.models.arms.adept_wrist import (
    ADEPT_WRIST,
    BODY_LENGTH,
    FINGER_LENGTH,
    endpoint,
    jacobian,
    joint_positions,
    mount_position,
)

X = np.array([0.45, 0.25, 0.3, 0.7, 0.2, -0.3, 0.4])


@pytest.fixture(scope="module")
def plant() -> MultibodyPlant:
    plant = MultibodyPlant(0.0)
    Parser(plant).AddModels(str(ADEPT_WRIST.urdf))
    plant.WeldFrames(plant.world_frame(), plant.GetFrameByName("base"))
    plant.Finalize()
    return plant


def test_hanging_straight_down_the_wrist_lengthens_the_quill() -> None:
    q = np.array([0.4, 0.9, 0.3, -0.2])
    expected = adept_one.endpoint(q) - [0, 0, BODY_LENGTH + FINGER_LENGTH, 0]
    found = endpoint(np.concatenate([q, np.zeros(3)]))
    np.testing.assert_allclose(found, [*expected, 0, 0, 0], rtol=0, atol=1e-15)


def test_urdf_turns_the_nugget_as_the_angles_say(plant: MultibodyPlant) -> None:
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, joint_positions(X, "positive"))
    X_WE = plant.GetFrameByName("endpoint").CalcPoseInWorld(context)
    yaw, pitch, roll = X[3:6]
    expected = RollPitchYaw(roll, pitch, yaw).ToRotationMatrix().matrix()
    np.testing.assert_allclose(X_WE.rotation().matrix(), expected, rtol=0, atol=1e-14)
    mount = plant.GetFrameByName("link_4").CalcPoseInWorld(context).translation()
    np.testing.assert_allclose(mount_position(X), mount, rtol=0, atol=1e-14)


def test_leaning_outwards_takes_the_gripper_off_the_wall_and_leaves_the_nugget() -> None:
    # The wall is ahead along the nugget's x axis; the body that leans stands back from it.
    def stands_back(lean: float) -> float:
        x = np.array([0.45, 0.25, 0.3, 0.7, 0.0, 0.0, lean])
        q = joint_positions(x, "positive")
        np.testing.assert_allclose(endpoint(q), x, rtol=0, atol=1e-14)
        return float((x[:3] - mount_position(x))[:2] @ [math.cos(0.7), math.sin(0.7)])

    assert stands_back(0.0) == pytest.approx(0.0, abs=1e-15)
    assert stands_back(0.4) == pytest.approx(BODY_LENGTH * math.sin(0.4), abs=1e-14)


def test_wrist_adds_no_singular_pose() -> None:
    q = joint_positions(X, "negative")
    assert np.linalg.det(jacobian(q)) == pytest.approx(
        np.linalg.det(adept_one.jacobian(q[:4])), rel=1e-12
    )


def test_weight_of_the_payload_is_the_same_as_without_the_wrist(plant: MultibodyPlant) -> None:
    context = plant.CreateDefaultContext()
    plant.SetPositions(context, joint_positions(X, "positive"))
    assert plant.CalcGravityGeneralizedForces(context)[2] == pytest.approx(6 * 9.81)


@pytest.mark.parametrize(
    ("endpoint_vector", "allowed"),
    [
        (
            (0.8, 0.0, 0.3, 0.0, 0.0, 0.0, -0.1),
            "the mount more than 0.05 m and less than 0.8 m from the base's axis",
        ),
        ((0.5, 0.1, 0.3, 0.0, math.nan, 0.0, 0.0), "finite numbers"),
    ],
)
def test_out_of_reach(endpoint_vector: tuple[float, ...], allowed: str) -> None:
    message = re.escape(f"endpoint is {endpoint_vector}, allowed: {allowed}")
    with pytest.raises(ValueError, match=f"^{message}$"):
        joint_positions(np.array(endpoint_vector), "positive")
