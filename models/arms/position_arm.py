"""A position-controlled arm: its joint servos, and the compliance between flange and part.

Forces do not move such an arm; what gives way is the sensor with the tool, or a remote centre
compliance (RCC), a device between flange and tool.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from chamfer.models.arms.wrist import WristParams
from chamfer.models.peg.support import RCC, Support, stacked, strain
from chamfer.models.validation import (
    ParameterError,
    require_between,
    require_not_negative,
    require_one_of,
    require_positive,
)

Array = NDArray[np.float64]
Control = Literal["impedance", "position"]
ComplianceKind = Literal["arm", "rcc"]

_MOST_DELAY: Final = 20  # samples


@dataclass(frozen=True, kw_only=True)
class ServoParams:
    """Joint servos of an arm that takes positions."""

    rate: float = 500.0  # Hz, of commands
    bandwidth: float = 20.0
    # Hz, at which each joint's response is down by 3 dB, critically damped; assumed
    delay: int = 1  # samples, from a command to the start of the joints' motion; assumed
    velocity: float = math.pi  # rad/s, or m/s, of each joint, at most
    acceleration: float = 25.0  # rad/s^2, or m/s^2, likewise; assumed
    repeatability: float = 3e-5  # m, half-width of the arm's position error, new each trial

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
        """Time between two commands, s."""
        return 1 / self.rate

    @property
    def frequency(self) -> float:
        """Frequency of each joint, rad/s: critically damped, -3 dB at the bandwidth."""
        return 2 * math.pi * self.bandwidth / math.sqrt(math.sqrt(2) - 1)


@dataclass(frozen=True, kw_only=True)
class ArmInterface:
    """Commands of the arm with the peg."""

    control: Control = "impedance"
    # impedance: torques, by impedance.*; position: joint positions, by admittance.*
    servo: ServoParams = field(default_factory=ServoParams)  # of position control

    def __post_init__(self) -> None:
        require_one_of(self, "control", get_args(Control))


# Of each kind, what is left open.
_OF_KIND: Final[Mapping[ComplianceKind, Mapping[str, float]]] = {
    # Assumed: between 1.2e5 N/m and 230 N m/rad of an optical sensor (OnRobot HEX-E, 200 N), from
    # memory, and 1e6 N/m, at the end of a tool of 0.1 m, of one of strain gauges (ATI Gamma).
    "arm": {
        "lateral": 1.5e5,
        "axial": 5e5,
        "angular": 500.0,
        "torsional": 300.0,
        "centre_distance": 0.0,
    },
    # Assumed but for Whitney's: of the order of a device of shear pads for some kg.
    "rcc": {
        "lateral": RCC["lateral_stiffness"],
        "axial": 5e5,
        "angular": RCC["angular_stiffness"],
        "torsional": 20.0,
        "centre_distance": RCC["centre_distance"],
        "most_lateral": 2.5e-3,
        "most_axial": 5e-4,
        "most_angular": math.radians(1.0),
        "mass": 0.2,
    },
}
_OF_A_DEVICE: Final = ("most_lateral", "most_axial", "most_angular", "mass")
_FARTHEST: Final = 1.0  # m, of a centre from the tip: beyond it the unit is wrong


@dataclass(frozen=True, kw_only=True)
class ComplianceParams:
    """Compliance between the arm's flange and the peg's tip; directions are the peg's.

    None: derived from the kind.
    """

    kind: ComplianceKind = "arm"
    # arm: sensor and tool, with their stiffness; rcc: a remote centre compliance between them
    lateral: float | None = None  # N/m, across the peg, at the centre
    axial: float | None = None  # N/m, along the peg
    angular: float | None = None  # N m/rad, that tilts the peg, about the centre
    torsional: float | None = None  # N m/rad, about the peg's axis
    centre_distance: float | None = None  # m, from the tip to the centre, away from the hole
    most_lateral: float | None = None  # m, deflection of an rcc at most, either way
    most_axial: float | None = None  # m, likewise along the peg
    most_angular: float | None = None  # rad, likewise, of tilt and torsion
    mass: float | None = None  # kg, of an rcc's part that hangs with the tool
    damping_ratio: float = 0.3  # of the tool on each spring; assumed

    def __post_init__(self) -> None:
        require_one_of(self, "kind", get_args(ComplianceKind))
        require_positive(self, "lateral", "axial", "angular", "torsional", "damping_ratio")
        require_positive(self, *_OF_A_DEVICE)
        if self.centre_distance is not None:
            require_between(self, -_FARTHEST, _FARTHEST, "centre_distance", unit="m")
        for name in _OF_A_DEVICE if self.kind == "arm" else ():
            if (value := getattr(self, name)) is not None:
                raise ParameterError(name, value, "null, or a kind: rcc that has it")

    def resolved(self) -> "Compliance":
        """Return the same with open fields set to the kind's values."""
        given = vars(self).items()
        said = {name: value for name, value in given if value is not None}
        return Compliance(**{**dict(given), **_OF_KIND[self.kind], **said})


