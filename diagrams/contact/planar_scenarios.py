"""Chapter 2: the two-link arm in the crucible (Figs. 2-3 to 2-6)."""

from dataclasses import dataclass, field, replace
from typing import ClassVar, Final

from diagrams.contact.hybrid_scenario import (
    ArmSettings,
    ControllerSettings,
    HybridScenario,
    SurfaceSettings,
    TaskSettings,
)
from models.arms.arm import Arm
from models.arms.planar_two_link import PLANAR_TWO_LINK
from models.surfaces import Crucible, Surface

# Joint friction, contact and gains are not published; chosen for the deviations of section 2.2.
_ARM: Final = ArmSettings(coulomb=(0.2, 0.2), breakaway=1.5, stribeck=0.02, viscous=(1.0, 1.0))
_HOLD: Final = TaskSettings(
    start=(1.0, 0.0),  # section 2.2
    direction=(0.0, -1.0),
    along=(1.0, 0.0),
    distance=1.5,  # to the nominal contact point, Fig. 2-3
    speed=0.33,  # section 2.2
    force=15.0,  # section 2.2
)
_SLIDE: Final = replace(_HOLD, amplitude=0.02, frequency=1.0)  # section 2.2
_CONTROLLER: Final = ControllerSettings(
    law="inverse",
    stiffness=(400.0, 400.0),
    integral=(400.0, 400.0),
    damping=(60.0, 60.0),
    force_integral=3.0,
)


@dataclass(frozen=True, kw_only=True)
class PlanarScenario(HybridScenario):
    """Hold the position in contact (Fig. 2-5)."""

    ARM: ClassVar[Arm] = PLANAR_TWO_LINK

    arm: ArmSettings = _ARM
    surface: SurfaceSettings = field(default_factory=SurfaceSettings)
    task: TaskSettings = _HOLD
    controller: ControllerSettings = _CONTROLLER
    duration: float = 12.0  # s

    def make_surface(self) -> Surface:
        """Return the crucible, whatever the surface's tilt and ripple (section 2.2)."""
        return Crucible()


@dataclass(frozen=True, kw_only=True)
class PlanarSlideScenario(PlanarScenario):
    """Slide along the crucible (Fig. 2-6)."""

    task: TaskSettings = _SLIDE
    duration: float = 20.0  # s


@dataclass(frozen=True, kw_only=True)
class RecoveryScenario(PlanarScenario):
    """A blow takes the tip off the crucible."""

    task: TaskSettings = replace(_HOLD, kick_time=8.0)
