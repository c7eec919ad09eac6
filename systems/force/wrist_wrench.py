"""The admittance of a position-controlled arm as a block, and what its wrist sensor feels."""

from typing import Final

import numpy as np
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.arms.wrist import SIZE, tip_axes
from chamfer.systems.force.contact_admittance import ContactAdmittanceLaw
from chamfer.systems.law_block import LawBlock

# X_TS, the axes of wrist and sensor at the peg's tip, z out of the hole.
WRIST_AXES: Final = RigidTransform(
    RotationMatrix(np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]))
)


class ContactAdmittance(LawBlock[ContactAdmittanceLaw]):
    """Moves an arm's reference pose away from its command as the force at its wrist asks for.

    .. pydrake_system::

        name: ContactAdmittance
        input_ports:
        - desired_pose
        - reading
        - tool_pose
        - tares
        output_ports:
        - reference_pose
        - force
        - advance

    ``M v' + D v + K x = F``, as :class:`chamfer.systems.force.admittance.AdmittanceController`
    with a command at rest, about and along the hole's axes. ``desired_pose``, ``tool_pose``, by
    the encoders, and ``reference_pose``, shape (7,), are quaternion w, x, y, z and position, m;
    ``reading``, shape (6,), N m above N, is the wrench on the tool about its tip in the sensor's
    axes. Taken off it are the tool's believed weight and the mean of what it read last while
    ``tares``, size 1, was 1; meanwhile the displacement x is taken back to 0 whatever it reads.

    ``force``, shape (3,), N, is what the tool pushes with along the hole's axes, and ``advance``,
    m, how far it is beyond the mouth by the encoders, as of
    :class:`chamfer.systems.force.impedance_controller.SpringForce`.

    The outputs follow the inputs at once; who samples them at the law's period gets what its step
    makes of them. Discrete states: velocity, command, 0, and displacement of the admittance, the
    zero and the count of its readings.
    """


class TurnedToSensor(LeafSystem):
    """Turns the true wrench in the springs into the axes of the sensor, which goes with the arm.

    .. pydrake_system::

        name: TurnedToSensor
        input_ports:
        - wrench
        - motion
        output_ports:
        - felt

    ``wrench`` and ``felt``, shape (6,), N m above N; ``motion``, shape (12,), is that of
    :class:`chamfer.systems.servo.joint_servo.JointServo`.
    """

    def __init__(self) -> None:
        super().__init__()
        wrench = self.DeclareVectorInputPort("wrench", SIZE)
        motion = self.DeclareVectorInputPort("motion", 2 * SIZE)

        def calc(context: Context, vector: BasicVector) -> None:
            R = tip_axes(*motion.Eval(context)[:3].tolist())
            vector.SetFromVector((wrench.Eval(context).reshape(2, 3) @ R).ravel())

        self.DeclareVectorOutputPort("felt", SIZE, calc, {wrench.ticket(), motion.ticket()})
