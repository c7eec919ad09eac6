"""Outlines as a lens shows them: straight edges become curves."""

from collections.abc import Sequence
from functools import lru_cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from chamfer.models.cameras.camera import Camera
from chamfer.systems.cameras.coverage import intersection
from chamfer.systems.cameras.scene import Patch, Shape

Array = NDArray[np.float64]

_PIECE: Final = 3.0  # pixels, of an edge that is drawn straight
_BEYOND: Final = 1.2  # radius up to which outlines are kept, relative to the image's corners
_AROUND: Final = 256  # corners of the circle that is kept


def through_lens(camera: Camera, shapes: Sequence[Shape]) -> list[Shape]:
    """Return shapes as a camera shows them.

    What the lens would fold back is cut off.

    Args:
        camera: The camera, with distortion.
        shapes: As the same camera without distortion shows them; all polygons are convex.
    """
    kept = []
    for (outline, colour), inside in shapes:
        polygon = _bent(camera, outline)
        if polygon is not None:
            patches = [(_bent(camera, patch.polygon), patch.colour) for patch in inside]
            seen = tuple(Patch(bent, add) for bent, add in patches if bent is not None)
            kept.append(Shape(Patch(polygon, colour), seen))
    return kept


def _bent(camera: Camera, polygon: Array) -> Array | None:
    field, radius = _field(camera)
    away = np.linalg.norm((polygon - np.array(camera.centre)) / camera.focal, axis=1)
    if away.max() >= radius:
        polygon = intersection(polygon, field)
    return camera.distorted(_subdivided(polygon)) if len(polygon) >= 3 else None


@lru_cache(maxsize=8)
def _field(camera: Camera) -> tuple[Array, float]:
    """Return a circle around all that a camera can show, pixels, and its radius at f = 1."""
    lens = camera.lens
    assert lens is not None
    u, v = camera.width - 0.5, camera.height - 0.5
    corners = camera.undistorted(np.array([[-0.5, -0.5], [u, -0.5], [-0.5, v], [u, v]]))
    far = np.linalg.norm((corners - np.array(camera.centre)) / camera.focal, axis=1)
    # A corner beyond the fold shows nothing.
    radius = min(lens.reach * (1 - 1e-9), _BEYOND * float(np.nan_to_num(far, nan=np.inf).max()))
    turns = np.linspace(0.0, 2 * np.pi, _AROUND, endpoint=False)
    circle = radius * np.column_stack([np.cos(turns), np.sin(turns)])
    return circle * camera.focal + camera.centre, radius


def _subdivided(polygon: Array) -> Array:
    ways = np.roll(polygon, -1, axis=0) - polygon
    pieces = np.maximum(np.ceil(np.linalg.norm(ways, axis=1) / _PIECE), 1.0).astype(int)
    first = np.cumsum(pieces) - pieces
    share = (np.arange(pieces.sum()) - np.repeat(first, pieces)) / np.repeat(pieces, pieces)
    points: Array = np.repeat(polygon, pieces, axis=0)
    points += share[:, np.newaxis] * np.repeat(ways, pieces, axis=0)
    return points
