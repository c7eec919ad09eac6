"""Poses of what a carriage carries."""

from typing import Any

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw

from models.validation import ParameterError
from models.wrist import tip_pose
from systems.pose import pose_from_vector
from systems.skills.carried_poses import CarriedPoses


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
