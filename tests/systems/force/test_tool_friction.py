import numpy as np

from chamfer.systems.force.arm_model import tool_friction

# A slide along x, and a joint about z at a lever of 0.5 m behind the tool: rows rad/s above m/s.
JACOBIAN = np.zeros((6, 2))
JACOBIAN[3, 0] = 1.0
JACOBIAN[2, 1], JACOBIAN[4, 1] = 1.0, 0.5


def test_what_one_joint_turns_is_held_by_its_friction_over_the_lever() -> None:
    found = tool_friction(JACOBIAN, np.array([3.0, 0.2]))
    assert np.allclose(found.held[[2, 3, 4]], [0.2, 3.0, 0.4])
    assert np.isinf(found.held[[0, 1, 5]]).all()


def test_what_slides_takes_the_power_of_its_joints() -> None:
    found = tool_friction(JACOBIAN, np.array([3.0, 0.2]))
    assert np.isclose(found.wound[3], 3.0)
    # The joint of least norm that makes 1 m/s across turns with 0.5/1.25 rad/s of what it is told.
    assert np.isclose(found.wound[4], 0.2 * 0.5 / 1.25)


def test_without_friction_nothing_is_held() -> None:
    found = tool_friction(JACOBIAN, np.zeros(2))
    assert np.allclose(found.held[[2, 3, 4]], 0.0)
    assert np.allclose(found.wound, 0.0)
