"""The feed-forward of a desired acceleration, by what it does to the arm."""

import numpy as np
import pytest
from pydrake.systems.analysis import Simulator

from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.force.hybrid_controller import AccelerationFeedforward

Q = np.array([0.4, 0.9, 0.2, -0.3])
WANTED = np.array([0.5, -0.3, 0.8, 0.2])


def torque(selection: np.ndarray, acceleration: np.ndarray) -> np.ndarray:
    block = AccelerationFeedforward(ADEPT_ONE, ArmDynamics(ADEPT_ONE), period=0.005)
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    block.GetInputPort("encoders").FixValue(context, [*Q, 1.0, -2.0, 0.1, 0.5])
    block.GetInputPort("desired_acceleration").FixValue(context, acceleration)
    block.GetInputPort("selection").FixValue(context, selection.ravel())
    assert not block.HasAnyDirectFeedthrough()
    simulator.AdvanceTo(0.001)
    found: np.ndarray = block.GetOutputPort("torque").Eval(context).copy()
    return found


def test_from_rest_the_arm_accelerates_as_wanted_in_the_position_domain_alone() -> None:
    # x'' = J M^-1 tau, where nothing else acts.
    mass = ArmDynamics(ADEPT_ONE, gravity=False).evaluate(Q, np.zeros(4)).mass
    normal = np.array([0.6, 0.8, 0.0, 0.0])
    for P in (np.eye(4), np.eye(4) - np.outer(normal, normal)):
        found = ADEPT_ONE.jacobian(Q) @ np.linalg.solve(mass, torque(P, WANTED))
        np.testing.assert_allclose(found, P @ WANTED, atol=1e-12)


def test_at_constant_speed_there_is_none() -> None:
    np.testing.assert_array_equal(torque(np.eye(4), np.zeros(4)), 0.0)


def test_refused() -> None:
    with pytest.raises(ParameterError, match=r"^torque is \[nan"):
        torque(np.eye(4), np.full(4, np.nan))
    with pytest.raises(ParameterError, match=r"^period is 0\.0"):
        AccelerationFeedforward(PLANAR_TWO_LINK, ArmDynamics(PLANAR_TWO_LINK), period=0.0)
