import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from chamfer.models.validation import ParameterError
from chamfer.systems.force.desired_pose import CompensatedPose, compensate

POSE = np.array([np.cos(0.3), 0.0, np.sin(0.3), 0.0, 1.0, 2.0, 3.0])


def test_moves_and_turns_in_the_worlds_axes() -> None:
    turn = np.array([0.1, -0.2, 0.3])
    found = compensate(POSE, np.concatenate([[0.01, 0.02, -0.03], turn]))
    expected = Rotation.from_rotvec(turn) * Rotation.from_quat(POSE[:4], scalar_first=True)
    off = expected.inv() * Rotation.from_quat(found[:4], scalar_first=True)
    assert off.magnitude() < 1e-12
    assert found[4:] == pytest.approx([1.01, 2.02, 2.97])
    assert found[:4] @ POSE[:4] > 0


def test_nothing_to_compensate_changes_nothing() -> None:
    assert compensate(POSE, np.zeros(6)) == pytest.approx(POSE, abs=1e-15)


def test_the_block_takes_its_share() -> None:
    block = CompensatedPose(-0.5)
    context = block.CreateDefaultContext()
    block.GetInputPort("desired_pose").FixValue(context, POSE)
    block.GetInputPort("compensation").FixValue(context, [0.02, 0.0, 0.0, 0.0, 0.0, 0.4])
    found = block.GetOutputPort("pose").Eval(context)
    assert found == pytest.approx(compensate(POSE, np.array([-0.01, 0, 0, 0, 0, -0.2])))


def test_refused() -> None:
    with pytest.raises(ParameterError, match="share is nan"):
        CompensatedPose(float("nan"))
    with pytest.raises(ParameterError, match="a quaternion other than zero"):
        compensate(np.zeros(7), np.zeros(6))
