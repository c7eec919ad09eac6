"""The rate of a measured force: what is left of it when it is filtered and differenced."""

import math
from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from models.validation import ParameterError, require_positive


@dataclass(frozen=True, kw_only=True)
class ForceRateParams:
    """Parameters of :class:`ForceRate`."""

    time_constant: float = 0.1  # s, of the filter before the difference; the rate lags by it
    period: float = 0.005  # s, of the samples

    def __post_init__(self) -> None:
        require_positive(self, "time_constant", "period")

    @property
    def share(self) -> float:
        """Part of a step of the force that the filter takes up in a period."""
        return 1 - math.exp(-self.period / self.time_constant)

    @property
    def noise_gain(self) -> float:
        """Standard deviation of the rate, 1/s, over that of a white noise of the force."""
        return self.share / self.period * math.sqrt(2 / (2 - self.share))


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

    Raises:
        ParameterError: If the force is not finite.
    """

    def __init__(self, params: ForceRateParams, *, dimension: int) -> None:
        super().__init__()
        share, period = params.share, params.period
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
