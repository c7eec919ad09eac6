"""The cell's two cameras, believed and true, and their measurements (section 4)."""

import math
from dataclasses import dataclass, field, fields, replace
from typing import Final, Literal, get_args

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import Adder, Gain, MatrixGain, TrajectorySource, ZeroOrderHold
from pydrake.trajectories import PiecewisePolynomial

from chamfer.diagrams.cell.work_cell import ARMS, ArmName, WorkCellScenario
from chamfer.models.cameras.camera import Camera, CameraPlacement, CameraStand, View
from chamfer.models.cameras.camera_model import CameraModel
from chamfer.models.peg.peg_and_hole import ColouredParts
from chamfer.models.validation import ParameterError, require_one_of, within
from chamfer.systems.cameras.camera_image import (
    FrameGrabberParams,
    SensorParams,
    add_frame_grabber,
)
from chamfer.systems.cameras.hand_camera import HandCamera, HandMount
from chamfer.systems.cameras.software_camera import AT_OPENING, SoftwareCamera
from chamfer.systems.cameras.vtk_camera import VtkCamera, missing_graphics
from chamfer.systems.pose import POSE_SIZE
from chamfer.systems.vision.cell_error import (
    AXES,
    CellError,
    CellErrorParams,
    ExpectedError,
    ImageClock,
    ImagePlaneError,
)
from chamfer.systems.vision.hand_sight import HandSight
from chamfer.systems.vision.part_appearance import Appearance, appearances
from chamfer.systems.vision.part_detection import ContinuityParams
from chamfer.systems.vision.part_detector import PartDetector, Undistortion
from chamfer.systems.vision.two_plane_stereo import TwoPlaneStereo

Renderer = Literal["software", "vtk"]
CamerasKind = Literal["pair", "hand", "none"]
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
    """The cameras, the delivery of their images, and the measurement in them."""

    kind: CamerasKind = "pair"
    # pair: two at right angles; hand: one next to the peg that sees the mouth of a hole in a
    # plate; none: the arm goes to the believed position of the hole
    hand: HandMount = HandMount()
    measured: Measured = "image"  # metric: by stereo, with the cameras' believed poses
    frames: FrameGrabberParams = field(default_factory=FrameGrabberParams)
    # of both; their period is also that of the controller
    xz: ViewSettings = ViewSettings()
    xy: ViewSettings = ViewSettings()
    most_misses: int = CellErrorParams.most_misses
    # missed frames of the slower camera in a row; with more the approach stops
    continuity: ContinuityParams = field(default_factory=ContinuityParams)

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "kind", get_args(CamerasKind))
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
        """Return the settings with another camera for a view of :data:`VIEWS`."""
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

    def pixel_scale(self, view: View) -> float:
        """Return the believed size of a straightened image's pixel, over ``pixel_size``.

        At the stand's distance.
        """
        stand = self.placement(view, (0.0, 0.0, 0.0)).camera
        believed = self.view(view).believed.of(stand).straight()
        ahead = (believed.p_WC - stand.p_WC) @ stand.R_WC[:, 2]
        nearer = float(1 - ahead / self.distance)
        return nearer * (stand.focal[0] / believed.focal[0])


def camera_placement(
    settings: CameraSettings, scenario: WorkCellScenario, view: View
) -> CameraPlacement:
    """Return a camera's pose in the hole's axes: it looks at the middle of the gap."""
    x, y, z = (scenario.hole_axes.inverse() @ np.array(scenario.mouth)).tolist()
    return settings.placement(view, (x - scenario.gap / 2, y, z))


def true_camera(settings: CameraSettings, scenario: WorkCellScenario, view: View) -> Camera:
    """Return a camera as it is in the world: right in its image is about into the hole."""
    stand, of = camera_placement(settings, scenario, view).camera, settings.view(view)
    return _in_world(scenario, of.true.over(of.believed).of(stand))


def _in_world(scenario: WorkCellScenario, camera: Camera) -> Camera:
    R_WH = scenario.hole_axes.matrix()
    return camera.placed(R_WH @ camera.R_WC, R_WH @ camera.p_WC)


def believed_camera(settings: CameraSettings, scenario: WorkCellScenario, view: View) -> Camera:
    """Return a camera as it is believed to be, in the hole's axes, in which errors are wanted."""
    return settings.view(view).believed.of(camera_placement(settings, scenario, view).camera)


