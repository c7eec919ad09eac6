"""The arms before their unknown walls: Adept One, Puma 250 and the planar arm (section 6.3)."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Final

from chamfer.diagrams.contact.contact_scenarios import AdeptLoop, PlanarLoop, PumaScenario
from chamfer.diagrams.contact.hybrid_scenario import ContactArmSettings
from chamfer.diagrams.contact.sensing import ControllerSettings, Sensing, SensingValues
from chamfer.diagrams.surface.unknown_wall_scenario import (
    UnknownWallScenario,
    WallSettings,
    WallTask,
)
from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.arm import Arm
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.systems.estimation.surface_observer import SurfaceObserverParams
from chamfer.systems.force.friction_compensation import FrictionCompensationParams
from chamfer.systems.sensing.force_sensor import ForceSensorParams

_WALL: Final = WallSettings(
    stiffness=3e4,
    damping=150.0,
    friction=SurfaceFriction(coefficient=0.3),
    shape="circle",
    radius=0.75,
    inside=True,
    tilt=0.15,
)
# Rubber between wrist and nugget; assumed.
_GRIPPER: Final = GripperCompliance(stiffness=1e3, damping=20.0)
# The observer needs three axes of force: the planar arm's sensor in place of the load cell.
_PUMA_SENSING: Final[Mapping[Sensing, SensingValues]] = {
    sensing: replace(values, sensor=PlanarLoop.SENSING[sensing].sensor)
    for sensing, values in PumaScenario.SENSING.items()
}


@dataclass(frozen=True, kw_only=True)
class AdeptUnknownWallScenario(UnknownWallScenario):
    """The Adept One slides a nugget along a wall that it does not know."""

    ARM: ClassVar[Arm] = ADEPT_ONE
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = AdeptLoop.SENSING

    arm: ContactArmSettings = AdeptLoop.arm
    surface: WallSettings = _WALL
    gripper: GripperCompliance = _GRIPPER
    task: WallTask = WallTask(
        start=(0.45, -0.2, 0.3, 0.0),
        direction=(1.0, 0.0, 0.0, 0.0),
        along=(0.0, 1.0, 0.0, 0.0),
        distance=0.05,
        speed=0.05,
        force=5.0,  # section 5.3.4
        slide_speed=0.03,  # nugget scanning, section 1.1.2
        kick_time=9.0,
    )
    controller: ControllerSettings = replace(
        AdeptLoop.controller, force_integral=3.0, force_damping=150.0
    )
    sensor: ForceSensorParams = ForceSensorParams(decoupling=True)
    observer: SurfaceObserverParams = SurfaceObserverParams(initial_deviation=0.2)
    measure_after: float = 3.0  # s
    trials: int = 4


@dataclass(frozen=True, kw_only=True)
class PumaUnknownWallScenario(UnknownWallScenario):
    """The same with the Puma 250, and with a wrist sensor in place of its load cell."""

    ARM: ClassVar[Arm] = PUMA_250
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = _PUMA_SENSING

    arm: ContactArmSettings = PumaScenario.arm
    surface: WallSettings = _WALL
    gripper: GripperCompliance = _GRIPPER
    task: WallTask = WallTask(
        start=(0.31, -0.011, 0.45),
        direction=(1.0, 0.0, 0.0),
        along=(0.0, 0.0, 1.0),
        distance=0.03,  # section 3.1.3
        speed=0.03,
        force=5.0,  # section 3.1.3
        slide_speed=0.03,
        kick_time=6.0,
        kick_speed=0.4,
    )
    controller: ControllerSettings = replace(
        PumaScenario.controller, force_integral=3.0, force_damping=150.0
    )
    sensor: ForceSensorParams = ForceSensorParams(noise=0.5)
    observer: SurfaceObserverParams = SurfaceObserverParams(initial_deviation=0.2)
    # Section 6.3; without it stiction lets the force rise to 8 N where contact is made.
    friction_compensation: FrictionCompensationParams | None = FrictionCompensationParams(
        bandwidth=20.0
    )
    duration: float = 10.0  # s
    measure_after: float = 3.0  # s
    trials: int = 4


@dataclass(frozen=True, kw_only=True)
class PlanarUnknownWallScenario(UnknownWallScenario):
    """The same with the two-link arm in the plane."""

    ARM: ClassVar[Arm] = PLANAR_TWO_LINK
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = PlanarLoop.SENSING

    arm: ContactArmSettings = PlanarLoop.arm
    surface: WallSettings = _WALL
    gripper: GripperCompliance = _GRIPPER
    task: WallTask = WallTask(
        start=(1.0, -1.4),
        direction=(0.0, -1.0),
        along=(1.0, 0.0),
        distance=0.1,
        speed=0.05,
        force=5.0,  # section 5.3.4
        slide_speed=0.03,
        kick_time=9.0,
        kick_speed=0.4,
    )
    controller: ControllerSettings = replace(
        PlanarLoop.controller, law="transpose", force_integral=8.0, force_damping=100.0
    )
    sensor: ForceSensorParams = ForceSensorParams(noise=0.5)
    observer: SurfaceObserverParams = SurfaceObserverParams(initial_deviation=0.2)
    measure_after: float = 3.0  # s
    trials: int = 4
