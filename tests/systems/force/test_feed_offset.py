"""A pose that is fed along another one's axis."""

import numpy as np
import pytest
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.framework import Context

from chamfer.systems.force.desired_pose import FeedOffset, axis_of
from chamfer.systems.pose import pose_vector

TURN = RollPitchYaw(0.2, -0.3, 0.4)
POSE = pose_vector(RigidTransform(RollPitchYaw(0.0, 0.1, 0.0), [1.0, 2.0, 3.0]))
ALONG = pose_vector(RigidTransform(TURN, [5.0, 5.0, 5.0]))
AXIS = TURN.ToRotationMatrix().matrix()[:, 0]


def fed(feed: tuple[float, float, float], time: float) -> tuple[FeedOffset, Context]:
    block = FeedOffset()
    context = block.CreateDefaultContext()
    context.SetTime(time)
    block.GetInputPort("pose").FixValue(context, POSE)
    block.GetInputPort("along").FixValue(context, ALONG)
    block.GetInputPort("feed").FixValue(context, feed)
    return block, context


def test_the_axis_of_a_pose() -> None:
    assert axis_of(ALONG) == pytest.approx(AXIS)


def test_between_its_samples_the_feed_goes_on() -> None:
    block, context = fed((0.01, 0.02, 1.0), 1.25)
    found = block.GetOutputPort("advanced_pose").Eval(context)
    assert found[:4] == pytest.approx(POSE[:4])
    assert found[4:] == pytest.approx(POSE[4:] + 0.015 * AXIS)


def test_the_velocity_is_that_of_the_feed() -> None:
    block, context = fed((0.01, -0.02, 1.0), 1.25)
    found = block.GetOutputPort("velocity").Eval(context)
    assert found == pytest.approx(np.concatenate([np.zeros(3), -0.02 * AXIS]))


def test_without_a_feed_the_pose_is_as_it_was() -> None:
    block, context = fed((0.0, 0.0, 0.0), 7.0)
    np.testing.assert_array_equal(block.GetOutputPort("advanced_pose").Eval(context), POSE)
