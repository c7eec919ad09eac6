"""Admittance: a commanded motion that gives way to force as a mass on spring and damper would.

    M v' + D (v - v_cmd) + K (x - x_cmd) = F

in each of six axes, with the wrench F on the tool, x the integral of v and x_cmd that of v_cmd.
Without M and K it is accommodation. Source: N. Hogan, Impedance control, part I, J. Dynamic
Systems, Measurement, and Control 107 (1985) 1-7; B. Siciliano and L. Villani, Robot Force Control
(1999), chapter 3, where an inner loop tracks the motion that such an equation gives. What follows
is derived here.

A sample of the period T makes v of the one before, v-, with the mass' own rate taken backwards
and the spring where v leads, so that neither can make it unstable by itself::

    (M/T + D + K T) (v - v_cmd) = F - K e- + M/T (v- - v_cmd),   e = e- + T (v - v_cmd)

Against a stiffness k, with one sample of delay between force and velocity, the loop's poles obey

    z^2 - (2 mu + delta) z + mu + kappa = 0

with the shares mu, delta and sigma that M/T, D and K T have of their sum S, and ``kappa = k T/S``.
They are stable for ``kappa < 1 - mu``, which is ``k T < D + K T`` whatever the mass, and real and
not negative, so that the force is monotone, for ``(2 mu + delta)^2 >= 4 (mu + kappa)``, which is

    D >= 2 k T + 2 sqrt(k^2 T^2 + M (k + K) + k K T^2).

Without M and K that is accommodation's ``4 k T``, and for T = 0 the critical damping of M against
k + K. With a remote centre of compliance all poles of the six axes have to be so.
"""

import math
from dataclasses import dataclass
from typing import ClassVar, Final, NamedTuple

import numpy as np

from chamfer.models.validation import ParameterError
from chamfer.systems.force.accommodation_law import (
    AXES,
    AccommodatingLaw,
    AccommodationObservation,
    AccommodationParams,
    product,
)
from chamfer.systems.law import Array

_NOTHING: Final = (0.0,) * len(AXES)
_REAL: Final = 1e-6  # imaginary part of a double pole, by rounding


@dataclass(frozen=True, kw_only=True)
class AdmittanceParams(AccommodationParams):
    """Parameters of :class:`AdmittanceLaw`; matrices are diagonal at the centre of compliance."""

    inertia: tuple[float, ...] = _NOTHING  # kg m^2 and kg, M; 0: none, as accommodation
    spring: tuple[float, ...] = _NOTHING  # N m/rad and N/m, K, towards the commanded motion

    _least: ClassVar[str] = "2 k T + 2 sqrt(k^2 T^2 + M (k + K) + k K T^2)"

    def __post_init__(self) -> None:
        for name in ("inertia", "spring"):
            values = getattr(self, name)
            if len(values) != len(AXES) or not all(0 <= value < math.inf for value in values):
                raise ParameterError(name, values, "six finite numbers >= 0")
        super().__post_init__()

    @property
    def is_accommodation(self) -> bool:
        """Whether there is neither mass nor spring."""
        return not any((*self.inertia, *self.spring))

    @property
    def least_damping(self) -> tuple[float, ...]:
        """The damping of each axis from which on its force is monotone, with the centre at 0."""
        T, found = self.period, []
        for k, M, K in zip(self.stiffness, self.inertia, self.spring, strict=True):
            root = math.sqrt((k * T) ** 2 + M * (k + K) + k * K * T**2)
            found.append(2 * k * T + 2 * root)
        return tuple(found)

    @property
    def mobility(self) -> Array:
        """``(M/T + D + K T)^-1`` at the reference point, shape (6, 6)."""
        T = self.period
        added = np.array(self.inertia) / T + T * np.array(self.spring)
        return self._mobility_of(np.array(self.damping) + added)

    @property
    def momentum(self) -> Array:
        """``M/T`` at the reference point, N m s/rad and N s/m, shape (6, 6)."""
        return self._at_reference(np.array(self.inertia) / self.period)

    @property
    def restoring(self) -> Array:
        """K at the reference point, N m/rad and N/m, shape (6, 6)."""
        return self._at_reference(np.array(self.spring))

    def _at_reference(self, diagonal: Array) -> Array:
        moved = self._moved(-1.0)
        matrix: Array = ((moved.T * diagonal)[:, None] * moved.T).sum(axis=2)
        return matrix

    def _require_centre(self) -> None:
        if self.is_accommodation:
            return super()._require_centre()
        T, Y, one, nothing = self.period, self.mobility, np.eye(6), np.zeros((6, 6))
        once = one + Y @ (self.momentum - T * self.restoring)
        twice = -Y @ (self.momentum + T * np.diag(self.stiffness))
        poles = np.linalg.eigvals(np.block([[once, twice], [one, nothing]]))
        # A stiff axis has its poles at 1 and 0.
        worst = complex(poles[np.argmax(np.abs(poles.imag) + np.maximum(-poles.real, 0.0))])
        if abs(worst.imag) > _REAL or worst.real < -_REAL:
            allowed = f"one with which all poles are real and not negative, here {worst:.3g}"
            raise ParameterError("centre", self.centre, allowed)
        return None


class AdmittanceState(NamedTuple):
    """Memory from one step to the next, shape (6,) each."""

    velocity: Array
    perturbed: Array
    displacement: Array  # x - x_cmd, rad and m


class AdmittanceLaw(AccommodatingLaw[AdmittanceState]):
    """See :class:`chamfer.systems.force.admittance.AdmittanceController`."""

    def __init__(self, params: AdmittanceParams) -> None:
        super().__init__(params, AdmittanceState(*np.zeros((3, len(AXES)))))
        self._momentum, self._restoring = params.momentum, params.restoring

    def update(
        self, state: AdmittanceState, observation: AccommodationObservation, time: float
    ) -> AdmittanceState:
        """Return the state after a step."""
        command, wrench, damping = observation
        kept = product(self._momentum, state.velocity - command)
        pull = kept - product(self._restoring, state.displacement)
        velocity = command + product(self.mobility(damping), wrench + pull)
        displacement = state.displacement + self.period * (velocity - command)
        return AdmittanceState(velocity, command, displacement)
