"""Accommodation, or damping control: a commanded velocity that gives way to force (section 3.2).

Source: Morrow, Nelson and Khosla. The paper gives no equation; as usual it is

    V_ref = V_cmd + D^-1 F,

with the wrench F on the tool and a damping matrix D. A maintained velocity v stalls where the
force is D |v|. Against a stiffness k, sampled with the period T, the contact force obeys

    f' = (1 - kappa) f,  kappa = k T / D,

without delay, monotone up to kappa = 1 and stable below 2; with one sample of delay between force
and velocity, z^2 - z + kappa = 0, monotone up to 1/4 and stable below 1. Of a full damping matrix
the eigenvalues of ``T D^-1 K`` take the place of kappa.

The sub-matrices of D are primitives of their own: linear accommodation is a finite damping of the
translations, angular accommodation one of the rotations. The matrix is diagonal at the centre of
compliance, which may be remote: a lateral force at the tip then turns the tool as well.
"""

import math
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import ClassVar, Final, NamedTuple, Self

import numpy as np

from chamfer.models.validation import ParameterError, require_numbers, require_positive
from chamfer.systems.law import Array, HeldLaw, Signal, State

AXES: Final = ("rx", "ry", "rz", "x", "y", "z")  # of velocities and wrenches, angular above
MONOTONE: Final = 0.25  # kappa, with one sample of delay
VELOCITY: Final = ("rad/s",) * 3 + ("m/s",) * 3
WRENCH: Final = ("N m",) * 3 + ("N",) * 3
DAMPING: Final = ("N m s/rad",) * 3 + ("N s/m",) * 3


@dataclass(frozen=True, kw_only=True)
class AccommodationParams:
    """Parameters of :class:`AccommodationLaw`; the paper prints none.

    Of axes that do not give way the damping is infinity.
    """

    damping: tuple[float, ...] = (2.0, 2.0, 2.0, 800.0, 800.0, 800.0)
    # N m s/rad and N s/m, about and along the tool's axes, D; assumed
    stiffness: tuple[float, ...] = (20.0, 20.0, 20.0, 2e4, 2e4, 2e4)
    # N m/rad and N/m, of gripper or wrist and contact in series; assumed
    period: float = 0.01  # s, of the controller; assumed
    centre: tuple[float, ...] = (0.0, 0.0, 0.0)  # m, of compliance, from the wrench's reference
    allow_unstable: bool = False  # True: run beyond the bound on kappa

    _least: ClassVar[str] = f"k T / {MONOTONE:g}"

    def __post_init__(self) -> None:
        require_positive(self, "period")
        require_numbers(self, 3, "centre")
        for name in ("damping", "stiffness"):
            values = getattr(self, name)
            if len(values) != len(AXES):
                raise ParameterError(name, values, "six numbers")
        if not all(value > 0 for value in self.damping):
            raise ParameterError("damping", self.damping, "six numbers > 0, infinity for stiff")
        if not all(0 <= value < math.inf for value in self.stiffness):
            raise ParameterError("stiffness", self.stiffness, "six finite numbers >= 0")
        if self.allow_unstable:
            return
        for axis, damping, stiffness, least in zip(
            AXES, self.damping, self.stiffness, self.least_damping, strict=True
        ):
            if not least <= damping * (1 + 1e-9):
                raise ParameterError(
                    f"damping of {axis}",
                    damping,
                    f"at least {self._least} = {least:.4g} against a stiffness of "
                    f"{stiffness:g}, or a more compliant wrist",
                )
        if any(self.centre):
            self._require_centre()

    def _require_centre(self) -> None:
        loop = self.period * self.mobility @ np.diag(self.stiffness)
        largest = float(np.linalg.eigvals(loop).real.max())
        if not largest <= MONOTONE * (1 + 1e-9):
            found = f"the largest eigenvalue of T D^-1 K, here {largest:.3g}"
            allowed = f"one with which {found}, is at most {MONOTONE:g}"
            raise ParameterError("centre", self.centre, allowed)

    def with_damping(self, set_to: tuple[float, ...]) -> "AccommodationParams":
        """Return these parameters with some of the dampings set, those that are not 0."""
        if not any(set_to):
            return self
        damping = tuple(new or own for new, own in zip(set_to, self.damping, strict=True))
        return replace(self, damping=damping)

    def against(self, stiffness: tuple[float, ...]) -> Self:
        """Return these parameters for a wrist of this stiffness, with the damping it needs."""
        stiffer = tuple(map(max, self.stiffness, stiffness))
        found = replace(self, stiffness=stiffer, allow_unstable=True)
        if not self.allow_unstable:
            found = replace(found, damping=tuple(map(max, self.damping, found.least_damping)))
        return replace(found, allow_unstable=self.allow_unstable)

    @property
    def least_damping(self) -> tuple[float, ...]:
        """The damping of each axis from which on its force is monotone, with the centre at 0."""
        return tuple(stiffness * self.period / MONOTONE for stiffness in self.stiffness)

    @property
    def mobility(self) -> Array:
        """``D^-1`` at the reference point of wrenches and velocities, shape (6, 6)."""
        return self._mobility_of(np.array(self.damping))

    def _mobility_of(self, damping: Array) -> Array:
        """Return the inverse at the reference point of a matrix that is diagonal at the centre.

        Sums go from the first to the last, here and in the laws, so that C has the same bits.
        """
        moved = self._moved(1.0)
        matrix: Array = ((moved / damping)[:, None] * moved).sum(axis=2)
        return matrix

    def _moved(self, sign: float) -> Array:
        """Return the velocity at the reference point of one at the centre; -1: the opposite."""
        x, y, z = (sign * one for one in self.centre)
        moved = np.eye(6)
        moved[3:, :3] = [[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]]
        return moved


