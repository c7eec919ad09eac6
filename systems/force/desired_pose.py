"""The desired pose of a tool: a straight motion, a feed, a compensation."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from chamfer.models.validation import ParameterError
from chamfer.systems.force.tool_pose import (
    StraightMotion,
    advanced,
    compensate,
    feed_velocity,
    share_of_compensation,
)
from chamfer.systems.pose import POSE_SIZE, pose_vector

Array = NDArray[np.float64]


class StoppableMotion(LeafSystem):
    """Moves on a line from a position to a goal, until it is stopped.

    .. pydrake_system::

        name: StoppableMotion
        input_ports:
        - stop (optional)
        output_ports:
        - desired_pose
        - desired_velocity

    ``desired_pose``, shape (7,), is quaternion w, x, y, z and position, m, a cubic polynomial of
    time; the orientation is always the goal's. ``desired_velocity``, shape (6,), is rad/s and m/s
    in the world's axes. Once ``stop``, size 1, is 1 at the start of a period, the pose stays and
    the velocity is 0, permanently.

    Discrete state: when it was stopped, s, or infinity.

    The tool starts at ``p_WT``, m, shape (3,), and is at the goal X_WT from ``duration``, s, on;
    the period, s, is that in which it reads ``stop``.
    """

    def __init__(self, p_WT: Array, goal: RigidTransform, duration: float, period: float) -> None:
        super().__init__()
        if not 0 < period < math.inf:
            raise ParameterError("period", period, "a finite number > 0")
        motion = StraightMotion(p_WT, goal.translation(), duration)
        quaternion = pose_vector(goal)[:4]
        stop = self.DeclareVectorInputPort("stop", 1)
        stopped = self.DeclareDiscreteState([math.inf])

        def look(context: Context, state: State) -> None:
            if not stop.HasValue(context) or not stop.Eval(context)[0] >= 0.5:
                return
            value = state.get_mutable_discrete_state(stopped)
            value[0] = min(value[0], context.get_time())

        def at(context: Context) -> tuple[Array, Array]:
            return motion.at(context.get_time(), context.get_discrete_state(stopped)[0])

        def calc_pose(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(np.concatenate([quaternion, at(context)[0]]))

        def calc_velocity(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(np.concatenate([np.zeros(3), at(context)[1]]))

        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, look)
        depends = {self.time_ticket(), self.discrete_state_ticket(stopped)}
        self.DeclareVectorOutputPort("desired_pose", 7, calc_pose, depends)
        self.DeclareVectorOutputPort("desired_velocity", 6, calc_velocity, depends)


FEED_SIZE = 3
OFFSET_SIZE = 8


class FeedOffset(LeafSystem):
    """Moves a pose along the x axis of another one, and sideways.

    .. pydrake_system::

        name: FeedOffset
        input_ports:
        - pose
        - along
        - feed
        - offset (optional)
        output_ports:
        - advanced_pose
        - velocity

    ``pose``, ``along`` and ``advanced_pose``, shape (7,), are quaternion w, x, y, z and position,
    m. ``feed``, shape (3,), is distance, m, speed, m/s, and their time, s; between its samples the
    pose continues at that speed. ``offset``, shape (8,), is the sideways offset at that time, m,
    along y and z of ``along``, the rotations about them, rad, and the rates, m/s and rad/s.
    ``velocity``, shape (6,), rad/s and m/s in the world's axes, is that of feed and offset only.
    """

    def __init__(self) -> None:
        super().__init__()
        pose, along = (self.DeclareVectorInputPort(name, POSE_SIZE) for name in ("pose", "along"))
        feed = self.DeclareVectorInputPort("feed", FEED_SIZE)
        offset = self.DeclareVectorInputPort("offset", OFFSET_SIZE)

        def aside(context: Context) -> Array | None:
            found: Array | None = offset.Eval(context) if offset.HasValue(context) else None
            return found

        def calc_pose(context: Context, vector: BasicVector) -> None:
            fed = along.Eval(context), feed.Eval(context), context.get_time(), aside(context)
            vector.SetFromVector(advanced(pose.Eval(context), *fed))

        def calc_velocity(context: Context, vector: BasicVector) -> None:
            fed = along.Eval(context), feed.Eval(context), aside(context)
            vector.SetFromVector(feed_velocity(*fed))

        depends = {along.ticket(), feed.ticket(), offset.ticket()}
        moves = {*depends, pose.ticket(), self.time_ticket()}
        self.DeclareVectorOutputPort("advanced_pose", POSE_SIZE, calc_pose, moves)
        self.DeclareVectorOutputPort("velocity", 6, calc_velocity, depends)


_WORLD: Final = RotationMatrix()


class CompensatedPose(LeafSystem):
    """Adds a share of the compensation to a desired pose.

    .. pydrake_system::

        name: CompensatedPose
        input_ports:
        - desired_pose
        - compensation
        output_ports:
        - pose

    ``desired_pose`` and ``pose``, shape (7,), are quaternion w, x, y, z and position, m;
    ``compensation``, shape (6,), is a displacement, m, and a rotation vector, rad, in axes H.

    ``share`` is this arm's part of the compensation, negative for the arm with the hole, whose
    motion has the opposite effect. R_WH has the axes, by default the world's.
    """

    def __init__(self, share: float, R_WH: RotationMatrix = _WORLD) -> None:
        super().__init__()
        if not math.isfinite(share):
            raise ParameterError("share", share, "a finite number")
        pose = self.DeclareVectorInputPort("desired_pose", POSE_SIZE)
        compensation = self.DeclareVectorInputPort("compensation", 6)
        taken = share_of_compensation(share, R_WH.matrix())

        def calc(context: Context, vector: BasicVector) -> None:
            share_taken = taken @ compensation.Eval(context)
            vector.SetFromVector(compensate(pose.Eval(context), share_taken))

        depends = {pose.ticket(), compensation.ticket()}
        self.DeclareVectorOutputPort("pose", POSE_SIZE, calc, depends)
