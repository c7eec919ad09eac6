"""Section 3.1: the Puma 250 with a uniaxial load cell (Figs. 3-3 to 3-8)."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Final

from chamfer.diagrams.contact.hybrid_scenario import (
    ArmSettings,
    ControllerSettings,
    HybridTrials,
    OnPlane,
    TaskOnPlane,
    UnevenPlane,
)
from chamfer.diagrams.contact.sensing import Sensing, SensingValues, ideal
from chamfer.models.arms.arm import Arm, JointFrictionParams
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.systems.force.contact_detection import ContactDetectionParams
from chamfer.systems.sensing.encoders import EncoderParams
from chamfer.systems.sensing.force_sensor import LoadCellParams

# Nothing of the Puma's dynamics, friction, contact or gains is published: all is assumed.
_FRICTION: Final = JointFrictionParams(
    coulomb=(0.55, 0.4, 0.55), breakaway=1.5, viscous=(0.5, 0.5, 0.3)
)
_CONTROLLER: Final = ControllerSettings(
    law="transpose",
    stiffness=1200.0,
    integral=4800.0,
    damping=60.0,
    force_integral=2.0,
)
# Roller and nugget test need different ones: several millimetres and two centimetres of error.
_SOFT: Final = replace(
    _CONTROLLER,
    stiffness=400.0,
    integral=400.0,
    force_integral=3.0,
)
_CELL: Final = LoadCellParams(axis=(1.0, 0.0, 0.0), noise=0.1)  # along the forearm; assumed
_SENSING: Final[Mapping[Sensing, SensingValues]] = {
    "ideal": SensingValues(sensor=ideal(_CELL)),
    "realistic": SensingValues(
        # A cell of 100 N, its amplifier and 12 bits (Data Translation, section 3.1.1); assumed.
        sensor=replace(
            _CELL,
            bias=1.0,
            drift=0.005,
            bandwidth=100.0,
            delay=0.0,
            resolution=200.0 / 4096,
            full_scale=100.0,
            tare=0.1,
        ),
        # 1000 counts a turn of the motors, gears of 46.72, 69.9733 and 42.9867: a PUMA 260, in the
        # arm parameters of YARP's BabyBot
        encoders=EncoderParams(
            counts=(7436.0, 11137.0, 6842.0), velocity="differenced", bandwidth=0.0
        ),
        # of a Heurikon HK68, a 68030 (section 3.1.1); assumed
        computation_delay=2.5e-3,
        computation_jitter=5e-4,
    ),
}
_TABLE: Final = UnevenPlane(
    stiffness=1e4,
    damping=50.0,
    friction=SurfaceFriction(coefficient=0.1),
    ripple=5e-5,
    wavelength=0.02,
)
_GLASS: Final = UnevenPlane(
    stiffness=3e4, damping=150.0, friction=SurfaceFriction(coefficient=0.3)
)
_ROLLER: Final = TaskOnPlane(
    start=(0.176, -0.011, 0.1545),
    direction=(0.0, 0.0, -1.0),
    along=(0.0, 1.0, 0.0),
    distance=0.05,  # section 3.1.3
    speed=0.05 / 1.5,  # contact after 1.5 s
    force=5.0,  # section 3.1.3
)
_NUGGET: Final = TaskOnPlane(
    start=(0.31, -0.011, 0.546),
    direction=(1.0, 0.0, 0.0),
    along=(0.0, 0.0, 1.0),
    distance=0.03,  # section 3.1.3
    speed=0.03 / 0.5,  # contact after 0.5 s
    force=5.0,  # section 3.1.3
)


@dataclass(frozen=True, kw_only=True)
class PumaLoop(OnPlane):
    """What the Puma's experiments have in common."""

    ARM: ClassVar[Arm] = PUMA_250
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = _SENSING

    arm: ArmSettings = ArmSettings(joint_friction=_FRICTION)
    surface: UnevenPlane = _TABLE
    task: TaskOnPlane = _ROLLER
    controller: ControllerSettings = _CONTROLLER
    sensor: LoadCellParams = LoadCellParams(axis=_CELL.axis)
    detection: ContactDetectionParams = ContactDetectionParams(detect=0.5, release=0.2)


@dataclass(frozen=True, kw_only=True)
class PumaScenario(PumaLoop, HybridTrials):
    """The same, several times."""

    trials: int = 2


@dataclass(frozen=True, kw_only=True)
class PumaRollerHoldScenario(PumaScenario):
    """Press a roller on a table (Fig. 3-5)."""


@dataclass(frozen=True, kw_only=True)
class PumaRollerMotionScenario(PumaScenario):
    """Roll along the table, 4 cm at 0.25 Hz (Fig. 3-6)."""

    task: TaskOnPlane = replace(_ROLLER, amplitude=0.04, frequency=2 * math.pi * 0.25)


@dataclass(frozen=True, kw_only=True)
class PumaNuggetHoldScenario(PumaScenario):
    """Press a nugget on a glass wall (Fig. 3-7)."""

    surface: UnevenPlane = _GLASS
    controller: ControllerSettings = _SOFT
    task: TaskOnPlane = _NUGGET


@dataclass(frozen=True, kw_only=True)
class PumaNuggetMotionScenario(PumaScenario):
    """Slide the nugget along the wall, 4 cm at 0.1 Hz (Fig. 3-8)."""

    surface: UnevenPlane = _GLASS
    controller: ControllerSettings = _SOFT
    task: TaskOnPlane = replace(
        _NUGGET,
        speed=0.03,  # contact after 1 s
        amplitude=0.04,
        frequency=2 * math.pi * 0.1,
    )
    duration: float = 25.0  # s
