"""Images as a camera without distortion would have taken them."""

from typing import Final

import cv2
import numpy as np

from models.camera import Camera
from systems.cameras.camera_image import Image

_FAR: Final = 1e4  # pixels: at the border of the image in that direction


class Undistortion:
    """Straightens what a camera's lens has bent.

    Lines that are straight in space are straight again, so that parts are detected as by the same
    camera without distortion. What that one would show and this one doesn't is filled with the
    image's border, so that a part which reaches to the border still does.

    Args:
        camera: As it is believed to be.
    """

    def __init__(self, camera: Camera) -> None:
        v, u = np.mgrid[: camera.height, : camera.width].astype(float)
        grid = np.stack([u, v], axis=-1)
        seen = camera.distorted(grid)
        way = grid - np.array(camera.centre)
        away = _FAR * way / np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1.0)
        seen = np.where(np.isfinite(seen), seen, away)
        self._u, self._v = seen.astype(np.float32).transpose(2, 0, 1).copy()

    def __call__(self, image: Image) -> Image:
        """Return the straightened image, of the same shape, (height, width, 3)."""
        straight = cv2.remap(
            image, self._u, self._v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return straight.astype(np.uint8, copy=False)
