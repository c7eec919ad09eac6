"""A pose that advances along another one's axis, as a feed says."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.systems.pose import POSE_SIZE

Array = NDArray[np.float64]

FEED_SIZE = 3


def axis_of(pose: Array) -> Array:
    """Return the x axis of a pose's frame in the world, shape (3,); the quaternion has length 1.

    Args:
        pose: Quaternion w, x, y, z and position, m, shape (7,).
    """
    w, x, y, z = pose[:4].tolist()
    return np.array([1 - 2 * (y * y + z * z), 2 * (x * y + w * z), 2 * (x * z - w * y)])


class FeedOffset(LeafSystem):
    """Moves a pose along the x axis of another one.

    .. pydrake_system::

        name: FeedOffset
        input_ports:
        - pose
        - along
        - feed
        output_ports:
        - advanced_pose
        - velocity

    ``pose``, ``along`` and ``advanced_pose``, shape (7,), are quaternion w, x, y, z and position,
    m. ``feed``, shape (3,): how far, m, how fast, m/s, and when that was so, s; between its
    samples the pose goes on at that rate. ``velocity``, shape (6,), rad/s and m/s in the world's
    axes, is the feed's alone.
    """

    def __init__(self) -> None:
        super().__init__()
        pose, along = (self.DeclareVectorInputPort(name, POSE_SIZE) for name in ("pose", "along"))
        feed = self.DeclareVectorInputPort("feed", FEED_SIZE)

        def calc_pose(context: Context, vector: BasicVector) -> None:
            fed, rate, since = feed.Eval(context).tolist()
            advanced = np.array(pose.Eval(context))
            way = fed + rate * (context.get_time() - since)
            advanced[4:] += way * axis_of(along.Eval(context))
            vector.SetFromVector(advanced)

        def calc_velocity(context: Context, vector: BasicVector) -> None:
            velocity = np.zeros(6)
            velocity[3:] = feed.Eval(context)[1] * axis_of(along.Eval(context))
            vector.SetFromVector(velocity)

        self.DeclareVectorOutputPort(
            "advanced_pose",
            POSE_SIZE,
            calc_pose,
            {pose.ticket(), along.ticket(), feed.ticket(), self.time_ticket()},
        )
        self.DeclareVectorOutputPort("velocity", 6, calc_velocity, {along.ticket(), feed.ticket()})
