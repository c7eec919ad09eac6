"""Detections of the parts compared with the truth: in the image, as error signal, in space.

True in an image is what the pinhole camera makes of the part's frame: the centre of the end face
and the axis, which stays a straight line. A silhouette need not be symmetric about either.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Final, NamedTuple

import cv2
import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform, RollPitchYaw

from chamfer.diagrams.cell.cell_vision import VIEWS, Renderer
from chamfer.models.cameras.camera import Camera, View
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import require_not_negative
from chamfer.systems.cameras.camera_image import Image, add_noise
from chamfer.systems.cameras.scene import SceneStyle
from chamfer.systems.cameras.software_camera import render
from chamfer.systems.cameras.vtk_camera import VtkCamera
from chamfer.systems.pose import pose_vector
from chamfer.systems.vision.detections import Detection, Status
from chamfer.systems.vision.part_appearance import appearances
from chamfer.systems.vision.part_detection import detect_parts
from chamfer.systems.vision.part_detector import alignment_error
from chamfer.systems.vision.two_plane_stereo import PartInSpace, locate, metric_error

Array = NDArray[np.float64]

PARTS: Final = ("peg", "hole")

# Of each error, by its name.
UNITS: Final[Mapping[str, str]] = {
    **{
        f"{view}.{target}.{quantity}": "rad" if quantity == "angle" else length
        for view in VIEWS
        for target, length in (("peg", "px"), ("hole", "px"), ("error", "px"), ("scaled", "m"))
        for quantity in ("lateral", "axial", "angle")
    },
    **{
        f"space.{target}.{quantity}": unit
        for target in (*PARTS, "relative")
        for quantity, unit in (("tip", "m"), ("axis", "rad"))
    },
}
STATUSES: Final = tuple(f"{view}.{part}.status" for view in VIEWS for part in PARTS)

_SHARP: Final = SceneStyle(face=1.0, bore=1.0, blur=0.0)
_ON_AXIS: Final = 0.001  # m, from the origin of a part to another point of its axis


class Poses(NamedTuple):
    """Where the parts are in the world."""

    X_WT: RigidTransform  # of the peg's tip
    X_WM: RigidTransform  # of the hole part's mouth


class TrialCamera:
    """A camera that draws the parts; VTK needs what ``missing_graphics`` looks for.

    The blur, pixels, is that of the software camera, not of sampled images.
    """

    def __init__(
        self, parts: ColouredParts, camera: Camera, renderer: Renderer, blur: float
    ) -> None:
        self.camera = camera
        self._parts, self._style = parts, SceneStyle(blur=blur)
        self._vtk = None
        if renderer == "vtk":
            self._vtk = VtkCamera(parts, camera)
            self._context = self._vtk.CreateDefaultContext()

    def images(self, poses: Poses, noise: float, random: np.random.Generator) -> dict[str, Image]:
        """Return images of the parts, each of shape (height, width, 3), by their kind.

        ``clean`` is what the renderer draws, ``noisy`` the same with noise, grey levels. In
        ``sampled`` a pixel shows one part or the background, never both: as of a sensor with gaps
        between its pixels.
        """
        if self._vtk is not None:
            for name, X_WP in zip(("peg_pose", "hole_pose"), poses, strict=True):
                self._vtk.GetInputPort(name).FixValue(self._context, pose_vector(X_WP))
            clean: Image = (
                self._vtk.GetOutputPort("image").Eval(self._context).data[..., :3].copy()
            )
            return {"clean": clean, "noisy": add_noise(clean, noise, random)}
        clean = render(self._parts, self.camera, *poses, style=self._style)
        sharp = render(self._parts, self.camera, *poses, style=_SHARP)
        return {
            "clean": clean,
            "noisy": add_noise(clean, noise, random),
            "sampled": _nearest_colours(sharp, self._parts),
        }


def kinds(renderer: Renderer) -> tuple[str, ...]:
    """Return the kinds of images of a renderer; VTK samples by itself."""
    return ("clean", "noisy", "sampled") if renderer == "software" else ("clean", "noisy")


def _nearest_colours(rgb: Image, parts: ColouredParts) -> Image:
    """Return an image in which every pixel is all background, all peg or all hole part."""
    colours = np.array([_SHARP.background, parts.peg_colour, parts.hole_colour])
    # Squared distances but for what they have in common.
    offsets = (colours**2).sum(axis=1, keepdims=True)
    distances = cv2.transform(rgb.astype(np.float32), np.hstack([-2 * colours, offsets]))
    return np.asarray(colours.astype(np.uint8)[distances.argmin(axis=2)])


def true_detection(camera: Camera, X_WP: RigidTransform) -> Detection:
    """Return where a part's origin and x axis are in the image."""
    # A straight line stays one: any other point of it that is before the camera will do.
    return _seen(*camera.project(_axis(X_WP, _ON_AXIS)))


def _axis(X_WP: RigidTransform, length: float) -> Array:
    """Return a part's origin and a further point of its x axis, m, world frame, shape (2, 3)."""
    return np.array([X_WP @ np.zeros(3), X_WP @ np.array([length, 0.0, 0.0])])


def _seen(origin: Array, further: Array) -> Detection:
    (u, v), (du, dv) = origin.tolist(), (further - origin).tolist()
    return Detection(status=Status.VALID, tip=(u, v), angle=math.atan2(dv, du), point=(u, v))


