"""The cell's two cameras and what is made of their images (section 4)."""

from dataclasses import dataclass, field
from typing import Final, Literal, get_args

import numpy as np
from pydrake.systems.framework import DiagramBuilder, LeafSystem, OutputPort
from pydrake.systems.primitives import DiscreteTimeDelay, Gain, TrajectorySource, ZeroOrderHold
from pydrake.trajectories import PiecewisePolynomial

from diagrams.cell.work_cell import ARMS, ArmName, WorkCellScenario
from models.camera import Camera, CameraPlacement, CameraStand, View
from models.peg_and_hole import ColouredParts
from models.validation import ParameterError, require_one_of, within
from systems.vision.camera_image import FrameGrabberParams, add_frame_grabber
from systems.vision.cell_error import CellError, CellErrorParams
from systems.vision.expected_error import ExpectedError
from systems.vision.image_plane_error import AXES, ImagePlaneError
from systems.vision.part_appearance import appearances
from systems.vision.part_detector import PartDetector
from systems.vision.software_camera import SoftwareCamera
from systems.vision.two_plane_stereo import TwoPlaneStereo
from systems.vision.vtk_camera import VtkCamera, missing_graphics

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
class CameraSettings(CellCameras):
    """The two cameras, what delivers their images, and what is measured in them."""

    measured: Measured = "image"  # metric: by stereo, with the cameras' places known
    frames: FrameGrabberParams = field(default_factory=FrameGrabberParams)
    most_misses: int = CellErrorParams.most_misses  # in a row, more and the approach stops

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "measured", get_args(Measured))


def camera_placement(
    settings: CameraSettings, scenario: WorkCellScenario, view: View
) -> CameraPlacement:
    """Return where a camera stands in the hole's axes: it looks at the middle of the gap."""
    x, y, z = (scenario.hole_axes.inverse() @ np.array(scenario.mouth)).tolist()
    return settings.placement(view, (x - scenario.gap / 2, y, z))


def cell_camera(settings: CameraSettings, scenario: WorkCellScenario, view: View) -> Camera:
    """Return that camera in the world: right in its image is into the hole."""
    camera, R_WH = camera_placement(settings, scenario, view).camera, scenario.hole_axes.matrix()
    return camera.placed(R_WH @ camera.R_WC, R_WH @ camera.p_WC)


def add_cell_vision(
    builder: DiagramBuilder,
    scenario: WorkCellScenario,
    settings: CameraSettings,
    *,
    poses: dict[ArmName, OutputPort],
    begin: float,
    desired: dict[ArmName, OutputPort] | None = None,
    parts_there: ColouredParts | None = None,
) -> CellError:
    """Add cameras, detection and the error of the parts' alignment.

    Args:
        builder: Where to.
        scenario: The cell.
        settings: The cameras.
        poses: True poses of the tool frames, which the cameras alone see.
        begin: s, before which nothing is compensated.
        desired: Poses, shape (7,), that the tools should have, if they change; by default a peg
            in line with the hole, at the scenario's gap, is what is desired.
        parts_there: What the cameras look at, where it is not what the scenario says it is.

    Returns:
        The block whose outputs are the measured error, in pixels and rad along and about the
        hole's axes, and its age.
    """
    connect = builder.Connect
    gap = scenario.gap / settings.pixel_size
    error: CellError = builder.AddNamedSystem(
        "image error",
        CellError(
            CellErrorParams(
                gap=gap,
                most_misses=settings.most_misses,
                begin=begin,
                period=settings.frames.period,
            )
        ),
    )
    if settings.renderer == "vtk" and (reason := missing_graphics()):
        raise ParameterError("cameras.renderer", "vtk", f"software here: {reason}")
    trigger = _add_trigger(builder, settings.frames, begin)
    there = scenario.parts if parts_there is None else parts_there
    detectors = [
        _add_camera(builder, scenario, settings, view, poses, trigger, there) for view in VIEWS
    ]
    measured = _add_measurement(builder, scenario, settings, detectors)
    connect(measured, error.GetInputPort("alignment_error"))
    if desired is not None:
        expected = builder.AddNamedSystem(
            "expected error",
            ExpectedError(pixel_size=settings.pixel_size, gap=gap, R_WH=scenario.hole_axes),
        )
        for arm in ARMS:
            connect(desired[arm], expected.GetInputPort(f"{arm}_pose"))
        as_old = _add_delay(builder, settings.frames, expected.get_output_port())
        connect(as_old, error.GetInputPort("expected_error"))
    return error


