"""The peg and the hole part as outlines in an image, the farther before the nearer.

The parts are solids of revolution, or square, without a waist, so that their outlines are convex
polygons.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from chamfer.models.cameras.camera import Camera
from chamfer.models.peg.part_surfaces import rings
from chamfer.models.peg.peg_and_hole import Colour, ColouredParts, Section, require_colour
from chamfer.models.validation import ParameterError, require_not_negative
from chamfer.systems.cameras.coverage import intersection

Array = NDArray[np.float64]

_SIDES: Final = 128  # corners of a circle: outlines are right within 0.006 px
_FAR: Final = 1e5  # pixels; what reaches further is not drawn


@dataclass(frozen=True, kw_only=True)
class SceneStyle:
    """The visible scene besides the parts' shapes and colours; all of it is assumed."""

    background: Colour = (200, 200, 200)
    face: float = 0.85  # brightness of the end faces, relative to the sides
    bore: float = 0.6  # brightness of what is seen of the bore, as above
    blur: float = 0.7  # pixels, standard deviation of the lens' blur

    def __post_init__(self) -> None:
        require_not_negative(self, "blur")
        for name in ("face", "bore"):
            if not 0 < getattr(self, name) <= 1:
                raise ParameterError(name, getattr(self, name), "more than 0 and at most 1")
        require_colour(self, "background")


class Patch(NamedTuple):
    """A polygon and the colour that it adds, red, green and blue."""

    polygon: Array  # pixels, shape (n, 2)
    colour: Array  # shape (3,)


class Shape(NamedTuple):
    """An outline that covers what is behind it, and patches inside of it."""

    outline: Patch
    inside: tuple[Patch, ...]


def scene_shapes(
    parts: ColouredParts,
    camera: Camera,
    X_WT: RigidTransform | None,
    X_WM: RigidTransform | None,
    style: SceneStyle,
) -> list[Shape]:
    """Return the shapes that a camera without distortion sees, in drawing order.

    The poses are of the peg's tip and of the hole part's mouth frame; None: it is not there.
    """
    peg, hole, section = parts.peg, parts.hole, parts.section
    bar = None
    if X_WT is not None:
        bar = _Solid(camera, X_WT, peg.profile, section, parts.peg_colour, style)
    if X_WM is None:
        return [] if bar is None else bar.whole()
    tube = _Solid(camera, X_WM, hole.outside, section, parts.hole_colour, style)
    shapes = tube.whole()
    axis, p_WM = X_WM.rotation().matrix()[:, 0], X_WM.translation()
    open_to_camera = float((camera.p_WC - p_WM) @ axis) < 0
    bore = style.bore * tube.colour
    opening = None
    if open_to_camera:
        opening = outline(camera, _placed(X_WM, hole.bore[:1], section)[0])
        if shapes and opening is not None:
            patch = Patch(opening, bore - style.face * tube.colour)
            shapes = [Shape(shapes[0].outline, (*shapes[0].inside, patch))]
    if bar is None or X_WT is None:
        return shapes

    depth = (bar.points - p_WM) @ axis
    if not (depth > 0).any():
        return [*shapes, *bar.whole()] if open_to_camera else [*bar.whole(), *shapes]
    p_WT = X_WT.translation()
    foot = p_WM + float((p_WT - p_WM) @ axis) * axis
    if np.linalg.norm(p_WT - foot) > hole.mouth_radius:
        # Beside the hole part: the one whose axis is nearer is in front.
        nearer = np.linalg.norm(p_WT - camera.p_WC) < np.linalg.norm(foot - camera.p_WC)
        return [*shapes, *bar.whole()] if nearer else [*bar.whole(), *shapes]
    outer = bar.cut(-depth, end=0)
    if opening is None:
        return [*outer, *shapes]
    inner = [
        Patch(polygon, colour - bore if k == 0 else colour)
        for shape in bar.cut(depth, end=-1)
        for k, (seen, colour) in enumerate((shape.outline, *shape.inside))
        if len(polygon := intersection(seen, opening)) >= 3
    ]
    shapes = [Shape(shape.outline, (*shape.inside, *inner)) for shape in shapes]
    return [*shapes, *outer]


