"""A wrench on a body of a plant."""

import math
import re
from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.multibody.plant import MultibodyPlant
from pydrake.multibody.tree import RotationalInertia, SpatialInertia
from pydrake.systems.framework import DiagramBuilder

from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import ToolForce

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


def test_it_follows_the_wrench_at_once() -> None:
    block = ToolForce(two_bodies().GetBodyByName("tool").index())
    context: Any = block.CreateDefaultContext()
    for wrench in (WRENCH, -2 * WRENCH):
        block.GetInputPort("wrench").FixValue(context, wrench)
        (force,) = block.GetOutputPort("spatial_forces").Eval(context)
        np.testing.assert_array_equal(force.F_Bq_W.rotational(), wrench[:3])
        np.testing.assert_array_equal(force.F_Bq_W.translational(), wrench[3:])
        np.testing.assert_array_equal(force.p_BoBq_B, np.zeros(3))
    assert block.HasAnyDirectFeedthrough()


@pytest.mark.parametrize("value", [math.nan, math.inf])
def test_a_wrench_that_is_not_finite_is_refused(value: float) -> None:
    block = ToolForce(two_bodies().GetBodyByName("tool").index())
    context: Any = block.CreateDefaultContext()
    block.GetInputPort("wrench").FixValue(context, [0.0, 0.0, 0.0, value, 0.0, 0.0])
    message = f"wrench is [0.0, 0.0, 0.0, {value}, 0.0, 0.0], allowed: finite numbers"
    with pytest.raises(ParameterError, match=f"^{re.escape(message)}$"):
        block.GetOutputPort("spatial_forces").Eval(context)
