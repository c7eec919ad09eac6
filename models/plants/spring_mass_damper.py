"""The robot under impedance control, approximated as a spring, a mass and a damper.

Ruybal, Lumia and Wood simulate the arm as a spring-mass-damper (section 3) and print neither its
mass nor its damping. The defaults are identified: with the paper's own stiffness of 700 N/m they
are the only values for which eq. (2) gives the published rise time and overshoot of Fig. 8
(experiment ``plant-identification``).
"""

import math
from dataclasses import dataclass
from typing import Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.models.validation import ParameterError, require_positive

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
    to position m: what the hardware does. ``compliance`` is ``1/(m s^2 + b s + k)``, force N to
    position m.
    """
    m, b, k = params.mass, params.damping, params.stiffness
    input_gain = k if form == "position" else 1.0
    output = [[0.0, 1.0]] if form == "velocity" else [[1.0, 0.0]]
    return StateSpace(
        A=np.array([[0.0, 1.0], [-k / m, -b / m]]),
        B=np.array([[0.0], [input_gain / m]]),
        C=np.array(output),
        D=np.zeros((1, 1)),
    )
