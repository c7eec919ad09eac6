"""A block that measures something in every image that it is shown."""

from abc import abstractmethod

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem, OutputPort
from pydrake.systems.sensors import ImageRgba8U

from chamfer.systems.cameras.camera_image import Image, read_image

Array = NDArray[np.float64]


class ImageMeasurement(LeafSystem):
    """Gives a vector that is measured in an image.

    .. pydrake_system::

        name: ImageMeasurement
        input_ports:
        - image
        output_ports:
        - (the measured vector)

    The output follows the image, so that it is as old as it is, and holds nothing back.

    Args:
        output: Name of the output port.
        size: Of the vector.
        width: Of the image, pixels.
        height: Of the image, pixels.
    """

    def __init__(self, output: str, size: int, width: int = 320, height: int = 240) -> None:
        super().__init__()
        # Of the last image that was looked at: whatever updates a state anywhere in a diagram
        # makes Drake ask again, and detection is the dearest part of the loop.
        self._seen: tuple[Image, Array] | None = None
        self._image = self.DeclareAbstractInputPort("image", Value(ImageRgba8U(width, height, 0)))
        self._depends = {self._image.ticket()}
        self._measured: OutputPort = self.DeclareVectorOutputPort(
            output, size, self._calc_measured, self._depends
        )

    @abstractmethod
    def measure(self, image: Image | None) -> Array:
        """Return the vector of an image, shape (height, width, 3); None: there is no image."""

    def _calc_measured(self, context: Context, vector: BasicVector) -> None:
        rgb = read_image(self._image.Eval(context))
        if rgb is None:
            vector.SetFromVector(self.measure(None))
            return
        if self._seen is None or not np.array_equal(self._seen[0], rgb):
            self._seen = rgb, self.measure(rgb)
        vector.SetFromVector(self._seen[1])
