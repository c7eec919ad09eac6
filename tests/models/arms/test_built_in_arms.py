"""The arms that are built in beside the WAM, against their makers' or their own closed forms."""

import math

import numpy as np
import pytest

from chamfer.models.arms import adept_one
from chamfer.models.arms.urdf_arm import chosen_arm
from chamfer.models.validation import ParameterError

# a and d, m, and alpha, rad, of each joint: the maker's Denavit-Hartenberg table.
_UR5E = (
    (0.0, 0.1625, math.pi / 2),
    (-0.425, 0.0, 0.0),
    (-0.3922, 0.0, 0.0),
    (0.0, 0.1333, math.pi / 2),
    (0.0, 0.0997, -math.pi / 2),
    (0.0, 0.0996, 0.0),
)


@pytest.mark.parametrize("seed", range(3))
def test_the_ur5e_has_its_makers_lengths(seed: int) -> None:
    q = np.random.default_rng(seed).uniform(-3.0, 3.0, 6)
    X = np.eye(4)
    for angle, (a, d, alpha) in zip(q, _UR5E, strict=True):
        c, s, ca, sa = math.cos(angle), math.sin(angle), math.cos(alpha), math.sin(alpha)
        frame = np.eye(4)
        frame[0] = c, -s * ca, s * sa, a * c
        frame[1] = s, c * ca, -c * sa, a * s
        frame[2] = 0.0, sa, ca, d
        X = X @ frame
    at = chosen_arm("ur5e", None).kinematics(q)
    assert np.allclose(at.R, X[:3, :3], atol=1e-12)
    assert np.allclose(at.p, X[:3, 3], atol=1e-12)


def test_the_scara_is_the_adept_one_with_its_flange_down() -> None:
    q = np.array([0.3, -0.8, 0.2, 0.5])
    at, tip = chosen_arm("scara", None).kinematics(q), adept_one.endpoint(q)
    assert np.allclose(at.p, tip[:3], atol=1e-12)
    assert np.allclose(at.R[:, 2], (0, 0, -1), atol=1e-12)
    assert math.isclose(math.atan2(at.R[1, 0], at.R[0, 0]), tip[3], abs_tol=1e-12)
    # Nothing turns about a horizontal axis.
    assert np.allclose(at.J[:2], 0.0, atol=1e-12)


@pytest.mark.parametrize("model", ["wam", "ur5e", "scara"])
def test_a_built_in_arm_has_its_flange(model: str) -> None:
    with pytest.raises(ParameterError, match=f"tool_frame is 'tool0', allowed: null: {model}"):
        chosen_arm(model, "tool0")