def resolved_cameras(settings: CameraSettings, scenario: WorkCellScenario) -> CameraSettings:
    """Fill in the open fields of the cameras, from their files if they have any."""
    if settings.kind == "hand":
        with within("cameras.hand"):
            hand = settings.hand.read().of(scenario.parts, scenario.gap)
        frames = ViewFrames(
            **{one.name: getattr(hand.frames, one.name) for one in fields(ViewFrames)}
        )
        view = ViewSettings(frames=frames)
        return replace(settings, hand=hand, xz=view, xy=view)
    xz, xy = (_resolved(settings, scenario, view) for view in VIEWS)
    return replace(settings, xz=xz, xy=xy)


def _resolved(settings: CameraSettings, scenario: WorkCellScenario, view: View) -> ViewSettings:
    given = settings.view(view)
    stand = camera_placement(settings, scenario, view).camera
    in_world = _in_world(scenario, stand)
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


# The axes of which a view tells, as ImagePlaneError takes them.
_SEEN: Final[dict[View, tuple[float, ...]]] = {
    "xz": (1.0, 0.0, 1.0, 1.0, 1.0, 0.0),
    "xy": (0.0, 1.0, 0.0, 0.0, 0.0, 1.0),
}


def add_cell_vision(
    builder: DiagramBuilder,
    scenario: WorkCellScenario,
    settings: CameraSettings,
    *,
    poses: dict[ArmName, OutputPort],
    begin: float,
    tool_pose: OutputPort | None = None,
    desired: dict[ArmName, OutputPort] | None = None,
    parts_there: ColouredParts | None = None,
) -> CellError:
    """Add cameras, detection and the measured error of alignment, pixels and rad in hole's axes.

    Args:
        builder: Where to.
        scenario: The cell.
        settings: The cameras.
        poses: True poses of the tool frames, which the cameras alone see.
        begin: s, before which nothing is compensated.
        tool_pose: Of the peg by its encoders, which a camera in the hand needs.
        desired: Poses, shape (7,), that the tools should have, if they change; by default a peg
            in line with the hole, at the scenario's gap, is what is desired.
        parts_there: What the cameras look at, where it is not what the scenario says it is.
    """
    connect, frames = builder.Connect, settings.frames
    gap = scenario.gap / settings.pixel_size
    clocks = [
        ImageClock(one.period, one.offset, settings.delay(view))
        for view, one in zip(VIEWS, map(settings.frames_of, VIEWS), strict=True)
    ]
    params = CellErrorParams(
        gap=gap,
        most_misses=settings.most_ticks,
        begin=begin,
        period=frames.period,
        latency=(frames.latency + 1) * frames.period,
        images=tuple(clocks),
        continuity=settings.continuity,
    )
    error: CellError = builder.AddNamedSystem("image error", CellError(params))
    there = scenario.parts if parts_there is None else parts_there
    if settings.kind == "hand":
        assert tool_pose is not None
        sight = _add_hand(builder, scenario, settings, poses, tool_pose, there)
        connect(sight.GetOutputPort("hidden"), error.GetInputPort("hidden"))
        measured = sight.GetOutputPort("alignment_error")
    else:
        measured = _add_pair(builder, scenario, settings, poses, begin, there)
    connect(measured, error.GetInputPort("alignment_error"))
    if desired is not None:
        expected = builder.AddNamedSystem(
            "expected error",
            ExpectedError(pixel_size=settings.pixel_size, gap=gap, R_WH=scenario.hole_axes),
        )
        for arm in ARMS:
            connect(desired[arm], expected.GetInputPort(f"{arm}_pose"))
        as_old = _add_delays(builder, settings, expected.get_output_port())
        connect(as_old, error.GetInputPort("expected_error"))
    return error


def _add_pair(
    builder: DiagramBuilder,
    scenario: WorkCellScenario,
    settings: CameraSettings,
    poses: dict[ArmName, OutputPort],
    begin: float,
    there: ColouredParts,
) -> OutputPort:
    """Add two cameras and return the alignment error that they measure."""
    if settings.renderer == "vtk" and (reason := missing_graphics()):
        raise ParameterError("cameras.renderer", "vtk", f"software here: {reason}")
    trigger = _add_trigger(builder, settings, begin)
    detectors = [
        _add_camera(builder, scenario, settings, view, poses, trigger, there) for view in VIEWS
    ]
    return _add_measurement(builder, scenario, settings, detectors)


