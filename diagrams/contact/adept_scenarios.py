"""Section 3.2: the Adept One with a wrist force sensor (Figs. 3-11 to 3-15)."""

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
from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.arm import Arm, JointFrictionParams
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.systems.sensing.encoders import EncoderParams
from chamfer.systems.sensing.force_sensor import ForceSensorParams

# Masses, friction, contact and gains are not published; one set for all experiments, but for the
# wrist's friction where it is the subject.
_FRICTION: Final = JointFrictionParams(
    coulomb=(1.0, 0.5, 12.0, 0.05), breakaway=1.3, viscous=(2.0, 1.0, 60.0, 0.05)
)
_CONTROLLER: Final = ControllerSettings(
    law="inverse",
    stiffness=(750.0, 300.0, 12000.0, 20.0),
    integral=(750.0, 300.0, 12000.0, 20.0),
    damping=(50.0, 20.0, 750.0, 1.0),
    force_integral=2.0,
)
# The thesis gives the noise; the cross-talk, which it blames but does not give, is assumed.
_FIGURE: Final = ForceSensorParams(
    noise=0.5,  # N, section 3.2.3
    cross_talk=0.1,
)
# No data sheet of the arm's encoders was found. Assumed: a count is a quarter of a repeatability
# of 0.025 mm at full reach, 0.05 mm of the quill, 0.05 degrees, which is from memory.
_ENCODERS: Final = EncoderParams(
    counts=(1.28e5, 1.28e5, 8e4, 4.6e3), velocity="differenced", bandwidth=0.0
)
# A JR3 of 100 N, converter of 1/4000 of that, first of its low-passes: 500 Hz, late by about one
# by the cut-off in all (such filters: Electronics 2020, 9(8), 1291; the numbers are from memory of
# the manual). Forces leak into each other as in the figures; a moment of full scale, 5 N m, into a
# force as 2 % of its full scale. Bias, drift and lever are assumed.
JR3: Final = ForceSensorParams(
    noise=0.5,
    bias=1.0,
    drift=0.005,
    bandwidth=500.0,
    delay=1.7e-3,
    resolution=0.025,
    full_scale=100.0,
    tare=0.1,
    cross_talk=(
        (1.0, 0.1, 0.1, 0.4, 0.4, 0.4),
        (0.1, 1.0, 0.1, 0.4, 0.4, 0.4),
        (0.1, 0.1, 1.0, 0.4, 0.4, 0.4),
        (1e-3, 1e-3, 1e-3, 1.0, 0.02, 0.02),
        (1e-3, 1e-3, 1e-3, 0.02, 1.0, 0.02),
        (1e-3, 1e-3, 1e-3, 0.02, 0.02, 1.0),
    ),
    position=(0.0, 0.0, 0.1),
)
_SENSING: Final[Mapping[Sensing, SensingValues]] = {
    "ideal": SensingValues(sensor=ideal(_FIGURE)),
    "realistic": SensingValues(
        sensor=JR3,
        encoders=_ENCODERS,
        # of a 133 MHz Pentium (section 6.2.1), which is to need less than several ms; assumed
        computation_delay=1e-3,
        computation_jitter=2e-4,
    ),
}
_PLATE: Final = UnevenPlane(
    stiffness=3e4,
    damping=150.0,
    friction=SurfaceFriction(coefficient=0.1),
    tilt=0.011,
    ripple=5e-5,
    wavelength=0.02,
)
_WALL: Final = UnevenPlane(
    stiffness=3e4,
    damping=150.0,
    friction=SurfaceFriction(coefficient=0.3),
    tilt=0.005,
    ripple=2e-5,
    wavelength=0.02,
)
_ROLLER: Final = TaskOnPlane(
    start=(0.5, -0.3, 0.3, 0.0),
    direction=(0.0, 0.0, -1.0, 0.0),
    along=(1.0, 0.0, 0.0, 0.0),
    distance=0.07,  # section 3.2.3
    speed=0.07 / 6.0,  # contact after 6 s
    force=20.0,  # section 3.2.3
)
_NUGGET: Final = TaskOnPlane(
    start=(0.49, -0.3, 0.3, 0.0),
    direction=(1.0, 0.0, 0.0, 0.0),
    along=(0.0, 0.0, 1.0, 0.0),
    distance=0.01,
    speed=0.01,
    force=5.0,  # section 3.2.3
)


@dataclass(frozen=True, kw_only=True)
class AdeptLoop(OnPlane):
    """What the Adept's experiments have in common."""

    ARM: ClassVar[Arm] = ADEPT_ONE
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = _SENSING

    arm: ArmSettings = ArmSettings(joint_friction=_FRICTION)
    surface: UnevenPlane = _WALL
    task: TaskOnPlane = _NUGGET
    controller: ControllerSettings = _CONTROLLER
    sensor: ForceSensorParams = ForceSensorParams()


@dataclass(frozen=True, kw_only=True)
class AdeptScenario(AdeptLoop, HybridTrials):
    """The same, several times."""

    trials: int = 4


@dataclass(frozen=True, kw_only=True)
class AdeptRollerHoldScenario(AdeptScenario):
    """Press a roller on a plate (Fig. 3-11)."""

    surface: UnevenPlane = _PLATE
    task: TaskOnPlane = _ROLLER
    measure_after: float = 10.0  # s, the force has converged


@dataclass(frozen=True, kw_only=True)
class AdeptRollerMotion(AdeptLoop):
    """Roll along the plate, 3 cm at 0.25 Hz, once."""

    surface: UnevenPlane = _PLATE
    task: TaskOnPlane = replace(
        _ROLLER,
        distance=0.01,
        speed=0.01 / 1.8,  # contact after 1.8 s
        amplitude=0.03,
        frequency=2 * math.pi * 0.25,
    )


@dataclass(frozen=True, kw_only=True)
class AdeptRollerMotionScenario(AdeptRollerMotion, AdeptScenario):
    """Roll along the plate, 3 cm at 0.25 Hz (Fig. 3-12)."""


@dataclass(frozen=True, kw_only=True)
class AdeptNuggetHoldScenario(AdeptScenario):
    """Press a nugget on a wall (Fig. 3-13)."""


@dataclass(frozen=True, kw_only=True)
class AdeptNuggetMotion(AdeptLoop):
    """Slide the nugget along the wall, 1 cm in 10 s, once."""

    task: TaskOnPlane = replace(_NUGGET, amplitude=0.01, frequency=2 * math.pi / 10)
    duration: float = 25.0  # s


@dataclass(frozen=True, kw_only=True)
class AdeptNuggetMotionScenario(AdeptNuggetMotion, AdeptScenario):
    """Slide the nugget along the wall, 1 cm in 10 s (Fig. 3-14)."""


@dataclass(frozen=True, kw_only=True)
class WristContentionScenario(AdeptScenario):
    """A nugget that touches the wall beside the wrist's axis (Fig. 3-15)."""

    arm: ArmSettings = ArmSettings(
        joint_friction=replace(_FRICTION, coulomb=(1.0, 0.5, 12.0, 0.1)),
        contact_offset=(0.0, 0.05, 0.0),
    )
    duration: float = 25.0  # s
    measure_after: float = 10.0  # s
    trials: int = 2
