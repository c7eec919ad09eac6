"""What the alignment by sight is: the arms, the cameras, and what is made of what they see."""

import math
from dataclasses import dataclass, field, replace
from typing import ClassVar, Final, Literal, get_args

from chamfer.diagrams.cell.cell_cameras import CameraSettings, true_camera
from chamfer.diagrams.cell.six_axis_settings import SixAxisPid, SixAxisSettings
from chamfer.diagrams.cell.work_cell import HOLE_ARM, HoleSettings, WorkCellScenario
from chamfer.models.cameras.camera import Camera, View
from chamfer.models.peg.peg_and_hole import OF_CONTACT, ColouredParts
from chamfer.models.validation import (
    ParameterError,
    require_one_of,
    require_positive,
    require_same,
)
from chamfer.systems.force.arm_model import Vector3
from chamfer.systems.force.impedance_controller import ImpedanceControllerParams

_LONGEST: Final = 3600.0  # s, what a run may be asked for
_OF_ONE_ARM: Final = ("peg", "none")  # what may be compensated where the hole is a fixture

Compensated = Literal["peg", "hole", "both", "none"]
ControllerKind = Literal["fsm", "pid"]


@dataclass(frozen=True, kw_only=True)
class ControllerChoice:
    """What makes compensation of the cameras' errors."""

    kind: ControllerKind = "fsm"  # the state machine of compensator.*, or the PID laws of pid.*

    def __post_init__(self) -> None:
        require_one_of(self, "kind", get_args(ControllerKind))


@dataclass(frozen=True, kw_only=True)
class AlignmentScenario(WorkCellScenario):
    """The arms hold the parts at a distance, and the cameras align them (Figs. 12 to 14)."""

    compensated: Compensated | None = None
    # which arm takes the compensation; None: both, section 5, or what there is of them
    controller: ControllerChoice = ControllerChoice()
    cameras: CameraSettings = field(default_factory=CameraSettings)
    compensator: SixAxisSettings = field(default_factory=SixAxisSettings)
    pid: SixAxisPid = field(default_factory=SixAxisPid)
    initial_error: tuple[float, ...] = (0.0, 0.006, -0.008, 0.0, 0.05, -0.06)
    # m and rad, of the peg's commanded pose, as errors of the kinematic model make it, along and
    # about the hole's axes; assumed
    start_offset: Vector3 = (0.0, 0.0, 0.0)  # m, likewise, from the peg's goal to where it starts
    motion_time: float = 2.0  # s, from there to the goal
    begin: float = 1.5  # s, of the compensation; until then impedance control alone
    compensation_time: float = 2.5  # s, how long the compensation lasts; section 5
    UNUSED_OF_PARTS: ClassVar[tuple[str, ...]] = OF_CONTACT

    def __post_init__(self) -> None:
        super().__post_init__()
        require_same(
            self.parts, ColouredParts, "parts", *self.UNUSED_OF_PARTS, why="the parts don't touch"
        )
        if self.compensated is not None:
            choices = get_args(Compensated) if self.hole.kind == "arm" else _OF_ONE_ARM
            require_one_of(self, "compensated", choices)
        require_positive(self, "begin", "compensation_time", "motion_time", most=_LONGEST)
        for name, size in (("initial_error", 6), ("start_offset", 3)):
            value = getattr(self, name)
            if len(value) != size or not all(map(math.isfinite, value)):
                raise ParameterError(name, value, f"{size} finite numbers")

    @property
    def duration(self) -> float:
        """When the run ends, s."""
        return self.begin + self.compensation_time

    @property
    def moves(self) -> bool:
        """Whether the peg has a way to go."""
        return any(self.start_offset)

    def camera(self, view: View) -> Camera:
        """Return a camera as it is: it looks at the gap, at about a plane of the hole's axes."""
        return true_camera(self.cameras, self, view)


@dataclass(frozen=True, kw_only=True)
class VerticalTrackingScenario(AlignmentScenario):
    """The peg's tip goes up to the hole's height, 10 cm away from it (Fig. 11).

    The way is not published: assumed.
    """

    compensated: Compensated | None = "peg"
    hole: HoleSettings = replace(HOLE_ARM, payload_error=0.0)  # exactly at the height, section 5
    impedance: ImpedanceControllerParams = field(
        default_factory=lambda: ImpedanceControllerParams(stiffness=(700.0, 700.0, 700.0))
    )  # about 700 N/m, section 5
    gap: float = 0.1  # m, section 5
    initial_error: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
    start_offset: Vector3 = (0.0, 0.0, -0.03)
    begin: float = 0.1
    compensation_time: float = 3.9

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.axis != "horizontal":
            allowed = "horizontal, for a peg that goes up to the height of the hole"
            raise ParameterError("axis", self.axis, allowed)
