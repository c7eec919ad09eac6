"""Images as a camera without distortion, of square pixels, would have taken them."""

from typing import Final, Self

import cv2
import numpy as np

from chamfer.models.cameras.camera import Camera
from chamfer.systems.cameras.camera_image import Image

_FAR: Final = 1e4  # pixels: at the border of the image in that direction


class Undistortion:
    """Straightens what a camera's lens has bent, and makes its pixels square.

    Lines that are straight in space are straight again, and angles in a plane before the camera
    are angles in the image, so that parts are detected as by
    :meth:`chamfer.models.cameras.camera.Camera.straight`. What that one would show and this one
    doesn't is filled with the image's border, so that a part which reaches to the border still
    does.

    Args:
        camera: As it is believed to be.
    """

    def __init__(self, camera: Camera) -> None:
        straight = camera.straight()
        v, u = np.mgrid[: straight.height, : straight.width].astype(float)
        grid = np.stack([u, v], axis=-1)
        if straight.focal != camera.focal:
            grid = (grid - straight.centre) / straight.focal * camera.focal + camera.centre
        seen = camera.distorted(grid)
        way = grid - np.array(camera.centre)
        away = _FAR * way / np.maximum(np.linalg.norm(way, axis=-1, keepdims=True), 1.0)
        seen = np.where(np.isfinite(seen), seen, away)
        self._u, self._v = seen.astype(np.float32).transpose(2, 0, 1).copy()

    @classmethod
    def of(cls, camera: Camera) -> Self | None:
        """Return what straightens a camera's images; None where there is nothing to straighten."""
        fx, fy = camera.focal
        return None if camera.lens is None and fx == fy else cls(camera)

    def __call__(self, image: Image) -> Image:
        """Return the straightened image, shape (height, width, 3) of the straight camera."""
        straight = cv2.remap(
            image, self._u, self._v, cv2.INTER_LINEAR, borderMode=cv2.BORDER_REPLICATE
        )
        return straight.astype(np.uint8, copy=False)
