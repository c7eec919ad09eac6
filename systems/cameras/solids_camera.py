"""A camera that draws coloured convex solids: connectors, grippers, whatever a skill handles.

It paints as the software camera does: outlines by the pinhole model, bent by the lens, with the
exact area that they cover of every pixel.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.math import RigidTransform
from pydrake.systems.framework import Context, LeafSystem
from pydrake.systems.sensors import ImageRgba8U

from chamfer.models.cameras.camera import Camera
from chamfer.models.peg.peg_and_hole import Colour, require_colour
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import Image, write_image
from chamfer.systems.cameras.scene import Patch, SceneStyle, Shape, outline
from chamfer.systems.cameras.software_camera import paint_shapes
from chamfer.systems.pose import POSE_SIZE, pose_from_vector

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False)
class Solid:
    """A visible body: the convex hull of its vertices, in one colour."""

    name: str
    vertices: Array  # m, in the body's frame, shape (n, 3), n >= 4
    colour: Colour

    def __post_init__(self) -> None:
        if not self.name.isidentifier():
            raise ParameterError("name", self.name, "letters, digits and _, no digit first")
        vertices = np.asarray(self.vertices)
        if vertices.ndim != 2 or vertices.shape[1] != 3 or len(vertices) < 4:
            allowed = "shape (n, 3) with n >= 4"
            raise ParameterError(f"vertices of {self.name}", vertices.shape, allowed)
        if not np.isfinite(vertices).all():
            raise ParameterError(f"vertices of {self.name}", vertices.tolist(), "finite numbers")
        require_colour(self, "colour")


_STYLE: Final = SceneStyle()


def render_solids(
    camera: Camera,
    solids: Sequence[Solid],
    poses: Mapping[str, RigidTransform],
    style: SceneStyle = _STYLE,
) -> Image:
    """Return a camera's image of solids.

    The solid whose nearest vertex is nearest, along the optical axis, covers the others: a sleeve
    covers what it is put over. A solid that reaches behind the camera is not drawn, nor is one
    without a pose, by its name, of its frame in the world. Red, green, blue, (height, width, 3).
    """
    pinhole = camera.without_distortion()
    seen: list[tuple[float, Shape]] = []
    for solid in solids:
        X_WB = poses.get(solid.name)
        if X_WB is None:
            continue
        p_W = solid.vertices @ X_WB.rotation().matrix().T + X_WB.translation()
        polygon = outline(pinhole, p_W)
        if polygon is not None:
            depth = float(((p_W - camera.p_WC) @ camera.R_WC[:, 2]).min())
            seen.append((depth, Shape(Patch(polygon, np.array(solid.colour, dtype=float)), ())))
    seen.sort(key=lambda one: -one[0])
    return paint_shapes(camera, [shape for _, shape in seen], style)


class SolidsCamera(LeafSystem):
    """Draws the image of coloured convex solids.

    .. pydrake_system::

        name: SolidsCamera
        input_ports:
        - (<name>_pose of each solid, optional)
        - camera_pose (optional)
        output_ports:
        - image

    The inputs are poses in the world, shape (7,): quaternion w, x, y, z and position in m. A
    solid whose port is not connected is not in view. ``camera_pose`` is the pose of a moving
    camera's frame, z along the optical axis. Without a connection the camera has the fixed pose
    of ``camera``.

    Raises:
        ParameterError: If there are no solids, or two have the same name.
    """

    def __init__(self, camera: Camera, solids: Sequence[Solid]) -> None:
        super().__init__()
        names = [solid.name for solid in solids]
        if not names or len({*names, "camera"}) != len(names) + 1:
            raise ParameterError("solids", names, "one or more, of different names but camera")
        ports: dict[str, Any] = {
            name: self.DeclareVectorInputPort(f"{name}_pose", POSE_SIZE)
            for name in (*names, "camera")
        }

        def calc(context: Context, output: Any) -> None:
            poses = {
                name: pose_from_vector(port.Eval(context))
                for name, port in ports.items()
                if port.HasValue(context)
            }
            X_WC = poses.get("camera")
            placed = camera
            if X_WC is not None:
                placed = camera.placed(X_WC.rotation().matrix(), X_WC.translation())
            write_image(output, render_solids(placed, solids, poses))

        model = Value(ImageRgba8U(camera.width, camera.height, 0))
        self.DeclareAbstractOutputPort(
            "image", model.Clone, calc, {port.ticket() for port in ports.values()}
        )
