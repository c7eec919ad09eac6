"""Chapter 2: the two-link arm in the crucible (Figs. 2-3 to 2-6)."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import ClassVar, Final

import numpy as np

from chamfer.diagrams.contact.hybrid_scenario import (
    ArmSettings,
    ControllerSettings,
    HybridScenario,
    HybridTrials,
    Task,
)
from chamfer.diagrams.contact.sensing import Sensing, SensingValues, ideal
from chamfer.models.arms.arm import Arm, JointFrictionParams
from chamfer.models.arms.planar_two_link import PLANAR_TWO_LINK
from chamfer.models.surfaces.rounds import Crucible
from chamfer.models.validation import ParameterError
from chamfer.systems.contact.arm_in_contact import ContactParams
from chamfer.systems.sensing.encoders import EncoderParams
from chamfer.systems.sensing.force_sensor import ForceSensorParams

# Joint friction, contact and gains are not published; chosen for the deviations of section 2.2.
_ARM: Final = ArmSettings(
    joint_friction=JointFrictionParams(
        coulomb=(0.2, 0.2), breakaway=1.5, stribeck=0.02, viscous=(1.0, 1.0)
    )
)
_HOLD: Final = Task(
    start=(1.0, 0.0),  # section 2.2; the crucible's wall is 1.5 m below, Fig. 2-3
    direction=(0.0, -1.0),
    along=(1.0, 0.0),
    speed=0.33,  # section 2.2
    force=15.0,  # section 2.2
)
_SLIDE: Final = replace(_HOLD, amplitude=0.02, frequency=1.0)  # section 2.2
_CONTROLLER: Final = ControllerSettings(
    law="inverse",
    stiffness=400.0,
    integral=400.0,
    damping=60.0,
    force_integral=3.0,
)
# The loop with the gains above is unstable with a torque that is 2.7 ms late or more. With less
# stiffness and damping, and more of the integrals, it bears 8 ms and keeps the force as well.
LATE: Final = replace(
    _CONTROLLER, stiffness=250.0, integral=500.0, damping=25.0, force_integral=4.0
)
# There never was such an arm: its encoders are a direct drive's, its sensor a small JR3, its
# computer the thesis' Pentium (see the Adept's); the cross-talk is 2 %.
_SENSING: Final[Mapping[Sensing, SensingValues]] = {
    "ideal": SensingValues(sensor=ideal(ForceSensorParams())),
    "realistic": SensingValues(
        sensor=ForceSensorParams(
            noise=0.1,
            bias=1.0,
            drift=0.005,
            bandwidth=500.0,
            delay=1.7e-3,
            resolution=0.025,
            full_scale=100.0,
            tare=0.1,
            cross_talk=0.02,
            position=(0.0, 0.0, 0.0),
        ),
        encoders=EncoderParams(counts=1.28e5, velocity="differenced", bandwidth=0.0),
        computation_delay=1e-3,
        computation_jitter=2e-4,
    ),
}


@dataclass(frozen=True, kw_only=True)
class PlanarLoop(HybridScenario):
    """The arm in the crucible, whose shape is fixed."""

    ARM: ClassVar[Arm] = PLANAR_TWO_LINK
    SENSING: ClassVar[Mapping[Sensing, SensingValues]] = _SENSING

    arm: ArmSettings = _ARM
    surface: ContactParams = ContactParams()
    task: Task = _HOLD
    controller: ControllerSettings = _CONTROLLER
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
    """Hold the position in contact (Fig. 2-5)."""


@dataclass(frozen=True, kw_only=True)
class PlanarSlideScenario(PlanarScenario):
    """Slide along the crucible (Fig. 2-6)."""

    task: Task = _SLIDE
    duration: float = 20.0  # s


@dataclass(frozen=True, kw_only=True)
class PlanarSlideLateScenario(PlanarSlideScenario):
    """The same with a torque one sample late, and gains that bear it."""

    controller: ControllerSettings = replace(LATE, computation_delay=0.005, computation_jitter=0.0)


@dataclass(frozen=True, kw_only=True)
class RecoveryScenario(PlanarLoop):
    """A blow takes the tip off the crucible."""

    task: Task = replace(_HOLD, kick_time=8.0)
