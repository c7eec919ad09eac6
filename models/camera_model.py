"""What is believed of a camera, and what is true of it, where that is not as its stand says."""

import math
from dataclasses import dataclass, fields, replace
from typing import Final, Self

import numpy as np
from scipy.spatial.transform import Rotation

from models.camera import Camera
from models.lens_distortion import Coefficients, LensDistortion
from models.validation import ParameterError

_NUMBERS: Final = {"focal_length": 2, "principal_point": 2, "position": 3, "tilt": 2}
_WORDS: Final = {2: "two", 3: "three"}


@dataclass(frozen=True, kw_only=True)
class CameraModel:
    """A camera beside another one, that of a stand; None: as something else says, which fills in.

    The camera is moved by ``position`` along the other one's axes; then it is turned by the
    rotation vector ``tilt`` about the other one's u and v axes; and ``roll`` is about the optical
    axis that it then has.
    """

    focal_length: tuple[float, float] | None = None  # pixels, along u and v
    principal_point: tuple[float, float] | None = None  # pixels, where the optical axis is seen
    distortion: Coefficients | None = None  # k1, k2, p1, p2, k3 of OpenCV's model
    position: tuple[float, float, float] | None = None  # m: right, down, ahead
    tilt: tuple[float, float] | None = None  # rad, about u and about v
    roll: float | None = None  # rad, beyond the other one's

    def __post_init__(self) -> None:
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

    @classmethod
    def like(cls, camera: Camera) -> Self:
        """Return a camera's model beside itself."""
        return cls(
            focal_length=camera.focal,
            principal_point=camera.centre,
            distortion=camera.distortion,
            position=(0.0, 0.0, 0.0),
            tilt=(0.0, 0.0),
            roll=0.0,
        )

    def over(self, other: Self) -> Self:
        """Return this model, with what it leaves open as another one says."""
        given = {one.name: getattr(self, one.name) for one in fields(self)}
        return replace(
            other, **{name: value for name, value in given.items() if value is not None}
        )

    def of(self, camera: Camera) -> Camera:
        """Return the camera of this model beside a camera, by which what is open is filled in."""
        model = self.over(type(self).like(camera))
        assert model.focal_length is not None
        assert model.principal_point is not None
        assert model.distortion is not None
        assert model.position is not None
        assert model.tilt is not None
        assert model.roll is not None
        turn = Rotation.from_rotvec([*model.tilt, 0.0]) * Rotation.from_rotvec([0, 0, model.roll])
        return replace(
            camera,
            focal=model.focal_length,
            centre=model.principal_point,
            distortion=model.distortion,
            R_WC=camera.R_WC @ turn.as_matrix(),
            p_WC=camera.p_WC + camera.R_WC @ np.array(model.position),
        )