class _Solid:
    """A solid that a profile and its section make, in front of a camera."""

    def __init__(
        self,
        camera: Camera,
        X_WP: RigidTransform,
        profile: Array,
        section: Section,
        colour: Colour,
        style: SceneStyle,
    ) -> None:
        self.points = _placed(X_WP, profile, section)  # m, world, shape (n, sides, 3)
        self.colour = np.array(colour, dtype=float)
        self._camera = camera
        self._face = (style.face - 1) * self.colour
        # The end faces that the camera sees, by the index of their ring.
        towards = (camera.p_WC - X_WP.translation()) @ X_WP.rotation().matrix()[:, 0]
        self._ends = [k for k, sign in ((0, -1), (-1, 1)) if sign * (towards - profile[k, 0]) > 0]

    def whole(self) -> list[Shape]:
        """Return the solid as it is."""
        pixels = self._camera.project(self.points.reshape(-1, 3))
        of_rings = pixels.reshape(*self.points.shape[:2], 2)
        return self._shape(pixels, [of_rings[k] for k in self._ends])

    def cut(self, keep: Array, end: int) -> list[Shape]:
        """Return what is left where ``keep``, shape (n, sides), is not negative; one end face."""
        before, after = keep[:-1], keep[1:]
        lines, around = np.nonzero(before * after < 0)
        share = before[lines, around] / (before[lines, around] - after[lines, around])
        start, stop = self.points[lines, around], self.points[lines + 1, around]
        crossings = start + share[:, np.newaxis] * (stop - start)
        kept = np.concatenate([self.points[keep >= 0], crossings])
        faces = [self.points[end][keep[end] >= 0]] if end in self._ends else []
        project = self._camera.project
        return self._shape(project(kept), [project(face) for face in faces])

    def _shape(self, pixels: Array, faces: list[Array]) -> list[Shape]:
        around = _hull(pixels)
        if around is None:
            return []
        seen = [_hull(face) for face in faces]
        patches = tuple(Patch(face, self._face) for face in seen if face is not None)
        return [Shape(Patch(around, self.colour), patches)]


def _placed(X_WP: RigidTransform, profile: Array, section: Section) -> Array:
    around = _rings(profile.tobytes(), section)
    return np.asarray(around @ X_WP.rotation().matrix().T + X_WP.translation())


@lru_cache(maxsize=16)
def _rings(profile: bytes, section: Section) -> Array:
    return rings(np.frombuffer(profile).reshape(-1, 2), _SIDES, section)


def outline(camera: Camera, p_W: Array) -> Array | None:
    """Return the convex outline, pixels, shape (k, 2), of points ``p_W``, m, shape (n, 3).

    The camera has no distortion; None of a part that is not all before it.
    """
    return _hull(camera.project(p_W))


def _hull(pixels: Array) -> Array | None:
    if len(pixels) < 3 or not (np.abs(pixels) < _FAR).all():
        return None
    # Single precision is finest about 0.
    middle = pixels[0].round()
    hull = cv2.convexHull((pixels - middle).astype(np.float32))[:, 0]
    return hull + middle if len(hull) >= 3 else None


_PIECE: Final = 3.0  # pixels, of an edge that is drawn straight
_BEYOND: Final = 1.2  # radius up to which outlines are kept, relative to the image's corners
_AROUND: Final = 256  # corners of the circle that is kept


def through_lens(camera: Camera, shapes: Sequence[Shape]) -> list[Shape]:
    """Return shapes, convex and as the camera without distortion shows them, as it shows them.

    What the lens would fold back is cut off.
    """
    if camera.lens is None:
        return list(shapes)
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
    if len(polygon) < 3:
        return None
    return camera.without_distortion().shown_by(camera, _subdivided(polygon))


@lru_cache(maxsize=8)
def _field(camera: Camera) -> tuple[Array, float]:
    """Return a circle around all that a camera can show, pixels, and its radius at f = 1."""
    lens = camera.lens
    assert lens is not None
    u, v = camera.width - 0.5, camera.height - 0.5
    corners = camera.at_unit_focal(np.array([[-0.5, -0.5], [u, -0.5], [-0.5, v], [u, v]]))
    far = np.linalg.norm(corners, axis=1)
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
