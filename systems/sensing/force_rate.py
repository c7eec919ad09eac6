"""The rate of a measured force: what is left of it when it is filtered and differenced."""

import math
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from chamfer.models.validation import ParameterError, require_positive


@dataclass(frozen=True, kw_only=True)
class ForceRateParams:
    """Parameters of :class:`ForceRate`."""

    time_constant: float = 0.1  # s, of the filter before the difference; the rate lags by it

    def __post_init__(self) -> None:
        require_positive(self, "time_constant")

    def share(self, period: float) -> float:
        """Return the part of a step of the force that the filter takes up in a period, s."""
        return 1 - math.exp(-period / self.time_constant)

    def noise_gain(self, period: float) -> float:
        """Return the rate's standard deviation over that of a force with white noise, 1/s.

        Args:
            period: s, of the samples.
        """
        share = self.share(period)
        return share / period * math.sqrt(2 / (2 - share))


class ForceRate(LeafSystem):
    """Differences a force that a first-order filter has smoothed.

    .. pydrake_system::

        name: ForceRate
        input_ports:
        - measured_force
        output_ports:
        - measured_force_rate

    With the filtered force ``f <- f + a (F - f)`` and the period T the rate is ``a (F - f) / T``,
    of the sample that the inputs show.

    ``measured_force``, shape (d,), N; ``measured_force_rate``, shape (d,), N/s.

    Discrete state: the last period's filtered force, shape (d,), N; 0 at first.

    Args:
        params: The filter.
        dimension: d.
        period: s.

    Raises:
        ParameterError: If the force is not finite.
    """

    def __init__(self, params: ForceRateParams, *, dimension: int, period: float) -> None:
        super().__init__()
        share = params.share(period)
        force = self.DeclareVectorInputPort("measured_force", dimension)
        filtered = self.DeclareDiscreteState(dimension)

        def change(context: Context) -> np.ndarray:
            measured = force.Eval(context)
            if not all(map(math.isfinite, measured.tolist())):
                raise ParameterError("measured_force", measured.tolist(), "finite numbers")
            step: np.ndarray = share * (measured - context.get_discrete_state(filtered).value())
            return step

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetFromVector(change(context) / period)

        def tick(context: Context, values: DiscreteValues) -> None:
            before = context.get_discrete_state(filtered).value()
            values.set_value(filtered, before + change(context))

        sources = {force.ticket(), self.discrete_state_ticket(filtered)}
        self.DeclareVectorOutputPort("measured_force_rate", dimension, calc, sources)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, tick)
