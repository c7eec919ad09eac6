"""What may be set where the Adept with its wrist charges a crucible (thesis, section 1.1.2)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import ClassVar, Final, Literal

import numpy as np
from numpy.typing import NDArray

from chamfer.diagrams.charging.base_compensation import BaseCompensationParams
from chamfer.diagrams.charging.wrist_control import CONTROLLER, FRICTION, GRIPPER, SENSING
from chamfer.diagrams.contact.hybrid_scenario import (
    FreeArmSettings,
    require_periods,
    require_steps,
    updates_of,
)
from chamfer.diagrams.contact.sensing import ControllerSettings, Sensing, SensingValues
from chamfer.models.arms.adept_wrist import ADEPT_WRIST
from chamfer.models.arms.arm import Arm
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.charging.nugget import Nugget
from chamfer.models.charging.packing import PlanItem
from chamfer.models.charging.station import Layout, Station
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_not_negative,
    require_one_of,
    require_positive,
    within,
)
from chamfer.systems.charging.charging_chart import DONE, MODE_OF, STOPPED
from chamfer.systems.charging.charging_params import ChargingParams
from chamfer.systems.charging.grasp import GraspParams
from chamfer.systems.contact.arm_dynamics import ArmDynamics
from chamfer.systems.contact.arm_in_contact import ArmInContactParams, ContactParams
from chamfer.systems.sensing.encoders import EncoderParams, HomingParams
from chamfer.systems.sensing.force_sensor import ForceSensorParams

Array = NDArray[np.float64]
Fault = Literal[
    "none",
    "part_missing",
    "part_dropped",
    "wall_missing",
    "layer_missing",
    "contact_lost",
    "halt",
    "sensor_dead",
]

_FAULTS: Final[tuple[Fault, ...]] = (
    "none",
    "part_missing",
    "part_dropped",
    "wall_missing",
    "layer_missing",
    "contact_lost",
    "halt",
    "sensor_dead",
)
_MOST_ITEMS: Final = 200
_RUNNING: Final = tuple(name for name in MODE_OF if name not in (DONE, STOPPED))
_LAYING: Final = ("wall", "crown", "bulk")  # modes that items of their kind alone come to
# Of what may be missing, the items that would meet it.
_MEET: Final = {"wall_missing": ("wall",), "layer_missing": ("wall", "crown")}


@dataclass(frozen=True, kw_only=True)
class StationSettings:
    """The cell, and what the cycle takes it to be."""

    true: Station = Station()
    believed: Layout = Layout()


@dataclass(frozen=True, kw_only=True)
class WallSettings(ContactParams):
    """The crucible's wall: material, and how it stands."""

    stiffness: float = 3e4  # N/m, of the wall; assumed, as the Adept's
    damping: float = 150.0  # N s/m, of the wall; assumed, as the Adept's
    friction: SurfaceFriction = SurfaceFriction(coefficient=0.3)  # of nuggets on fused silica
    lean: float = 0.0  # rad, by which the crucible stands off the vertical, its top towards +x

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite(self, "lean")
        if abs(self.lean) > 0.2:
            raise ParameterError("lean", self.lean, "at most 0.2 rad")


@dataclass(frozen=True, kw_only=True)
class LayerSettings(ContactParams):
    """What a nugget is laid on."""

    stiffness: float = 1e4  # N/m, of the nuggets below on the bed; assumed
    damping: float = 50.0  # N s/m, of them; assumed
    friction: SurfaceFriction = SurfaceFriction(coefficient=0.3)  # of nuggets on nuggets
    tilt: float = 0.0  # rad, by which it rises towards +x
    mass: float = 0.085  # kg, of the nugget that is pushed
    slip_friction: float = 0.5  # of that nugget on the bed, in which it is nestled; assumed

    def __post_init__(self) -> None:
        super().__post_init__()
        require_finite(self, "tilt")
        require_positive(self, "mass")
        require_not_negative(self, "slip_friction")
        if abs(self.tilt) > 0.5:
            raise ParameterError("tilt", self.tilt, "at most 0.5 rad")


@dataclass(frozen=True, kw_only=True)
class FaultParams:
    """What goes wrong, once."""

    kind: Fault = "none"
    # part_missing: the feeder has none; part_dropped: the gripper loses it; wall_missing,
    # layer_missing: it is not there; contact_lost: a blow takes the nugget off; halt: the
    # operator's key; sensor_dead: the force sensor reads a constant from then on
    state: str = "slew.over"  # the chart's, in which it happens; read where a kind has a time
    item: int = 0  # index in the plan
    delay: float = 0.2  # s, after the state is entered
    duration: float | None = None  # s, of halt and blow; None: derived, 1 s and 0.1 s
    force: float = 3.0
    # N, of the blow, away from the wall: contact is lost, and found again with less than 2 N;
    # after 20 N for 1 s the nugget comes back so hard that the cycle stops

    def __post_init__(self) -> None:
        require_one_of(self, "kind", _FAULTS)
        require_one_of(self, "state", _RUNNING)
        require_not_negative(self, "delay")
        require_positive(self, "force")
        if self.duration is not None:
            require_positive(self, "duration")
        if self.item < 0:
            raise ParameterError("item", self.item, "a whole number >= 0")

    def require_met(self, kind: str) -> None:
        """Refuse a fault that its item does not come to.

        Args:
            kind: Of the item: wall, crown or bulk.

        Raises:
            ParameterError: If the item meets nothing that is missing, or is never in the state.
        """
        met = _MEET.get(self.kind, _LAYING)
        if kind not in met:
            raise ParameterError("item", self.item, f"an item that meets it: {' or '.join(met)}")
        mode = self.state.partition(".")[0]
        timed = self.kind in ("part_dropped", "contact_lost", "halt", "sensor_dead")
        if timed and mode in _LAYING and mode != kind:
            raise ParameterError("state", self.state, f"one that a {kind} item comes to")

    @property
    def lasting(self) -> float:
        """How long it acts, s; what is gone or dead stays so."""
        if self.kind in ("halt", "contact_lost"):
            usual = 1.0 if self.kind == "halt" else 0.1
            return usual if self.duration is None else self.duration
        return math.inf


