"""A two-fingered gripper: it holds a part as it finds it, or lets it rest."""

import math
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common.value import AbstractValue, Value
from pydrake.systems.framework import (
    Context,
    DiagramBuilder,
    InputPortIndex,
    LeafSystem,
    OutputPort,
    State,
)
from pydrake.systems.primitives import Adder, PortSwitch

from chamfer.models.validation import ParameterError, require_positive

Array = NDArray[np.float64]

SIZE: Final = 6  # of a displacement, rad above m
# Where the part is to be, as an input of a PortSwitch, whose first one is what selects.
HELD: Final = InputPortIndex(1)
RESTS: Final = InputPortIndex(2)


@dataclass(frozen=True, kw_only=True)
class GripperParams:
    """Parameters of :class:`Gripper`."""

    reach: float = 0.004  # m, between fingers and part, within which it grips; assumed
    period: float = 0.01  # s, between two looks at what it is told; assumed
    senses: bool = True  # whether its fingers feel a part; without, a part is weighed at the wrist

    def __post_init__(self) -> None:
        require_positive(self, "reach", "period")


class Gripper(LeafSystem):
    """Decides what it holds, and how.

    .. pydrake_system::

        name: Gripper
        input_ports:
        - carriage
        - closed
        output_ports:
        - offset
        - resting
        - selection
        - holding

    ``carriage``, shape (12,), is a displacement, rad above m, and its rate. ``closed``, size 1, is
    1 for closed fingers. A part is gripped when the fingers close within reach of it, as it is
    then; until that, and after the fingers have opened, it rests where it is.

    All outputs change at ticks alone; :func:`add_gripper` makes where the part is to be of them.
    ``offset`` and ``resting``, shape (12,), are the displacement of a part that is held relative
    to the carriage, and where one rests that is not, both with a rate of zero; ``selection``, an
    ``InputPortIndex``, is :data:`HELD` or :data:`RESTS`; ``holding``, size 1, is 1 while it holds
    a part.

    Discrete state: whether it holds the part; ``offset``; ``resting``; whether the fingers were
    closed at the last tick.

    Args:
        params: Reach and period.
        resting: Where the part is at first, rad above m, shape (6,).
        offset: Of a part that is held from the begin, shape (6,); None: it is not held.

    Raises:
        ParameterError: At construction if ``resting`` or ``offset`` is not six finite numbers; in
            a run if ``carriage`` is not finite when the fingers close or open.
    """

    def __init__(
        self, params: GripperParams, *, resting: Array, offset: Array | None = None
    ) -> None:
        super().__init__()
        for name, value in (("resting", resting), ("offset", offset)):
            if value is not None and not (np.shape(value) == (SIZE,) and np.isfinite(value).all()):
                raise ParameterError(name, np.asarray(value).tolist(), "six finite numbers")
        self._params = params
        self._carriage = self.DeclareVectorInputPort("carriage", 2 * SIZE)
        self._closed = self.DeclareVectorInputPort("closed", 1)
        self._holds = self.DeclareDiscreteState([float(offset is not None)])
        self._offset = self.DeclareDiscreteState(
            _at_rest(np.zeros(SIZE) if offset is None else offset)
        )
        self._resting = self.DeclareDiscreteState(_at_rest(resting))
        self._were_closed = self.DeclareDiscreteState([float(offset is not None)])
        self.DeclareStateOutputPort("offset", self._offset)
        self.DeclareStateOutputPort("resting", self._resting)
        self.DeclareAbstractOutputPort(
            "selection",
            lambda: Value[InputPortIndex](HELD),
            self._calc_selection,
            {self.discrete_state_ticket(self._holds)},
        )
        self.DeclareStateOutputPort("holding", self._holds)
        self.DeclarePeriodicUnrestrictedUpdateEvent(params.period, 0.0, self._tick)

    def _calc_selection(self, context: Context, value: AbstractValue) -> None:
        value.set_value(HELD if context.get_discrete_state(self._holds)[0] else RESTS)

    def _tick(self, context: Context, state: State) -> None:
        holds = bool(context.get_discrete_state(self._holds)[0])
        closed = self._closed.Eval(context)[0] >= 0.5
        were_closed = bool(context.get_discrete_state(self._were_closed)[0])
        if closed == were_closed:
            return
        values = state.get_mutable_discrete_state()
        values.set_value(self._were_closed, [float(closed)])
        if holds == closed:
            return
        carriage: Array = self._carriage.Eval(context)[:SIZE]
        if not np.isfinite(carriage).all():
            raise ParameterError("carriage", carriage.tolist(), "finite numbers")
        if closed:
            offset = context.get_discrete_state(self._resting).value()[:SIZE] - carriage
            if math.hypot(*offset[3:]) <= self._params.reach:
                values.set_value(self._holds, [1.0])
                values.set_value(self._offset, _at_rest(offset))
        else:
            offset = context.get_discrete_state(self._offset).value()[:SIZE]
            values.set_value(self._holds, [0.0])
            values.set_value(self._resting, _at_rest(carriage + offset))


class Gripped(NamedTuple):
    """What :func:`add_gripper` added."""

    part: OutputPort  # where the part is to be: displacement, rad above m, and rate, shape (12,)
    holding: OutputPort  # 1 while it holds the part, size 1


def add_gripper(
    builder: DiagramBuilder, gripper: Gripper, *, carriage: OutputPort, closed: OutputPort
) -> Gripped:
    """Add a gripper, and what moves the part with it: no Python between its ticks.

    Args:
        builder: Where to.
        gripper: Not yet added.
        carriage: Displacement, rad above m, and its rate, shape (12,).
        closed: 1 for closed fingers.
    """
    builder.AddNamedSystem("gripper", gripper)
    held = builder.AddNamedSystem("held part", Adder(2, 2 * SIZE))
    switch = builder.AddNamedSystem("part", PortSwitch(2 * SIZE))
    assert switch.DeclareInputPort("held").get_index() == HELD
    assert switch.DeclareInputPort("resting").get_index() == RESTS
    connect = builder.Connect
    connect(carriage, gripper.GetInputPort("carriage"))
    connect(closed, gripper.GetInputPort("closed"))
    connect(carriage, held.get_input_port(0))
    connect(gripper.GetOutputPort("offset"), held.get_input_port(1))
    connect(held.get_output_port(), switch.GetInputPort("held"))
    connect(gripper.GetOutputPort("resting"), switch.GetInputPort("resting"))
    connect(gripper.GetOutputPort("selection"), switch.get_port_selector_input_port())
    return Gripped(switch.get_output_port(), gripper.GetOutputPort("holding"))


def _at_rest(displacement: Array) -> Array:
    """Return a displacement with a rate of zero, shape (12,)."""
    return np.concatenate([displacement, np.zeros(SIZE)])
