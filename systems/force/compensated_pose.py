"""A commanded pose with a compensation of six degrees of freedom (Fig. 1 and Fig. 14)."""

import math

import numpy as np
from numpy.typing import NDArray
from pydrake.common.eigen_geometry import AngleAxis, Quaternion
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from models.validation import ParameterError

Array = NDArray[np.float64]

POSE_SIZE = 7


def compensate(pose: Array, compensation: Array) -> Array:
    """Return a pose moved and turned about its own origin.

    Args:
        pose: Quaternion w, x, y, z and position, m, shape (7,).
        compensation: Displacement, m, and rotation vector, rad, in the world's axes, shape (6,).

    Returns:
        Shape (7,); the quaternion is the one of the two that is nearer to the pose's.
    """
    angle = float(np.linalg.norm(compensation[3:]))
    axis = compensation[3:] / angle if angle > 0 else np.array([1.0, 0.0, 0.0])
    turned = (AngleAxis(angle, axis).quaternion().multiply(Quaternion(_unit(pose[:4])))).wxyz()
    if turned @ pose[:4] < 0:
        turned = -turned
    return np.concatenate([turned, pose[4:] + compensation[:3]])


def _unit(quaternion: Array) -> Array:
    length = float(np.linalg.norm(quaternion))
    if not 0 < length < math.inf:
        raise ParameterError("desired_pose", quaternion.tolist(), "a quaternion other than zero")
    scaled: Array = quaternion / length
    return scaled


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
    ``compensation``, shape (6,), is a displacement, m, and a rotation vector, rad, in the world's
    axes.

    Args:
        share: Of the compensation that this arm takes; negative for the arm with the hole, whose
            motion has the opposite effect.
    """

    def __init__(self, share: float) -> None:
        super().__init__()
        if not math.isfinite(share):
            raise ParameterError("share", share, "a finite number")
        pose = self.DeclareVectorInputPort("desired_pose", POSE_SIZE)
        compensation = self.DeclareVectorInputPort("compensation", 6)

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(
                compensate(pose.Eval(context), share * compensation.Eval(context))
            )

        self.DeclareVectorOutputPort(
            "pose", POSE_SIZE, calc, {pose.ticket(), compensation.ticket()}
        )
