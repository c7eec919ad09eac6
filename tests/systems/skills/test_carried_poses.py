"""Poses of what a carriage carries."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw
from scipy.spatial.transform import Rotation

from models.validation import ParameterError
from systems.pose import pose_from_vector
from systems.skills.carried_poses import CarriedPoses, carriage_pose

values = st.lists(st.floats(-1, 1), min_size=6, max_size=6)


@given(values)
def test_a_displacement_is_a_rotation_vector_and_a_position(displacement: list[float]) -> None:
    X_WE = carriage_pose(np.array(displacement))
    expected = Rotation.from_rotvec(displacement[:3]).as_matrix()
    np.testing.assert_allclose(X_WE.rotation().matrix(), expected, atol=1e-9)
    np.testing.assert_array_equal(X_WE.translation(), displacement[3:])


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
        assert found.IsNearlyEqualTo(carriage_pose(displacement) @ X_EB, 1e-9)
    with pytest.raises(ParameterError, match=r"^carried is \{\}, allowed: one thing or more$"):
        CarriedPoses({})
