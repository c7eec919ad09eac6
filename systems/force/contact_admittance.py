"""What a position-controlled arm makes of the force at its wrist: a pose beside its command."""

import math
from dataclasses import dataclass
from typing import Final, Literal, NamedTuple, get_args

import numpy as np

from chamfer.models.validation import (
    ParameterError,
    require_numbers,
    require_one_of,
    require_same,
)
from chamfer.systems.force.accommodation_law import AXES, WRENCH, AccommodationObservation
from chamfer.systems.force.admittance_law import AdmittanceLaw, AdmittanceParams, AdmittanceState
from chamfer.systems.force.tool_pose import POSE, compensate, share_of_compensation
from chamfer.systems.law import Array, Law, Signal

AdmittanceKind = Literal["wrist", "none"]

_SIX: Final = len(AXES)
_RECENTRED: Final = 0.1  # s, time constant with which a displacement is taken back; assumed


@dataclass(frozen=True, kw_only=True)
class ContactAdmittanceParams:
    """``M v' + D v + K x = F``: how far, x, the arm goes from its command for a wrench F.

    About and along the hole's axes, x into it: rx, ry, rz in N m and rad, x, y, z in N and m.
    """

    kind: AdmittanceKind = "wrist"
    # wrist: gives way to the wrist sensor's force; none: to nothing, what gives way is below it
    inertia: tuple[float, ...] = (0.0,) * _SIX  # kg m^2 and kg, M; 0: none
    damping: tuple[float, ...] | None = None
    # N m s/rad and N s/m, D; None: derived, what the contact needs
    spring: tuple[float, ...] = (5.0, 5.0, 5.0, 400.0, 400.0, 400.0)
    # N m/rad and N/m, K, towards the command
    centre: tuple[float, ...] = (0.0, 0.0, 0.0)  # m, of compliance, from the peg's tip

    def __post_init__(self) -> None:
        require_one_of(self, "kind", get_args(AdmittanceKind))
        require_numbers(self, 3, "centre")
        for name in ("inertia", "spring"):
            values = getattr(self, name)
            if len(values) != _SIX or not all(0 <= value < math.inf for value in values):
                raise ParameterError(name, values, "six finite numbers >= 0")
        given = self.damping
        positive = given is None or (len(given) == _SIX and all(0 < d < math.inf for d in given))
        if not positive:
            raise ParameterError("damping", given, "six finite numbers > 0, or null")
        if self.kind == "none":
            names = "inertia", "damping", "spring", "centre"
            why = "admittance.kind is none"
            require_same(self, ContactAdmittanceParams, "admittance", *names, why=why)

    @property
    def stiffness(self) -> tuple[float, ...]:
        """K, N m/rad and N/m; infinity where nothing gives way."""
        return self.spring if self.kind == "wrist" else (math.inf,) * _SIX


class ContactAdmittanceObservation(NamedTuple):
    """What the law reads."""

    desired_pose: Array
    wrench: Array
    recentres: Array


class ContactAdmittanceCommand(NamedTuple):
    """What the law gives, shape (7,)."""

    reference_pose: Array


class ContactAdmittanceLaw(
    Law[AdmittanceState, ContactAdmittanceObservation, ContactAdmittanceCommand]
):
    """See :class:`ContactAdmittance`."""

    observation = ContactAdmittanceObservation

    def __init__(self, params: ContactAdmittanceParams, R_WH: Array, *, period: float) -> None:
        damping = params.damping if params.kind == "wrist" else (math.inf,) * _SIX
        if damping is None:
            raise ParameterError("damping", None, "six numbers > 0")
        # That the loop is stable in contact is known where the arm is.
        self._give_way = AdmittanceLaw(
            AdmittanceParams(
                inertia=params.inertia,
                damping=damping,
                spring=params.spring,
                centre=params.centre,
                period=period,
                allow_unstable=True,
            )
        )
        self._kept = math.exp(-period / _RECENTRED)
        # compensate() takes m above rad.
        self._moves = np.roll(share_of_compensation(1.0, R_WH), 3, axis=1)
        super().__init__(
            period=period,
            inputs={
                "desired_pose": POSE._replace(finite=True),
                "wrench": Signal(_SIX, WRENCH, finite=True),
                "recentres": Signal(),
            },
            outputs={"reference_pose": POSE},
            start=self._give_way.start(),
        )

    def step(
        self, state: AdmittanceState, observation: ContactAdmittanceObservation, time: float
    ) -> tuple[AdmittanceState, ContactAdmittanceCommand]:
        """Return the state after a step, and the pose that is commanded."""
        desired, wrench, recentres = observation
        if recentres[0] >= 0.5:
            still = np.zeros(_SIX)
            given = AdmittanceState(still, still, self._kept * state.displacement)
        else:
            seen = AccommodationObservation(np.zeros(_SIX), wrench, None)
            given = self._give_way.update(state, seen, time)
        moved = compensate(desired, self._moves @ given.displacement)
        return given, ContactAdmittanceCommand(moved)
