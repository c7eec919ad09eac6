"""What the cell's two cameras are: as they stand, as they are believed to be, as they are."""

import math
from dataclasses import dataclass, field, fields, replace
from typing import Final, Literal, get_args

import numpy as np

from chamfer.diagrams.cell.work_cell import WorkCellScenario
from chamfer.models.cameras.camera import Camera, CameraPlacement, CameraStand, View
from chamfer.models.cameras.camera_model import CameraModel
from chamfer.models.validation import ParameterError, require_one_of, within
from chamfer.systems.cameras.camera_image import FrameGrabberParams, SensorParams
from chamfer.systems.vision.cell_error import CellErrorParams
from chamfer.systems.vision.continuity import ContinuityParams

Renderer = Literal["software", "vtk"]
Measured = Literal["image", "metric"]

VIEWS: Final[tuple[View, ...]] = ("xz", "xy")


@dataclass(frozen=True, kw_only=True)
class CellCameras(CameraStand):
    """The two cameras."""

    renderer: Renderer = "software"  # vtk needs OpenGL

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "renderer", get_args(Renderer))


@dataclass(frozen=True, kw_only=True)
class ViewFrames:
    """When one camera takes its frames, and how they arrive; None: as those of both."""

    period: float | None = None  # s, between exposures
    offset: float | None = None  # s, of the first exposure
    latency: int | None = None  # of an image, in its periods from the exposure to its arrival
    noise: float | None = None  # grey levels, standard deviation
    miss: float | None = None  # probability that a frame is dropped

    def of(self, both: FrameGrabberParams) -> FrameGrabberParams:
        """Return the camera's frames, given those of both."""
        given = {one.name: getattr(self, one.name) for one in fields(self)}
        return replace(both, **{name: value for name, value in given.items() if value is not None})


@dataclass(frozen=True, kw_only=True)
class ViewSettings:
    """One of the cameras.

    What is open of ``believed`` is as the camera stands, and what is open of ``true`` as
    ``believed``. Only images are of the true one. From the believed one are the metric
    measurement, what straightens the images if it is believed to bend them or to have pixels that
    are not square, and, in the images, the size of a pixel.
    """

    believed: CameraModel = CameraModel()
    true: CameraModel = CameraModel()
    frames: ViewFrames = ViewFrames()
    sensor: SensorParams = SensorParams()


@dataclass(frozen=True, kw_only=True)
class CameraSettings(CellCameras):
    """The two cameras, what delivers their images, and what is measured in them."""

    measured: Measured = "image"  # metric: by stereo, with the cameras' places known
    frames: FrameGrabberParams = field(default_factory=FrameGrabberParams)
    # of both; at its period the controller ticks
    xz: ViewSettings = ViewSettings()
    xy: ViewSettings = ViewSettings()
    most_misses: int = CellErrorParams.most_misses
    # of the slower camera's frames in a row; more and the approach stops
    continuity: ContinuityParams = field(default_factory=ContinuityParams)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "measured", get_args(Measured))
        for view in VIEWS:
            with within(f"{view}.frames"):
                period = self.frames_of(view).period
            sensor = self.view(view).sensor
            if sensor.exposure > period:
                allowed = f"at most the camera's period, {period:g} s"
                raise ParameterError(f"{view}.sensor.exposure", sensor.exposure, allowed)
            if self.renderer == "vtk":
                for name in ("exposure", "vignetting", "white_balance"):
                    value, zero = getattr(sensor, name), getattr(SensorParams, name)
                    if value != zero:
                        allowed = f"{zero}: vtk can't draw it"
                        raise ParameterError(f"{view}.sensor.{name}", value, allowed)

    def view(self, view: View) -> ViewSettings:
        """Return one of the cameras."""
        settings: ViewSettings = getattr(self, view)
        return settings

    def with_view(self, view: View, camera: ViewSettings) -> "CameraSettings":
        """Return the same with another camera for a view of :data:`VIEWS`."""
        return replace(self, xz=camera) if view == "xz" else replace(self, xy=camera)

    def frames_of(self, view: View) -> FrameGrabberParams:
        """Return how the frames of one camera are taken and arrive."""
        return self.view(view).frames.of(self.frames)

    @property
    def most_ticks(self) -> int:
        """Of the controller in a row, without a measurement while frames are dropped."""
        slowest = max(self.frames_of(view).period for view in VIEWS)
        return math.ceil(self.most_misses * slowest / self.frames.period - 1e-6)

    def delay(self, view: View) -> float:
        """Return how old the middle of a camera's exposure is when its image arrives, s."""
        frames = self.frames_of(view)
        return frames.latency * frames.period + self.view(view).sensor.exposure / 2

    def believed(self, view: View, camera: Camera) -> Camera:
        """Return a camera that stands like another one as it is believed to be."""
        return self.view(view).believed.of(camera)

    def true(self, view: View, camera: Camera) -> Camera:
        """Return it as it is."""
        of = self.view(view)
        return of.true.over(of.believed).of(camera)

    def pixel_scale(self, view: View) -> float:
        """Return the believed size of a straightened image's pixel, over ``pixel_size``.

        At the stand's distance.
        """
        stand = self.placement(view, (0.0, 0.0, 0.0)).camera
        believed = self.believed(view, stand).straight()
        ahead = (believed.p_WC - stand.p_WC) @ stand.R_WC[:, 2]
        nearer = float(1 - ahead / self.distance)
        return nearer * (stand.focal[0] / believed.focal[0])


