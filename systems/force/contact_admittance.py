"""What a position-controlled arm makes of the force at its wrist, as far as it is left open."""

import math
from dataclasses import dataclass
from typing import Final

from chamfer.models.validation import ParameterError, require_numbers
from chamfer.systems.force.accommodation_law import AXES

_SIX: Final = len(AXES)


@dataclass(frozen=True, kw_only=True)
class ContactAdmittanceParams:
    """``M v' + D v + K x = F``: how far, x, the arm goes from its command for a wrench F.

    About and along the hole's axes, x into it: rx, ry, rz in N m and rad, x, y, z in N and m.
    """

    inertia: tuple[float, ...] = (0.0,) * _SIX  # kg m^2 and kg, M; 0: none
    damping: tuple[float, ...] | None = None
    # N m s/rad and N s/m, D, infinity: does not give way; None: derived, what the contact needs
    spring: tuple[float, ...] = (5.0, 5.0, 5.0, 400.0, 400.0, 400.0)
    # N m/rad and N/m, K, towards the command
    centre: tuple[float, ...] = (0.0, 0.0, 0.0)  # m, of compliance, from the peg's tip

    def __post_init__(self) -> None:
        require_numbers(self, 3, "centre")
        for name in ("inertia", "spring"):
            values = getattr(self, name)
            if len(values) != _SIX or not all(0 <= value < math.inf for value in values):
                raise ParameterError(name, values, "six finite numbers >= 0")
        given = self.damping
        if given is not None and not (len(given) == _SIX and all(value > 0 for value in given)):
            raise ParameterError("damping", given, "six numbers > 0, or null")
