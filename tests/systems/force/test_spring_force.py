"""What an arm's own springs and encoders say of a contact."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw, RotationMatrix

from chamfer.models.validation import ParameterError
from chamfer.systems.force.impedance_controller import SpringForce
from chamfer.systems.pose import pose_vector

STIFFNESS = (100.0, 200.0, 400.0)
R_WD = RollPitchYaw(0.1, -0.2, 0.3).ToRotationMatrix()
R_WM = RollPitchYaw(-0.2, 0.1, 0.5).ToRotationMatrix()
P_WD = np.array([0.1, 0.2, 0.3])


def read(p_WT: np.ndarray, p_WM: np.ndarray) -> tuple[np.ndarray, float]:
    block = SpringForce(STIFFNESS)
    context = block.CreateDefaultContext()
    for name, R, p in (
        ("command", R_WD, P_WD),
        ("tool_pose", RotationMatrix(), p_WT),
        ("hole_pose", R_WM, p_WM),
    ):
        block.GetInputPort(name).FixValue(context, pose_vector(RigidTransform(R, p)))
    force = block.GetOutputPort("force").Eval(context)
    return force, float(block.GetOutputPort("advance").Eval(context)[0])


def test_the_springs_are_along_the_commands_axes_the_force_along_the_holes() -> None:
    off = np.array([0.01, -0.02, 0.005])  # in the command's axes
    force, _ = read(P_WD - R_WD @ off, np.zeros(3))
    expected = R_WM.inverse() @ (R_WD @ (np.array(STIFFNESS) * off))
    assert force == pytest.approx(expected)


def test_a_tool_at_its_command_pushes_with_nothing() -> None:
    force, _ = read(P_WD, np.zeros(3))
    assert force == pytest.approx(np.zeros(3), abs=1e-15)


def test_the_advance_is_along_the_holes_axis() -> None:
    p_WM = np.array([0.5, 0.0, 0.1])
    _, advance = read(p_WM + R_WM @ np.array([-0.03, 0.004, 0.002]), p_WM)
    assert advance == pytest.approx(-0.03)


def test_refused() -> None:
    with pytest.raises(ParameterError, match=r"stiffness is \(1\.0, 0\.0, 1\.0\)"):
        SpringForce((1.0, 0.0, 1.0))