def _add_hand(
    builder: DiagramBuilder,
    scenario: WorkCellScenario,
    settings: CameraSettings,
    poses: dict[ArmName, OutputPort],
    tool_pose: OutputPort,
    there: ColouredParts,
) -> HandSight:
    """Add the camera in the hand, and what sees the mouth in its images."""
    hand, gap, connect = settings.hand, scenario.gap, builder.Connect
    camera = builder.AddNamedSystem("hand camera", HandCamera(there, hand, gap))
    for arm, pose in poses.items():
        connect(pose, camera.GetInputPort(f"{arm}_pose"))
    frames = add_frame_grabber(builder, hand.frames, "hand frames", hand.width, hand.height)
    sight: HandSight = builder.AddNamedSystem(
        "hand sight",
        HandSight(
            scenario.parts,
            hand,
            gap=gap,
            X_WM=scenario.nominal_pose("hole"),
            pixel_size=settings.pixel_size,
        ),
    )
    connect(camera.get_output_port(), frames.GetInputPort("image"))
    connect(frames.get_output_port(), sight.GetInputPort("image"))
    connect(tool_pose, sight.GetInputPort("tool_pose"))
    connect(sight.GetOutputPort("looks"), frames.GetInputPort("trigger"))
    return sight


def looks_in(
    settings: CameraSettings, scenario: WorkCellScenario, view: View
) -> tuple[Appearance, Appearance]:
    """Return the appearance of peg and hole part in a camera's straightened images."""
    with within("parts"):
        pixel = settings.pixel_size * settings.pixel_scale(view)
        return appearances(scenario.parts, pixel, settings.distance)


def undistortion_of(
    settings: CameraSettings, scenario: WorkCellScenario, view: View
) -> Undistortion | None:
    """Return the straightening of a camera's images; None if they are believed to be straight."""
    return Undistortion.of(believed_camera(settings, scenario, view))


def _add_trigger(
    builder: DiagramBuilder, settings: CameraSettings, begin: float
) -> OutputPort | None:
    """Add what lets nobody draw images that nobody looks at; None if all are looked at."""
    of_views = [settings.frames_of(view) for view in VIEWS]
    first = begin - max((frames.latency + 2) * frames.period for frames in of_views)
    if first <= 0:
        return None
    looks = PiecewisePolynomial.ZeroOrderHold([0.0, first, begin], np.array([[0.0, 1.0, 1.0]]))
    return builder.AddNamedSystem("trigger", TrajectorySource(looks)).get_output_port()


def _add_delays(
    builder: DiagramBuilder, settings: CameraSettings, expected: OutputPort
) -> OutputPort:
    """Add what makes the expected error as old as the images at every instant."""
    xz, xy = (settings.frames_of(view) for view in VIEWS)
    open_xz, open_xy = (settings.view(view).sensor.exposure for view in VIEWS)
    if (xz.period, xz.offset, xz.latency, open_xz) == (xy.period, xy.offset, xy.latency, open_xy):
        return _add_delay(builder, xz, open_xz, expected, "expected")
    both = builder.AddNamedSystem("expected of both", Adder(2, len(AXES)))
    for i, view in enumerate(VIEWS):
        name, exposure = f"expected of {view}", settings.view(view).sensor.exposure
        seen = builder.AddNamedSystem(name, MatrixGain(np.diag(_SEEN[view])))
        builder.Connect(expected, seen.get_input_port())
        frames, of_view = settings.frames_of(view), seen.get_output_port()
        as_old = _add_delay(builder, frames, exposure, of_view, name)
        builder.Connect(as_old, both.get_input_port(i))
    return both.get_output_port()


def _add_delay(
    builder: DiagramBuilder,
    frames: FrameGrabberParams,
    exposure: float,
    expected: OutputPort,
    name: str,
) -> OutputPort:
    if exposure:
        # A blurred image shows the middle of its exposure.
        middle = (frames.offset - exposure / 2) % frames.period
        hold = ZeroOrderHold(frames.period, len(AXES), middle)
        expected = _held(builder, f"{name}, half exposed", hold, expected)
    # The first hold exposes; what follows samples what was held just before the instant.
    for k in range(frames.latency + 1):
        hold = ZeroOrderHold(frames.period, len(AXES), frames.offset)
        expected = _held(builder, f"{name}, {k} periods old", hold, expected)
    return expected


