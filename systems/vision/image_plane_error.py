"""From what two cameras see to an uncalibrated error of all six degrees of freedom (section 4)."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.systems.vision.part_detector import ERROR_SIZE

Array = NDArray[np.float64]

AXES: Final = ("x", "y", "z", "roll", "pitch", "yaw")  # world axes, turns about X, Y and Z


def image_plane_error(xz: Array, xy: Array) -> Array:
    """Return the error of all six axes from those that two cameras see, shape (6,).

    Args:
        xz: Of the camera that looks along Y, shape (3,): along, across and the angle.
        xy: Of the one that looks down, shape (3,).
    """
    along, down, pitch = xz.tolist()
    _, aside, yaw = xy.tolist()
    roll = 0.0 if math.isfinite(pitch) else math.nan
    # Down in the images is -Z and -Y; from right to down is a turn about +Y and about -Z.
    return np.array([along, -aside, -down, roll, pitch, -yaw])


class ImagePlaneError(LeafSystem):
    """The way of the peg in pixels and image-plane angles, from one camera for each plane.

    .. pydrake_system::

        name: ImagePlaneError
        input_ports:
        - xz_error
        - xy_error
        output_ports:
        - alignment_error

    The inputs are :func:`chamfer.systems.vision.part_detector.alignment_error` of the camera that
    looks along Y and of the one that looks down, shape (3,), with X to the right in both images.
    Nothing is calibrated: ``alignment_error``, shape (6,), desired minus actual, has pixels along
    X, Y and Z and rad about them (:data:`AXES`); parts of revolution need no turn about X. The
    distance along X is that of the first camera. What was not measured is NaN.
    """

    def __init__(self) -> None:
        super().__init__()
        xz, xy = (
            self.DeclareVectorInputPort(name, ERROR_SIZE) for name in ("xz_error", "xy_error")
        )

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(image_plane_error(xz.Eval(context), xy.Eval(context)))

        self.DeclareVectorOutputPort(
            "alignment_error", len(AXES), calc, {xz.ticket(), xy.ticket()}
        )
