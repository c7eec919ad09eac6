"""Postures that are found without one that is near."""

from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from chamfer.models.arms.serial_arm import SerialArm, searched_posture
from chamfer.models.arms.urdf_arm import chosen_arm
from chamfer.models.arms.wam import WAM
from chamfer.models.validation import ParameterError

ARM = chosen_arm(str(Path(__file__).with_name("six_joints.urdf")), None)
AHEAD = Rotation.from_matrix([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]])  # z ahead
UP = np.array([0.0, 0.0, 1.0])
PLACE = np.array([0.55, 0.1, 0.2])


@pytest.mark.parametrize("arm", [ARM, WAM])
def test_the_flange_is_where_it_is_asked_to_be(arm: SerialArm) -> None:
    q = searched_posture(arm, AHEAD.as_matrix(), PLACE, UP)
    found = arm.kinematics(q)
    np.testing.assert_allclose(found.R, AHEAD.as_matrix(), rtol=0, atol=1e-10)
    np.testing.assert_allclose(found.p, PLACE, rtol=0, atol=1e-10)
    assert arm.within_limits(q)
    assert np.linalg.svd(found.J, compute_uv=False)[-1] > 0.05
    np.testing.assert_array_equal(q, searched_posture(arm, AHEAD.as_matrix(), PLACE, UP))


def test_the_elbow_is_up_against_gravity() -> None:
    def height(up: np.ndarray) -> float:
        """How high the elbow is, of the base's z."""
        _, lift, *_ = searched_posture(ARM, AHEAD.as_matrix(), PLACE, up)
        return float(np.cos(lift))

    assert height(UP) > 0.2
    assert height(-UP) < height(UP) - 0.3


@pytest.mark.parametrize("place", [(2.0, 0.0, 0.2), (0.0, 0.0, 0.2)])
def test_what_is_out_of_reach(place: tuple[float, float, float]) -> None:
    message = rf"^flange position is \({place[0]}, .*\), allowed: within reach of six_joints, so"
    with pytest.raises(ParameterError, match=message):
        searched_posture(ARM, AHEAD.as_matrix(), np.array(place), UP)
