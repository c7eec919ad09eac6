"""The mean of a signal's last samples: less noise for who looks more rarely."""

import math

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from chamfer.models.validation import ParameterError


class MovingAverage(LeafSystem):
    """Means the last samples of a signal, the present one included.

    .. pydrake_system::

        name: MovingAverage
        input_ports:
        - signal
        output_ports:
        - mean

    Of n samples with white noise the mean has the n-th part of its variance, and is late by
    (n - 1) / 2 periods. Before n samples it is the mean of those that there were.

    ``signal`` and ``mean``, shape (size,), in the signal's unit.

    Discrete state: the last n - 1 samples, the newest first, shape ((n - 1) * size,), and how many
    of them there were, size 1.

    Args:
        samples: n, 1 or more.
        period: s, of the samples.
        size: Of the signal.

    Raises:
        ParameterError: If one of them is not positive; while running, if the signal is not finite.
    """

    def __init__(self, *, samples: int, period: float, size: int) -> None:
        super().__init__()
        if samples < 1:
            raise ParameterError("samples", samples, "1 or more")
        if not 0 < period < math.inf:
            raise ParameterError("period", period, "a finite number > 0")
        kept = samples - 1
        signal = self.DeclareVectorInputPort("signal", size)
        last = self.DeclareDiscreteState(kept * size)
        counted = self.DeclareDiscreteState(1)

        def now(context: Context) -> np.ndarray:
            value: np.ndarray = signal.Eval(context)
            if not all(map(math.isfinite, value.tolist())):
                raise ParameterError("signal", value.tolist(), "finite numbers")
            return value

        def calc(context: Context, vector: BasicVector) -> None:
            count = context.get_discrete_state(counted).value()[0]
            before = context.get_discrete_state(last).value().reshape(kept, size)
            # What there was not yet is zero.
            vector.SetFromVector((now(context) + before.sum(axis=0)) / (1 + count))

        def tick(context: Context, values: DiscreteValues) -> None:
            before = context.get_discrete_state(last).value()
            count = context.get_discrete_state(counted).value()[0]
            values.set_value(last, np.concatenate([now(context), before])[: kept * size])
            values.set_value(counted, np.array([min(count + 1, kept)]))

        sources = {
            signal.ticket(),
            self.discrete_state_ticket(last),
            self.discrete_state_ticket(counted),
        }
        self.DeclareVectorOutputPort("mean", size, calc, sources)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, tick)
