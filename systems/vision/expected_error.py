"""What the cameras should see of a commanded motion."""

from typing import Final

import numpy as np
from pydrake.math import RotationMatrix
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.part_poses import PosePorts
from chamfer.systems.vision.image_plane_error import AXES

_WORLD: Final = RotationMatrix()


class ExpectedError(LeafSystem):
    """The alignment error that remains, on purpose, at a point of a trajectory.

    .. pydrake_system::

        name: ExpectedError
        input_ports:
        - peg_pose
        - hole_pose
        output_ports:
        - expected_error

    The poses, shape (7,), are those that are commanded, before any compensation;
    ``expected_error``, shape (6,), is what
    :class:`chamfer.systems.vision.cell_error.CellError` subtracts: from peg to hole, pixels along
    and rad about axes H, x into the hole. Pixels need the images' scale only, which the eye can
    measure on the parts.

    Args:
        pixel_size: m.
        gap: pixels, that count as no error along X.
        R_WH: The axes; by default the world's.
    """

    def __init__(self, *, pixel_size: float, gap: float, R_WH: RotationMatrix = _WORLD) -> None:
        super().__init__()
        if not 0 < pixel_size < np.inf:
            raise ParameterError("pixel_size", pixel_size, "a finite number > 0")
        poses = PosePorts(self)
        R_HW = R_WH.matrix().T

        def calc(context: Context, vector: BasicVector) -> None:
            X_WT, X_WM = poses.read(context)
            if X_WT is None or X_WM is None:
                raise ParameterError("peg_pose and hole_pose", None, "both connected")
            moved = R_HW @ (X_WM.translation() - X_WT.translation()) / pixel_size
            moved[0] -= gap
            turn = RotationMatrix(X_WM.rotation() @ X_WT.rotation().inverse()).ToAngleAxis()
            error = np.concatenate([moved, turn.angle() * (R_HW @ turn.axis())])
            error[AXES.index("roll")] = 0.0
            vector.SetFromVector(error)

        self.DeclareVectorOutputPort("expected_error", len(AXES), calc, poses.tickets())