def camera_placement(
    settings: CameraSettings, scenario: WorkCellScenario, view: View
) -> CameraPlacement:
    """Return where a camera stands in the hole's axes: it looks at the middle of the gap."""
    x, y, z = (scenario.hole_axes.inverse() @ np.array(scenario.mouth)).tolist()
    return settings.placement(view, (x - scenario.gap / 2, y, z))


def true_camera(settings: CameraSettings, scenario: WorkCellScenario, view: View) -> Camera:
    """Return a camera as it is in the world: right in its image is about into the hole."""
    stand = camera_placement(settings, scenario, view).camera
    camera, R_WH = settings.true(view, stand), scenario.hole_axes.matrix()
    return camera.placed(R_WH @ camera.R_WC, R_WH @ camera.p_WC)


def believed_camera(settings: CameraSettings, scenario: WorkCellScenario, view: View) -> Camera:
    """Return a camera as it is believed to be, in the hole's axes, in which errors are wanted."""
    return settings.believed(view, camera_placement(settings, scenario, view).camera)


def resolved_cameras(settings: CameraSettings, scenario: WorkCellScenario) -> CameraSettings:
    """Fill in what is open of the cameras, from their files if they have any.

    Raises:
        ParameterError: If a file can't be read, the renderer can't draw a camera, or one that is
            believed is beyond what it looks at.
    """
    xz, xy = (_resolved(settings, scenario, view) for view in VIEWS)
    return replace(settings, xz=xz, xy=xy)


def _resolved(settings: CameraSettings, scenario: WorkCellScenario, view: View) -> ViewSettings:
    given = settings.view(view)
    stand = camera_placement(settings, scenario, view).camera
    R_WH = scenario.hole_axes.matrix()
    in_world = stand.placed(R_WH @ stand.R_WC, R_WH @ stand.p_WC)
    models = {}
    for name in ("believed", "true"):
        with within(f"cameras.{view}.{name}"):
            models[name] = getattr(given, name).read(in_world)
    believed: CameraModel = models["believed"].over(CameraModel.like(stand))
    true: CameraModel = models["true"].over(believed)
    with within(f"cameras.{view}.believed"):
        believed.of(stand).straight()
    if settings.renderer == "vtk" and any(true.distortion or ()):
        allowed = "all 0: vtk can't draw it"
        raise ParameterError(f"cameras.{view}.true.distortion", true.distortion, allowed)
    if not (believed.position or (0, 0, 0))[2] < settings.distance:
        allowed = f"less than the distance, {settings.distance:g} m, ahead"
        raise ParameterError(f"cameras.{view}.believed.position", believed.position, allowed)
    frames = settings.frames_of(view)
    known = {one.name: getattr(frames, one.name) for one in fields(ViewFrames)}
    return replace(given, believed=believed, true=true, frames=ViewFrames(**known))