class AccommodationObservation(NamedTuple):
    """Inputs of the law, shape (6,) each."""

    command: Array
    wrench: Array
    damping: Array | None


class AccommodationState(NamedTuple):
    """Memory from one step to the next, and outputs of the law, shape (6,) each."""

    velocity: Array
    perturbed: Array


def product(matrix: Array, vector: Array) -> Array:
    """Return the product of a matrix and a vector, each sum from the first to the last."""
    total: Array = (matrix * vector).sum(axis=1, initial=0.0)
    return total


class AccommodatingLaw(HeldLaw[State, AccommodationObservation, State]):
    """A law that yields to a wrench: the signals that such laws have in common."""

    observation = AccommodationObservation

    def __init__(self, params: AccommodationParams, start: State) -> None:
        size = len(AXES)
        super().__init__(
            period=params.period,
            inputs={
                "command": Signal(size, VELOCITY, finite=True),
                "wrench": Signal(size, WRENCH, finite=True),
                "damping": Signal(size, DAMPING, optional=True),
            },
            outputs={"velocity": Signal(size, VELOCITY), "perturbed": Signal(size, VELOCITY)},
            start=start,
        )
        self.params = params
        self._mobility = lru_cache(maxsize=16)(lambda own: params.with_damping(own).mobility)

    def mobility(self, damping: Array | None) -> Array:
        """Return the matrix from a wrench to a velocity, with a damping that is set."""
        return self._mobility(() if damping is None else tuple(damping.tolist()))


class AccommodationLaw(AccommodatingLaw[AccommodationState]):
    """See :class:`chamfer.systems.force.accommodation.AccommodationController`."""

    def __init__(self, params: AccommodationParams) -> None:
        super().__init__(params, AccommodationState(*np.zeros((2, len(AXES)))))

    def update(
        self, state: AccommodationState, observation: AccommodationObservation, time: float
    ) -> AccommodationState:
        """Return the state after a step."""
        command, wrench, damping = observation
        return AccommodationState(command + product(self.mobility(damping), wrench), command)
