"""The arms in contact: the planar one in its crucible, the Puma 250 and the Adept One.

A class is an arm, a constant the scenario of a figure (chapters 2 and 3). With ``Scenario`` in its
name a class runs its loop several times.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Final

import numpy as np

from chamfer.diagrams.contact.hybrid_scenario import (
    ContactArmSettings,
    HybridScenario,
    HybridTrials,
    OnPlane,
    PlaneTask,
    SlidingTask,
    UnevenPlane,
)
from chamfer.diagrams.contact.sensing import (
    ROUGH,
    ControllerSettings,
    Sensing,
    SensingValues,
    ideal,
)
from chamfer.models.arms.adept_one import ADEPT_ONE
from chamfer.models.arms.arm import Arm, JointFrictionParams
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.arms.puma_250 import PUMA_250
from chamfer.models.surfaces.friction import SurfaceFriction
from chamfer.models.surfaces.rounds import Crucible
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.arm_in_contact import ContactParams
from chamfer.systems.force.contact_detection_law import ContactDetectionParams
from chamfer.systems.sensing.encoders import EncoderParams
from chamfer.systems.sensing.force_sensor import ForceSensorParams, LoadCellParams

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

# Chapter 2, the two-link arm in the crucible: Figs. 2-3 to 2-6.

# Joint friction, contact and gains are not published; chosen for the deviations of section 2.2.
_PLANAR_ARM: Final = ContactArmSettings(
    joint_friction=JointFrictionParams(
        coulomb=(0.2, 0.2), breakaway=1.5, stribeck=0.02, viscous=(1.0, 1.0)
    )
)
_PLANAR_HOLD: Final = SlidingTask(
    start=(1.0, 0.0),  # section 2.2; the crucible's wall is 1.5 m below, Fig. 2-3
    direction=(0.0, -1.0),
    along=(1.0, 0.0),
    speed=0.33,  # section 2.2
    force=15.0,  # section 2.2
)
_PLANAR_CONTROLLER: Final = ControllerSettings(
    law="inverse",
    stiffness=400.0,
    integral=400.0,
    damping=60.0,
    force_integral=3.0,
)
# The loop with the gains above is unstable with a torque that is 2.7 ms late or more. With less
# stiffness and damping, and more of the integrals, it bears 8 ms and keeps the force as well.
LATE_GAINS: Final = replace(
    _PLANAR_CONTROLLER, stiffness=250.0, integral=500.0, damping=25.0, force_integral=4.0
)
# There never was such an arm: its encoders are a direct drive's, its sensor a small JR3, its
# computer the thesis' Pentium (see the Adept's); the cross-talk is 2 %.
_PLANAR_SENSING: Final[Mapping[Sensing, SensingValues]] = {
    "ideal": SensingValues(sensor=ideal(ForceSensorParams())),
    "realistic": SensingValues(
        friction_noise=ROUGH,
        sensor=replace(JR3, noise=0.1, cross_talk=0.02, position=(0.0, 0.0, 0.0)),
        encoders=EncoderParams(counts=1.28e5, velocity="differenced", bandwidth=0.0),
        computation_delay=1e-3,
        computation_jitter=2e-4,
    ),
}


@dataclass(frozen=True, kw_only=True)
class PlanarLoop(HybridScenario):
    """The two-link arm in the crucible, whose shape is fixed."""

    ARM: ClassVar[Arm] = PLANAR_TWO_LINK
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = _PLANAR_SENSING

    arm: ContactArmSettings = _PLANAR_ARM
    surface: ContactParams = ContactParams()
    task: SlidingTask = _PLANAR_HOLD
    controller: ControllerSettings = _PLANAR_CONTROLLER
    sensor: ForceSensorParams = ForceSensorParams()
    duration: float = 12.0  # s

    @property
    def distance(self) -> float:
        """Distance from the start to the crucible's wall, m."""
        try:
            return self.make_surface().ahead(np.array(self.task.start), self.direction)
        except ParameterError as error:
            raise ParameterError("task.start", self.task.start, error.allowed) from error

    def make_surface(self) -> Crucible:
        """Return the crucible of section 2.2."""
        return Crucible()


@dataclass(frozen=True, kw_only=True)
class PlanarScenario(PlanarLoop, HybridTrials):
    """The same, several times."""


# Hold the position (Fig. 2-5), slide (Fig. 2-6), slide with a torque one sample late and gains
# that bear it; a blow that takes the tip off the crucible (section 2.1.4).
PLANAR_HOLD: Final = PlanarScenario()
PLANAR_SLIDE: Final = PlanarScenario(
    task=replace(_PLANAR_HOLD, amplitude=0.02, frequency=1.0),  # section 2.2
    duration=20.0,
)
PLANAR_SLIDE_LATE: Final = replace(
    PLANAR_SLIDE,
    controller=replace(LATE_GAINS, computation_delay=0.005, computation_jitter=0.0),
)
CONTACT_RECOVERY: Final = PlanarLoop(task=replace(_PLANAR_HOLD, kick_time=8.0))