@dataclass(frozen=True, kw_only=True)
class CrucibleChargingScenario:
    """Nuggets from a feeder, over a scanner, into a crucible, one after the other."""

    ARM: ClassVar[Arm] = ADEPT_WRIST
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = SENSING

    plan: tuple[PlanItem, ...] = (
        PlanItem(kind="wall", mass=0.085, azimuth=0.3),
        PlanItem(kind="wall", mass=0.185, azimuth=1.0),
        PlanItem(kind="crown", mass=0.140, azimuth=0.3),
        PlanItem(kind="bulk", mass=0.4),
    )  # nuggets and loads of the bulk filler, in the order of laying
    station: StationSettings = StationSettings()
    arm: FreeArmSettings = FreeArmSettings(joint_friction=FRICTION)
    gripper: GripperCompliance | None = GRIPPER  # of the fingers; None: rigid
    wall: WallSettings = WallSettings()
    layer: LayerSettings = LayerSettings()
    feeder: ContactParams = ContactParams(
        stiffness=1500.0, damping=60.0, friction=SurfaceFriction(coefficient=0.3)
    )  # a nugget on the feeder's foam; assumed: a hard tray meets 15 cm/s with more than 20 N
    filler_mass: float = 0.5  # kg, of the empty bulk filler, which hangs as a nugget does
    grasp: GraspParams = GraspParams()
    charging: ChargingParams = ChargingParams(wall_force=1.2)
    controller: ControllerSettings = CONTROLLER
    sensing: Sensing = "ideal"
    # no error of sensors or computer but what is told; realistic: what is open, as they are
    sensor: ForceSensorParams = field(default_factory=ForceSensorParams)
    encoders: EncoderParams = field(default_factory=EncoderParams)
    homing: HomingParams = HomingParams(
        zero_error=(0.005, 0.005, 0.004, 0.02, 0.01, 0.01, 0.01),
        mark_distance=(0.05, 0.05, -0.02, 0.1, 0.05, 0.05, 0.05),
    )  # what encoders are off before they pass their index marks; assumed
    friction_compensation: BaseCompensationParams | None = None  # by a base sensor; None: none
    fault: FaultParams = FaultParams()
    step: float = 1e-4  # s, of the arm's dynamics, friction and contact
    duration: float | None = None  # s, at most; None: derived, a minute an item

    def __post_init__(self) -> None:
        require_positive(self, "step", "filler_mass")
        require_one_of(self, "sensing", ("ideal", "realistic"))
        if not 1 <= len(self.plan) <= _MOST_ITEMS:
            raise ParameterError("plan", len(self.plan), f"1 to {_MOST_ITEMS} items")
        period = self.controller.period
        require_steps(self.step, period)
        for name, own in (("charging", self.charging.period), ("grasp", self.grasp.period)):
            if own != period:
                raise ParameterError(f"{name}.period", own, f"controller.period, {period:g}")
        if self.duration is not None:
            require_periods(self.duration, period)
        if self.fault.item >= len(self.plan):
            raise ParameterError("fault.item", self.fault.item, f"0 to {len(self.plan) - 1}")
        with within("fault"):
            self.fault.require_met(self.plan[self.fault.item].kind)
        friction, n = self.arm.joint_friction, self.ARM.num_joints
        if len(friction.coulomb) != n:
            raise ParameterError("arm.joint_friction.coulomb", friction.coulomb, f"{n} numbers")
        if self.gripper is not None:
            with within("gripper"):
                self.gripper.matrix(3)
                self.gripper.damping_matrix(3)
        with within("controller"):
            self.controller.for_joints(n)
        with within("homing"):
            self.homing.for_joints(n)

    def dynamics(self) -> ArmDynamics:
        """Return the arm's equations of motion."""
        return ArmDynamics(self.ARM)

    @property
    def nuggets(self) -> tuple[Nugget, ...]:
        """What is in the gripper with each item, as it is; a bulk item with its filler."""
        return tuple(
            replace(item.true_nugget, mass=item.mass + self.filler_mass)
            if item.kind == "bulk"
            else item.true_nugget
            for item in self.plan
        )

    @property
    def start(self) -> Array:
        """Where the endpoint truly is at the start, m and rad, shape (7,): over the feeder."""
        x, y, z = self.station.believed.feeder
        over = self.charging.lift_height + self.plan[0].believed_nugget.height
        return np.array([x, y, z + over, 0.0, 0.0, 0.0, self.charging.lean])

    @property
    def plant(self) -> ArmInContactParams:
        """The arm, without what it touches."""
        updates = updates_of(self.step, self.controller.period)
        return ArmInContactParams(
            joint_friction=self.arm.joint_friction,
            gripper=self.gripper,
            step=self.step,
            held=updates.held,
            window=updates.window,
        )
