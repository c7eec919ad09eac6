"""Measures the peg's displacement to the hole with a camera in the hand."""

import math
from typing import Final

import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.systems.sensors import ImageRgba8U

from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.camera_image import read_image
from chamfer.systems.cameras.hand_camera import HandMount
from chamfer.systems.pose import POSE_SIZE, pose_from_vector
from chamfer.systems.vision.cell_error import AXES
from chamfer.systems.vision.mouth_detector import MouthParams, detect_mouth
from chamfer.systems.vision.mouth_pose import Look, hole_pose, rims

_HIDDEN: Final = 0.85  # of the gap: from there on the peg may hide a part of the mouth
_LOOKS: Final = 0.35  # likewise: until there it is looked for
_SURE: Final = np.array([2.5e-4] * 3 + [0.01] * 2)  # m and rad, standard deviations, at most


class HandSight(LeafSystem):
    """Measures the displacement from the peg's tip to the mouth with a camera next to the peg.

    .. pydrake_system::

        name: HandSight
        input_ports:
        - image
        - tool_pose
        output_ports:
        - alignment_error
        - hidden
        - looks

    The input ``tool_pose``, shape (7,), is the peg's pose by its arm's encoders. It gives the axes
    of the error, and the region in which the block searches the mouth. Outputs:

    - ``alignment_error``, shape (6,): that of
      :class:`~chamfer.systems.vision.cell_error.CellError`. It is NaN where no mouth was found, or
      where its pose is not sure, with the camera's calibration error included.
    - ``hidden``, size 1: 1 where the peg is so near the expected mouth that it may hide a part.
    - ``looks``: 0 where the peg is so near that the camera takes no more images.

    Args:
        parts: The believed peg and hole.
        mount: The camera, with no field left open.
        gap: m, at which it sees the whole mouth.
        X_WM: The believed pose of the hole.
        pixel_size: m, of a pixel of the error.
    """

    def __init__(
        self,
        parts: ColouredParts,
        mount: HandMount,
        *,
        gap: float,
        X_WM: RigidTransform,
        pixel_size: float,
    ) -> None:
        super().__init__()
        camera, circles = mount.camera(gap), rims(parts.hole)
        params = MouthParams(reach=1.5 * mount.reach)
        image = self.DeclareAbstractInputPort("image", Value(ImageRgba8U()))
        tool = self.DeclareVectorInputPort("tool_pose", POSE_SIZE)
        R_WH = X_WM.rotation()
        # In the camera's axes, as what it is off is.
        straight, covariance = camera.straight(), mount.covariance

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(np.full(len(AXES), math.nan))
            picture = read_image(image.Eval(context))
            if picture is None:
                return
            X_WT = pose_from_vector(tool.Eval(context))
            mouth = detect_mouth(picture, camera, X_WT.InvertAndCompose(X_WM), circles, params)
            if mouth.pose is None:
                return
            look = Look(straight, mouth.seen)
            pose = hole_pose([look], mouth.pose.X_WM, hand_eye=covariance)
            if pose is None or (np.sqrt(np.diag(pose.covariance)) > _SURE).any():
                return
            R_HT = R_WH.inverse() @ X_WT.rotation()
            turn = (R_HT @ pose.X_WM.rotation() @ R_HT.inverse()).ToAngleAxis()
            moved = R_HT @ pose.X_WM.translation() / pixel_size
            vector.SetFromVector(np.concatenate([moved, turn.angle() * turn.axis()]))

        def is_nearer(context: Context, share: float) -> bool:
            p_MT = X_WM.inverse() @ pose_from_vector(tool.Eval(context)).translation()
            return bool(p_MT[0] > -share * gap)

        def calc_hidden(context: Context, vector: BasicVector) -> None:
            vector[0] = float(is_nearer(context, _HIDDEN))

        def calc_looks(context: Context, vector: BasicVector) -> None:
            vector[0] = float(not is_nearer(context, _LOOKS))

        # Once an image: a pose that changes since tells nothing new of it.
        self.DeclareVectorOutputPort("alignment_error", len(AXES), calc, {image.ticket()})
        self.DeclareVectorOutputPort("hidden", 1, calc_hidden, {tool.ticket()})
        self.DeclareVectorOutputPort("looks", 1, calc_looks, {tool.ticket()})