@dataclass(frozen=True, kw_only=True)
class Compliance(ComplianceParams):
    """The same with nothing open; an arm has neither limits nor a device's mass."""

    lateral: float
    axial: float
    angular: float
    torsional: float
    centre_distance: float

    @property
    def support(self) -> Support:
        """Its support in the theory of wedging and jamming, on a rigid arm."""
        return Support(
            lateral_stiffness=self.lateral,
            angular_stiffness=self.angular,
            centre_distance=self.centre_distance,
        )

    def wrist(
        self, *, mass: float, centre_of_mass: float, inertia: float, axial_inertia: float
    ) -> WristParams:
        """Return the springs of a plant, with their load: z away from the hole.

        Args:
            mass: Of tool and peg, kg; the device's is put into their centre of mass.
            centre_of_mass: Of tool and peg above the tip, m.
            inertia: Of tool and peg about axes across through the tip, kg m^2.
            axial_inertia: About their axis, kg m^2.
        """
        own = self.mass or 0.0
        about = self.angular, self.angular, self.torsional
        return WristParams(
            stiffness=(*about, self.lateral, self.lateral, self.axial),
            centre=self.centre_distance,
            damping_ratio=self.damping_ratio,
            mass=mass + own,
            inertia=inertia + own * centre_of_mass**2,
            axial_inertia=axial_inertia,
            centre_of_mass=centre_of_mass,
        )

    def strain(self, wrench: Array) -> Array:
        """Return the displacement of the centre, rad above m, shape (..., 6), by a wrench.

        Args:
            wrench: On the tool about its tip in the wrist's axes, N m above N, shape (..., 6).
        """
        force = wrench[..., 3:]
        lever = np.array([0.0, 0.0, self.centre_distance])
        moment = wrench[..., :3] - np.cross(np.broadcast_to(lever, force.shape), force)
        about = self.angular, self.angular, self.torsional
        springs = np.array([*about, self.lateral, self.lateral, self.axial])
        strained: Array = np.concatenate([moment, force], axis=-1) / springs
        return strained

    def deflection(self, displacement: Array) -> Array:
        """Return an rcc's deflection as a share of its limits, shape (...,): 1 at a stop.

        Args:
            displacement: Of the centre, rad above m, shape (..., 6), as of the wrist's joints.
        """
        rx, ry, rz, x, y, z = np.moveaxis(np.asarray(displacement, dtype=np.float64), -1, 0)
        if self.most_lateral is None or self.most_axial is None or self.most_angular is None:
            return np.zeros_like(x)
        turned = np.maximum(np.hypot(rx, ry), np.abs(rz)) / self.most_angular
        along = np.abs(z) / self.most_axial
        share: Array = np.maximum(np.hypot(x, y) / self.most_lateral, np.maximum(along, turned))
        return share


def require_within_deflection(
    compliance: Compliance, position_error: float, angle_error: float, arm: Support | None = None
) -> None:
    """Refuse a hole's errors, at most m across and rad, that take an rcc beyond its limits.

    Of both errors the one that has the larger part in it is named. The arm is what gives way
    behind the device, at rest; None: it does not.
    """
    device = compliance.support
    whole = stacked(device, arm) if arm else device
    errors = {"position_error": position_error, "angle_error": angle_error}
    strains = np.abs(strain(device, whole, *np.eye(2)))  # by a unit of each error
    for name, taken in zip(("most_lateral", "most_angular"), strains, strict=True):
        most, parts = getattr(compliance, name), taken * np.array([*errors.values()])
        if most is not None and (together := float(parts.sum())) > most:
            blamed = [*errors][int(np.argmax(parts))]
            allowed = f"less: with it the rcc gives way by {together:.3g}, compliance.{name} is"
            raise ParameterError(f"hole.{blamed}", errors[blamed], f"{allowed} {most:.3g}")
