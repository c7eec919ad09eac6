"""The Adept with its wrist under control: friction, gains, gripper, sensors and computer.

Gains, gripper and the wrist's friction are not published. Gains are chosen for the wall: sliding
2 cm/s along one whose normal is 5 mrad off, with friction of 0.3, the force has to stay within
0 and 2 N.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Final

from chamfer.diagrams.contact.contact_scenarios import JR3
from chamfer.diagrams.contact.sensing import (
    ControllerSettings,
    Sensing,
    SensingValues,
    ideal,
    missing,
)
from chamfer.models.arms.arm import JointFrictionParams
from chamfer.models.arms.gripper import GripperCompliance
from chamfer.models.validation import require_not_negative
from chamfer.systems.force.friction_compensation import FrictionCompensationParams
from chamfer.systems.sensing.encoders import EncoderParams
from chamfer.systems.sensing.force_sensor import BaseSensorParams, ForceSensorParams

# Of joints 1 to 4 the Adept One's; of the wrist's geared motors assumed.
FRICTION: Final = JointFrictionParams(
    coulomb=(1.0, 0.5, 12.0, 0.05, 0.05, 0.03, 0.02),
    breakaway=1.3,
    viscous=(2.0, 1.0, 60.0, 0.05, 0.05, 0.03, 0.02),
)
# With the whole model and an inertia of 1 gains are of an acceleration: 1/s^2, 1/s^3 and 1/s.
_SPEED: Final = 35.0  # rad/s, of the position loop, damped by 0.9
CONTROLLER: Final = ControllerSettings(
    law="inverse",
    full_dynamics=True,
    inertia=(1.0,) * 7,
    stiffness=_SPEED**2,
    integral=10 * _SPEED**2,
    damping=1.8 * _SPEED,
    force_integral=10.0,
    # Down, where 6.5 kg have no more than the quill's friction, Kif is b / m at 65 N s/m.
    force_damping=100.0,
    # As in Fig. 3-15: against a wall only the quill, which slides, needs its integrator.
    held_integrators=(0, 1, 3, 4, 5, 6),
)
GRIPPER: Final = GripperCompliance(stiffness=1000.0, damping=5.0)
SENSING: Final[Mapping[Sensing, SensingValues]] = {
    "ideal": SensingValues(sensor=ideal(ForceSensorParams())),
    "realistic": SensingValues(
        sensor=JR3,
        # Joints 1 to 4 as the Adept One's. Wrist: 500 lines a turn, four counts a line, geared
        # down by 100; assumed, read by the counters of appendix D.
        encoders=EncoderParams(
            counts=(1.28e5, 1.28e5, 8e4, 4.6e3, 3.2e4, 3.2e4, 3.2e4),
            velocity="differenced",
            bandwidth=0.0,
        ),
        computation_delay=1e-3,  # as the Adept One's
        computation_jitter=2e-4,
    ),
}


# A plate that bears the arm, 1000 N and 200 N m, with noise and resolution that are the wrist
# sensor's parts of the full scale; bias and drift likewise. All of it is assumed.
_SENSORS: Final[Mapping[Sensing, BaseSensorParams]] = {
    "ideal": ideal(BaseSensorParams()),
    "realistic": BaseSensorParams(
        noise=1.0,
        bias=2.0,
        drift=0.01,
        bandwidth=200.0,
        delay=1.7e-3,
        resolution=0.25,
        full_scale=1000.0,
        tare=0.0,
    ),
}


@dataclass(frozen=True, kw_only=True)
class BaseCompensationParams(FrictionCompensationParams):
    """Friction compensation with the torques from a sensor under the base."""

    bandwidth: float = 10.0  # Hz, of the estimate's first-order lag; assumed
    joints: tuple[int, ...] | None = (0, 1, 2)
    # indices of those compensated; None: all. Friction of the wrist is below the sensor's noise
    rest_speed: float = 1e-3
    # rad/s, m/s of the quill: a joint that the command moves slower keeps its estimate; 0: the
    # estimate also follows at joints at rest, which then limit-cycle
    sensor: BaseSensorParams = BaseSensorParams()

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "rest_speed")

    def filled(self, sensing: Sensing) -> "BaseCompensationParams":
        """Return the parameters with the sensor of ``sensing``."""
        left_open = missing(self.sensor, _SENSORS[sensing])
        return replace(self, sensor=replace(self.sensor, **left_open))  # type: ignore[arg-type]