# Section 3.1, the Puma 250 with a uniaxial load cell: Figs. 3-3 to 3-8.

# Nothing of the Puma's dynamics, friction, contact or gains is published: all is assumed.
_PUMA_FRICTION: Final = JointFrictionParams(
    coulomb=(0.55, 0.4, 0.55), breakaway=1.5, viscous=(0.5, 0.5, 0.3)
)
_PUMA_CONTROLLER: Final = ControllerSettings(
    law="transpose",
    stiffness=1200.0,
    integral=4800.0,
    damping=60.0,
    force_integral=2.0,
)
# Roller and nugget test need different ones: several millimetres and two centimetres of error.
_PUMA_SOFT: Final = replace(
    _PUMA_CONTROLLER,
    stiffness=400.0,
    integral=400.0,
    force_integral=3.0,
)
_PUMA_CELL: Final = LoadCellParams(axis=(1.0, 0.0, 0.0), noise=0.1)  # along the forearm; assumed
_PUMA_SENSING: Final[Mapping[Sensing, SensingValues]] = {
    "ideal": SensingValues(sensor=ideal(_PUMA_CELL)),
    "realistic": SensingValues(
        friction_noise=ROUGH,
        # A cell of 100 N, its amplifier and 12 bits (Data Translation, section 3.1.1); assumed.
        sensor=replace(
            _PUMA_CELL,
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
_PUMA_TABLE: Final = UnevenPlane(
    stiffness=1e4,
    damping=50.0,
    friction=SurfaceFriction(coefficient=0.1),
    ripple=5e-5,
    wavelength=0.02,
)
_PUMA_GLASS: Final = UnevenPlane(
    stiffness=3e4, damping=150.0, friction=SurfaceFriction(coefficient=0.3)
)
_PUMA_ROLLER: Final = PlaneTask(
    start=(0.176, -0.011, 0.1545),
    direction=(0.0, 0.0, -1.0),
    along=(0.0, 1.0, 0.0),
    distance=0.05,  # section 3.1.3
    speed=0.05 / 1.5,  # contact after 1.5 s
    force=5.0,  # section 3.1.3
)
_PUMA_NUGGET: Final = PlaneTask(
    start=(0.31, -0.011, 0.546),
    direction=(1.0, 0.0, 0.0),
    along=(0.0, 0.0, 1.0),
    distance=0.03,  # section 3.1.3
    speed=0.03 / 0.5,  # contact after 0.5 s
    force=5.0,  # section 3.1.3
)


@dataclass(frozen=True, kw_only=True)
class PumaLoop(OnPlane):
    """The Puma 250 on a table or before a glass wall."""

    ARM: ClassVar[Arm] = PUMA_250
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = _PUMA_SENSING

    arm: ContactArmSettings = ContactArmSettings(joint_friction=_PUMA_FRICTION)
    surface: UnevenPlane = _PUMA_TABLE
    task: PlaneTask = _PUMA_ROLLER
    controller: ControllerSettings = _PUMA_CONTROLLER
    sensor: LoadCellParams = LoadCellParams(axis=_PUMA_CELL.axis)
    detection: ContactDetectionParams = ContactDetectionParams(detect=0.5, release=0.2)


@dataclass(frozen=True, kw_only=True)
class PumaScenario(PumaLoop, HybridTrials):
    """The same, several times."""

    trials: int = 2


# Press a roller on a table (Fig. 3-5), roll along it (Fig. 3-6); press a nugget on a glass wall
# (Fig. 3-7), slide along it (Fig. 3-8).
PUMA_ROLLER_HOLD: Final = PumaScenario()
PUMA_ROLLER_MOTION: Final = PumaScenario(
    task=replace(_PUMA_ROLLER, amplitude=0.04, frequency=2 * math.pi * 0.25)
)
# Section 3.1.4: "more compliant and damped"; by how much is not published.
PUMA_ROLLER_MOTION_SOFT: Final = replace(
    PUMA_ROLLER_MOTION,
    surface=replace(
        _PUMA_TABLE, stiffness=_PUMA_TABLE.stiffness / 10, damping=3 * _PUMA_TABLE.damping
    ),
)
PUMA_NUGGET_HOLD: Final = PumaScenario(
    surface=_PUMA_GLASS, controller=_PUMA_SOFT, task=_PUMA_NUGGET
)
PUMA_NUGGET_MOTION: Final = replace(
    PUMA_NUGGET_HOLD,
    task=replace(
        _PUMA_NUGGET,
        speed=0.03,  # contact after 1 s
        amplitude=0.04,
        frequency=2 * math.pi * 0.1,
    ),
    duration=25.0,
)

# Section 3.2, the Adept One with a wrist force sensor: Figs. 3-11 to 3-15.

# Masses, friction, contact and gains are not published; one set for all experiments, but for the
# wrist's friction where it is the subject.
_ADEPT_FRICTION: Final = JointFrictionParams(
    coulomb=(1.0, 0.5, 12.0, 0.05), breakaway=1.3, viscous=(2.0, 1.0, 60.0, 0.05)
)
_ADEPT_CONTROLLER: Final = ControllerSettings(
    law="inverse",
    stiffness=(750.0, 300.0, 12000.0, 20.0),
    integral=(750.0, 300.0, 12000.0, 20.0),
    damping=(50.0, 20.0, 750.0, 1.0),
    force_integral=2.0,
)
# The thesis gives the noise; the cross-talk, which it blames but does not give, is assumed.
_ADEPT_FIGURE: Final = ForceSensorParams(
    noise=0.5,  # N, section 3.2.3
    cross_talk=0.1,
)
# No data sheet of the arm's encoders was found. Assumed: a count is a quarter of a repeatability
# of 0.025 mm at full reach, 0.05 mm of the quill, 0.05 degrees, which is from memory.
_ADEPT_ENCODERS: Final = EncoderParams(
    counts=(1.28e5, 1.28e5, 8e4, 4.6e3), velocity="differenced", bandwidth=0.0
)
_ADEPT_SENSING: Final[Mapping[Sensing, SensingValues]] = {
    "ideal": SensingValues(sensor=ideal(_ADEPT_FIGURE)),
    "realistic": SensingValues(
        friction_noise=ROUGH,
        sensor=JR3,
        encoders=_ADEPT_ENCODERS,
        # of a 133 MHz Pentium (section 6.2.1), which is to need less than several ms; assumed
        computation_delay=1e-3,
        computation_jitter=2e-4,
    ),
}
_ADEPT_PLATE: Final = UnevenPlane(
    stiffness=3e4,
    damping=150.0,
    friction=SurfaceFriction(coefficient=0.1),
    tilt=0.011,
    ripple=5e-5,
    wavelength=0.02,
)
_ADEPT_WALL: Final = UnevenPlane(
    stiffness=3e4,
    damping=150.0,
    friction=SurfaceFriction(coefficient=0.3),
    tilt=0.005,
    ripple=2e-5,
    wavelength=0.02,
)
_ADEPT_ROLLER: Final = PlaneTask(
    start=(0.5, -0.3, 0.3, 0.0),
    direction=(0.0, 0.0, -1.0, 0.0),
    along=(1.0, 0.0, 0.0, 0.0),
    distance=0.07,  # section 3.2.3
    speed=0.07 / 6.0,  # contact after 6 s
    force=20.0,  # section 3.2.3
)
_ADEPT_NUGGET: Final = PlaneTask(
    start=(0.49, -0.3, 0.3, 0.0),
    direction=(1.0, 0.0, 0.0, 0.0),
    along=(0.0, 0.0, 1.0, 0.0),
    distance=0.01,
    speed=0.01,
    force=5.0,  # section 3.2.3
)


@dataclass(frozen=True, kw_only=True)
class AdeptLoop(OnPlane):
    """The Adept One on a plate or before a metal wall."""

    ARM: ClassVar[Arm] = ADEPT_ONE
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = _ADEPT_SENSING

    arm: ContactArmSettings = ContactArmSettings(joint_friction=_ADEPT_FRICTION)
    surface: UnevenPlane = _ADEPT_WALL
    task: PlaneTask = _ADEPT_NUGGET
    controller: ControllerSettings = _ADEPT_CONTROLLER
    sensor: ForceSensorParams = ForceSensorParams()


@dataclass(frozen=True, kw_only=True)
class AdeptScenario(AdeptLoop, HybridTrials):
    """The same, several times."""

    trials: int = 4


# Press a roller on a plate (Fig. 3-11), roll along it (Fig. 3-12); press a nugget on a wall
# (Fig. 3-13), slide along it (Fig. 3-14); touch beside the wrist's axis (Fig. 3-15).
ADEPT_ROLLER_HOLD: Final = AdeptScenario(
    surface=_ADEPT_PLATE, task=_ADEPT_ROLLER, measure_after=10.0
)
ADEPT_ROLLER_MOTION: Final = AdeptScenario(
    surface=_ADEPT_PLATE,
    task=replace(
        _ADEPT_ROLLER,
        distance=0.01,
        speed=0.01 / 1.8,  # contact after 1.8 s
        amplitude=0.03,
        frequency=2 * math.pi * 0.25,
    ),
)
ADEPT_NUGGET_HOLD: Final = AdeptScenario()
ADEPT_NUGGET_MOTION: Final = AdeptScenario(
    task=replace(_ADEPT_NUGGET, amplitude=0.01, frequency=2 * math.pi / 10), duration=25.0
)
WRIST_CONTENTION: Final = AdeptScenario(
    arm=ContactArmSettings(
        joint_friction=replace(_ADEPT_FRICTION, coulomb=(1.0, 0.5, 12.0, 0.1)),
        contact_offset=(0.0, 0.05, 0.0),
    ),
    duration=25.0,
    measure_after=10.0,
    trials=2,
)
