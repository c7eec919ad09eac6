import math
import re

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from chamfer.models.validation import ParameterError
from chamfer.systems.pose import pose_from_vector, pose_vector


def test_pose_vector_has_a_positive_scalar_part() -> None:
    for angle in (0.3, 3.0, 3.3, -0.3, -3.0):
        X = RigidTransform(RotationMatrix.MakeYRotation(angle), [1.0, 2.0, 3.0])
        vector = pose_vector(X)
        sign = 1 if math.cos(angle / 2) > 0 else -1
        expected = [math.cos(angle / 2), 0, math.sin(angle / 2), 0]
        np.testing.assert_allclose(vector[:4], sign * np.array(expected), atol=1e-12)
        np.testing.assert_array_equal(vector[4:], [1, 2, 3])


@settings(deadline=None)
@given(seed=st.integers(0, 2**32 - 1))
def test_pose_vector_round_trip(seed: int) -> None:
    generator = np.random.default_rng(seed)
    X = RigidTransform(RollPitchYaw(generator.uniform(-3, 3, 3)), generator.normal(size=3))
    vector = pose_vector(X)
    assert vector.shape == (7,)
    np.testing.assert_array_equal(vector[4:], X.translation())
    back = pose_from_vector(np.concatenate([1.005 * vector[:4], vector[4:]]))
    np.testing.assert_allclose(back.GetAsMatrix4(), X.GetAsMatrix4(), atol=1e-12)


@pytest.mark.parametrize(
    "vector",
    [[0.0] * 7, [2.0] + [0.0] * 6, [1.0] + [0.0] * 5 + [math.nan], [math.nan] * 7],
)
def test_pose_errors(vector: list[float]) -> None:
    message = re.escape(
        f"pose is {vector!r}, allowed: finite numbers, the first four a quaternion of length 1"
    )
    with pytest.raises(ParameterError, match=f"^{message}$"):
        pose_from_vector(np.array(vector))
