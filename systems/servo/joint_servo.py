"""Joint servos of an arm that takes positions: the motion of its tool to a commanded pose."""

from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State, ValueProducer

from chamfer.models.arms.position_arm import ServoParams
from chamfer.models.arms.serial_arm import rotation_vector
from chamfer.models.arms.wrist import SIZE, tip_turns
from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import ArmModel
from chamfer.systems.force.tool_pose import axes_of
from chamfer.systems.pose import POSE_SIZE, pose_vector

Array = NDArray[np.float64]

_DAMPED: Final = 1e-3  # rad and m, of the inverse kinematics' least squares


class JointServo(LeafSystem):
    """Moves an arm's joints to commanded positions, whatever forces act on its tool.

    .. pydrake_system::

        name: JointServo
        input_ports:
        - reference_pose
        output_ports:
        - tool_pose
        - encoders
        - saturated
        - motion

    Once a period of the servos the block turns the tool's reference pose into joint positions, by
    a step of Newton's method with damped least squares from the last ones. They arrive whole
    samples later, and are held. Each joint follows as a critically damped second-order system,

        q'' = w^2 (q_cmd - q) - 2 w q',

    exact for a held command, with rate and acceleration limited. An arm with fewer than six joints
    comes as near to the pose as it can.

    The input ``reference_pose``, shape (7,), is quaternion w, x, y, z and position, m, of the
    tool's frame with its springs not deflected. The outputs of n joints:

    - ``tool_pose``, shape (7,), the pose of this frame by the encoders;
    - ``encoders``, shape (2 n,), rad and rad/s, or m;
    - ``saturated``, shape (n,), 1 where a joint is at its limit of rate, acceleration or range;
    - ``motion``, shape (12,), the true displacement of the frame from ``rest``, rad above m, in
      the axes of rest, and its rate, for the plant alone.

    Discrete state: q and its rate, the commands on their way, and the saturated joints.

    Args:
        params: The servos.
        model: The controller's model of the arm.
        posture: Initial joint positions, shape (n,).
        step: s, of the plant; the servos' period is a multiple of it.
        rest: X_WS, from which the motion is measured.
        X_TS: Pose of that frame in the tool's.
        true: Turns a believed pose in the world into the true one.

    Raises:
        ParameterError: During a run, if the reference pose is not finite.
    """

    def __init__(
        self,
        params: ServoParams,
        model: ArmModel,
        posture: Array,
        *,
        step: float,
        rest: RigidTransform,
        X_TS: RigidTransform,
        true: RigidTransform,
    ) -> None:
        super().__init__()
        n = len(posture)
        self._params, self._model, self._step = params, model, step
        self._steps = round(params.period / step)
        self._lower, self._upper = map(np.array, (model.arm.lower_limits, model.arm.upper_limits))
        to_rest = rest.inverse() @ true
        self._turned, self._shift = to_rest.rotation().matrix(), to_rest.translation()
        self._R_TS, self._p_TS = X_TS.rotation().matrix(), X_TS.translation()
        self._damped = _DAMPED**2 * np.eye(n)
        self._reference = self.DeclareVectorInputPort("reference_pose", POSE_SIZE)
        self._joints = self.DeclareDiscreteState(np.concatenate([posture, np.zeros(n)]))
        self._commands = self.DeclareDiscreteState(np.tile(posture, params.delay + 1))
        self._saturated = self.DeclareDiscreteState(n)
        moves = {self.discrete_state_ticket(self._joints)}
        place = ValueProducer(lambda: Value[object](), self._calc_place)
        self._place = self.DeclareCacheEntry("pose and Jacobian", place, moves)
        self.DeclareVectorOutputPort("tool_pose", POSE_SIZE, self._calc_pose, moves)
        self.DeclareStateOutputPort("encoders", self._joints)
        self.DeclareStateOutputPort("saturated", self._saturated)
        self.DeclareVectorOutputPort("motion", 2 * SIZE, self._calc_motion, moves)
        # As a plant with sampled outputs steps: what its springs show is of one instant.
        self.DeclarePeriodicUnrestrictedUpdateEvent(step, 0.0, self._update)

    def _calc_place(self, context: Context, value: AbstractValue) -> None:
        value.set_value(self._model.kinematics(self._values(context, self._joints)[0]))

    def _calc_pose(self, context: Context, vector: BasicVector) -> None:
        vector.SetFromVector(pose_vector(self._place.Eval(context)[0]))

    def _calc_motion(self, context: Context, vector: BasicVector) -> None:
        X_WT, J = self._place.Eval(context)
        rate = (J @ self._values(context, self._joints)[1]).reshape(2, 3) @ self._turned.T
        R_WT = X_WT.rotation().matrix()
        place = self._turned @ (X_WT.translation() + R_WT @ self._p_TS) + self._shift
        turns = tip_turns(self._turned @ R_WT @ self._R_TS)
        vector.SetFromVector(np.concatenate([turns, place, rate.ravel()]))

    def _values(self, context: Context, group: int) -> Array:
        values: Array = context.get_discrete_state(group).value()
        return values.reshape(-1, len(self._lower))

    def _update(self, context: Context, changed: State) -> None:
        params, h, values = self._params, self._step, changed.get_mutable_discrete_state()
        (q, v), commands = (self._values(context, one) for one in (self._joints, self._commands))
        if round(context.get_time() / h) % self._steps == 0:
            commands = np.vstack([commands[1:], self._inverse(context, commands[-1])])
            values.set_value(self._commands, commands.ravel())
        w, lack = params.frequency, q - commands[0]
        decay, pull = np.exp(-w * h), v + w * lack
        wanted = (v - h * w * pull) * decay
        most = params.acceleration * h
        rate = np.minimum(np.maximum(wanted, v - most), v + most)
        rate = np.minimum(np.maximum(rate, -params.velocity), params.velocity)
        limited = rate != wanted
        after = np.where(limited, q + h * (v + rate) / 2, commands[0] + (lack + h * pull) * decay)
        inside = np.minimum(np.maximum(after, self._lower), self._upper)
        at_end = (commands[0] <= self._lower) | (commands[0] >= self._upper)
        rate[inside != after] = 0.0
        values.set_value(self._joints, np.concatenate([inside, rate]))
        values.set_value(self._saturated, (limited | at_end).astype(np.float64))

    def _inverse(self, context: Context, near: Array) -> Array:
        """Return the joint positions of the reference pose, from those of the last one."""
        pose = self._reference.Eval(context)
        if not np.isfinite(pose).all():
            at = f"reference pose of the arm at {context.get_time():.6g} s"
            raise ParameterError(at, pose.tolist(), "finite numbers")
        X_WT, J = self._model.kinematics(near)
        turn = rotation_vector(axes_of(pose) @ X_WT.rotation().matrix().T)
        error = np.concatenate([turn, pose[4:] - X_WT.translation()])
        damped = J.T @ J + self._damped
        found: Array = near + np.linalg.solve(damped, J.T @ error)
        inside: Array = np.minimum(np.maximum(found, self._lower), self._upper)
        return inside