def _add_trigger(
    builder: DiagramBuilder, frames: FrameGrabberParams, begin: float
) -> OutputPort | None:
    """Add what lets nobody draw images that nobody looks at; None if all are looked at."""
    first = begin - (frames.latency + 2) * frames.period
    if first <= 0:
        return None
    looks = PiecewisePolynomial.ZeroOrderHold([0.0, first, begin], np.array([[0.0, 1.0, 1.0]]))
    return builder.AddNamedSystem("trigger", TrajectorySource(looks)).get_output_port()


def _add_delay(
    builder: DiagramBuilder, frames: FrameGrabberParams, expected: OutputPort
) -> OutputPort:
    """Add what makes the expected error as old as the images at every instant."""
    hold = builder.AddNamedSystem(
        "expected when exposed", ZeroOrderHold(frames.period, len(AXES), frames.offset)
    )
    builder.Connect(expected, hold.get_input_port())
    if not frames.latency:
        return hold.get_output_port()
    # It samples what was held just before the instant, so that 0 steps are a delay already.
    delay = builder.AddNamedSystem(
        "expected when delivered",
        DiscreteTimeDelay(frames.period, frames.latency - 1, len(AXES)),
    )
    builder.Connect(hold.get_output_port(), delay.get_input_port())
    return delay.get_output_port()


def _add_measurement(
    builder: DiagramBuilder,
    scenario: WorkCellScenario,
    settings: CameraSettings,
    detectors: list[PartDetector],
) -> OutputPort:
    if settings.measured == "image":
        planes = builder.AddNamedSystem("both image planes", ImagePlaneError())
        for view, detector in zip(VIEWS, detectors, strict=True):
            builder.Connect(
                detector.GetOutputPort("alignment_error"), planes.GetInputPort(f"{view}_error")
            )
        return planes.GetOutputPort("alignment_error")
    # In the hole's axes, in which the error is wanted.
    xz, xy = (camera_placement(settings, scenario, view).camera for view in VIEWS)
    stereo = builder.AddNamedSystem("two-plane stereo", TwoPlaneStereo(xz, xy))
    for view, detector in zip(VIEWS, detectors, strict=True):
        builder.Connect(
            detector.GetOutputPort("detections"), stereo.GetInputPort(f"detections_{view}")
        )
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
    camera = cell_camera(settings, scenario, view)
    kind: type[SoftwareCamera | VtkCamera] = (
        SoftwareCamera if settings.renderer == "software" else VtkCamera
    )
    source: LeafSystem = builder.AddNamedSystem(f"{view} camera", kind(parts_there, camera))
    for arm, pose in poses.items():
        builder.Connect(pose, source.GetInputPort(f"{arm}_pose"))
    frames = add_frame_grabber(builder, settings.frames, f"{view} frames")
    builder.Connect(source.GetOutputPort("image"), frames.GetInputPort("image"))
    if trigger is not None:
        builder.Connect(trigger, frames.GetInputPort("trigger"))
    with within("parts"):
        looks = appearances(scenario.parts, settings.pixel_size)
    detector: PartDetector = builder.AddNamedSystem(f"{view} detection", PartDetector(*looks))
    builder.Connect(frames.get_output_port(), detector.get_input_port())
    return detector
