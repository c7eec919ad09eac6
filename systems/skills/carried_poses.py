"""What a carriage carries, as poses for the cameras that see it."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pydrake.common.eigen_geometry import AngleAxis
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from models.validation import ParameterError
from systems.pose import POSE_SIZE, pose_vector

Array = NDArray[np.float64]


def carriage_pose(displacement: Array) -> RigidTransform:
    """Return X_WE of a displacement: rotation vector, rad, above position, m, shape (6,)."""
    turn = np.asarray(displacement[:3], dtype=float)
    angle = float(np.linalg.norm(turn))
    if angle == 0.0:
        return RigidTransform(displacement[3:])
    R_WE = RotationMatrix(AngleAxis(angle=angle, axis=turn / angle))
    return RigidTransform(R_WE, displacement[3:])


class CarriedPoses(LeafSystem):
    """Gives the poses of what is fixed to a carriage.

    .. pydrake_system::

        name: CarriedPoses
        input_ports:
        - displacement
        output_ports:
        - (<name>_pose of each thing)

    ``displacement``, shape (6,), rad above m, is a rotation vector and a position, world frame:
    the integral of a velocity while the carriage turns about one axis, and nearly so for small
    turns. The poses are in the world, shape (7,): quaternion w, x, y, z and position in m.

    Args:
        carried: X_EB of each thing in the carriage's frame, by its name.

    Raises:
        ParameterError: If nothing is carried.
    """

    def __init__(self, carried: Mapping[str, RigidTransform]) -> None:
        super().__init__()
        if not carried:
            raise ParameterError("carried", dict(carried), "one thing or more")
        displacement = self.DeclareVectorInputPort("displacement", 6)

        def reader(X_EB: RigidTransform) -> Callable[[Context, BasicVector], None]:
            def calc(context: Context, vector: Any) -> None:
                X_WE = carriage_pose(displacement.Eval(context))
                vector.SetFromVector(pose_vector(X_WE @ X_EB))

            return calc

        for name, X_EB in carried.items():
            self.DeclareVectorOutputPort(
                f"{name}_pose", POSE_SIZE, reader(X_EB), {displacement.ticket()}
            )
