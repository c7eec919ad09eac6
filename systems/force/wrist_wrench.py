"""The wrench at a position-controlled arm's wrist, as the controller makes it of its sensor."""

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.arms.wrist import SIZE, tip_pose
from chamfer.systems.force.contact_admittance import ContactAdmittanceLaw
from chamfer.systems.force.tool_pose import advance_of, axes_of
from chamfer.systems.law_block import LawBlock
from chamfer.systems.pose import POSE_SIZE

Array = NDArray[np.float64]

GRAVITY = np.array([0.0, 0.0, -9.81])  # m/s^2, in the world


class ContactAdmittance(LawBlock[ContactAdmittanceLaw]):
    """Moves an arm's reference pose away from its command as a wrench asks for.

    .. pydrake_system::

        name: ContactAdmittance
        input_ports:
        - desired_pose
        - wrench
        - recentres
        output_ports:
        - reference_pose

    ``M v' + D v + K x = F``, as :class:`chamfer.systems.force.admittance.AdmittanceController`
    with a command at rest, about and along the hole's axes, R_WH. ``desired_pose`` and
    ``reference_pose``, shape (7,), are quaternion w, x, y, z and position, m; ``wrench``, shape
    (6,), N m above N, is that on the tool at its tip, in the hole's axes. While ``recentres``,
    size 1, is 1, the displacement is taken back whatever the wrench is. The reference pose follows
    the inputs at once; who samples it at the law's period gets what its step makes of them.

    Discrete state: the velocity, the command, 0, and the displacement.
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
            R = tip_pose(motion.Eval(context)[:SIZE]).rotation().matrix()
            vector.SetFromVector((wrench.Eval(context).reshape(2, 3) @ R).ravel())

        self.DeclareVectorOutputPort("felt", SIZE, calc, {wrench.ticket(), motion.ticket()})


class WristWrench(LeafSystem):
    """Turns a wrist sensor's wrench into the hole's axes, less the tool's believed weight.

    .. pydrake_system::

        name: WristWrench
        input_ports:
        - reading
        - tool_pose
        output_ports:
        - wrench

    ``reading`` and ``wrench``, shape (6,), N m above N, are those on the tool about its tip;
    ``tool_pose``, shape (7,), is by the encoders. The sensor's axes are R_TS in the tool's frame
    T, the hole's R_WH; the tool is believed to have a mass, kg, with its centre at p_TC, m.
    """

    def __init__(
        self, *, R_TS: RotationMatrix, R_WH: RotationMatrix, mass: float, p_TC: Array
    ) -> None:
        super().__init__()
        reading = self.DeclareVectorInputPort("reading", SIZE)
        pose = self.DeclareVectorInputPort("tool_pose", POSE_SIZE)
        to_tool, to_hole, weight = R_TS.matrix().T, R_WH.matrix(), mass * GRAVITY

        def calc(context: Context, vector: BasicVector) -> None:
            R_WT = axes_of(pose.Eval(context))
            wrench = reading.Eval(context).reshape(2, 3) @ to_tool @ R_WT.T
            wrench[0] -= _cross(R_WT @ p_TC, weight)
            wrench[1] -= weight
            vector.SetFromVector((wrench @ to_hole).ravel())

        self.DeclareVectorOutputPort("wrench", SIZE, calc, {reading.ticket(), pose.ticket()})


class SensedPush(LeafSystem):
    """Reads what an arm pushes with, and how far its tool is beyond the mouth, off its sensors.

    .. pydrake_system::

        name: SensedPush
        input_ports:
        - wrench
        - tool_pose
        - hole_pose
        output_ports:
        - force
        - advance

    The outputs are those of :class:`chamfer.systems.force.impedance_controller.SpringForce`:
    ``force``, shape (3,), N, of the tool on what it touches, along the hole's axes, the opposite
    of the ``wrench``'s, shape (6,), N m above N; ``advance``, m, by the encoders.
    """

    def __init__(self) -> None:
        super().__init__()
        wrench = self.DeclareVectorInputPort("wrench", SIZE)
        tool, hole = (
            self.DeclareVectorInputPort(name, POSE_SIZE) for name in ("tool_pose", "hole_pose")
        )

        def calc_force(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(-wrench.Eval(context)[3:])

        def calc_advance(context: Context, vector: BasicVector) -> None:
            vector[0] = advance_of(tool.Eval(context), hole.Eval(context))

        self.DeclareVectorOutputPort("force", 3, calc_force, {wrench.ticket()})
        self.DeclareVectorOutputPort("advance", 1, calc_advance, {tool.ticket(), hole.ticket()})


def _cross(a: Array, b: Array) -> Array:
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def wrist_axes() -> RigidTransform:
    """Return X_TS, the axes of wrist and sensor at the peg's tip, z out of the hole."""
    return RigidTransform(
        RotationMatrix(np.array([[0.0, 0.0, -1.0], [0.0, 1.0, 0.0], [1.0, 0.0, 0.0]]))
    )
