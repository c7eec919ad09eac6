"""A play: its output moves only once the input has moved far enough."""

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from chamfer.models.validation import ParameterError


class Backlash(LeafSystem):
    """Follows its input at a distance: backlash, or a spring against dry friction.

    .. pydrake_system::

        name: Backlash
        input_ports:
        - command
        output_ports:
        - followed

    Input and output have the size 1. The output stays until the input is further away than the
    half width, then follows at that distance. The block is exact for an input that is held
    between updates.

    Discrete state: the output before the input's last change, which starts at 0.

    Args:
        half_width: In the input's unit.
        period: s, of the updates.

    Raises:
        ParameterError: If the half width is negative.
    """

    def __init__(self, half_width: float, *, period: float) -> None:
        super().__init__()
        if not 0 <= half_width < np.inf:
            raise ParameterError("half_width", half_width, "a finite number >= 0")
        command = self.DeclareVectorInputPort("command", 1)
        state = self.DeclareDiscreteState(1)

        def followed(context: Context) -> float:
            value = float(command.Eval(context)[0])
            before = float(context.get_discrete_state(state).value()[0])
            return min(max(before, value - half_width), value + half_width)

        def calc(context: Context, output: BasicVector) -> None:
            output[0] = followed(context)

        def update(context: Context, values: DiscreteValues) -> None:
            values.get_mutable_vector(state)[0] = followed(context)

        self.DeclareVectorOutputPort(
            "followed", 1, calc, {command.ticket(), self.discrete_state_ticket(state)}
        )
        self.DeclarePeriodicDiscreteUpdateEvent(period, 0.0, update)
