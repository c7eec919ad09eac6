"""The scenario of the alignment by vision: arms, cameras, controllers and valid starts."""

from collections.abc import Iterator
from dataclasses import dataclass, field, fields, replace
from typing import Any, ClassVar, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray
from pydrake.math import RigidTransform

from chamfer.diagrams.cell.cell_vision import (
    VIEWS,
    CameraSettings,
    believed_camera,
    camera_placement,
    true_camera,
)
from chamfer.diagrams.cell.work_cell import HOLE_ARM, ArmName, WorkCellScenario
from chamfer.models.cameras.camera import Camera, View
from chamfer.models.cameras.camera_model import CameraModel
from chamfer.models.peg.part_surfaces import require_apart, rings
from chamfer.models.peg.peg_and_hole import OF_CONTACT, ColouredParts, PegAndHole
from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_numbers,
    require_one_of,
    require_positive,
    require_same,
)
from chamfer.systems.force.arm_model import Vector3
from chamfer.systems.force.impedance_law import ImpedanceControllerParams
from chamfer.systems.force.tool_pose import compensate
from chamfer.systems.pose import pose_from_vector, pose_vector
from chamfer.systems.servo.compensator_law import AxisParams, OpenAxisParams
from chamfer.systems.servo.pid_law import OpenPidGains, PidGains

Kind = Literal["lateral", "rotational"]

KINDS: Final[tuple[Kind, ...]] = ("lateral", "rotational")  # three axes each, in this order


@dataclass(frozen=True, kw_only=True)
class OpenAxis(OpenAxisParams):
    """One of the compensator's elements: errors in pixels or rad, increments in m or rad.

    What is None is designed, see :mod:`chamfer.diagrams.cell.controller_design`.
    """

    dead_zone: float | None = None
    # pixels or rad; None: designed, the smallest one in which the increment settles
    large_error: float | None = None
    # pixels or rad; None: designed, the least that large increments need to die out
    increment: float | None = None
    # m or rad; None: designed, 8 mm or 0.32 rad per s, less if a given dead zone needs it
    limit: float | None = None  # m or rad; None: 0.03 m or 0.3 rad


@dataclass(frozen=True, kw_only=True)
class OpenGains(OpenPidGains):
    """One of the PID laws; gains that are None are designed likewise."""

    proportional: float | None = None
    # m/pixels or 1; None: designed, by SIMC for a closed loop of 0.05 s about the dead time
    integral: float | None = None  # m/(pixels s) or 1/s; None: designed, likewise
    limit: float | None = None  # m or rad; None: 0.03 m or 0.3 rad


@dataclass(frozen=True, kw_only=True)
class SixAxisSettings:
    """The compensator's elements."""

    lateral: OpenAxis = OpenAxis()
    rotational: OpenAxis = OpenAxis()

    @property
    def axes(self) -> tuple[AxisParams, ...]:
        """The six elements in the order of ``image_plane_error.AXES``."""
        return (self.lateral.closed,) * 3 + (self.rotational.closed,) * 3


@dataclass(frozen=True, kw_only=True)
class SixAxisPid:
    """The baseline's gains."""

    lateral: OpenGains = OpenGains()
    rotational: OpenGains = OpenGains()

    @property
    def axes(self) -> tuple[PidGains, ...]:
        """The six laws, in the order of the compensator's elements."""
        return (self.lateral.closed,) * 3 + (self.rotational.closed,) * 3


_LONGEST: Final = 3600.0  # s, what a run may be asked for
_OF_ONE_ARM: Final = ("peg", "none")  # what may be compensated where the hole is a fixture

Compensated = Literal["peg", "hole", "both", "none"]
ControllerKind = Literal["fsm", "pid"]


@dataclass(frozen=True, kw_only=True)
class ControllerChoice:
    """The controllers that turn the cameras' errors into compensation."""

    kind: ControllerKind = "fsm"  # the state machine of compensator.*, or the PID laws of pid.*

    def __post_init__(self) -> None:
        require_one_of(self, "kind", get_args(ControllerKind))


