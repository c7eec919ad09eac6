"""Conditions that make the mouth of a hole hard to see, each at three severities.

What is on the plate is drawn in its plane, y and z of the mouth's frame M, in radii of the mouth.
Where the mouth is, and so what is true, stays as it is.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any, Final, Literal, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from chamfer.models.cameras.camera import Camera
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.systems.cameras.camera_image import add_noise
from chamfer.systems.cameras.mouth_scene import PlateStyle, render_mouth

Array = NDArray[np.float64]
Light = NDArray[np.floating[Any]]  # red, green and blue, 0 to 255, shape (height, width, 3)

_SHIFT: Final = 5  # of cv2's parts of a pixel, bits


@dataclass(frozen=True, kw_only=True)
class MouthScene:
    """A plate before a camera in the hand."""

    parts: ColouredParts
    camera: Camera  # in any frame
    X_WT: RigidTransform
    X_WM: RigidTransform
    noise: float  # grey levels, standard deviation
    random: np.random.Generator

    def light(self, plate: PlateStyle = PlateStyle(), tip: float = 0.0) -> Light:  # noqa: B008
        """Return the plate and the peg, which may be nearer by ``tip``, m."""
        X_WT = self.X_WT @ RigidTransform([tip, 0.0, 0.0])
        image = render_mouth(self.parts, self.camera, X_WT, self.X_WM, plate=plate)
        return np.asarray(image, np.float32)

    def on_plate(self, points: Array) -> Array:
        """Return the pixels of points of the plate, radii of the mouth, shape (n, 2)."""
        p_M = self.parts.hole.mouth_radius * np.insert(points, 0, 0.0, axis=1)
        return self.camera.project(p_M @ self.X_WM.rotation().matrix().T + self.X_WM.translation())

    def mask(self, points: Array, soft: float = 0.7, width: float | None = None) -> Light:
        """Return the mask of a polygon or of a line, width in pixels, shape (height, width, 1)."""
        pixels = np.rint(self.on_plate(points) * 2**_SHIFT).astype(np.int32)
        covered = np.zeros((self.camera.height, self.camera.width), np.float32)
        if width is None:
            cv2.fillPoly(covered, [pixels], 1.0, cv2.LINE_8, _SHIFT)
        else:
            cv2.polylines(covered, [pixels], False, 1.0, max(round(width), 1), cv2.LINE_8, _SHIFT)
        return np.asarray(cv2.GaussianBlur(covered, (0, 0), soft), np.float32)[..., np.newaxis]

    def turn(self) -> float:
        """Return a direction, rad, anywhere."""
        return float(self.random.uniform(0, 2 * math.pi))


def _at(radius: float | Array, turn: float | Array) -> Array:
    return np.stack(np.broadcast_arrays(radius * np.cos(turn), radius * np.sin(turn)), axis=-1)


def _disc(centre: Array, radius: float) -> Array:
    return centre + _at(radius, np.linspace(0, 2 * math.pi, 60))


Draw = Callable[[MouthScene, float], Light]


def _plain(scene: MouthScene, level: float) -> Light:
    return scene.light()


def _chips(scene: MouthScene, level: float) -> Light:
    """Break pieces out of the rims, dark as the bore."""
    light = scene.light()
    bore = scene.parts.hole.radius / scene.parts.hole.mouth_radius
    for radius in (bore, 1.0, bore):
        turn, wide = scene.turn(), scene.random.uniform(0.1, level)
        turns = np.linspace(turn - wide, turn + wide, 20)
        deep = 0.15 * wide * np.cos(np.linspace(-1.57, 1.57, 20))
        piece = np.concatenate([_at(radius - 0.02, turns), _at(radius + deep, turns)[::-1]])
        shade = scene.random.uniform(0.1, 0.5)
        light = light * (1 - (1 - shade) * scene.mask(piece))
    return light


def _scratches(scene: MouthScene, level: float) -> Light:
    light = scene.light()
    for _ in range(round(level)):
        start, end = (_at(scene.random.uniform(0.9, 2.0), scene.turn()) for _ in range(2))
        line = scene.mask(np.stack([start, end]), 0.6, scene.random.uniform(1, 3))
        light = light * (1 + scene.random.choice([-0.5, 0.6]) * line)
    return light


def _highlights(scene: MouthScene, level: float) -> Light:
    light = scene.light()
    for _ in range(3):
        centre = _at(scene.random.uniform(0.7, 1.2), scene.turn())
        spot = scene.mask(_disc(centre, scene.random.uniform(0.05, level)), 3.0)
        light = light + 300 * spot
    return light


def _second_hole(scene: MouthScene, level: float) -> Light:
    """Draw another hole of the same size beside it, at a distance, radii."""
    light, hole = scene.light(), scene.parts.hole
    beside = hole.mouth_radius * level * np.array([0.0, *_at(1.0, scene.turn())])
    other = render_mouth(scene.parts, scene.camera, None, scene.X_WM @ RigidTransform(beside))
    away = _disc(beside[1:] / hole.mouth_radius, 1.1)
    share = scene.mask(away)
    # The peg stays before it.
    peg = (light[..., :1] > light[..., 2:]).astype(np.float32)
    share = share * (1 - peg)
    return (1 - share) * light + share * other


def _other_hole(scene: MouthScene, level: float) -> Light:
    """Draw a hole of another size in its place."""
    parts = scene.parts
    other = replace(
        parts,
        hole_radius=level * parts.hole_radius,
        peg_radius=0.9 * level * parts.peg_radius,
        outer_radius=2 * parts.outer_radius,
    )
    return render_mouth(other, scene.camera, None, scene.X_WM).astype(np.float32)


def _no_hole(scene: MouthScene, level: float) -> Light:
    """Draw nothing but marks and a drawn circle."""
    light = scene.light()
    everywhere = scene.mask(_disc(np.zeros(2), 1.2))
    face = PlateStyle.face * np.array(scene.parts.hole_colour, np.float32)
    light = light * (1 - everywhere) + everywhere * face
    ring = scene.mask(_disc(np.zeros(2), level), 0.7, 2.0)
    return light * (1 - 0.7 * ring)


def _shadow(scene: MouthScene, level: float) -> Light:
    turn = scene.turn()
    edge = scene.random.uniform(-0.8, 0.8)
    corners = np.array([[edge, -9.0], [edge, 9.0], [9.0, 9.0], [9.0, -9.0]])
    cos, sin = math.cos(turn), math.sin(turn)
    half = corners @ np.array([[cos, sin], [-sin, cos]])
    return scene.light() * (1 - level * scene.mask(half, scene.random.uniform(0.7, 4.0)))


def _round_shadow(scene: MouthScene, level: float) -> Light:
    """Cast a round shadow, as of a peg, over the mouth."""
    disc = _disc(_at(level, scene.turn()), scene.random.uniform(0.7, 1.3))
    return scene.light() * (1 - 0.6 * scene.mask(disc, scene.random.uniform(0.7, 3.0)))


def _dirt(scene: MouthScene, level: float) -> Light:
    """Put a dark blot over a part of the rim."""
    blot = _at(1 + 0.2 * scene.random.standard_normal(24), np.linspace(0, 6.0, 24))
    blot = _at(1.0, scene.turn()) + level * blot
    return scene.light() * (1 - 0.8 * scene.mask(blot, 1.0))


def _texture(scene: MouthScene, level: float) -> Light:
    """Mill the plate: parallel grooves, in the bore none."""
    height, width = scene.camera.height, scene.camera.width
    noise = scene.random.standard_normal((height, width)).astype(np.float32)
    grooves = np.asarray(cv2.GaussianBlur(noise, (0, 0), 25.0, sigmaY=1.0), np.float32)
    return np.asarray(scene.light() * (1 + level * (grooves / grooves.std())[..., np.newaxis]))


def _blur(scene: MouthScene, level: float) -> Light:
    return scene.light(PlateStyle(blur=level))


def _bright(scene: MouthScene, level: float) -> Light:
    return scene.light() * level


def _nearer(scene: MouthScene, level: float) -> Light:
    """Let the peg come nearer, and hide a part of the mouth."""
    return scene.light(tip=level)


def _flat(scene: MouthScene, level: float) -> Light:
    """Light the chamfer as bright as the face, but for a share."""
    return scene.light(PlateStyle(chamfer=PlateStyle.face, shading=level))


class MouthCondition(NamedTuple):
    """How pictures are made hard."""

    said: str
    asked: Literal["found", "none", "sure"]  # none: there is no mouth; sure: found or refused
    levels: tuple[float, float, float]  # mild, middle, severe
    draw: Draw
    noise: bool = False  # whether the level is the noise, grey levels


CONDITIONS: Final[Mapping[str, MouthCondition]] = {
    "plain": MouthCondition("as it is", "found", (0.0, 0.0, 0.0), _plain),
    "noise": MouthCondition("noise, grey levels", "found", (6.0, 10.0, 20.0), _plain, True),
    "blur": MouthCondition("blur, pixels", "found", (1.0, 1.4, 2.5), _blur),
    "dark": MouthCondition("less light, share", "found", (0.6, 0.4, 0.2), _bright),
    "bright": MouthCondition("more light, share", "found", (1.15, 1.4, 2.0), _bright),
    "texture": MouthCondition("grooves, share", "found", (0.05, 0.1, 0.25), _texture),
    "scratches": MouthCondition("scratches", "found", (4.0, 10.0, 25.0), _scratches),
    "chips": MouthCondition("chips, half width, rad", "found", (0.2, 0.4, 0.8), _chips),
    "highlights": MouthCondition("highlights, radii", "found", (0.1, 0.2, 0.5), _highlights),
    "shadow": MouthCondition("half in shadow, share", "found", (0.3, 0.5, 0.8), _shadow),
    "round-shadow": MouthCondition("round shadow, off", "found", (1.0, 0.5, 0.1), _round_shadow),
    "flat-chamfer": MouthCondition("chamfer like face", "found", (0.4, 0.25, 0.1), _flat),
    "dirt": MouthCondition("dirt on the rim, radii", "found", (0.1, 0.25, 0.6), _dirt),
    "second-hole": MouthCondition("second hole, off", "found", (3.0, 2.5, 2.1), _second_hole),
    "peg-nearer": MouthCondition("peg nearer, m", "sure", (0.006, 0.012, 0.02), _nearer),
    "other-hole": MouthCondition("hole of other size", "none", (1.25, 1.12, 0.93), _other_hole),
    "no-hole": MouthCondition("a drawn circle only", "none", (1.0, 0.9, 0.83), _no_hole),
}


def mouth_picture(scene: MouthScene, name: str, level: float) -> NDArray[np.uint8]:
    """Return a picture of a condition, shape (height, width, 3)."""
    condition = CONDITIONS[name]
    light = condition.draw(scene, level)
    image = np.clip(np.rint(light), 0, 255).astype(np.uint8)
    return add_noise(image, level if condition.noise else scene.noise, scene.random)
