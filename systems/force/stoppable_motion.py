"""A straight motion of a tool from rest to rest, which can be told to stop."""

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State
from pydrake.trajectories import PiecewisePolynomial

from chamfer.models.validation import ParameterError
from chamfer.systems.pose import pose_vector

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

    Args:
        p_WT: Where the tool starts, m, shape (3,).
        goal: X_WT from ``duration`` on.
        duration: s.
        period: s, between two looks at ``stop``.
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
