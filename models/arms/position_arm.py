"""An arm that takes positions: its joint servos, and what gives way between its flange and a part.

Forces do not move such an arm; what gives way is the sensor with the tool, or a remote centre
compliance (RCC), a device between flange and tool.
"""

import math
from dataclasses import dataclass, field
from typing import Final, Literal, get_args

from chamfer.models.validation import (
    ParameterError,
    require_between,
    require_not_negative,
    require_one_of,
    require_positive,
)

Control = Literal["impedance", "position"]
ComplianceKind = Literal["arm", "rcc"]

_MOST_DELAY: Final = 20  # samples


@dataclass(frozen=True, kw_only=True)
class ServoParams:
    """How the joints of an arm follow the positions that it takes."""

    rate: float = 500.0  # Hz, of commands
    bandwidth: float = 20.0
    # Hz, at which each joint's response is down by 3 dB, critically damped; assumed
    delay: int = 1  # samples, from a command to where the joints begin to follow it; assumed
    velocity: float = math.pi  # rad/s, or m/s, of each joint, at most
    acceleration: float = 25.0  # rad/s^2, or m/s^2, likewise; assumed
    repeatability: float = 3e-5  # m, half-width of how far the arm is off, new each trial

    def __post_init__(self) -> None:
        require_between(self, 125.0, 1000.0, "rate", unit="Hz")
        require_positive(self, "bandwidth", "velocity", "acceleration")
        require_not_negative(self, "repeatability")
        if self.delay not in range(_MOST_DELAY + 1):
            allowed = f"a whole number of samples, 0 to {_MOST_DELAY}"
            raise ParameterError("delay", self.delay, allowed)
        if not self.bandwidth < self.rate / 2:
            allowed = f"less than half of the rate, {self.rate / 2:g} Hz"
            raise ParameterError("bandwidth", self.bandwidth, allowed)

    @property
    def period(self) -> float:
        """Between two commands, s."""
        return 1 / self.rate

    @property
    def frequency(self) -> float:
        """Of each joint's undamped motion, rad/s: critically damped, -3 dB at the bandwidth."""
        return 2 * math.pi * self.bandwidth / math.sqrt(math.sqrt(2) - 1)


@dataclass(frozen=True, kw_only=True)
class ArmInterface:
    """What the arm with the peg takes."""

    control: Control = "impedance"
    # impedance: torques, as impedance.* has it; position: joint positions, as admittance.* has it
    servo: ServoParams = field(default_factory=ServoParams)  # of position control

    def __post_init__(self) -> None:
        require_one_of(self, "control", get_args(Control))


@dataclass(frozen=True, kw_only=True)
class ComplianceParams:
    """What gives way between the arm's flange and the peg's tip; directions are the peg's.

    None: derived from the kind.
    """

    kind: ComplianceKind = "arm"
    # arm: sensor and tool, as stiff as they are; rcc: a remote centre compliance between them
    lateral: float | None = None  # N/m, across the peg, at the centre
    axial: float | None = None  # N/m, along the peg
    angular: float | None = None  # N m/rad, that tilts the peg, about the centre
    torsional: float | None = None  # N m/rad, about the peg's axis
    centre_distance: float | None = None  # m, from the tip to the centre, away from the hole
    most_lateral: float | None = None  # m, deflection at most, either way
    most_axial: float | None = None  # m, likewise
    most_angular: float | None = None  # rad, likewise, of tilt and torsion
    mass: float | None = None  # kg, of the device's part that hangs with the tool
    damping_ratio: float = 0.3  # of the tool on each spring; assumed

    def __post_init__(self) -> None:
        require_one_of(self, "kind", get_args(ComplianceKind))
