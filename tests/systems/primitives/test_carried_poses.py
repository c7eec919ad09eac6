"""Poses of what a carriage carries."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.math import SpatialVelocity
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from chamfer.models.arms.wrist import tip_pose
from chamfer.models.validation import ParameterError
from chamfer.systems.pose import pose_from_vector, pose_vector
from chamfer.systems.primitives.carriage import CarriedPoses, PoseDisplacement, TrueMotion


def test_block() -> None:
    carried = {
        "plug": RigidTransform([0.0, 0.0, -0.04]),
        "camera": RigidTransform(RollPitchYaw(3.1, 0.0, 0.2), [0.1, 0.0, 0.2]),
    }
    block = CarriedPoses(carried)
    context: Any = block.CreateDefaultContext()
    displacement = np.array([0.1, -0.2, 0.3, 0.01, 0.02, 0.03])
    block.GetInputPort("displacement").FixValue(context, displacement)
    for name, X_EB in carried.items():
        found = pose_from_vector(block.GetOutputPort(f"{name}_pose").Eval(context))
        assert found.IsNearlyEqualTo(tip_pose(displacement) @ X_EB, 1e-9)
    with pytest.raises(ParameterError, match=r"^carried is \{\}, allowed: one thing or more$"):
        CarriedPoses({})


def displacement_of(pose: np.ndarray) -> np.ndarray:
    block = PoseDisplacement()
    context: Any = block.CreateDefaultContext()
    block.GetInputPort("pose").FixValue(context, pose)
    return np.array(block.GetOutputPort("displacement").Eval(context))


def within(limit: float) -> st.SearchStrategy[float]:
    return st.floats(-limit, limit)


@given(
    st.tuples(*[within(1.4)] * 2, within(3.1), *[within(2.0)] * 3),
    st.sampled_from([1.0, -1.0]),
)
def test_displacement_is_carried_poses_undone(
    displacement: tuple[float, ...], sign: float
) -> None:
    carried = CarriedPoses({"tool": RigidTransform()})
    context: Any = carried.CreateDefaultContext()
    carried.GetInputPort("displacement").FixValue(context, list(displacement))
    pose = np.array(carried.GetOutputPort("tool_pose").Eval(context))
    pose[:4] *= sign  # a quaternion and its opposite are one turn
    np.testing.assert_allclose(displacement_of(pose), displacement, atol=1e-9)


def test_a_turn_about_z_is_between_half_turns() -> None:
    for turn, expected in ((0.75, 0.75), (1.25, -0.75), (-1.5, 0.5)):
        pose = pose_vector(tip_pose(np.array([0, 0, turn * math.pi, 0, 0, 0])))
        assert displacement_of(pose)[2] == pytest.approx(expected * math.pi)


def test_a_pose_that_is_none_is_refused() -> None:
    with pytest.raises(ParameterError, match=r"^pose is \[nan, "):
        displacement_of(np.full(7, math.nan))


def test_true_motion_is_that_of_the_body_in_a_plant() -> None:
    plant = MultibodyPlant(0.0)
    for name in ("first", "second"):
        plant.AddRigidBody(name, SpatialInertia.SolidSphereWithMass(1.0, 0.1))
    plant.Finalize()
    bodies = [plant.GetBodyByName(name) for name in ("first", "second")]
    builder = DiagramBuilder()
    builder.AddSystem(plant)
    for body in bodies:
        block = builder.AddSystem(TrueMotion(body.index()))
        builder.Connect(plant.get_body_poses_output_port(), block.GetInputPort("body_poses"))
        builder.Connect(
            plant.get_body_spatial_velocities_output_port(), block.GetInputPort("body_velocities")
        )
        builder.ExportOutput(block.GetOutputPort("motion"), body.name())
    diagram = builder.Build()
    context: Any = diagram.CreateDefaultContext()
    inside = plant.GetMyMutableContextFromRoot(context)
    rng = np.random.default_rng(3)
    expected = {}
    for body in bodies:
        displacement, velocity = rng.uniform(-1, 1, 6), rng.uniform(-1, 1, 6)
        plant.SetFreeBodyPose(inside, body, tip_pose(displacement))
        V_WB = SpatialVelocity(w=velocity[:3], v=velocity[3:])
        plant.SetFreeBodySpatialVelocity(context=inside, body=body, V_JpJc=V_WB)
        expected[body.name()] = [*displacement, *velocity]
    for name, motion in expected.items():
        np.testing.assert_allclose(diagram.GetOutputPort(name).Eval(context), motion, atol=1e-12)
