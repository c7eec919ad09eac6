"""The two arms align the parts by sight: cameras, compensator, impedance control (section 5)."""

from dataclasses import dataclass, field
from typing import Final, Literal

import numpy as np
from pydrake.common import RandomDistribution
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import ConstantVectorSource, RandomSource

from diagrams.work_cell import ARMS, ArmName, WorkCellScenario, add_work_cell
from models.camera import CameraPlacement, View
from models.validation import ParameterError, require_one_of, require_positive
from systems.force.compensated_pose import CompensatedPose, compensate
from systems.servo.compensator import AxisParams, CompensatorParams, TrajectoryCompensator
from systems.vision.camera_image import FrameGrabber, FrameGrabberParams
from systems.vision.cell_error import CellError, CellErrorParams
from systems.vision.part_detector import PartDetector
from systems.vision.part_poses import pose_vector
from systems.vision.software_camera import SoftwareCamera

Compensated = Literal["peg", "hole", "both", "none"]

VIEWS: Final[tuple[View, ...]] = ("xz", "xy")
_SHARES: Final[dict[Compensated, dict[ArmName, float]]] = {
    "peg": {"peg": 1.0, "hole": 0.0},
    "hole": {"peg": 0.0, "hole": -1.0},
    "both": {"peg": 0.5, "hole": -0.5},
    "none": {"peg": 0.0, "hole": 0.0},
}


@dataclass(frozen=True, kw_only=True)
class CameraSettings:
    """The two cameras and what delivers their images."""

    distance: float = 0.5  # m, from the parts; assumed
    pixel_size: float = 0.0005  # m, at the parts; assumed
    roll: float = 0.1  # rad, about the optical axes; assumed
    frames: FrameGrabberParams = field(default_factory=FrameGrabberParams)


@dataclass(frozen=True, kw_only=True)
class SixAxisSettings:
    """The compensator's elements: errors in pixels or rad, increments in m or rad."""

    lateral: AxisParams = field(
        default_factory=lambda: AxisParams(
            dead_zone=0.5, large_error=6.0, increment=1.5e-4, limit=0.03
        )
    )
    rotational: AxisParams = field(
        default_factory=lambda: AxisParams(
            dead_zone=0.0015, large_error=0.02, increment=4e-3, limit=0.3
        )
    )
    most_misses: int = 4  # in a row, more and the approach stops; assumed

    @property
    def axes(self) -> tuple[AxisParams, ...]:
        """The six elements in the order of :data:`systems.vision.cell_error.AXES`."""
        return (self.lateral,) * 3 + (self.rotational,) * 3


@dataclass(frozen=True, kw_only=True)
class AlignmentScenario(WorkCellScenario):
    """The arms hold the parts at a distance, and the cameras align them (Figs. 12 to 14)."""

    compensated: Compensated = "peg"  # which arm takes the compensation
    cameras: CameraSettings = field(default_factory=CameraSettings)
    compensator: SixAxisSettings = field(default_factory=SixAxisSettings)
    initial_error: tuple[float, ...] = (0.0, 0.006, -0.008, 0.0, 0.05, -0.06)
    # m and rad, of the peg's commanded pose, as errors of the kinematic model make it; assumed
    begin: float = 1.5  # s, of the compensation; until then impedance control alone
    compensation_time: float = 2.5  # s, section 5

    def __post_init__(self) -> None:
        super().__post_init__()
        require_one_of(self, "compensated", tuple(_SHARES))
        require_positive(self, "begin", "compensation_time")
        if len(self.initial_error) != 6 or not np.all(np.isfinite(self.initial_error)):
            raise ParameterError("initial_error", self.initial_error, "six finite numbers")

    @property
    def duration(self) -> float:
        """When the run ends, s."""
        return self.begin + self.compensation_time

    def placement(self, view: View) -> CameraPlacement:
        """Return where a camera stands: it looks at the middle of the gap."""
        x, y, z = self.meeting_point
        given = self.cameras
        return CameraPlacement(
            view=view,
            target=(x - self.gap / 2, y, z),
            distance=given.distance,
            pixel_size=given.pixel_size,
            roll=given.roll,
        )


