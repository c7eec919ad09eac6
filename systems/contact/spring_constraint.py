"""A spring that resists a tool's motion in both directions, or in one only."""

import math
from dataclasses import dataclass
from typing import Literal

import numpy as np
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.validation import (
    ParameterError,
    require_finite,
    require_not_negative,
    require_one_of,
)

SIZE = 6  # of displacements and wrenches, angular above linear
_INDICES = f"a whole number from 0 to {SIZE - 1}"


@dataclass(frozen=True, kw_only=True)
class SpringConstraintParams:
    """Parameters of :class:`SpringConstraint`."""

    index: int | None = None  # of the constrained element, 0 to 2 about, 3 to 5 along x, y, z;
    # None: derived from the motion, that of a dither
    sides: Literal["none", "both", "one"] = "both"
    # on which it acts; one: against growing displacements
    stiffness: float = 2e4  # N/m or N m/rad, of the spring
    stop_at: float = 0.0  # m or rad, position of a stop on one side

    def __post_init__(self) -> None:
        require_one_of(self, "sides", ("none", "both", "one"))
        require_not_negative(self, "stiffness")
        require_finite(self, "stop_at")
        if self.index is not None and self.index not in range(SIZE):
            raise ParameterError("index", self.index, _INDICES)


class SpringConstraint(LeafSystem):
    """Resists a displacement along one axis with a spring.

    .. pydrake_system::

        name: SpringConstraint
        input_ports:
        - displacement
        output_ports:
        - wrench

    ``displacement``, shape (6,), rad above m; ``wrench``, shape (6,), N m above N, on the tool.

    Raises:
        ParameterError: At construction without an index; in a run if the displacement is not
            finite.
    """

    def __init__(self, params: SpringConstraintParams) -> None:
        super().__init__()
        index = params.index
        if index is None:
            raise ParameterError("index", index, _INDICES)
        displacement = self.DeclareVectorInputPort("displacement", SIZE)

        def calc(context: Context, vector: BasicVector) -> None:
            x = float(displacement.Eval(context)[index])
            if not math.isfinite(x):
                raise ParameterError("displacement", x, "a finite number")
            if params.sides == "one":
                x = max(0.0, x - params.stop_at)
            elif params.sides == "none":
                x = 0.0
            wrench = np.zeros(SIZE)
            wrench[index] = -params.stiffness * x
            vector.SetFromVector(wrench)

        self.DeclareVectorOutputPort("wrench", SIZE, calc, {displacement.ticket()})
