"""The pose that a tool is told to take: a straight motion, a feed, a compensation."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State
from pydrake.trajectories import PiecewisePolynomial

from chamfer.models.validation import ParameterError
from chamfer.systems.pose import POSE_SIZE, pose_vector

Array = NDArray[np.float64]


class StoppableMotion(LeafSystem):
    """Goes on a line from a position to a goal, unless it is stopped.

    .. pydrake_system::

        name: StoppableMotion
        input_ports:
        - stop (optional)
        output_ports:
        - desired_pose
        - desired_velocity

    ``desired_pose``, shape (7,), is quaternion w, x, y, z and position, m, a cubic polynomial of
    time; the orientation is the goal's all along. ``desired_velocity``, shape (6,), is rad/s and
    m/s in the world's axes. Once ``stop``, size 1, was 1 at a period's begin the pose stays where
    it is and the velocity is 0, for good.

    Discrete state: when it was stopped, s, or infinity.

    The tool starts at ``p_WT``, m, shape (3,), and is at the goal X_WT from ``duration``, s, on;
    the period, s, is between two looks at ``stop``.
    """

    def __init__(self, p_WT: Array, goal: RigidTransform, duration: float, period: float) -> None:
        super().__init__()
        for name, value in (("duration", duration), ("period", period)):
            if not 0 < value < math.inf:
                raise ParameterError(name, value, "a finite number > 0")
        if np.shape(p_WT) != (3,) or not np.isfinite(p_WT).all():
            raise ParameterError("p_WT", np.asarray(p_WT).tolist(), "three finite numbers")
        points = np.column_stack([p_WT, goal.translation()])
        way = PiecewisePolynomial.CubicHermite([0.0, duration], points, np.zeros((3, 2)))
        rate = way.derivative(1)
        quaternion = pose_vector(goal)[:4]
        stop = self.DeclareVectorInputPort("stop", 1)
        stopped = self.DeclareDiscreteState([math.inf])

        def look(context: Context, state: State) -> None:
            if not stop.HasValue(context) or not stop.Eval(context)[0] >= 0.5:
                return
            value = state.get_mutable_discrete_state(stopped)
            value[0] = min(value[0], context.get_time())

        def calc_pose(context: Context, vector: BasicVector) -> None:
            time = min(context.get_time(), context.get_discrete_state(stopped)[0])
            vector.SetFromVector(np.concatenate([quaternion, way.value(time)[:, 0]]))

        def calc_velocity(context: Context, vector: BasicVector) -> None:
            moves = context.get_time() < min(duration, context.get_discrete_state(stopped)[0])
            v = rate.value(context.get_time())[:, 0] if moves else np.zeros(3)
            vector.SetFromVector(np.concatenate([np.zeros(3), v]))

        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, look)
        depends = {self.time_ticket(), self.discrete_state_ticket(stopped)}
        self.DeclareVectorOutputPort("desired_pose", 7, calc_pose, depends)
        self.DeclareVectorOutputPort("desired_velocity", 6, calc_velocity, depends)


FEED_SIZE = 3


def axis_of(pose: Array) -> Array:
    """Return the x axis of a pose's frame, (3,), of its unit quaternion and position, (7,)."""
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

        depends = {along.ticket(), feed.ticket()}
        moves = {*depends, pose.ticket(), self.time_ticket()}
        self.DeclareVectorOutputPort("advanced_pose", POSE_SIZE, calc_pose, moves)
        self.DeclareVectorOutputPort("velocity", 6, calc_velocity, depends)


_WORLD: Final = RotationMatrix()


def compensate(pose: Array, compensation: Array) -> Array:
    """Return a pose, (7,), moved and turned about its own origin by a compensation, (6,), m, rad.

    The compensation is in the world's axes; the quaternion is the one of the two that is nearer to
    the pose's.
    """
    w, x, y, z, *position = pose.tolist()
    *moved, r, p, q = compensation.tolist()
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0 < length < math.inf:
        raise ParameterError("desired_pose", pose[:4].tolist(), "a quaternion other than zero")
    angle = math.sqrt(r * r + p * p + q * q)
    cosine = math.cos(angle / 2)
    scale = math.sin(angle / 2) / angle if angle > 0 else 0.5
    r, p, q = scale * r, scale * p, scale * q
    # Beyond half a turn the other one of the two quaternions is nearer to the pose's.
    length = math.copysign(length, cosine)
    turned = (
        (cosine * w - r * x - p * y - q * z) / length,
        (cosine * x + r * w + p * z - q * y) / length,
        (cosine * y - r * z + p * w + q * x) / length,
        (cosine * z + r * y - p * x + q * w) / length,
    )
    return np.array([*turned, *(a + b for a, b in zip(position, moved, strict=True))])


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

    ``share`` is what this arm takes of the compensation, negative for the arm with the hole, whose
    motion has the opposite effect; R_WH has the axes, by default the world's.
    """

    def __init__(self, share: float, R_WH: RotationMatrix = _WORLD) -> None:
        super().__init__()
        if not math.isfinite(share):
            raise ParameterError("share", share, "a finite number")
        pose = self.DeclareVectorInputPort("desired_pose", POSE_SIZE)
        compensation = self.DeclareVectorInputPort("compensation", 6)
        taken = share * np.kron(np.eye(2), R_WH.matrix())  # the share, in the world's axes

        def calc(context: Context, vector: BasicVector) -> None:
            share_taken = taken @ compensation.Eval(context)
            vector.SetFromVector(compensate(pose.Eval(context), share_taken))

        depends = {pose.ticket(), compensation.ticket()}
        self.DeclareVectorOutputPort("pose", POSE_SIZE, calc, depends)
