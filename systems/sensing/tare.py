"""Taking a force sensor's zero on command."""

import math

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from chamfer.models.validation import ParameterError


class Tare(LeafSystem):
    """Takes off what the sensor read, on average, while it was told to take its zero.

    .. pydrake_system::

        name: Tare
        input_ports:
        - force
        - tare
        output_ports:
        - tared_force
        - spread

    So a bias goes, and with a nugget in the gripper its weight. What drifts or turns with the
    sensor afterwards does not.

    ``force``, shape (size,), N, or N m above N; ``tare``, size 1: 1 while the zero is taken.
    ``tared_force``, likewise: zero meanwhile, and what is read less the last mean before and
    afterwards. ``spread``, likewise: the standard deviation of one of the readings of which the
    last mean is, 0 before there are two.

    Discrete states: the mean and the sum of squared deviations from it, shape (size,) each, and
    of how many readings they are, size 2: of the zero that is being taken, 0 once it is taken,
    and of the last one.

    Args:
        period: s, of the readings.
        size: How many the readings are: 3 of a force, 6 of a wrench.

    Raises:
        ParameterError: If the period is not positive; while running, if the force is not finite.
    """

    def __init__(self, *, period: float, size: int = 3) -> None:
        super().__init__()
        if not 0 < period < math.inf:
            raise ParameterError("period", period, "a finite number > 0")
        force = self.DeclareVectorInputPort("force", size)
        tare = self.DeclareVectorInputPort("tare", 1)
        mean = self.DeclareDiscreteState(size)
        squares = self.DeclareDiscreteState(size)
        counts = self.DeclareDiscreteState(2)

        def takes(context: Context) -> bool:
            return bool(tare.Eval(context)[0] > 0.5)

        def calc(context: Context, vector: BasicVector) -> None:
            if takes(context):
                vector.SetFromVector(np.zeros(size))
            else:
                off = context.get_discrete_state(mean).value()
                vector.SetFromVector(force.Eval(context) - off)

        def calc_spread(context: Context, vector: BasicVector) -> None:
            readings = context.get_discrete_state(counts).value()[1]
            sums = context.get_discrete_state(squares).value()
            vector.SetFromVector(np.sqrt(sums / max(readings - 1, 1)))

        def tick(context: Context, values: DiscreteValues) -> None:
            running, last = context.get_discrete_state(counts).value().tolist()
            if not takes(context):
                values.set_value(counts, [0.0, last])
                return
            reading = force.Eval(context)
            if not all(map(math.isfinite, reading.tolist())):
                raise ParameterError("force", reading.tolist(), "finite numbers")
            # The first one of a new zero leaves nothing of the last.
            before = context.get_discrete_state(mean).value()
            sums = context.get_discrete_state(squares).value() if running else np.zeros(size)
            after = before + (reading - before) / (running + 1) if running else reading
            values.set_value(mean, after)
            values.set_value(squares, sums + (reading - before) * (reading - after))
            values.set_value(counts, [running + 1, running + 1])

        sources = {force.ticket(), tare.ticket(), self.discrete_state_ticket(mean)}
        self.DeclareVectorOutputPort("tared_force", size, calc, sources)
        spread_of = {self.discrete_state_ticket(one) for one in (squares, counts)}
        self.DeclareVectorOutputPort("spread", size, calc_spread, spread_of)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, tick)