@dataclass(frozen=True, kw_only=True)
class AlignmentScenario(WorkCellScenario):
    """The arms hold the parts at a distance, and the cameras align them (Figs. 12 to 14)."""

    compensated: Compensated | None = None
    # the arm that takes the compensation; None: both, section 5, or the only one
    controller: ControllerChoice = ControllerChoice()
    cameras: CameraSettings = field(default_factory=CameraSettings)
    compensator: SixAxisSettings = field(default_factory=SixAxisSettings)
    pid: SixAxisPid = field(default_factory=SixAxisPid)
    initial_error: tuple[float, ...] = (0.0, 0.006, -0.008, 0.0, 0.05, -0.06)
    # m and rad, of the peg's commanded pose, caused by errors of the kinematic model, along and
    # about the hole's axes; assumed
    start_offset: Vector3 = (0.0, 0.0, 0.0)  # m, likewise, from the peg's goal to its start
    motion_time: float = 2.0  # s, from there to the goal
    begin: float = 1.5  # s, of the compensation; until then impedance control alone
    compensation_time: float = 2.5  # s, duration of the compensation; section 5

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
        require_not_negative(self, "gap")
        require_numbers(self, 6, "initial_error")
        require_numbers(self, 3, "start_offset")

    @property
    def duration(self) -> float:
        """When the run ends, s."""
        return self.begin + self.compensation_time

    @property
    def moves(self) -> bool:
        """Whether the peg has a way to go."""
        return any(self.start_offset)

    @property
    def repeatability(self) -> float:
        """Half-width of how far off the peg's arm is across the hole, new each trial, m."""
        return 0.0 if self.servo is None else self.servo.repeatability

    def camera(self, view: View) -> Camera:
        """Return the true camera: it looks at the gap, at about a plane of the hole's axes."""
        return true_camera(self.cameras, self, view)


@dataclass(frozen=True, kw_only=True)
class ResolvedAlignmentScenario(AlignmentScenario):
    """The scenario with cameras, arms and controllers filled in, for diagrams."""

    compensated: Compensated
    meeting_point: Vector3


BY_SIGHT: Final = AlignmentScenario()
# The peg's tip goes up to the hole's height, 10 cm away from it (Fig. 11). The way is not
# published: assumed.
VERTICAL_TRACKING: Final = AlignmentScenario(
    compensated="peg",
    hole=replace(HOLE_ARM, payload_error=0.0),  # exactly at the height, section 5
    impedance=ImpedanceControllerParams(stiffness=(700.0, 700.0, 700.0)),  # N/m, section 5
    gap=0.1,  # m, section 5
    initial_error=(0.0, 0.0, 0.0, 0.0, 0.0, 0.0),
    start_offset=(0.0, 0.0, -0.03),
    begin=0.1,
    compensation_time=3.9,
)

_WAY: Final = np.linspace(1.0, 0.0, 21)  # of the start's offset, where the peg is looked at


def require_start_apart(scenario: AlignmentScenario) -> None:
    """Refuse parts that overlap before the compensation begins, by the field that makes them.

    The arms are taken to be where their commands and their bases make them be: at the start
    without the commands' initial error, and on the way to the goal with it.
    """
    way = _WAY if scenario.moves else _WAY[-1:]
    starts = [offset_pose(scenario, share) for share in way.tolist()]
    commands = [wrong_pose(scenario, X_WT) for X_WT in starts]
    X_WM = scenario.nominal_pose("hole")
    gap = [scenario.nominal_pose("peg")]
    for name, poses in (("gap", gap), ("start_offset", starts[:1]), ("initial_error", commands)):
        blamed = name if scenario.gap > 0 else "gap"
        for X_WT in poses:
            X_MT = X_WM.InvertAndCompose(X_WT)
            require_apart(scenario.parts, X_MT, blamed, getattr(scenario, blamed))
    for name in scenario.arms:
        off = true_pose(scenario, "hole", X_WM) if name == "hole" else X_WM
        for X_WT in (starts[0], *commands):
            X_MT = off.InvertAndCompose(true_pose(scenario, "peg", X_WT))
            value = getattr(scenario, name).base_error
            require_apart(scenario.parts, X_MT, f"{name}.base_error", value)


def true_pose(scenario: WorkCellScenario, arm: ArmName, X_WT: RigidTransform) -> RigidTransform:
    """Return where a tool is if its arm takes it to be at a pose: its base may be elsewhere."""
    settings = getattr(scenario, arm)
    X_WB = settings.base.transform
    return X_WB @ settings.base_error.transform @ X_WB.inverse() @ X_WT


def offset_pose(scenario: AlignmentScenario, share: float) -> RigidTransform:
    """Return the peg's desired pose where a share of its way to the goal is left."""
    goal = scenario.nominal_pose("peg")
    return RigidTransform(goal.rotation(), goal @ (share * np.array(scenario.start_offset)))


def wrong_pose(scenario: AlignmentScenario, X_WT: RigidTransform) -> RigidTransform:
    """Return the pose that the peg's arm is commanded to instead of the desired one."""
    error = np.reshape(scenario.initial_error, (2, 3)) @ scenario.hole_axes.matrix().T
    return pose_from_vector(compensate(pose_vector(X_WT), error.ravel()))


Array = NDArray[np.float64]

_SIDES: Final = 16  # points of an edge
# Pixels, half of a part's width: of smaller ones most pictures show no end to be measured.
_NARROWEST: Final = 5.0
_SEEN: Final[dict[ArmName, str]] = {"peg": "the peg's tip", "hole": "the hole part's front face"}


