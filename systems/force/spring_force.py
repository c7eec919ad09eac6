"""What an arm under impedance control knows of a contact: its encoders and its own springs."""

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.common.eigen_geometry import Quaternion
from pydrake.math import RotationMatrix
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.validation import ParameterError
from chamfer.systems.force.arm_model import Vector3
from chamfer.systems.pose import POSE_SIZE

Array = NDArray[np.float64]


class SpringForce(LeafSystem):
    """Reads the force of an arm's virtual springs, and how far its tool is beyond another one.

    .. pydrake_system::

        name: SpringForce
        input_ports:
        - command
        - tool_pose
        - hole_pose
        output_ports:
        - force
        - advance

    ``command`` and ``tool_pose``, shape (7,), are where the arm is told to be and where its
    encoders say that it is, ``hole_pose`` where the hole is, by encoders too, or by what is known.
    ``force``, shape (3,), N, is that of the springs on the tool along the hole's axes,
    ``K_p (x_d - x)`` of eq. (1) of Ruybal, Lumia and Wood: at rest it is what the tool pushes
    with, but for what the model of the arm lacks (payload, the joints' dry friction), which is to
    be tared. ``advance``, m, is how far the tool is beyond the hole's mouth along its axis.

    Args:
        stiffness: N/m, of the springs, along the axes of the commanded pose.
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
            desired, actual = command.Eval(context), tool.Eval(context)
            R_WD, R_WM = _rotation(desired), _rotation(hole.Eval(context))
            spring = springs * (R_WD.T @ (desired[4:] - actual[4:]))
            vector.SetFromVector(R_WM.T @ (R_WD @ spring))

        def calc_advance(context: Context, vector: BasicVector) -> None:
            mouth = hole.Eval(context)
            vector[0] = float(_rotation(mouth)[:, 0] @ (tool.Eval(context)[4:] - mouth[4:]))

        depends = {tool.ticket(), hole.ticket()}
        self.DeclareVectorOutputPort("force", 3, calc_force, {command.ticket(), *depends})
        self.DeclareVectorOutputPort("advance", 1, calc_advance, depends)


def _rotation(pose: Array) -> Array:
    quaternion = pose[:4] / np.linalg.norm(pose[:4])
    matrix: Array = RotationMatrix(Quaternion(quaternion)).matrix()
    return matrix
