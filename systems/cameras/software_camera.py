"""A camera that draws the peg and the hole part itself: no graphics library, any machine.

Outlines are projected by the pinhole model, bent as the lens bends them and drawn with the exact
area that they cover of every pixel.
"""

import math
from collections.abc import Sequence
from functools import lru_cache
from typing import Any, Final

import cv2
import numpy as np
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, LeafSystem
from pydrake.systems.sensors import ImageRgba8U
from pydrake.trajectories import PiecewisePose

from chamfer.models.cameras.camera import Camera
from chamfer.models.peg.peg_and_hole import Colour, ColouredParts
from chamfer.systems.cameras.camera_image import Image, SensorParams, shaded, write_image
from chamfer.systems.cameras.coverage import paint
from chamfer.systems.cameras.scene import SceneStyle, Shape, scene_shapes, through_lens
from chamfer.systems.pose import POSE_SIZE, pose_from_vector


class PosePorts:
    """The inputs ``peg_pose`` and ``hole_pose`` of a system, with something behind their names."""

    def __init__(self, system: LeafSystem, when: str = "") -> None:
        self._ports: list[Any] = [
            system.DeclareVectorInputPort(f"{name}{when}", POSE_SIZE)
            for name in ("peg_pose", "hole_pose")
        ]

    def read(self, context: Context) -> tuple[RigidTransform | None, RigidTransform | None]:
        """Return X_WT of the peg and X_WM of the hole part.

        None where a port is not connected, or the zeros of a hold that has not sampled yet.
        """
        poses = [port.Eval(context) if port.HasValue(context) else _NONE for port in self._ports]
        peg, hole = (pose_from_vector(pose) if pose.any() else None for pose in poses)
        return peg, hole

    def tickets(self) -> set[Any]:
        """Return the prerequisites of an output that reads the poses."""
        return {port.ticket() for port in self._ports}


PartPoses = tuple[RigidTransform | None, RigidTransform | None]

AT_OPENING: Final = "_at_opening"  # of the names of ports

_NONE: Final = np.zeros(POSE_SIZE)
_STYLE: Final = SceneStyle()
_SENSOR: Final = SensorParams()
_STEP: Final = 1.0  # pixels, of motion in one of the pictures of an exposure
_MOST: Final = 32  # pictures of an exposure


def render(
    parts: ColouredParts,
    camera: Camera,
    X_WT: RigidTransform | None,
    X_WM: RigidTransform | None,
    *,
    style: SceneStyle = _STYLE,
) -> Image:
    """Return a camera's image of the peg and the hole part, shape (height, width, 3).

    The poses are of the peg's tip and of the hole part's mouth frame; None: it is not there. The
    nearer part covers the other. A peg in the hole is cut at the plane of the mouth: what is
    behind it shows through the opening only. A part that reaches behind the camera is not drawn.
    Where the edges of both parts coincide, a pixel shows up to a quarter of the background.
    """
    shapes = scene_shapes(parts, camera.without_distortion(), X_WT, X_WM, style)
    return paint_shapes(camera, shapes, style)


def render_moving(
    parts: ColouredParts,
    camera: Camera,
    opening: PartPoses,
    closing: PartPoses,
    *,
    style: SceneStyle = _STYLE,
) -> Image:
    """Return the image of a camera whose shutter is open while the parts move uniformly.

    It is the mean of pictures of at most a pixel's motion each, of up to 32. The poses X_WT and
    X_WM are those when the shutter opens (None: as when it closes) and closes (None: not there).
    """
    travel = 0.0
    profiles = parts.peg.profile, parts.hole.outside
    for profile, X_begin, X_end in zip(profiles, opening, closing, strict=True):
        if X_begin is not None and X_end is not None:
            ends = np.pad(profile[[0, -1], :1], ((0, 0), (0, 2))).T
            moved = camera.project((X_end @ ends).T) - camera.project((X_begin @ ends).T)
            travel = max(travel, float(np.nan_to_num(np.linalg.norm(moved, axis=1)).max()))
    count = min(max(math.ceil(travel / _STEP), 1), _MOST)
    ways = list(zip(opening, closing, strict=True))
    images = [
        render(parts, camera, *(between(*way, (k + 0.5) / count) for way in ways), style=style)
        for k in range(count)
    ]
    if count == 1:
        return images[0]
    total = np.zeros(images[0].shape, np.float32)
    for image in images:
        cv2.accumulate(image, total)
    return cv2.convertScaleAbs(total, alpha=1 / count).astype(np.uint8, copy=False)


def between(
    X_begin: RigidTransform | None, X_end: RigidTransform | None, share: float
) -> RigidTransform | None:
    """Return the pose at a share of an even motion from one to another; None: not there."""
    if X_begin is None or X_end is None:
        return X_end
    return PiecewisePose.MakeLinear([0.0, 1.0], [X_begin, X_end]).GetPose(share)


def paint_shapes(camera: Camera, shapes: Sequence[Shape], style: SceneStyle) -> Image:
    """Return the image of shapes as the camera without distortion shows them, farthest first."""
    width, height = camera.width, camera.height
    shapes = through_lens(camera, shapes)
    image = _blank(width, height, style.background).copy()
    if not shapes:
        return image
    margin = int(np.ceil(4 * style.blur)) + 1
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
    if style.blur:
        cv2.GaussianBlur(window, (0, 0), style.blur, window, borderType=cv2.BORDER_REPLICATE)
    image[top:bottom, left:right] = cv2.convertScaleAbs(window)
    return image


@lru_cache(maxsize=8)
def _blank(width: int, height: int, colour: Colour) -> Image:
    return np.tile(np.array(colour, np.uint8), (height, width, 1))


class SoftwareCamera(LeafSystem):
    """Draws the image of the peg and the hole part without a graphics library.

    .. pydrake_system::

        name: SoftwareCamera
        input_ports:
        - peg_pose (optional)
        - hole_pose (optional)
        output_ports:
        - image

    ``peg_pose`` and ``hole_pose`` are the poses of the frames T and M in the world, shape (7,):
    quaternion w, x, y, z and position in m. A part whose port is not connected is not in view.
    The image follows the poses; a :class:`~chamfer.systems.cameras.camera_image.FrameGrabber`
    samples, holds, delays and adds noise.

    With an exposure the block also has ``peg_pose_at_opening`` and ``hole_pose_at_opening``, the
    poses when the shutter opened. A part without that pose has not moved since.
    """

    def __init__(
        self, parts: ColouredParts, camera: Camera, sensor: SensorParams = _SENSOR
    ) -> None:
        super().__init__()
        poses = PosePorts(self)
        opening = PosePorts(self, AT_OPENING) if sensor.exposure else None

        def calc(context: Context, output: Any) -> None:
            closing = poses.read(context)
            if opening is None:
                image = render(parts, camera, *closing)
            else:
                image = render_moving(parts, camera, opening.read(context), closing)
            if sensor.shades:
                image = shaded(image, sensor.vignetting, sensor.white_balance)
            write_image(output, image)

        model = Value(ImageRgba8U(camera.width, camera.height, 0))
        tickets = poses.tickets() if opening is None else poses.tickets() | opening.tickets()
        self.DeclareAbstractOutputPort("image", model.Clone, calc, tickets)