def require_in_view(scenario: AlignmentScenario) -> None:
    """Refuse parts whose end faces are not in both images, where the compensation begins.

    Named is the field that takes a part out of an image; the arms are where their commands and
    their bases make them be.
    """
    for arm, seen in _SEEN.items():
        for name, value, X_WT in _poses_in_view(scenario, arm):
            face = _end_face(scenario.parts, arm)
            if where := _outside(scenario, X_WT, face):
                if name == "gap":
                    name, value = _camera_field(scenario, X_WT, face) or (name, value)
                images = f"both cameras have {seen} in their images when the compensation begins"
                raise ParameterError(name, value, f"one with which {images}; {where}")


def require_fine_enough(scenario: AlignmentScenario) -> None:
    """Refuse pixels that are too large for the parts to be found."""
    cameras, parts = scenario.cameras, scenario.parts
    narrower = min(parts.peg_radius, parts.outer_radius)
    for view in VIEWS:
        most = narrower / _NARROWEST / cameras.pixel_scale(view)
        if cameras.pixel_size > most:
            wide = f"{2 * _NARROWEST:g} pixels wide in the {view} camera"
            allowed = f"at most {most:.3g} m, so that both parts are {wide}"
            raise ParameterError("cameras.pixel_size", cameras.pixel_size, allowed)


def _poses_in_view(
    scenario: AlignmentScenario, arm: ArmName
) -> Iterator[tuple[str, object, RigidTransform]]:
    """Yield fields that move a part, their values, and where it is with these and those before."""
    X_WT = scenario.nominal_pose(arm)
    yield "gap", scenario.gap, X_WT
    if arm == "peg":
        share = min(scenario.begin / scenario.motion_time, 1.0)
        left = 1 - share**2 * (3 - 2 * share)  # of a cubic from rest to rest
        X_WT = offset_pose(scenario, left)
        yield "start_offset", scenario.start_offset, X_WT
        X_WT = wrong_pose(scenario, X_WT)
        yield "initial_error", scenario.initial_error, X_WT
    yield f"{arm}.base_error", getattr(scenario, arm).base_error, true_pose(scenario, arm, X_WT)


def _camera_field(
    scenario: AlignmentScenario, X_WT: RigidTransform, p_T: Array
) -> tuple[str, object] | None:
    """Return the first field of a camera without which it sees a part, and its value, if any."""
    for view in VIEWS:
        settings = scenario.cameras.view(view)
        stand = CameraModel.like(camera_placement(scenario.cameras, scenario, view).camera)
        for which in ("true", "believed"):
            model: CameraModel = getattr(settings, which)
            for one in fields(CameraModel):
                value, stands = getattr(model, one.name), getattr(stand, one.name)
                if value in (None, stands):
                    continue
                other: dict[str, Any] = {which: replace(model, **{one.name: stands})}
                cameras = scenario.cameras.with_view(view, replace(settings, **other))
                if not _outside(replace(scenario, cameras=cameras), X_WT, p_T):
                    return f"cameras.{view}.{which}.{one.name}", value
    return None


def _end_face(parts: PegAndHole, arm: ArmName) -> Array:
    """Return the middle and the edge of the end face that the cameras look for, m, (n, 3)."""
    profile = parts.peg.profile[-1:] if arm == "peg" else parts.hole.outside[:1]
    return np.vstack([np.zeros(3), *rings(profile, _SIDES, parts.section)])


def _outside(scenario: AlignmentScenario, X_WT: RigidTransform, p_T: Array) -> str:
    """Return where points of a part are in an image that ends before it, empty if all are in."""
    p_W = p_T @ X_WT.rotation().matrix().T + X_WT.translation()
    for view in VIEWS:
        camera = scenario.camera(view)
        believed = believed_camera(scenario.cameras, scenario, view)
        pixels = camera.project(p_W)
        if np.isnan(pixels).any():
            lens = "" if camera.lens is None else ", or where its lens shows nothing"
            return f"it is behind the {view} camera{lens}"
        pixel = scenario.cameras.pixel_size
        size = f"{camera.width} x {camera.height} pixels of {pixel:g} m"
        straight = believed.straight()
        for as_seen, by, seen in (
            ("", camera, pixels),
            ("straightened, ", straight, believed.shown_by(straight, pixels)),
        ):
            last = np.array([by.width - 1, by.height - 1])
            inside = ((seen >= 0) & (seen <= last)).all(axis=1)
            if not inside.all():
                u, v = seen[~inside][0].tolist()
                return f"in that of {view}, {as_seen}{size}, it is at ({u:.4g}, {v:.4g})"
    return ""
