"""The errors that a camera of the cell may have: what each is, and how large it may well be."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, NamedTuple, TypeVar

import numpy as np

from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.cell_cameras import VIEWS, CameraSettings, ViewSettings
from chamfer.models.cameras.camera import View
from chamfer.models.cameras.camera_model import CameraModel
from chamfer.systems.cameras.camera_image import Image, SensorParams

Change = Callable[[ViewSettings, float, CameraSettings], ViewSettings]
Views = Sequence[View]
ScenarioT = TypeVar("ScenarioT", bound=AlignmentScenario)

_WARM: Final = (1.0, 0.0, -1.0)  # of red, green and blue: a lamp instead of daylight


class CameraError(NamedTuple):
    """An error of cameras that nobody knows of."""

    name: str
    unit: str
    most: float  # how large it may well be without calibration; assumed
    says: str  # in a few words
    change: Change | None = None  # of one camera
    views: Views = VIEWS  # cameras that have it
    off_axis: bool = False  # with the parts beside the optical axes
    moving: bool = False  # it shows in motion, or in many frames, only
    signed: bool = True  # it may also be of the other sign
    picture: Callable[[float], Callable[[Image], Image]] | None = None  # of parts at rest alone


def with_error(scenario: ScenarioT, error: CameraError, size: float, off_axis: float) -> ScenarioT:
    """Return a resolved scenario whose cameras have an error; its controllers stay as they are.

    Args:
        scenario: Resolved.
        error: Which.
        size: In the error's unit, with its sign.
        off_axis: m, from the optical axes to the parts, where the error is of these.
    """
    if error.off_axis:
        scenario = beside(scenario, off_axis)
    cameras, change = scenario.cameras, error.change
    if change is not None:
        for view in error.views:
            cameras = cameras.with_view(view, change(cameras.view(view), size, cameras))
    return replace(scenario, cameras=cameras)


def beside(scenario: ScenarioT, off_axis: float) -> ScenarioT:
    """Return a scenario with cameras that stand further down in their images, as is known."""
    cameras = scenario.cameras
    for view in VIEWS:
        of = cameras.view(view)
        moved = CameraModel(position=(0.0, off_axis, 0.0))
        known = replace(of, believed=moved.over(of.believed), true=moved.over(of.true))
        cameras = cameras.with_view(view, known)
    return replace(scenario, cameras=cameras)


def brightness_ramp(size: float) -> Callable[[Image], Image]:
    """Return what makes a picture brighter downwards, by a share of it from border to border."""

    def change(image: Image) -> Image:
        ramp = 1 + size * np.linspace(-0.5, 0.5, len(image))[:, np.newaxis, np.newaxis]
        return np.clip(np.rint(image * ramp), 0, 255).astype(np.uint8)

    return change


def _true(make: Callable[[CameraModel, float, CameraSettings], CameraModel]) -> Change:
    """Return what changes the true camera, to a model that says what is different."""

    def change(of: ViewSettings, size: float, cameras: CameraSettings) -> ViewSettings:
        return replace(of, true=make(of.true, size, cameras).over(of.true))

    return change


def _frames(name: str) -> Change:
    def change(of: ViewSettings, size: float, cameras: CameraSettings) -> ViewSettings:
        was = getattr(of.frames, name)
        value = round(was + size) if isinstance(was, int) else was + size
        return replace(of, frames=replace(of.frames, **{name: value}))

    return change


def _sensor(make: Callable[[SensorParams, float], SensorParams]) -> Change:
    def change(of: ViewSettings, size: float, cameras: CameraSettings) -> ViewSettings:
        return replace(of, sensor=make(of.sensor, size))

    return change


def _focal(along_u: float, along_v: float) -> Change:
    def make(true: CameraModel, size: float, _: CameraSettings) -> CameraModel:
        fu, fv = true.focal_length or (math.nan, math.nan)
        return CameraModel(focal_length=(fu * (1 + along_u * size), fv * (1 + along_v * size)))

    return _true(make)


def _lens(index: int) -> Change:
    def make(true: CameraModel, size: float, _: CameraSettings) -> CameraModel:
        coefficients = list(true.distortion or (0.0,) * 5)
        coefficients[index] += size
        k1, k2, p1, p2, k3 = coefficients
        return CameraModel(distortion=(k1, k2, p1, p2, k3))

    return _true(make)


def _moved(axis: int) -> Change:
    def make(true: CameraModel, size: float, _: CameraSettings) -> CameraModel:
        place = list(true.position or (0.0,) * 3)
        place[axis] += size
        right, down, ahead = place
        return CameraModel(position=(right, down, ahead))

    return _true(make)


def _principal_point(true: CameraModel, size: float, _: CameraSettings) -> CameraModel:
    cu, cv = true.principal_point or (math.nan, math.nan)
    return CameraModel(principal_point=(cu + size, cv + size))


def _tilt(true: CameraModel, size: float, _: CameraSettings) -> CameraModel:
    about_u, about_v = true.tilt or (0.0, 0.0)
    return CameraModel(tilt=(about_u + size, about_v + size))


def _aim(true: CameraModel, size: float, cameras: CameraSettings) -> CameraModel:
    """Turn the camera about what it looks at, about its v axis."""
    about_u, about_v = true.tilt or (0.0, 0.0)
    right, down, ahead = true.position or (0.0,) * 3
    sin, cos = math.sin(size), math.cos(size)
    place = (right - cameras.distance * sin, down, ahead + cameras.distance * (1 - cos))
    return CameraModel(tilt=(about_u, about_v + size), position=place)


def _roll(true: CameraModel, size: float, _: CameraSettings) -> CameraModel:
    return CameraModel(roll=(true.roll or 0.0) + size)


def _coarse(of: ViewSettings, size: float, cameras: CameraSettings) -> ViewSettings:
    """Make a pixel larger, as is known."""
    fu, fv = of.true.focal_length or (math.nan, math.nan)
    share = cameras.pixel_size / (cameras.pixel_size + size)
    known = CameraModel(focal_length=(fu * share, fv * share))
    return replace(of, believed=known.over(of.believed), true=known.over(of.true))


def _vignetting(sensor: SensorParams, size: float) -> SensorParams:
    return replace(sensor, vignetting=sensor.vignetting + size)


def _warm(sensor: SensorParams, size: float) -> SensorParams:
    red, green, blue = (
        gain * (1 + size * more) for gain, more in zip(sensor.white_balance, _WARM, strict=True)
    )
    return replace(sensor, white_balance=(red, green, blue))


def _shutter(sensor: SensorParams, size: float) -> SensorParams:
    return replace(sensor, exposure=sensor.exposure + size)


ERRORS: Final[tuple[CameraError, ...]] = (
    CameraError("focal_length", "", 0.3, "focal length", _focal(1.0, 1.0)),
    CameraError("pixel_aspect", "", 0.02, "aspect of the pixels", _focal(0.5, -0.5)),
    CameraError("principal_point", "pixels", 20.0, "principal point", _true(_principal_point)),
    CameraError("distortion", "", -1.25, "distortion k1 of parts on the axis", _lens(0)),
    CameraError(
        name="distortion_off_axis",
        unit="",
        most=-1.25,
        says="distortion k1 of parts off the axis",
        change=_lens(0),
        off_axis=True,
    ),
    CameraError(
        name="higher_distortion_off_axis",
        unit="",
        most=-30.0,
        says="distortion k2 of parts off the axis",
        change=_lens(1),
        off_axis=True,
    ),
    CameraError(
        name="decentring_off_axis",
        unit="",
        most=0.02,
        says="distortion p1 of parts off the axis",
        change=_lens(2),
        off_axis=True,
    ),
    CameraError("position_along", "m", 0.15, "a place nearer to the parts", _moved(2)),
    CameraError("position_across", "m", 0.03, "a place to the right", _moved(0)),
    CameraError("position_down", "m", 0.02, "a place further down", _moved(1)),
    CameraError("tilt_in_place", "rad", 0.05, "tilt in place", _true(_tilt)),
    CameraError("tilt_aimed", "rad", 0.3, "tilt with the aim kept", _true(_aim)),
    CameraError("roll", "rad", 0.15, "roll", _true(_roll)),
    CameraError("vignetting", "", 0.5, "vignetting", _sensor(_vignetting), signed=False),
    CameraError("white_balance", "", 0.2, "warm light", _sensor(_warm)),
    CameraError("shading", "", 0.5, "light from one side", picture=brightness_ramp),
    CameraError("pixel_size", "m", 5e-4, "larger pixels", _coarse, moving=True, signed=False),
    CameraError(
        "exposure", "s", 1 / 80, "an open shutter", _sensor(_shutter), moving=True, signed=False
    ),
    CameraError(
        "latency", "periods", 6.0, "later images", _frames("latency"), moving=True, signed=False
    ),
    CameraError(
        name="latency_of_one",
        unit="periods",
        most=5.0,
        says="later images of one camera",
        change=_frames("latency"),
        views=VIEWS[1:],
        moving=True,
        signed=False,
    ),
    CameraError(
        "period",
        "s",
        1 / 30 - 1 / 80,
        "a longer period",
        _frames("period"),
        moving=True,
        signed=False,
    ),
    CameraError(
        name="period_of_one",
        unit="s",
        most=1 / 30 - 1 / 80,
        says="a longer period of one camera",
        change=_frames("period"),
        views=VIEWS[1:],
        moving=True,
        signed=False,
    ),
    CameraError(
        name="clock_offset",
        unit="s",
        most=1 / 160,
        says="one camera's clock",
        change=_frames("offset"),
        views=VIEWS[1:],
        moving=True,
        signed=False,
    ),
    CameraError(
        "dropped_frames",
        "",
        0.1,
        "dropped frames",
        _frames("miss"),
        moving=True,
        signed=False,
    ),
    CameraError(
        "noise", "grey levels", 8.0, "more noise", _frames("noise"), moving=True, signed=False
    ),
)
