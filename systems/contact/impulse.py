"""A blow: a force that acts for a short time."""

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.models.validation import ParameterError


class Impulse(LeafSystem):
    """Gives an impulse as a constant force over a short time.

    .. pydrake_system::

        name: Impulse
        output_ports:
        - force

    Args:
        impulse: N s, shape (m,).
        begin: s.
        duration: s; a sampled plant sees the whole of it if this is its step.
    """

    def __init__(self, impulse: NDArray[np.float64], *, begin: float, duration: float) -> None:
        super().__init__()
        if not 0 < duration < np.inf:
            raise ParameterError("duration", duration, "a finite number > 0")
        force, zero = np.asarray(impulse) / duration, np.zeros(len(impulse))
        # Half a duration early, so that rounding decides neither the first nor the last sample.
        first = begin - 0.5 * duration

        def calc(context: Context, vector: BasicVector) -> None:
            acts = first <= context.get_time() < first + duration
            vector.SetFromVector(force if acts else zero)

        self.DeclareVectorOutputPort("force", len(force), calc, {self.time_ticket()})
