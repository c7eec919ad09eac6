"""Plants that a camera is to steer: the arm as spring, mass and damper, and a user's own.

Ruybal, Lumia and Wood simulate the robot under impedance control as a spring-mass-damper
(section 3) and print neither its mass nor its damping. The defaults are identified: with the
paper's own stiffness of 700 N/m they are the only values for which eq. (2) gives the published
rise time and overshoot of Fig. 8 (experiment ``plant-identification``).
"""

import math
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple

import numpy as np
import scipy  # whose submodules are imported where they are used
from numpy.typing import NDArray

from chamfer.models.plants.measured_step import IdentifiedPlant
from chamfer.models.validation import (
    ParameterError,
    known,
    require_not_negative,
    require_positive,
    require_same,
)

Form = Literal["velocity", "position", "compliance"]


@dataclass(frozen=True, kw_only=True)
class SpringMassDamperParams:
    """Parameters of a spring-mass-damper."""

    mass: float = 2.14708  # kg, of the arm at its tool; identified from Fig. 8
    damping: float = 53.896  # N s/m, of the arm; identified from Fig. 8
    stiffness: float = 700.0  # N/m, K_p of section 5, first experiment

    def __post_init__(self) -> None:
        require_positive(self, "mass", "damping", "stiffness")
        largest = max(self.damping, self.stiffness, 1.0)
        if not math.isfinite(largest / self.mass):
            raise ParameterError(
                "mass", self.mass, "at least what damping and stiffness can be divided by"
            )


class StateSpace(NamedTuple):
    """Matrices of ``xdot = A x + B u, y = C x + D u``."""

    A: NDArray[np.float64]
    B: NDArray[np.float64]
    C: NDArray[np.float64]
    D: NDArray[np.float64]


def state_space(params: SpringMassDamperParams, form: Form) -> StateSpace:
    """Return the spring-mass-damper with the state (position m, velocity m/s).

    ``velocity`` is ``s/(m s^2 + b s + k)``, force N to velocity m/s: what the paper says it
    simulated, with a zero at s = 0. ``position`` is ``k/(m s^2 + b s + k)``, commanded position m
    to position m: what the hardware does, by the stiffness K_p of eq. (1). ``compliance`` is
    ``1/(m s^2 + b s + k)``, force N to position m.
    """
    m, b, k = params.mass, params.damping, params.stiffness
    return StateSpace(
        A=np.array([[0.0, 1.0], [-k / m, -b / m]]),
        B=np.array([[0.0], [(k if form == "position" else 1.0) / m]]),
        C=np.array([[0.0, 1.0] if form == "velocity" else [1.0, 0.0]]),
        D=np.zeros((1, 1)),
    )


_MECHANICS: Final = ("mass", "damping", "stiffness")


@dataclass(frozen=True, kw_only=True)
class ServoPlantParams(SpringMassDamperParams):
    """A plant with one input and one output, described in one of three ways.

    By mass, damping and stiffness, ``k/(m s^2 + b s + k)``; or by a transfer function; or by a
    step response that was measured.
    """

    mass: float = 3.0  # kg, assumed
    damping: float = 70.0  # N s/m, assumed
    stiffness: float = 600.0  # N/m, from the command to the arm; assumed
    numerator: tuple[float, ...] | None = None
    # of a transfer function in s, highest power first, instead of mass, damping and stiffness
    denominator: tuple[float, ...] | None = None  # of that transfer function, highest power first
    measured: str | None = None
    # a CSV file with the columns time s, command and position, of a step, instead of both
    identified: IdentifiedPlant | None = None
    # the plant identified from it; None: not identified yet
    dead_time: float = 0.0  # s, of the plant alone, without the camera's

    def __post_init__(self) -> None:
        super().__post_init__()
        require_not_negative(self, "dead_time")
        if (self.numerator is None) != (self.denominator is None):
            missing = "numerator" if self.numerator is None else "denominator"
            raise ParameterError(missing, None, "numbers, as the other one is given")
        measured = self.measured is not None or self.identified is not None
        if measured or self.numerator is not None:
            why = "nothing reads it beside a transfer function or a measured step"
            require_same(self, ServoPlantParams, "plant", *_MECHANICS, why=why)
        if measured:
            why = "nothing reads it beside a measured step"
            unread = ("numerator", "denominator", "dead_time")
            require_same(self, ServoPlantParams, "plant", *unread, why=why)
        if self.numerator is not None and self.denominator is not None:
            _require_proper(self.numerator, self.denominator)


def _require_proper(numerator: tuple[float, ...], denominator: tuple[float, ...]) -> None:
    for name, values in (("numerator", numerator), ("denominator", denominator)):
        if not values or not values[0] or not all(map(math.isfinite, values)):
            raise ParameterError(name, values, "finite numbers, the first of them not 0")
    if not len(numerator) < len(denominator):
        allowed = f"more than {len(numerator)} numbers, a position does not jump with its command"
        raise ParameterError("denominator", denominator, allowed)


class TransferFunction(NamedTuple):
    """``e^(-dead_time s) numerator(s) / denominator(s)``, highest powers first."""

    numerator: tuple[float, ...]
    denominator: tuple[float, ...]
    dead_time: float  # s

    def scaled(self, *, gain: float, time: float) -> "TransferFunction":
        """Return it with its gain times a factor, and all its times another one."""

        def slower(values: tuple[float, ...], factor: float) -> tuple[float, ...]:
            last = len(values) - 1
            return tuple(factor * one * time ** (last - i) for i, one in enumerate(values))

        return TransferFunction(
            slower(self.numerator, gain), slower(self.denominator, 1.0), time * self.dead_time
        )

    def state_space(self) -> StateSpace:
        """Return it without its dead time."""
        return StateSpace(*scipy.signal.tf2ss(self.numerator, self.denominator))


def transfer_function(plant: ServoPlantParams) -> TransferFunction:
    """Return a plant's transfer function, from commanded to actual position.

    Raises:
        ParameterError: If it was measured and is not identified yet.
    """
    if plant.measured is not None or plant.identified is not None:
        found = known("plant.identified", plant.identified)
        rise = (found.ratio * found.lag**2, found.lag, 1.0)
        return TransferFunction((found.gain,), rise, found.dead_time)
    if plant.numerator is not None and plant.denominator is not None:
        return TransferFunction(plant.numerator, plant.denominator, plant.dead_time)
    mechanics = (plant.mass, plant.damping, plant.stiffness)
    return TransferFunction((plant.stiffness,), mechanics, plant.dead_time)
