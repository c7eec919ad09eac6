"""What a block that measures in images asks for, and what it remembers."""

from typing import Any

import numpy as np
from pydrake.common.value import Value
from pydrake.systems.sensors import ImageRgba8U

from chamfer.systems.cameras.camera_image import Image, write_image
from chamfer.systems.vision.part_detector import ImageMeasurement


class Brightness(ImageMeasurement):
    """Counts how often it looked."""

    def __init__(self) -> None:
        super().__init__("brightness", 2, 8, 6)
        self.looks = 0

    def measure(self, image: Image | None) -> np.ndarray:
        self.looks += image is not None
        return np.full(2, -1.0 if image is None else float(image.mean()))


def grey(level: int | None) -> Value:
    value = Value(ImageRgba8U(8, 6, 0))
    if level is not None:
        write_image(value, np.full((6, 8, 3), level, np.uint8))
    return value


def test_the_same_image_is_looked_at_once() -> None:
    block = Brightness()
    first: Any = block.CreateDefaultContext()
    second: Any = block.CreateDefaultContext()
    port = block.GetInputPort("image")
    output = block.GetOutputPort("brightness")
    seen = []
    for context, level in ((first, 10), (second, 10), (first, None), (first, 10), (first, 20)):
        port.FixValue(context, grey(level))
        seen.append(output.Eval(context).tolist())
    assert seen == [[10, 10], [10, 10], [-1, -1], [10, 10], [20, 20]]
    assert block.looks == 2


def test_it_follows_its_image() -> None:
    assert Brightness().HasDirectFeedthrough(0, 0)
