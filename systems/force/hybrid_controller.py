"""Hybrid position/force control as a block, and acceleration feedforward."""

import contextlib
import math

import numpy as np
from pydrake.systems.framework import Context, LeafSystem, System
from pydrake.systems.framework import State as DrakeState

from chamfer.models.arms.arm import Kinematics
from chamfer.models.validation import ParameterError, finite
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.force.hybrid_law import HybridControllerParams, HybridLaw
from chamfer.systems.law_block import LawBlock
from chamfer.systems.ports import require_ports


class HybridController(LawBlock[HybridLaw]):
    """Controls position in the domain P and force in the domain F = I - P.

    .. pydrake_system::

        name: HybridController
        input_ports:
        - encoders
        - desired_position
        - desired_force
        - measured_force
        - selection
        - mode
        - desired_velocity
        output_ports:
        - torque
        - position_error
        - force_error

    With endpoint x, Jacobian J and the projected error e = P (x_d - x), each period T computes

    * ``transpose`` (Fig. 2-1): ``I += Ki e T``, ``tau = J^T (Kp e + I - Kd P x')``
    * ``inverse`` (Fig. 2-2): ``e_q = J^-1 e``, ``I += Ki e_q T``,
      ``tau = Kp e_q + I - Kd J^-1 P x'``
    * ``projected``: the same with the pseudo-inverse ``(P J)^+`` in place of ``J^-1 P``. It is
      this project's: it moves the joints no more than the position domain needs, and removes the
      kinematic instability of the inverse law.
    * force: ``I_f += Kif F (F_d - F_m) T``, ``tau += J^T (F F_d + I_f - Kdf F x')``. The damping
      is this project's; the thesis has none (0). Without it the integral oscillates on a soft
      gripper, from Kif = b / m on for an arm of mass m and viscous friction b.

    Both integrators act after the selection. At a change of ``mode`` an offset torque absorbs the
    difference, except that of the force domain's damping, so that the torque does not jump
    (section 2.1.4).

    With ``desired_velocity`` connected the damping acts on the velocity error, ``P (x' - x_d')``
    in place of ``P x'``. A motion then lags only by its acceleration, not by ``Kd / Kp`` times its
    speed. Unconnected, as in the thesis, the damping acts on the velocity. The damping of the
    force domain always acts on the velocity.

    While contact is lost (mode 2) a velocity damping and an integral term replace the force
    integral: ``f = L d - B F x'``. Here d is the direction of F F_d. L integrates from 0 the
    difference to the creep speed, no faster than the ramp. The offset then makes the push start at
    0.

    With ``full_dynamics`` the law uses the model of (2-1). It divides its joint torque by the
    nominal ``inertia`` to a joint acceleration, multiplies that by the mass matrix, and adds
    Coriolis and gravity torques.

    Inputs:

    * ``encoders``, shape (2n,), q and velocity.
    * ``desired_position``, shape (m,), m (rad); ``desired_velocity``, shape (m,), m/s (rad/s).
    * ``desired_force`` and ``measured_force``, shape (m,), N, of the arm on its environment.
    * ``selection``, shape (m * m,), P row by row.
    * ``mode``, size 1, of :class:`chamfer.systems.force.contact_detection.ContactDetection`. A
      higher number is another contact, in which all position integrators are held. Otherwise the
      integrator of a joint that presses would push because of the others' errors.

    ``torque``, shape (n,), and the errors, desired minus measured, shape (m,), before the
    selection, are held over the period.

    Raises:
        ParameterError: If an input is not finite, P is no projection or, in contact, leaves the
            force no direction, or the arm reaches a singular pose.
    """

    def __init__(
        self,
        arm: Kinematics,
        params: HybridControllerParams,
        *,
        dynamics: ArmDynamics | None = None,
    ) -> None:
        known = None if dynamics is None else dynamics.evaluate
        super().__init__(HybridLaw(arm, params, dynamics=known))


def require_hybrid_ports(controller: System, arm: Kinematics) -> None:
    """Raise :class:`ParameterError` unless a system has :class:`HybridController`'s ports.

    It can do without ``desired_velocity``.
    """
    n, m = arm.num_joints, arm.num_coordinates
    inputs = {"encoders": 2 * n, "desired_position": m, "desired_force": m, "measured_force": m}
    require_ports(
        "controller",
        controller,
        inputs={**inputs, "selection": m * m, "mode": 1},
        outputs={"torque": n, "position_error": m, "force_error": m},
    )


class AccelerationFeedforward(LeafSystem):
    """Adds the torque for the desired acceleration, so that motions neither lag nor overshoot.

    .. pydrake_system::

        name: AccelerationFeedforward
        input_ports:
        - encoders
        - desired_acceleration
        - selection
        output_ports:
        - torque

    ``tau = M(q) J^-1 P x_d''`` as in the computed-torque law, with mass matrix M, or only its
    diagonal, Jacobian J and the position domain P. The feedback handles the term ``J' q'`` of a
    changing Jacobian. The block is separate from
    :class:`chamfer.systems.force.hybrid_controller.HybridController`, whose offset at a change of
    mode would keep the feedforward torque of that instant.

    ``encoders``, shape (2n,), is q and velocity; ``desired_acceleration``, shape (m,), m/s^2 and
    rad/s^2; ``selection``, shape (m * m,), is P row by row. ``torque``, shape (n,), N m or N, is
    held over the period, s.

    Raises:
        ParameterError: If the period is not positive; while running, if an input is not finite or
            the arm reaches a singular pose.
    """

    def __init__(
        self, arm: Kinematics, dynamics: ArmDynamics, *, period: float, diagonal: bool = False
    ) -> None:
        super().__init__()
        if not 0 < period < math.inf:
            raise ParameterError("period", period, "a finite number > 0")
        n, m = arm.num_joints, arm.num_coordinates
        encoders = self.DeclareVectorInputPort("encoders", 2 * n)
        desired = self.DeclareVectorInputPort("desired_acceleration", m)
        selection = self.DeclareVectorInputPort("selection", m * m)
        self.DeclareStateOutputPort("torque", self.DeclareDiscreteState(n))

        def tick(context: Context, state: DrakeState) -> None:
            acceleration, torque = desired.Eval(context), np.zeros(n)
            if np.any(acceleration):
                q, joints = encoders.Eval(context)[:n], np.full(n, np.nan)
                wanted = selection.Eval(context).reshape(m, m) @ acceleration
                with contextlib.suppress(np.linalg.LinAlgError):
                    joints = np.linalg.solve(arm.jacobian(q), wanted)
                mass = dynamics.evaluate(q, np.zeros(n)).mass
                torque = np.diag(mass) * joints if diagonal else mass @ joints
            state.get_mutable_discrete_state().set_value(0, finite("torque", torque))

        # Of the kind that the hybrid controller's are, so that both torques change at once.
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, tick)