def make_alignment_diagram(scenario: AlignmentScenario) -> Diagram:
    """Return the work cell with the vision loop closed (Fig. 10).

    Outputs: ``<arm>.true_pose``, ``<arm>.tool_pose``, ``<arm>.command``, ``<arm>.saturated``; of
    the vision ``error`` (pixels and rad), ``valid``, ``age`` and ``blind``; ``compensation`` (m
    and rad, world axes, of the peg relative to the hole).
    """
    builder = DiagramBuilder()
    connect = builder.Connect
    cell = add_work_cell(builder, scenario)
    period = scenario.cameras.frames.period
    error = builder.AddNamedSystem(
        "image error",
        CellError(
            CellErrorParams(
                gap=scenario.gap / scenario.cameras.pixel_size,
                most_misses=scenario.compensator.most_misses,
                begin=scenario.begin,
                period=period,
            )
        ),
    )
    for view in VIEWS:
        detector = _add_camera(
            builder,
            scenario,
            view,
            {arm: cell.arms[arm].true_pose for arm in ARMS},
        )
        connect(detector.GetOutputPort("alignment_error"), error.GetInputPort(f"{view}_error"))
    compensator = builder.AddNamedSystem(
        "trajectory compensator",
        TrajectoryCompensator(CompensatorParams(axes=scenario.compensator.axes, period=period)),
    )
    connect(error.GetOutputPort("error"), compensator.GetInputPort("error"))
    connect(error.GetOutputPort("valid"), compensator.GetInputPort("valid"))
    compensation = compensator.GetOutputPort("compensation")
    for arm in ARMS:
        ports = cell.arms[arm]
        goal = pose_vector(scenario.nominal_pose(arm))
        if arm == "peg":
            goal = compensate(goal, np.array(scenario.initial_error))
        desired = builder.AddNamedSystem(f"{arm} desired pose", ConstantVectorSource(goal))
        command = builder.AddNamedSystem(
            f"{arm} command", CompensatedPose(_SHARES[scenario.compensated][arm])
        )
        connect(desired.get_output_port(), command.GetInputPort("desired_pose"))
        connect(compensation, command.GetInputPort("compensation"))
        connect(command.get_output_port(), ports.desired_pose)
        builder.ExportOutput(command.get_output_port(), f"{arm}.command")
        for name in ("true_pose", "tool_pose", "saturated"):
            builder.ExportOutput(getattr(ports, name), f"{arm}.{name}")
    for name in ("error", "valid", "age", "blind"):
        builder.ExportOutput(error.GetOutputPort(name), name)
    builder.ExportOutput(compensation, "compensation")
    diagram = builder.Build()
    diagram.set_name("Alignment by sight")
    return diagram


def _add_camera(
    builder: DiagramBuilder,
    scenario: AlignmentScenario,
    view: View,
    poses: dict[ArmName, OutputPort],
) -> PartDetector:
    camera = builder.AddNamedSystem(
        f"{view} camera", SoftwareCamera(scenario.placement(view).camera)
    )
    frames = builder.AddNamedSystem(f"{view} frames", FrameGrabber(scenario.cameras.frames))
    detector: PartDetector = builder.AddNamedSystem(f"{view} detection", PartDetector())
    for arm, pose in poses.items():
        builder.Connect(pose, camera.GetInputPort(f"{arm}_pose"))
    builder.Connect(camera.get_output_port(), frames.GetInputPort("image"))
    if scenario.cameras.frames.noise or scenario.cameras.frames.miss:
        noise = builder.AddNamedSystem(
            f"{view} noise",
            RandomSource(RandomDistribution.kUniform, 2, scenario.cameras.frames.period),
        )
        builder.Connect(noise.get_output_port(), frames.GetInputPort("random"))
    builder.Connect(frames.get_output_port(), detector.get_input_port())
    return detector
