"""The PID controller of eq. (2), in Simulink's form."""

from dataclasses import dataclass

import numpy as np
from pydrake.systems.primitives import LinearSystem

from chamfer.models.validation import require_finite, require_positive


@dataclass(frozen=True, kw_only=True)
class PidParams:
    """Gains of ``F(s) = P + I/s + D N/(1 + N/s)``, Ruybal, Lumia and Wood, eq. (2)."""

    proportional: float = 341.0  # N/m, P, gain of the error
    integral: float = 21903.0  # N/(m s), I, gain of its integral
    derivative: float = -0.00853  # N s/m, D, gain of its derivative
    filter: float = 39971.0  # 1/s, N, bandwidth of the derivative's filter

    def __post_init__(self) -> None:
        require_finite(self, "proportional", "integral", "derivative")
        require_positive(self, "filter")


def make_pid(params: PidParams) -> LinearSystem:
    """Return the controller, error m to force N, as a continuous linear system.

    The state is (integral of the error m s, filtered error m). The filter is written as
    ``xf' = N (e - xf)``, so that its pole at -N does not scale the other states. Drake's own
    ``PidController`` takes the error's derivative as an input and has no filter.
    """
    n = params.filter
    controller = LinearSystem(
        A=np.diag([0.0, -n]),
        B=np.array([[1.0], [n]]),
        C=np.array([[params.integral, -params.derivative * n]]),
        D=np.array([[params.proportional + params.derivative * n]]),
    )
    controller.set_name("controller")
    return controller
