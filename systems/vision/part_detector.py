"""The block that finds the parts in a camera's images, and the alignment error in an image."""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.systems.sensors import ImageRgba8U

from systems.vision.camera_image import Image, read_image
from systems.vision.part_detection import Detection, Status, detect_parts

Array = NDArray[np.float64]

DETECTIONS_SIZE: Final = 12  # six of the peg, then six of the hole part
ERROR_SIZE: Final = 3


def pack_detections(peg: Detection, hole: Detection) -> Array:
    """Return two detections as a vector, shape (12,).

    Of the peg, then of the hole part: status (the number of :class:`Status`), u and v of the
    tip in pixels, the axis' angle in rad, u and v of a point on the axis in pixels.
    """
    values = [(part.status, *part.tip, part.angle, *part.point) for part in (peg, hole)]
    return np.array(values, dtype=float).ravel()


def unpack_detections(detections: Array) -> tuple[Detection, Detection]:
    """Return the detections of peg and hole part that :func:`pack_detections` put together."""
    peg, hole = (
        Detection(status=Status(int(s)), tip=(tu, tv), angle=angle, point=(pu, pv))
        for s, tu, tv, angle, pu, pv in np.reshape(detections, (2, 6)).tolist()
    )
    return peg, hole


def alignment_error(peg: Detection, hole: Detection) -> Array:
    """Return how the peg would have to move in one image, uncalibrated, shape (3,).

    Desired minus actual: along the hole's axis to bring the tip into the mouth, pixels; across it
    to bring the tip onto the axis, pixels, positive to the right of the way into the hole (for a
    hole on the right: down); the angle to turn, rad, positive from u to v.

    What is not known is NaN. Where the tip is hidden but the peg's axis is seen, ``along`` is not
    known and ``across`` is measured where the axis passes the mouth.
    """
    cos, sin = math.cos(hole.angle), math.sin(hole.angle)
    mouth = np.array(hole.tip)
    angle = hole.angle - peg.angle
    if peg.status == Status.OCCLUDED:
        start = np.array(peg.point)
        way = np.array([math.cos(peg.angle), math.sin(peg.angle)])
        gap = mouth - start
        gap = gap - way * (gap @ [cos, sin]) / math.cos(angle)
        return np.array([math.nan, gap @ [-sin, cos], angle])
    on_axis = np.array(hole.point)
    along = (mouth - peg.tip) @ [cos, sin]
    return np.array([along, (on_axis - peg.tip) @ [-sin, cos], angle])


class PartDetector(LeafSystem):
    """Finds the peg and the hole part in an image.

    .. pydrake_system::

        name: PartDetector
        input_ports:
        - image
        output_ports:
        - detections
        - alignment_error

    ``detections``, shape (12,), is laid out as in :func:`pack_detections`; ``alignment_error``,
    shape (3,), is that of :func:`alignment_error`. Both follow the image, so that they are as old
    as it is, and hold nothing back: what is not found in this image is NaN, with the reason in the
    status.
    """

    def __init__(self, width: int = 320, height: int = 240) -> None:
        super().__init__()
        # Of the last image that was looked at: whatever updates a state anywhere in a diagram
        # makes Drake ask again, and detection is the dearest part of the loop.
        self._seen: tuple[Image, Array] | None = None
        self._image = self.DeclareAbstractInputPort("image", Value(ImageRgba8U(width, height, 0)))
        depends = {self._image.ticket()}
        self._detections = self.DeclareVectorOutputPort(
            "detections", DETECTIONS_SIZE, self._calc_detections, depends
        )
        self.DeclareVectorOutputPort("alignment_error", ERROR_SIZE, self._calc_error, depends)

    def _calc_detections(self, context: Context, output: BasicVector) -> None:
        rgb = read_image(self._image.Eval(context))
        if rgb is None:
            nothing = Detection(status=Status.NO_IMAGE)
            output.SetFromVector(pack_detections(nothing, nothing))
            return
        if self._seen is None or not np.array_equal(self._seen[0], rgb):
            self._seen = rgb, pack_detections(*detect_parts(rgb))
        output.SetFromVector(self._seen[1])

    def _calc_error(self, context: Context, output: BasicVector) -> None:
        detections: Any = self._detections.Eval(context)
        output.SetFromVector(alignment_error(*unpack_detections(detections)))
