"""A straight motion that can be stopped, a feed along an axis, and a compensation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import Context
from scipy.spatial.transform import Rotation

from chamfer.systems.force.desired_pose import CompensatedPose, FeedOffset, StoppableMotion
from chamfer.systems.force.tool_pose import compensate
from chamfer.systems.pose import pose_vector

Array = np.ndarray

START = np.array([0.1, -0.2, 0.3])
GOAL = RigidTransform(RollPitchYaw(0.3, -0.2, 0.1), np.array([0.5, 0.0, 0.2]))
DURATION, PERIOD = 2.0, 0.25


def motion() -> StoppableMotion:
    return StoppableMotion(START, GOAL, DURATION, PERIOD)


def pose_at(block: StoppableMotion, context: Context) -> Array:
    return np.array(block.GetOutputPort("desired_pose").Eval(context))


def velocity_at(block: StoppableMotion, context: Context) -> Array:
    return np.array(block.GetOutputPort("desired_velocity").Eval(context))


def at(time: float) -> tuple[Array, Array]:
    """Pose and velocity_at at a time, with nothing that stops it."""
    block = motion()
    context = block.CreateDefaultContext()
    context.SetTime(time)
    return pose_at(block, context), velocity_at(block, context)


@given(time=st.floats(0.0, 3.0))
@settings(max_examples=50, deadline=None)
def test_cubic_from_rest_to_rest_on_a_line(time: float) -> None:
    found, rate = at(time)
    s = min(time / DURATION, 1.0)
    way = GOAL.translation() - START
    np.testing.assert_allclose(found[4:], START + (3 * s**2 - 2 * s**3) * way, rtol=0, atol=1e-12)
    np.testing.assert_allclose(rate[3:], 6 * s * (1 - s) / DURATION * way, rtol=0, atol=1e-12)


def stopped(when: float, *, back: bool) -> tuple[StoppableMotion, Simulator]:
    """A motion that is told to stop shortly before a time, and maybe to go on afterwards."""
    block = motion()
    simulator = Simulator(block)
    context = simulator.get_mutable_context()
    stop = block.GetInputPort("stop")
    stop.FixValue(context, [0.0])
    if when > 0.1:
        simulator.AdvanceTo(when - 0.1)
    stop.FixValue(context, [1.0])
    simulator.AdvanceTo(when + 0.1)
    stop.FixValue(context, [0.0 if back else 1.0])
    return block, simulator


@pytest.mark.parametrize("back", [False, True])
@pytest.mark.parametrize("when", [0.0, 0.75, 1.75, 2.5])
def test_stops_where_it_is_for_good(when: float, back: bool) -> None:
    block, simulator = stopped(when, back=back)
    for time in (when + 0.1, when + 0.3, when + 1.7, when + 5.0):
        simulator.AdvanceTo(time)
        context = simulator.get_context()
        np.testing.assert_allclose(pose_at(block, context), at(when)[0], rtol=0, atol=1e-12)
        assert not velocity_at(block, context).any()


TURN = RollPitchYaw(0.2, -0.3, 0.4)
FED = pose_vector(RigidTransform(RollPitchYaw(0.0, 0.1, 0.0), [1.0, 2.0, 3.0]))
ALONG = pose_vector(RigidTransform(TURN, [5.0, 5.0, 5.0]))
AXIS = TURN.ToRotationMatrix().matrix()[:, 0]


def test_between_its_samples_the_feed_goes_on_at_its_velocity() -> None:
    block = FeedOffset()
    context = block.CreateDefaultContext()
    context.SetTime(1.25)
    for name, value in {"pose": FED, "along": ALONG, "feed": (0.01, -0.02, 1.0)}.items():
        block.GetInputPort(name).FixValue(context, value)
    found = block.GetOutputPort("advanced_pose").Eval(context)
    assert found[:4] == pytest.approx(FED[:4])
    assert found[4:] == pytest.approx(FED[4:] + 0.005 * AXIS)
    velocity = block.GetOutputPort("velocity").Eval(context)
    assert velocity == pytest.approx(np.concatenate([np.zeros(3), -0.02 * AXIS]))


POSE = np.array([np.cos(0.3), 0.0, np.sin(0.3), 0.0, 1.0, 2.0, 3.0])


def test_moves_and_turns_in_the_worlds_axes() -> None:
    turn = np.array([0.1, -0.2, 0.3])
    found = compensate(POSE, np.concatenate([[0.01, 0.02, -0.03], turn]))
    expected = Rotation.from_rotvec(turn) * Rotation.from_quat(POSE[:4], scalar_first=True)
    off = expected.inv() * Rotation.from_quat(found[:4], scalar_first=True)
    assert off.magnitude() < 1e-12
    assert found[4:] == pytest.approx([1.01, 2.02, 2.97])
    assert found[:4] @ POSE[:4] > 0


def test_the_block_takes_its_share() -> None:
    block = CompensatedPose(-0.5)
    context = block.CreateDefaultContext()
    block.GetInputPort("desired_pose").FixValue(context, POSE)
    block.GetInputPort("compensation").FixValue(context, [0.02, 0.0, 0.0, 0.0, 0.0, 0.4])
    found = block.GetOutputPort("pose").Eval(context)
    assert found == pytest.approx(compensate(POSE, np.array([-0.01, 0, 0, 0, 0, -0.2])))
