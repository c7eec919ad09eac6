"""A camera in the hand: its mounting next to the peg, and its images of a mouth."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import Value
from pydrake.math import RigidTransform, RotationMatrix
from pydrake.systems.framework import Context, LeafSystem
from pydrake.systems.sensors import ImageRgba8U
from scipy.spatial.transform import Rotation

from chamfer.models.cameras.camera import (
    LARGEST_PIXEL,
    UNDISTORTED,
    Camera,
    Coefficients,
    LensDistortion,
)
from chamfer.models.cameras.camera_file import read_camera
from chamfer.models.peg.part_surfaces import rings
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_numbers,
    require_positive,
)
from chamfer.systems.cameras.camera_image import FrameGrabberParams, write_image
from chamfer.systems.cameras.mouth_scene import render_mouth
from chamfer.systems.cameras.scene import outline
from chamfer.systems.cameras.software_camera import PosePorts

Array = NDArray[np.float64]

_FULL: Final = 0.8  # of the image's height, that a mouth fills with its reach
_ANGLES: Final = np.arange(0.05, 0.951, 0.01)  # rad, that are tried
_POINTS: Final = 48  # of a rim, that are looked at
_LARGEST: Final = 10_000  # pixels, width and height of an image


@dataclass(frozen=True, kw_only=True)
class HandMount:
    """Where a camera in the hand is believed to be, and how far off that is; all is assumed.

    It looks at the mouth, as it is where the peg is in line at the gap, past the peg.
    """

    distance: float = 0.15  # m, from the mouth
    angle: float | None = None
    # rad, of its axis to the peg's; None: the least with which the peg hides none of the mouth
    pixel_size: float | None = None
    # m, that a pixel covers at the mouth; None: mouth and reach fill 0.8 of the image's height
    width: int = 640  # pixels
    height: int = 480  # pixels
    distortion: Coefficients = UNDISTORTED  # k1, k2, p1, p2, k3 of OpenCV's model
    reach: float = 0.004  # m, largest distance of the mouth from its expected position
    error: tuple[float, ...] = (0.0,) * 6
    # m and rad, error of the true camera along and about the believed one's axes, after
    # calibration
    frames: FrameGrabberParams = FrameGrabberParams(period=0.05)
    # assumed; it takes frames while the mouth is not hidden
    file: str | None = None
    # of `chamfer calibrate --poses`, with lens and deviations; None: the fields here
    angle_deviation: float = 2.5e-4
    # rad, standard deviation about an axis, by calibration: trials draw such errors
    position_deviation: float = 4e-5  # m, likewise, of its position

    def __post_init__(self) -> None:
        require_positive(self, "distance", "reach")
        require_not_negative(self, "angle_deviation", "position_deviation")
        require_numbers(self, 6, "error")
        LensDistortion(self.distortion)
        if self.pixel_size is not None:
            require_positive(self, "pixel_size", most=LARGEST_PIXEL, unit="m")
        if self.angle is not None and not 0 < self.angle < math.pi / 2:
            raise ParameterError("angle", self.angle, "between 0 and pi/2, rad")
        for name in ("width", "height"):
            value = getattr(self, name)
            if not (isinstance(value, int) and 1 <= value <= _LARGEST):
                raise ParameterError(name, value, f"a whole number from 1 to {_LARGEST}")

    def of(self, parts: ColouredParts, gap: float) -> "HandMount":
        """Return the mount with its open fields filled in.

        Raises:
            ParameterError: If the camera never sees the whole mouth at the gap, m.
        """
        pixel = self.pixel_size
        if pixel is None:
            pixel = 2 * (parts.hole.mouth_radius + self.reach) / (_FULL * self.height)
        mount = replace(self, pixel_size=pixel)
        angles = _ANGLES.tolist() if self.angle is None else [self.angle]
        for angle in angles:
            tried = replace(mount, angle=angle)
            if tried.sees(parts, gap):
                return tried
        at = f"at the gap, {gap:g} m, shows the whole mouth and {self.reach:g} m around it"
        if self.angle is not None:
            raise ParameterError("angle", self.angle, f"one with which a camera {at}")
        raise ParameterError("reach", self.reach, f"one with which some camera in the hand {at}")

    def read(self) -> "HandMount":
        """Return the mount with the values of its file, if it has one."""
        if self.file is None:
            return self
        found = read_camera(Path(self.file))
        if found.hand_eye is None or found.hand_eye.sd is None:
            allowed = "a file with hand_eye and its deviations, of chamfer calibrate --poses"
            raise ParameterError("file", self.file, allowed)
        sd = found.hand_eye.sd
        turn, shift = (
            float(np.sqrt(np.mean(np.square(one)))) for one in (sd.rotation_vector, sd.translation)
        )
        return replace(
            self,
            distortion=found.left.distortion,
            angle_deviation=turn,
            position_deviation=shift,
        )

    @property
    def deviations(self) -> tuple[float, float]:
        """Standard deviations that calibration leaves: of a mouth across, m, and its axis, rad."""
        turned = self.distance * self.angle_deviation
        return math.hypot(self.position_deviation, turned), self.angle_deviation

    def drawn(self, generator: np.random.Generator) -> "HandMount":
        """Return the mount with an error as large as calibration may well have left it."""
        sizes = np.repeat([self.position_deviation, self.angle_deviation], 3)
        error = np.add(self.error, sizes * generator.standard_normal(6))
        return replace(self, error=tuple(error.tolist()))

    def camera(self, gap: float, *, true: bool = False) -> Camera:
        """Return the camera in the peg's frame T, of a mount that leaves nothing open."""
        assert self.angle is not None
        assert self.pixel_size is not None
        cos, sin = math.cos(self.angle), math.sin(self.angle)
        ahead = np.array([cos, -sin, 0.0])
        R_TC = np.column_stack([[0.0, 0.0, 1.0], [-sin, -cos, 0.0], ahead])
        X_TC = RigidTransform(RotationMatrix(R_TC), [gap, 0.0, 0.0] - self.distance * ahead)
        if true:
            turn = RotationMatrix(Rotation.from_rotvec(self.error[3:]).as_matrix())
            X_TC = X_TC @ RigidTransform(turn, self.error[:3])
        focal = self.distance / self.pixel_size
        return Camera(
            width=self.width,
            height=self.height,
            focal=(focal, focal),
            centre=((self.width - 1) / 2, (self.height - 1) / 2),
            R_WC=X_TC.rotation().matrix(),
            p_WC=X_TC.translation(),
            distortion=self.distortion,
        )

    @property
    def covariance(self) -> Array:
        """The covariance of the camera's calibrated pose, m and rad, in its axes, shape (6, 6)."""
        sides = [self.position_deviation] * 3 + [self.angle_deviation] * 3
        return np.diag(np.maximum(sides, 1e-9) ** 2)

    def sees(self, parts: ColouredParts, gap: float) -> bool:
        """Return whether all of the mouth, and its reach around it, is seen at a gap, m."""
        camera, chamfer = self.camera(gap), parts.hole.chamfer
        assert self.angle is not None
        if chamfer.width and self.angle > math.pi / 2 - chamfer.angle:
            return False  # the chamfer hides the bore's nearer rim
        wide = np.array([[gap, parts.hole.mouth_radius + self.reach]])
        seen = camera.project(rings(wide, _POINTS)[0])
        last = np.array([self.width - 1, self.height - 1])
        if not ((seen >= 0) & (seen <= last)).all():
            return False
        peg = rings(parts.peg.profile, _POINTS, parts.section).reshape(-1, 3)
        around = outline(camera.without_distortion(), peg)
        if around is None:  # it reaches behind the camera: what is before it hides no less
            before = peg[(peg - camera.p_WC) @ camera.R_WC[:, 2] > 0.1 * self.distance]
            around = outline(camera.without_distortion(), before)
            if around is None:
                return True
        straight = camera.shown_by(camera.without_distortion(), seen)
        hull = around.astype(np.float32)
        return all(cv2.pointPolygonTest(hull, point, False) < 0 for point in straight.tolist())


class HandCamera(LeafSystem):
    """Draws the image of the mouth, and of the peg, for a camera that moves with the peg.

    .. pydrake_system::

        name: HandCamera
        input_ports:
        - peg_pose
        - hole_pose
        output_ports:
        - image

    ``peg_pose`` and ``hole_pose``, shape (7,), are those of
    :class:`~chamfer.systems.cameras.software_camera.SoftwareCamera`.
    """

    def __init__(self, parts: ColouredParts, mount: HandMount, gap: float) -> None:
        super().__init__()
        poses, camera = PosePorts(self), mount.camera(gap, true=True)

        def calc(context: Context, output: Any) -> None:
            X_WT, X_WM = poses.read(context)
            if X_WT is not None and X_WM is not None:
                # In the peg's frame the camera stands.
                X_TM = X_WT.InvertAndCompose(X_WM)
                write_image(output, render_mouth(parts, camera, RigidTransform(), X_TM))

        model = Value(ImageRgba8U(camera.width, camera.height, 0))
        self.DeclareAbstractOutputPort("image", model.Clone, calc, poses.tickets())
