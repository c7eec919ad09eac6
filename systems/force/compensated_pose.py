"""A commanded pose with a compensation of six degrees of freedom (Fig. 1 and Fig. 14)."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RotationMatrix
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.validation import ParameterError
from chamfer.systems.pose import POSE_SIZE

Array = NDArray[np.float64]

_WORLD: Final = RotationMatrix()


def compensate(pose: Array, compensation: Array) -> Array:
    """Return a pose moved and turned about its own origin.

    Args:
        pose: Quaternion w, x, y, z and position, m, shape (7,).
        compensation: Displacement, m, and rotation vector, rad, in the world's axes, shape (6,).

    Returns:
        Shape (7,); the quaternion is the one of the two that is nearer to the pose's.
    """
    w, x, y, z, *position = pose.tolist()
    *moved, r, p, q = compensation.tolist()
    length = math.sqrt(w * w + x * x + y * y + z * z)
    if not 0 < length < math.inf:
        raise ParameterError("desired_pose", pose[:4].tolist(), "a quaternion other than zero")
    angle = math.sqrt(r * r + p * p + q * q)
    cosine = math.cos(angle / 2)
    scale = math.sin(angle / 2) / angle if angle > 0 else 0.5
    r, p, q = scale * r, scale * p, scale * q
    # Beyond half a turn the other one of the two quaternions is nearer to the pose's.
    length = math.copysign(length, cosine)
    turned = (
        (cosine * w - r * x - p * y - q * z) / length,
        (cosine * x + r * w + p * z - q * y) / length,
        (cosine * y - r * z + p * w + q * x) / length,
        (cosine * z + r * y - p * x + q * w) / length,
    )
    return np.array([*turned, *(a + b for a, b in zip(position, moved, strict=True))])


class CompensatedPose(LeafSystem):
    """Adds a share of the compensation to a desired pose.

    .. pydrake_system::

        name: CompensatedPose
        input_ports:
        - desired_pose
        - compensation
        output_ports:
        - pose

    ``desired_pose`` and ``pose``, shape (7,), are quaternion w, x, y, z and position, m;
    ``compensation``, shape (6,), is a displacement, m, and a rotation vector, rad, in axes H.

    Args:
        share: Of the compensation that this arm takes; negative for the arm with the hole, whose
            motion has the opposite effect.
        R_WH: The axes; by default the world's.
    """

    def __init__(self, share: float, R_WH: RotationMatrix = _WORLD) -> None:
        super().__init__()
        if not math.isfinite(share):
            raise ParameterError("share", share, "a finite number")
        pose = self.DeclareVectorInputPort("desired_pose", POSE_SIZE)
        compensation = self.DeclareVectorInputPort("compensation", 6)
        taken = share * np.kron(np.eye(2), R_WH.matrix())  # the share, in the world's axes

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(
                compensate(pose.Eval(context), taken @ compensation.Eval(context))
            )

        self.DeclareVectorOutputPort(
            "pose", POSE_SIZE, calc, {pose.ticket(), compensation.ticket()}
        )
