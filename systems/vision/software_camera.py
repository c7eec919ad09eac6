"""A camera that draws the peg and the hole part itself: no graphics library, any machine.

Outlines are projected by the pinhole model, bent as the lens bends them and drawn with the exact
area that they cover of every pixel.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any

import cv2
import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, LeafSystem
from pydrake.systems.sensors import ImageRgba8U

from models.camera import Camera
from models.peg_and_hole import Colour, ColouredParts
from systems.vision.camera_image import Image, write_image
from systems.vision.coverage import paint
from systems.vision.lens_outlines import through_lens
from systems.vision.part_poses import PosePorts
from systems.vision.scene import SceneStyle, Shape, scene_shapes

_STYLE = SceneStyle()


def render(
    parts: ColouredParts,
    camera: Camera,
    X_WT: RigidTransform | None,
    X_WM: RigidTransform | None,
    *,
    style: SceneStyle = _STYLE,
) -> Image:
    """Return what a camera sees of the peg and the hole part.

    The nearer part covers the other. A peg in the hole is cut at the plane of the mouth: what is
    behind it shows through the opening only. A part that reaches behind the camera is not drawn.
    Where the edges of both parts coincide, a pixel shows up to a quarter of the background.

    Args:
        parts: Peg and hole part.
        camera: The camera.
        X_WT: Pose of the peg's tip frame in the world; None: no peg.
        X_WM: Pose of the hole part's mouth frame in the world; None: no hole part.
        style: Background, brightness and blur.

    Returns:
        Red, green, blue, shape (height, width, 3).
    """
    if camera.lens is None:
        shapes = scene_shapes(parts, camera, X_WT, X_WM, style)
    else:
        straight = scene_shapes(parts, camera.without_distortion(), X_WT, X_WM, style)
        shapes = through_lens(camera, straight)
    return paint_shapes(
        camera.width, camera.height, shapes, background=style.background, blur=style.blur
    )


def paint_shapes(
    width: int, height: int, shapes: Sequence[Shape], *, background: Colour, blur: float
) -> Image:
    """Return the image of shapes, the first the farthest.

    Args:
        width: Pixels.
        height: Pixels.
        shapes: What is to be drawn, in this order.
        background: Colour where there is nothing.
        blur: Standard deviation of the lens' blur, pixels.

    Returns:
        Red, green, blue, shape (height, width, 3).
    """
    image = _blank(width, height, background).copy()
    if not shapes:
        return image
    margin = int(np.ceil(4 * blur)) + 1
    corners = np.concatenate([shape.outline.polygon for shape in shapes])
    size = np.array([width, height])
    left, top = np.clip(np.floor(corners.min(axis=0)).astype(int) - margin, 0, size).tolist()
    right, bottom = np.clip(np.ceil(corners.max(axis=0)).astype(int) + margin, 0, size).tolist()
    if right <= left or bottom <= top:
        return image
    window = image[top:bottom, left:right].astype(np.float32)
    corner = np.array([left, top])
    for shape in shapes:
        paint(window, shape.outline.polygon - corner, shape.outline.colour, True)
        for polygon, colour in shape.inside:
            paint(window, polygon - corner, colour, False)
    if blur:
        cv2.GaussianBlur(window, (0, 0), blur, window, borderType=cv2.BORDER_REPLICATE)
    image[top:bottom, left:right] = cv2.convertScaleAbs(window)
    return image


@lru_cache(maxsize=8)
def _blank(width: int, height: int, colour: Colour) -> Image:
    return np.tile(np.array(colour, np.uint8), (height, width, 1))


class SoftwareCamera(LeafSystem):
    """The image of the peg and the hole part, drawn without a graphics library.

    .. pydrake_system::

        name: SoftwareCamera
        input_ports:
        - peg_pose (optional)
        - hole_pose (optional)
        output_ports:
        - image

    ``peg_pose`` and ``hole_pose`` are of the frames T and M in the world, shape (7,): quaternion
    w, x, y, z and position in m. A part whose port is not connected is not in view. The image
    follows the poses; a :class:`~systems.vision.camera_image.FrameGrabber` behind it samples,
    holds, delays and adds noise.
    """

    def __init__(self, parts: ColouredParts, camera: Camera, style: SceneStyle = _STYLE) -> None:
        super().__init__()
        poses = PosePorts(self)

        def calc(context: Context, output: Any) -> None:
            X_WT, X_WM = poses.read(context)
            write_image(output, render(parts, camera, X_WT, X_WM, style=style))

        model = Value(ImageRgba8U(camera.width, camera.height, 0))
        self.DeclareAbstractOutputPort("image", model.Clone, calc, poses.tickets())
