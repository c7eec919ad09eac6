"""What goes wrong while a crucible is charged, and when."""

from dataclasses import dataclass

import numpy as np
from pydrake.systems.framework import BasicVector, Context, DiscreteValues, LeafSystem

from chamfer.models.validation import ParameterError, require_not_negative, require_positive


@dataclass(frozen=True, kw_only=True)
class FaultTriggerParams:
    """Parameters of :class:`FaultTrigger`."""

    state: int  # index of the chart's state
    item: int  # index in the plan
    delay: float  # s, after the state is entered with that item
    duration: float  # s; may be infinite
    period: float = 0.005  # s

    def __post_init__(self) -> None:
        require_not_negative(self, "delay")
        require_positive(self, "period")
        if not self.duration > 0:
            raise ParameterError("duration", self.duration, "a number > 0")


class FaultTrigger(LeafSystem):
    """Says when a fault acts: once, a while after a state is entered.

    .. pydrake_system::

        name: FaultTrigger
        input_ports:
        - state
        - item
        output_ports:
        - active

    ``state`` and ``item``, size 1, of the chart; ``active``, size 1, 1 while the fault acts.

    Discrete state: time since the state was entered with the item, s, -1 before; active.
    """

    def __init__(self, params: FaultTriggerParams) -> None:
        super().__init__()
        self._params = params
        self._state = self.DeclareVectorInputPort("state", 1)
        self._item = self.DeclareVectorInputPort("item", 1)
        memory = self.DeclareDiscreteState(np.array([-1.0, 0.0]))

        def calc(context: Context, vector: BasicVector) -> None:
            vector.SetAtIndex(0, context.get_discrete_state(memory).value()[1])

        self.DeclareVectorOutputPort("active", 1, calc, {self.discrete_state_ticket(memory)})
        self.DeclarePeriodicDiscreteUpdateEvent(params.period, 0.0, self._tick)

    def _tick(self, context: Context, values: DiscreteValues) -> None:
        params = self._params
        since = float(context.get_discrete_state(0).value()[0])
        if since >= 0:
            since += params.period
        elif (
            self._state.Eval(context)[0] == params.state
            and self._item.Eval(context)[0] == params.item
        ):
            since = 0.0
        late = since - params.delay + 1e-9
        values.set_value(0, np.array([since, float(since >= 0 and 0 <= late < params.duration)]))


class CutOff(LeafSystem):
    """A sensor's line to the computer, which may be cut: it reads 0 then, and is known to.

    .. pydrake_system::

        name: CutOff
        input_ports:
        - signal
        - cut
        output_ports:
        - reading
        - alive

    ``signal`` and ``reading``, shape (k,); ``cut``, size 1; ``alive``, size 1, 0 while it is cut.

    Args:
        size: k.
    """

    def __init__(self, size: int) -> None:
        super().__init__()
        signal = self.DeclareVectorInputPort("signal", size)
        cut = self.DeclareVectorInputPort("cut", 1)

        def calc(context: Context, vector: BasicVector) -> None:
            whole = cut.Eval(context)[0] < 0.5
            vector.SetFromVector(signal.Eval(context) if whole else np.zeros(size))

        self.DeclareVectorOutputPort("reading", size, calc, {signal.ticket(), cut.ticket()})

        def show(context: Context, vector: BasicVector) -> None:
            vector.SetAtIndex(0, float(cut.Eval(context)[0] < 0.5))

        self.DeclareVectorOutputPort("alive", 1, show, {cut.ticket()})
