"""A body that strikes a plate, with the normal force of Hunt and Crossley, ``k x (1 + d v)``.

Whatever mass and stiffness are, energy gives the rebound e v of a speed v from

    d v - ln(1 + d v) = -d e v - ln(1 - d e v).
"""

import numpy as np
from scipy.special import lambertw


def restitution(dissipation: float, speed: float) -> float:
    """Return e, with a dissipation in s/m and the speed across the plate in m/s."""
    if not (x := dissipation * speed):
        return 1.0
    return float((1 + lambertw(-np.exp(np.log1p(x) - x - 1)).real) / x)
