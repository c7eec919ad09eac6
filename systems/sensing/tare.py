"""Taking a force sensor's zero on command."""

import math

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from models.validation import ParameterError

_SIZE = 3


class Tare(LeafSystem):
    """Takes off what the sensor read, on average, while it was told to take its zero.

    .. pydrake_system::

        name: Tare
        input_ports:
        - force
        - tare
        output_ports:
        - tared_force

    So a bias goes, and with a nugget in the gripper its weight. What drifts or turns with the
    sensor afterwards does not.

    ``force``, shape (3,), N; ``tare``, size 1: 1 while the zero is taken. ``tared_force``, shape
    (3,), N: zero meanwhile, and what is read less the last mean before and afterwards.

    Discrete states: the mean, shape (3,), N, and of how many readings it is, size 1, 0 once the
    zero is taken.

    Args:
        period: s, of the readings.

    Raises:
        ParameterError: If the period is not positive; while running, if the force is not finite.
    """

    def __init__(self, *, period: float) -> None:
        super().__init__()
        if not 0 < period < math.inf:
            raise ParameterError("period", period, "a finite number > 0")
        force = self.DeclareVectorInputPort("force", _SIZE)
        tare = self.DeclareVectorInputPort("tare", 1)
        mean = self.DeclareDiscreteState(_SIZE)
        count = self.DeclareDiscreteState(1)

        def takes(context: Context) -> bool:
            return bool(tare.Eval(context)[0] > 0.5)

        def calc(context: Context, vector: BasicVector) -> None:
            if takes(context):
                vector.SetFromVector(np.zeros(_SIZE))
            else:
                off = context.get_discrete_state(mean).value()
                vector.SetFromVector(force.Eval(context) - off)

        def tick(context: Context, values: DiscreteValues) -> None:
            if not takes(context):
                values.set_value(count, np.zeros(1))
                return
            reading = force.Eval(context)
            if not all(map(math.isfinite, reading.tolist())):
                raise ParameterError("force", reading.tolist(), "finite numbers")
            readings = context.get_discrete_state(count).value() + 1
            # The first one of a new zero leaves nothing of the last.
            before = context.get_discrete_state(mean).value()
            values.set_value(mean, before + (reading - before) / readings[0])
            values.set_value(count, readings)

        sources = {force.ticket(), tare.ticket(), self.discrete_state_ticket(mean)}
        self.DeclareVectorOutputPort("tared_force", _SIZE, calc, sources)
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, tick)
