"""Which joints a command moves, by the inverse of the Jacobian."""

import numpy as np
import pytest

from chamfer.models.arms.adept_wrist import ADEPT_WRIST
from chamfer.systems.force.friction_compensation import JointsToMove

Q = np.array([0.3, 1.1, 0.35, -0.4, 0.3, 0.3, 0.0])
REST = 1e-3


def moving(desired: np.ndarray, rest_speed: float = REST) -> list[float]:
    """Return what the block says at Q, with encoders that say so of joints that move."""
    block = JointsToMove(ADEPT_WRIST, rest_speed=rest_speed)
    context = block.CreateDefaultContext()
    block.GetInputPort("encoders").FixValue(context, [*Q, *np.ones(7)])
    block.GetInputPort("desired_velocity").FixValue(context, desired)
    found: list[float] = block.GetOutputPort("moving").Eval(context).tolist()
    return found


def test_down_the_wall_only_the_quill_moves() -> None:
    assert moving(np.array([0.0, 0.0, -0.02, 0.0, 0.0, 0.0, 0.0])) == [0, 0, 1, 0, 0, 0, 0]


@pytest.mark.parametrize("joint", range(7))
def test_a_joint_moves_from_the_rest_speed_on(joint: int) -> None:
    jacobian = ADEPT_WRIST.jacobian(Q)
    for share, expected in ((-1.1, 1.0), (1.1, 1.0), (0.9, 0.0), (0.0, 0.0)):
        speeds = np.zeros(7)
        speeds[joint] = share * REST
        found = moving(jacobian @ speeds)
        assert found[joint] == expected
        assert sum(found) == expected


def test_without_a_rest_speed_all_are_to_move() -> None:
    assert moving(np.zeros(7), rest_speed=0.0) == [1.0] * 7
