"""Limits at which a silicon nugget damages a glass crucible (appendix C)."""

from typing import Final

import numpy as np

from chamfer.models.validation import ParameterError

SCRATCH_FORCE: Final = 5.0  # N, sustained, section C.1
SAFE_SPEED: Final = 0.20  # m/s, "very little chance of impact damage", section C.2
IMPACT_SPEEDS: Final = (  # nugget kg, m/s at which damage begins, section C.2
    (0.014, 0.99),
    (0.028, 0.99),
    (0.085, 0.63),
    (0.140, 0.44),
    (0.185, 0.44),
)


def impact_speed_limit(mass: float) -> float:
    """Return the speed at which a nugget's impact begins to damage glass, m/s.

    Between the masses tested it is interpolated, beyond them held.

    Args:
        mass: Of the nugget, kg.

    Raises:
        ParameterError: If the mass is not a finite number > 0.
    """
    if not 0 < mass < np.inf:
        raise ParameterError("mass", mass, "a finite number > 0")
    masses, speeds = zip(*IMPACT_SPEEDS, strict=True)
    return float(np.interp(mass, masses, speeds))
