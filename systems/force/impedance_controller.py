"""Cartesian impedance control as a block, and the force of its springs."""

import math

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import ArmModel, Vector3
from chamfer.systems.force.impedance_law import ImpedanceControllerParams, ImpedanceLaw, KnownArm
from chamfer.systems.force.tool_pose import advance_of, spring_force
from chamfer.systems.law import Array
from chamfer.systems.law_block import LawBlock
from chamfer.systems.pose import POSE_SIZE


def make_impedance_law(
    model: ArmModel, posture: Array, params: ImpedanceControllerParams
) -> ImpedanceLaw:
    """Return the law of :class:`ImpedanceController`."""
    q = np.array(posture, dtype=np.float64)
    if q.shape != (model.arm.num_joints,) or not model.arm.within_limits(q):
        raise ParameterError("rest posture", tuple(q.tolist()), model.arm.ranges)

    def known(q: Array) -> KnownArm:
        X_WT, *rest = model.evaluate(q)
        return KnownArm(X_WT.GetAsMatrix34(), *rest)

    return ImpedanceLaw(known, q, params, limits=params.limits(model.arm.torque_limits))


class ImpedanceController(LawBlock[ImpedanceLaw]):
    """Makes the tool behave like a mass on springs and dampers at a desired pose, eq. (1).

    .. pydrake_system::

        name: ImpedanceController
        input_ports:
        - encoders
        - desired_pose
        - desired_velocity (optional)
        output_ports:
        - torque
        - tool_pose
        - saturated

    ``T = T_g(q) - J^T [K_p (x - x_d) + K_d (x' - x'_d)] + T_null``, once a period, with the
    controller's own model of the arm. Position and velocity errors are in the axes of the desired
    pose D. The orientation error is the rotation vector theta of R_DT, up to pi. The moment is the
    gradient of ``theta^T K theta / 2``, k theta for equal stiffnesses, so that the springs
    conserve energy. K_d is the :func:`~chamfer.systems.force.impedance_law.modal_damping` for the
    effective inertia ``Lambda = (J M^-1 J^T)^-1`` at the rest posture.

    The torque towards the rest posture, and the damping of the elbow's own motion, are projected
    into the null space that is consistent with the mass matrix. So they do not accelerate the
    tool. An arm with six joints has no null space. The law needs no inverse of the Jacobian, and
    the projection a regularised one. So in a singular pose the torque is finite and the tool is
    compliant according to eq. (1). Last, the torque is limited.

    Inputs and outputs for an arm with n joints:

    * ``encoders``, shape (2 n,), is q (rad) and velocity.
    * ``desired_pose``, shape (7,), is quaternion (w, x, y, z), of any length and sign, and
      position of the tool frame, m.
    * ``desired_velocity``, shape (6,), rad/s and m/s in the world's axes, is 0 if not connected.
    * ``torque``, shape (n,), N m.
    * ``tool_pose``, shape (7,), is the tool's pose in the model. The quaternion's sign does not
      jump (w >= 0 at the rest posture).
    * ``saturated``, shape (n,), is the sign of a torque that was limited, else 0.

    All outputs are held over the period; the first ones are those of the start. The model is the
    controller's knowledge of the arm; ``posture`` is the rest posture q, rad, shape (n,).

    Raises:
        ParameterError: At construction if the posture is outside the joints' ranges or too close
            to a singularity, or a mode is unstable at this period; in a run if an input is not
            finite or a quaternion is zero.
    """

    def __init__(self, model: ArmModel, posture: Array, params: ImpedanceControllerParams) -> None:
        # A MultibodyPlant with sampled outputs has made its step of the same instant before: no
        # step of delay gets into the loop.
        law = make_impedance_law(model, posture, params)
        super().__init__(law, updates="discrete", at_start=True)


class SpringForce(LeafSystem):
    """Computes the force of an arm's virtual springs, and its tool's depth in a hole.

    .. pydrake_system::

        name: SpringForce
        input_ports:
        - command
        - tool_pose
        - hole_pose
        output_ports:
        - force
        - advance

    ``command`` and ``tool_pose``, shape (7,), are the commanded pose and the encoders' pose of the
    arm. ``hole_pose`` is the hole's pose, from encoders or known. ``force``, shape (3,), N, is
    that of the springs on the tool along the hole's axes, ``K_p (x_d - x)`` of eq. (1) of Ruybal,
    Lumia and Wood. At rest it is the tool's pushing force, except for effects that the arm's model
    lacks (payload, the joints' dry friction); a tare removes these. ``advance``, m, is the tool's
    distance beyond the hole's mouth along its axis.

    ``stiffness``, N/m, is that of the springs along the axes of the commanded pose.
    """

    def __init__(self, stiffness: Vector3) -> None:
        super().__init__()
        if not all(0 < one < math.inf for one in stiffness):
            raise ParameterError("stiffness", stiffness, "finite numbers > 0")
        springs = np.array(stiffness)
        command, tool, hole = (
            self.DeclareVectorInputPort(name, POSE_SIZE)
            for name in ("command", "tool_pose", "hole_pose")
        )

        def calc_force(context: Context, vector: BasicVector) -> None:
            poses = (port.Eval(context) for port in (command, tool, hole))
            vector.SetFromVector(spring_force(springs, *poses))

        def calc_advance(context: Context, vector: BasicVector) -> None:
            vector[0] = advance_of(tool.Eval(context), hole.Eval(context))

        depends = {tool.ticket(), hole.ticket()}
        self.DeclareVectorOutputPort("force", 3, calc_force, {command.ticket(), *depends})
        self.DeclareVectorOutputPort("advance", 1, calc_advance, depends)
