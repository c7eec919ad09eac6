"""The believed and the true camera, where they differ from the nominal stand."""

import math
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final, Self, get_args

import numpy as np
from scipy.spatial.transform import Rotation

from chamfer.models.cameras.camera import Camera, Coefficients, LensDistortion, Matrix, Vector
from chamfer.models.cameras.camera_file import Eye, read_camera
from chamfer.models.validation import ParameterError, require_one_of

_NUMBERS: Final = {"focal_length": 2, "principal_point": 2, "position": 3, "tilt": 2}
_WORDS: Final = {2: "two", 3: "three"}
_OPPOSITE: Final = 1e-6  # sine of the angle from where the way to turn is not known


@dataclass(frozen=True, kw_only=True)
class CameraModel:
    """A camera relative to that of a stand; None: filled in from another source.

    The camera is moved by ``position`` along the other one's axes; then it is turned by the
    rotation vector ``tilt`` about the other one's u and v axes; and ``roll`` is about the optical
    axis that it then has.
    """

    focal_length: tuple[float, float] | None = None  # pixels, along u and v
    principal_point: tuple[float, float] | None = None  # pixels, image of the optical axis
    distortion: Coefficients | None = None  # k1, k2, p1, p2, k3 of OpenCV's model
    position: tuple[float, float, float] | None = None  # m: right, down, ahead
    tilt: tuple[float, float] | None = None  # rad, about u and about v
    roll: float | None = None  # rad, beyond the other one's
    file: str | None = None  # written by chamfer calibrate; fills the open fields
    camera: Eye | None = None  # of a file of two, None: left

    def __post_init__(self) -> None:
        if self.camera is not None:
            require_one_of(self, "camera", get_args(Eye))
            if self.file is None:
                raise ParameterError("camera", self.camera, "null without a file")
        for name, size in _NUMBERS.items():
            value = getattr(self, name)
            if value is not None and not (len(value) == size and all(map(math.isfinite, value))):
                raise ParameterError(name, value, f"{_WORDS[size]} finite numbers")
        if self.focal_length is not None and not min(self.focal_length) > 0:
            raise ParameterError("focal_length", self.focal_length, "two finite numbers > 0")
        if self.distortion is not None:
            LensDistortion(self.distortion)
        if self.roll is not None and not math.isfinite(self.roll):
            raise ParameterError("roll", self.roll, "a finite number")

    def read(self, camera: Camera) -> Self:
        """Return this model with its open fields from its file.

        Args:
            camera: Beside which the model is; the file's camera is there only if the file says
                where in the world it is.

        Raises:
            ParameterError: If the file can't be read, is of images of another size, or of a
                camera that looks the other way.
        """
        if self.file is None:
            return self
        try:
            file = read_camera(Path(self.file))
        except ParameterError as error:
            raise ParameterError("file", self.file, f"one that can be read; {error}") from error
        eye: Eye = self.camera or "left"
        found = file.eye(eye)
        if (found.width, found.height) != (camera.width, camera.height):
            size = f"{camera.width} x {camera.height} pixels"
            allowed = f"that of a camera with {size}; its has {found.width} x {found.height}"
            raise ParameterError("file", self.file, allowed)
        said = type(self)(
            focal_length=found.focal_length,
            principal_point=found.principal_point,
            distortion=found.distortion,
        )
        if file.world_pose is not None:
            R_WC, p_WC = file.world_pose.rotation, np.array(file.world_pose.translation)
            if eye == "right" and file.pose is not None:
                p_WC = p_WC + R_WC @ np.array(file.pose.translation)
                R_WC = R_WC @ file.pose.rotation
            try:
                place = type(self).beside(camera, R_WC, p_WC)
            except ParameterError as error:
                allowed = "that of a camera that does not look the other way in the world"
                raise ParameterError("file", self.file, allowed) from error
            said = said.over(place)
        return replace(self, file=None, camera=None).over(said)

    @classmethod
    def beside(cls, camera: Camera, R_WC: Matrix, p_WC: Vector) -> Self:
        """Return the model of a pose in the world relative to a camera; other fields stay open.

        Raises:
            ParameterError: If it looks the other way.
        """
        R = camera.R_WC.T @ R_WC
        x, y, z = R[:, 2].tolist()
        sine = math.hypot(x, y)
        if z < 0 and sine < _OPPOSITE:
            raise ParameterError("R_WC", R_WC.tolist(), "not against the other camera")
        size = math.atan2(sine, z) / sine if sine > 0 else 1.0
        tilt = (-size * y, size * x)
        roll = Rotation.from_matrix(Rotation.from_rotvec([*tilt, 0.0]).as_matrix().T @ R)
        right, down, ahead = (camera.R_WC.T @ (p_WC - camera.p_WC)).tolist()
        return cls(position=(right, down, ahead), tilt=tilt, roll=float(roll.as_rotvec()[2]))

    @classmethod
    def like(cls, camera: Camera) -> Self:
        """Return a camera's model relative to itself."""
        return cls(
            focal_length=camera.focal,
            principal_point=camera.centre,
            distortion=camera.distortion,
            position=(0.0, 0.0, 0.0),
            tilt=(0.0, 0.0),
            roll=0.0,
        )

    def over(self, other: Self) -> Self:
        """Return this model, with its open fields from another one."""
        given = {name: value for name, value in vars(self).items() if value is not None}
        return replace(other, **given)

    def of(self, camera: Camera) -> Camera:
        """Return the camera of this model relative to a camera, which fills in open fields.

        Raises:
            ParameterError: If there is a file to be read.
        """
        if self.file is not None:
            raise ParameterError("file", self.file, "null where it is used; resolve reads files")
        turn = Rotation.from_rotvec([*(self.tilt or (0.0, 0.0)), 0.0])
        turn *= Rotation.from_rotvec([0.0, 0.0, self.roll or 0.0])
        return replace(
            camera,
            focal=self.focal_length or camera.focal,
            centre=self.principal_point or camera.centre,
            distortion=self.distortion or camera.distortion,
            R_WC=camera.R_WC @ turn.as_matrix(),
            p_WC=camera.p_WC + camera.R_WC @ np.array(self.position or (0.0, 0.0, 0.0)),
        )