def _held(
    builder: DiagramBuilder, name: str, hold: ZeroOrderHold, value: OutputPort
) -> OutputPort:
    hold = builder.AddNamedSystem(name, hold)
    builder.Connect(value, hold.get_input_port())
    return hold.get_output_port()


def _add_measurement(
    builder: DiagramBuilder,
    scenario: WorkCellScenario,
    settings: CameraSettings,
    detectors: list[PartDetector],
) -> OutputPort:
    if settings.measured == "image":
        planes = builder.AddNamedSystem("both image planes", ImagePlaneError())
        for view, detector in zip(VIEWS, detectors, strict=True):
            seen = detector.GetOutputPort("alignment_error")
            scale = settings.pixel_scale(view)
            if scale != 1.0:
                # Pixels of different sizes are made alike.
                sizes = builder.AddNamedSystem(f"{view} pixels", Gain([scale, scale, 1.0]))
                builder.Connect(seen, sizes.get_input_port())
                seen = sizes.get_output_port()
            builder.Connect(seen, planes.GetInputPort(f"{view}_error"))
        return planes.GetOutputPort("alignment_error")
    xz, xy = (believed_camera(settings, scenario, view) for view in VIEWS)
    xz, xy = xz.straight(), xy.straight()  # as detections are reported
    stereo = builder.AddNamedSystem("two-plane stereo", TwoPlaneStereo(xz, xy))
    for view, detector in zip(VIEWS, detectors, strict=True):
        seen = detector.GetOutputPort("detections")
        builder.Connect(seen, stereo.GetInputPort(f"detections_{view}"))
    pixels = 1 / settings.pixel_size
    # Element by element: a matrix would spread one NaN to all axes.
    scale = builder.AddNamedSystem("metres to pixels", Gain([pixels] * 3 + [1.0] * 3))
    builder.Connect(stereo.GetOutputPort("alignment_error"), scale.get_input_port())
    return scale.get_output_port()


def _add_camera(
    builder: DiagramBuilder,
    scenario: WorkCellScenario,
    settings: CameraSettings,
    view: View,
    poses: dict[ArmName, OutputPort],
    trigger: OutputPort | None,
    parts_there: ColouredParts,
) -> PartDetector:
    camera = true_camera(settings, scenario, view)
    source: LeafSystem
    if settings.renderer == "software":
        source = SoftwareCamera(parts_there, camera, sensor=settings.view(view).sensor)
    else:
        source = VtkCamera(parts_there, camera)
    builder.AddNamedSystem(f"{view} camera", source)
    for arm, pose in poses.items():
        builder.Connect(pose, source.GetInputPort(f"{arm}_pose"))
    params = settings.frames_of(view)
    _add_shutter(builder, settings, view, poses, source)
    frames = add_frame_grabber(builder, params, f"{view} frames", camera.width, camera.height)
    builder.Connect(source.GetOutputPort("image"), frames.GetInputPort("image"))
    if trigger is not None:
        builder.Connect(trigger, frames.GetInputPort("trigger"))
    straighten = undistortion_of(settings, scenario, view)
    detector = PartDetector(*looks_in(settings, scenario, view), straighten)
    builder.AddNamedSystem(f"{view} detection", detector)
    builder.Connect(frames.get_output_port(), detector.get_input_port())
    return detector


def _add_shutter(
    builder: DiagramBuilder,
    settings: CameraSettings,
    view: View,
    poses: dict[ArmName, OutputPort],
    source: LeafSystem,
) -> None:
    """Add what tells a camera where the parts were when its shutter opened."""
    frames, exposure = settings.frames_of(view), settings.view(view).sensor.exposure
    if not exposure:
        return
    opens = (frames.offset - exposure) % frames.period
    if math.isclose(exposure, frames.period):
        opens = frames.offset  # no rounding before it, or the frame would show what follows it
    for arm, pose in poses.items():
        hold = ZeroOrderHold(frames.period, POSE_SIZE, opens)
        at_opening = _held(builder, f"{arm} as the {view} shutter opens", hold, pose)
        builder.Connect(at_opening, source.GetInputPort(f"{arm}_pose{AT_OPENING}"))