def measure(
    parts: ColouredParts,
    cameras: Mapping[View, Camera],
    images: Mapping[View, Image],
    poses: Poses,
    *,
    pixel_size: float,
) -> dict[str, float]:
    """Detect the parts in an image of each view, and return statuses and errors by their names.

    All errors, of :data:`UNITS`, are found minus true; NaN where the part was not found.

    - ``peg``, ``hole``: the tip or the mouth along the true axis (``axial``) and to the right of
      it (``lateral``), and the axis (``angle``).
    - ``error``: the alignment error that the controller gets, against the one that the true tips
      and axes in the image make.
    - ``scaled``: the alignment error times the size of a pixel, as without calibration, against
      the parts' distances and angle in the plane that the camera looks at.
    - ``space``: distance of the tips and angle of the axes by two-plane stereo, and of the way
      and the turn from the peg to the hole (``relative``); without a sign.
    """
    looks = appearances(parts, pixel_size)
    detected = {view: detect_parts(images[view], *looks) for view in VIEWS}
    measured: dict[str, float] = {}
    for view in VIEWS:
        camera, found = cameras[view], detected[view]
        true = [true_detection(camera, X_WP) for X_WP in poses]
        for name, one, other in zip(PARTS, found, true, strict=True):
            measured[f"{view}.{name}.status"] = float(one.status)
            measured |= _named(f"{view}.{name}", detection_error(one, other))
        signal = alignment_error(*found)
        measured |= _named(f"{view}.error", signal - alignment_error(*true))
        parallel = [_seen(*(_axis(X_WP, 1.0) @ camera.R_WC[:, :2])) for X_WP in poses]
        scaled = signal * [pixel_size, pixel_size, 1.0]
        measured |= _named(f"{view}.scaled", scaled - alignment_error(*parallel))
    return measured | _in_space([cameras[view] for view in VIEWS], detected, poses)


def detection_error(found: Detection, true: Detection) -> Array:
    """Return found minus true: of the tip along the axis, of the axis across, and its angle.

    Where the tip is not known, ``across`` is measured where the axis passes it.
    """
    cos, sin = math.cos(true.angle), math.sin(true.angle)
    angle = found.angle - true.angle
    if found.status == Status.VALID:
        du, dv = np.subtract(found.tip, true.tip)
        return np.array([cos * du + sin * dv, cos * dv - sin * du, angle])
    du, dv = np.subtract(found.point, true.tip)
    along, aside = cos * du + sin * dv, cos * dv - sin * du
    return np.array([math.nan, aside - math.tan(angle) * along, angle])


def _named(target: str, errors: Array) -> dict[str, float]:
    axial, lateral, angle = errors.tolist()
    return {f"{target}.lateral": lateral, f"{target}.axial": axial, f"{target}.angle": angle}


def _in_space(
    cameras: list[Camera], detected: Mapping[View, tuple[Detection, Detection]], poses: Poses
) -> dict[str, float]:
    measured = {}
    parts, truths = [], []
    for i, (name, X_WP) in enumerate(zip(PARTS, poses, strict=True)):
        part = locate(cameras, [detected[view][i] for view in VIEWS])
        x, y, z = X_WP.translation().tolist()
        a, b, c = X_WP.rotation().matrix()[:, 0].tolist()
        truth = PartInSpace(status=Status.VALID, tip=(x, y, z), direction=(a, b, c))
        measured[f"space.{name}.tip"] = math.dist(part.tip, truth.tip)
        sine = float(np.linalg.norm(np.cross(part.direction, truth.direction)))
        cosine = float(np.dot(part.direction, truth.direction))
        measured[f"space.{name}.axis"] = math.atan2(sine, cosine)
        parts.append(part)
        truths.append(truth)
    tip, axis = np.linalg.norm(
        (metric_error(*parts) - metric_error(*truths)).reshape(2, 3), axis=1
    )
    return measured | {"space.relative.tip": float(tip), "space.relative.axis": float(axis)}


@dataclass(frozen=True, kw_only=True)
class Reach:
    """How far a part is from its nominal pose at most, along and about each axis; uniform."""

    distance: float  # m, from the nominal pose, at most, along each axis
    angle: float  # rad, from the nominal pose, at most, about each axis

    def __post_init__(self) -> None:
        require_not_negative(self, "distance", "angle")


@dataclass(frozen=True, kw_only=True)
class PoseSpread:
    """Where the parts may be."""

    peg: Reach  # relative to the hole
    hole: Reach  # in the world


WIDE: Final = PoseSpread(
    peg=Reach(distance=0.01, angle=0.1), hole=Reach(distance=0.003, angle=0.03)
)  # as at the start of an alignment
NEAR: Final = PoseSpread(
    peg=Reach(distance=0.001, angle=0.005), hole=Reach(distance=0.003, angle=0.002)
)  # as at its end


def draw_poses(gap: float, spread: PoseSpread, random: np.random.Generator) -> Poses:
    """Return random poses of the parts.

    The gap, m, is from the peg's tip to the hole's mouth, nominal; the world's origin is its
    middle.
    """
    X_WM = RigidTransform([gap / 2, 0.0, 0.0]) @ _deviation(spread.hole, random)
    X_MT = RigidTransform([-gap, 0.0, 0.0]) @ _deviation(spread.peg, random)
    return Poses(X_WT=X_WM @ X_MT, X_WM=X_WM)


def _deviation(reach: Reach, random: np.random.Generator) -> RigidTransform:
    angles = random.uniform(-reach.angle, reach.angle, 3)
    return RigidTransform(RollPitchYaw(angles), random.uniform(-reach.distance, reach.distance, 3))
