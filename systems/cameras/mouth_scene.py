"""The image of a hole's mouth in a plate, by a camera in the hand next to the peg."""

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from pydrake.math import RigidTransform

from chamfer.models.cameras.camera import Camera
from chamfer.models.peg.part_surfaces import rings
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import (
    require_between,
    require_finite,
    require_not_negative,
    require_positive,
)
from chamfer.systems.cameras.camera_image import Image
from chamfer.systems.cameras.scene import Patch, SceneStyle, Shape, outline, scene_shapes
from chamfer.systems.cameras.software_camera import paint_shapes

_SHADES: Final = 32  # of a chamfer, around it
_CORNERS: Final = 4  # of a circle, in each


@dataclass(frozen=True, kw_only=True)
class PlateStyle:
    """The plate that the hole is in, and its light; all of it is assumed."""

    radius: float = 0.08  # m, of the plate about the hole
    face: float = 0.85  # brightness of the front face, relative to the part's colour
    bore: float = 0.12  # brightness of the bore, which is dark
    chamfer: float = 0.6  # mean brightness of the chamfer
    shading: float = 0.15  # how much brighter it is where it faces the light
    light: float = 0.6  # rad, about the hole's axis, from y to z, where the light is from
    blur: float = SceneStyle.blur  # pixels, standard deviation of the lens' blur

    def __post_init__(self) -> None:
        require_positive(self, "radius")
        require_between(self, 0, 1, "face", "bore", "chamfer", "shading")
        require_not_negative(self, "blur")
        require_finite(self, "light")


PLATE: Final = PlateStyle()


def render_mouth(
    parts: ColouredParts,
    camera: Camera,
    X_WT: RigidTransform | None,
    X_WM: RigidTransform,
    *,
    plate: PlateStyle = PLATE,
) -> Image:
    """Return a camera's image of a hole in a plate, shape (height, width, 3).

    The poses are of the peg's tip, None without a peg, and of the mouth. What of a peg is below
    the plate's face is not drawn.
    """
    style = SceneStyle(face=plate.face, bore=max(plate.bore, 1e-3), blur=plate.blur)
    pinhole = camera.without_distortion()
    wide = replace(parts, outer_radius=max(plate.radius, parts.outer_radius))
    drawn = scene_shapes(wide, pinhole, X_WT, X_WM, style)
    if not drawn:
        return paint_shapes(camera, [], style)
    around, *before = drawn
    colour = np.array(parts.hole_colour, dtype=float)
    face, bore = plate.face * colour, plate.bore * colour
    inside = []
    circles = rings(parts.hole.bore[:2], _SHADES * _CORNERS, parts.section)
    circles = circles @ X_WM.rotation().matrix().T + X_WM.translation()
    opening = outline(pinhole, circles[0])
    if opening is not None:
        inside.append(Patch(opening, bore - face))
    if opening is not None and parts.hole.chamfer.width:
        seen = pinhole.project(circles)
        for k in range(_SHADES):
            corners = np.arange(k * _CORNERS, (k + 1) * _CORNERS + 1) % (_SHADES * _CORNERS)
            turn = 2 * math.pi * (k + 0.5) / _SHADES
            # It faces the axis: brightest is what is opposite to the light.
            level = plate.chamfer - plate.shading * math.cos(turn - plate.light)
            part = np.concatenate([seen[0, corners], seen[1, corners[::-1]]])
            inside.append(Patch(part, level * colour - bore))
    whole = Shape(Patch(around.outline.polygon, face), tuple(inside))
    return paint_shapes(camera, [whole, *before], style)
