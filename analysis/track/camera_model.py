"""Calibrated cameras for recordings, from a ``camera.yaml``."""

from pathlib import Path

import numpy as np

from chamfer.analysis.scenario.errors import UserError
from chamfer.models.cameras.camera import Camera
from chamfer.models.cameras.camera_file import CalibratedCamera, FramePose, read_camera
from chamfer.models.validation import ParameterError

_LEFT = FramePose(rotation_vector=(0.0, 0.0, 0.0), translation=(0.0, 0.0, 0.0))


def read_cameras(path: Path, number: int) -> tuple[Camera, ...]:
    """Return the left camera of a file, or both, in the left one's frame.

    Args:
        path: Of the file.
        number: Of the cameras that are needed, 1 or 2.

    Raises:
        UserError: If the file can't be read, or has only one camera of the two.
    """
    try:
        file = read_camera(path)
        cameras = [_placed(file.left, _LEFT)]
        if number == 2:
            if file.right is None or file.pose is None:
                raise UserError(
                    f"{path} holds one camera, allowed with --right: a file of two, with right "
                    "and pose"
                )
            cameras.append(_placed(file.right, file.pose.value))
    except ParameterError as error:
        raise UserError(str(error)) from error
    return tuple(cameras)


def _placed(camera: CalibratedCamera, pose: FramePose) -> Camera:
    return Camera(
        width=camera.width,
        height=camera.height,
        focal=camera.focal_length,
        centre=camera.principal_point,
        R_WC=pose.rotation,
        p_WC=np.array(pose.translation),
        distortion=camera.distortion,
    )
