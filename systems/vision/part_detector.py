"""The blocks that find parts in a camera's images, and the alignment error in an image."""

import math
from abc import abstractmethod
from collections.abc import Sequence
from typing import Final, NamedTuple, Self

import cv2
import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, OutputPort
from pydrake.systems.sensors import ImageRgba8U

from chamfer.models.cameras.camera import Camera
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import Image, read_image
from chamfer.systems.vision.detections import (
    DETECTION_SIZE,
    DETECTIONS_SIZE,
    Detection,
    Status,
    pack_detections,
    unpack_detections,
)
from chamfer.systems.vision.part_appearance import Appearance
from chamfer.systems.vision.part_detection import detect, detect_parts

Array = NDArray[np.float64]

# pixels a grey level; at a noise of 4 grey levels the parts of the paper, at rest, had standard
# deviations of 0.026 pixels and 0.25 mrad
_POINT: Final = 0.0175
_FLOOR: Final = 0.02  # pixels, of a point without noise: what a row gains or loses


class ImageMeasurement(LeafSystem):
    """Outputs a vector of a given size that is measured in an image.

    .. pydrake_system::

        name: ImageMeasurement
        input_ports:
        - image
        output_ports:
        - (the measured vector)

    The output follows the image, so it has the image's age. Elements that are not found in this
    image are NaN, with the reason in the status.
    """

    def __init__(self, output: str, size: int) -> None:
        super().__init__()
        # Of the last image that was looked at: whatever updates a state anywhere in a diagram
        # makes Drake ask again, and detection is the dearest part of the loop.
        self._seen: tuple[Image, Array] | None = None
        self._image = self.DeclareAbstractInputPort("image", Value(ImageRgba8U(1, 1, 0)))
        self._depends = {self._image.ticket()}
        self._measured: OutputPort = self.DeclareVectorOutputPort(
            output, size, self._calc_measured, self._depends
        )

    @abstractmethod
    def measure(self, image: Image | None) -> Array:
        """Return the vector of an image, shape (height, width, 3); None: no image."""

    def _calc_measured(self, context: Context, vector: BasicVector) -> None:
        rgb = read_image(self._image.Eval(context))
        if rgb is None:
            vector.SetFromVector(self.measure(None))
            return
        if self._seen is None or not np.array_equal(self._seen[0], rgb):
            self._seen = rgb, self.measure(rgb)
        vector.SetFromVector(self._seen[1])


_FAR: Final = 1e4  # pixels: at the border of the image in that direction


class Undistortion:
    """Straightens an image to that of :meth:`chamfer.models.cameras.camera.Camera.straight`.

    What that one would show and this one doesn't is filled with the image's border, so that a part
    which reaches to the border still does.
    """

    def __init__(self, camera: Camera) -> None:
        straight = camera.straight()
        v, u = np.mgrid[: straight.height, : straight.width].astype(float)
        grid = np.stack([u, v], axis=-1)
        seen = straight.shown_by(camera, grid)
        way = straight.shown_by(camera.without_distortion(), grid) - np.array(camera.centre)
        away = _FAR * way / np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1.0)
        seen = np.where(np.isfinite(seen), seen, away)
        self._u, self._v = seen.astype(np.float32).transpose(2, 0, 1).copy()

    @classmethod
    def of(cls, camera: Camera) -> Self | None:
        """Return the straightening of a camera's images; None if they are straight."""
        fx, fy = camera.focal
        return None if camera.lens is None and fx == fy else cls(camera)

    def __call__(self, image: Image) -> Image:
        """Return the straightened image, shape (height, width, 3) of the straight camera."""
        straight = cv2.remap(
            image, self._u, self._v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return straight.astype(np.uint8, copy=False)


ERROR_SIZE: Final = 3

_NOTHING: Final = Detection(status=Status.NO_IMAGE)


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


class MeasurementSpread(NamedTuple):
    """Standard deviations of the error measured in one image."""

    lateral: float  # pixels
    rotational: float  # rad


def measurement_spread(noise: float, peg: float, hole: float, gap: float) -> MeasurementSpread:
    """Return the effect of noise, grey levels, on the errors of two long parts in one image.

    Both long edges of a part are lines fitted to one point a column: over so many columns of the
    peg and of the hole part. Over L columns a line's angle has the variance ``12 s^2 / L^3`` and
    its middle ``s^2 / L``, with s the standard deviation of one point, and the axis is the mean of
    two lines. The lateral error is that of the peg's tip from the hole's axis, which is prolonged
    over the gap, columns between tip and mouth.
    """
    point = math.hypot(_POINT * noise, _FLOOR)
    angles = [6 / length**3 for length in (peg, hole)]
    prolonged = angles[1] * (gap + hole / 2) ** 2 + 0.5 / hole
    at_tip = 2.0 / peg  # middle and angle of the peg's own axis, at its end
    return MeasurementSpread(
        lateral=point * math.sqrt(prolonged + at_tip), rotational=point * math.sqrt(sum(angles))
    )


class PartsDetector(ImageMeasurement):
    """Finds any parts in an image, by their appearance.

    .. pydrake_system::

        name: PartsDetector
        input_ports:
        - image
        output_ports:
        - detections

    ``detections``, shape (6 n,), is laid out as in :func:`pack_detections`, in the order of
    ``parts``.

    Raises:
        ParameterError: If there are no parts.
    """

    def __init__(self, parts: Sequence[Appearance]) -> None:
        if not parts:
            raise ParameterError("parts", list(parts), "one or more")
        super().__init__("detections", DETECTION_SIZE * len(parts))
        self._parts = tuple(parts)

    def measure(self, image: Image | None) -> Array:
        """Return the packed detections of the parts in an image."""
        parts = self._parts
        return pack_detections(*[_NOTHING if image is None else detect(image, p) for p in parts])


class PartDetector(ImageMeasurement):
    """Finds the peg and the hole part in an image.

    .. pydrake_system::

        name: PartDetector
        input_ports:
        - image
        output_ports:
        - detections
        - alignment_error

    ``detections``, shape (12,), is laid out as in :func:`pack_detections`; ``alignment_error``,
    shape (3,), is that of :func:`alignment_error`. With the camera's undistortion both are those
    of its straightened images.
    """

    def __init__(
        self, peg: Appearance, hole: Appearance, undistortion: Undistortion | None = None
    ) -> None:
        super().__init__("detections", DETECTIONS_SIZE)
        self._parts = peg, hole
        self._undistortion = undistortion
        self.DeclareVectorOutputPort(
            "alignment_error", ERROR_SIZE, self._calc_error, self._depends
        )

    def measure(self, image: Image | None) -> Array:
        """Return the packed detections of both parts in an image."""
        if image is None:
            return pack_detections(_NOTHING, _NOTHING)
        if self._undistortion is not None:
            image = self._undistortion(image)
        return pack_detections(*detect_parts(image, *self._parts))

    def _calc_error(self, context: Context, output: BasicVector) -> None:
        peg, hole = unpack_detections(self._measured.Eval(context))
        output.SetFromVector(alignment_error(peg, hole))
