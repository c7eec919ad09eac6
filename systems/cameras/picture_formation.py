"""What a camera's shutter, lens and sensor make of the light, beside shapes and noise."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError, require_not_negative
from chamfer.systems.cameras.camera_image import Image

Gains = NDArray[np.float32]

NEUTRAL: Final = (1.0, 1.0, 1.0)


@dataclass(frozen=True, kw_only=True)
class SensorParams:
    """A camera's shutter, the light that its lens loses, and the colours that it sees."""

    exposure: float = 0.0  # s, how long the shutter is open, until the frame's instant
    vignetting: float = 0.0  # share of the light that is lost in the image's corners
    white_balance: tuple[float, float, float] = NEUTRAL  # gains of red, green and blue

    def __post_init__(self) -> None:
        require_not_negative(self, "exposure")
        if not 0 <= self.vignetting <= 1:
            raise ParameterError("vignetting", self.vignetting, "a share, from 0 to 1")
        gains = self.white_balance
        if len(gains) != 3 or not all(math.isfinite(gain) and gain > 0 for gain in gains):
            raise ParameterError("white_balance", gains, "three finite numbers > 0")

    @property
    def shades(self) -> bool:
        """Whether it changes what an image of resting parts shows."""
        return self.vignetting > 0 or self.white_balance != NEUTRAL


def shaded(image: Image, vignetting: float, white_balance: tuple[float, float, float]) -> Image:
    """Return an image with less light towards the corners, and other colours.

    Args:
        image: Red, green, blue, shape (height, width, 3).
        vignetting: Share of the light that is lost in the corners; it grows with the square of
            the distance from the image's middle.
        white_balance: Gains of red, green and blue; what gets brighter than white is white.
    """
    height, width = image.shape[:2]
    gains = _gains(width, height, vignetting, white_balance)
    return cv2.multiply(image, gains, dtype=cv2.CV_8U).astype(np.uint8, copy=False)


@lru_cache(maxsize=8)
def _gains(
    width: int, height: int, vignetting: float, white_balance: tuple[float, float, float]
) -> Gains:
    v, u = np.mgrid[:height, :width]
    across, down = 2.0 * u - (width - 1), 2.0 * v - (height - 1)
    corner = max((width - 1) ** 2 + (height - 1) ** 2, 1)
    light = 1.0 - vignetting * (across**2 + down**2) / corner
    gains: Gains = (light[..., np.newaxis] * np.array(white_balance)).astype(np.float32)
    return gains


def mean_image(images: Sequence[Image]) -> Image:
    """Return what a sensor has collected that saw images one after the other, equally long."""
    if len(images) == 1:
        return images[0]
    total = np.zeros(images[0].shape, np.float32)
    for image in images:
        cv2.accumulate(image, total)
    return cv2.convertScaleAbs(total, alpha=1 / len(images)).astype(np.uint8, copy=False)
