"""The torque that a desired acceleration asks of an arm whose model is known."""

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import Context, LeafSystem
from pydrake.systems.framework import State as DrakeState

from chamfer.models.arms.arm import Kinematics
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.arm_dynamics import ArmDynamics

Array = NDArray[np.float64]


class AccelerationFeedforward(LeafSystem):
    """Adds what the inertia takes, so that a motion neither lags nor overshoots as it speeds up.

    .. pydrake_system::

        name: AccelerationFeedforward
        input_ports:
        - encoders
        - desired_acceleration
        - selection
        output_ports:
        - torque

    ``tau = M(q) J^-1 P x_d''``, with mass matrix M, Jacobian J and the position domain P, as the
    computed-torque law has it; what a turning Jacobian adds, ``J' q'``, is left to the feedback.
    It is apart from :class:`chamfer.systems.force.hybrid_controller.HybridController`, whose
    offset at a change of mode would keep what is accelerated with at that instant.

    ``encoders``, shape (2n,), q and velocity; ``desired_acceleration``, shape (m,), m/s^2 and
    rad/s^2; ``selection``, shape (m * m,), P row by row. ``torque``, shape (n,), N m or N, is held
    over the period.

    Args:
        arm: Its kinematics, m = n.
        dynamics: Its equations of motion.
        period: s, of the computer.

    Raises:
        ParameterError: If the period is not positive; while running, if an input is not finite or
            the arm comes to a singular pose.
    """

    def __init__(self, arm: Kinematics, dynamics: ArmDynamics, *, period: float) -> None:
        super().__init__()
        if not 0 < period < math.inf:
            raise ParameterError("period", period, "a finite number > 0")
        n, m = arm.num_joints, arm.num_coordinates
        self._arm, self._dynamics = arm, dynamics
        self._encoders = self.DeclareVectorInputPort("encoders", 2 * n)
        self._acceleration = self.DeclareVectorInputPort("desired_acceleration", m)
        self._selection = self.DeclareVectorInputPort("selection", m * m)
        self.DeclareStateOutputPort("torque", self.DeclareDiscreteState(n))
        # Of the kind that the hybrid controller's are, so that both torques change at once.
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._tick)

    def _tick(self, context: Context, state: DrakeState) -> None:
        acceleration = self._acceleration.Eval(context)
        torque = np.zeros(self._arm.num_joints)
        if np.any(acceleration):
            q = self._encoders.Eval(context)[: len(torque)]
            P = self._selection.Eval(context).reshape(len(acceleration), -1)
            torque = self._torque(q, P @ acceleration)
        state.get_mutable_discrete_state().set_value(0, torque)

    def _torque(self, q: Array, acceleration: Array) -> Array:
        try:
            joints = np.linalg.solve(self._arm.jacobian(q), acceleration)
        except np.linalg.LinAlgError:
            joints = np.full(len(q), np.nan)
        torque: Array = self._dynamics.evaluate(q, np.zeros(len(q))).mass @ joints
        if not all(map(math.isfinite, torque.tolist())):
            raise ParameterError("torque", torque.tolist(), "finite numbers")
        return torque
