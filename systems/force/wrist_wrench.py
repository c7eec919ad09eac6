"""The admittance of a position-controlled arm as a block, and its wrist sensor's load."""

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
    """Offsets an arm's reference pose from its command by the force at its wrist.

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

    ``M v' + D v + K x = F``, like :class:`chamfer.systems.force.admittance.AdmittanceController`
    with a command at rest, about and along the hole's axes.

    * ``desired_pose``, ``tool_pose``, from the encoders, and ``reference_pose``, shape (7,), are
      quaternion w, x, y, z and position, m.
    * ``reading``, shape (6,), N m above N, is the wrench on the tool about its tip in the sensor's
      axes. The law subtracts the tool's believed weight and the last tare.
    * ``tares``, size 1, is 1 during a tare: the law averages the readings, and returns the
      displacement x to 0 whatever the reading is.
    * ``force``, shape (3,), N, is the tool's pushing force along the hole's axes.
    * ``advance``, m, is its distance beyond the mouth by the encoders. Both are as in
      :class:`chamfer.systems.force.impedance_controller.SpringForce`.

    The outputs follow the inputs directly; sampled at the law's period they are the results of its
    step. Discrete states: velocity, command, 0, and displacement of the admittance, the zero and
    the count of its readings.
    """


class TurnedToSensor(LeafSystem):
    """Expresses the true wrench in the springs in the axes of the sensor, which moves along.

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
