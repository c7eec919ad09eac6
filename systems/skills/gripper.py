"""A two-fingered gripper: it holds a part as it finds it, or lets it rest."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.framework import BasicVector, Context, LeafSystem, State

from models.validation import ParameterError, require_positive

Array = NDArray[np.float64]

SIZE: Final = 6  # of a displacement, rad above m


@dataclass(frozen=True, kw_only=True)
class GripperParams:
    """Parameters of :class:`Gripper`."""

    reach: float = 0.004  # m, between fingers and part, within which it grips; assumed
    period: float = 0.01  # s, between two looks at what it is told; assumed

    def __post_init__(self) -> None:
        require_positive(self, "reach", "period")


class Gripper(LeafSystem):
    """Gives where the part that it holds is to be.

    .. pydrake_system::

        name: Gripper
        input_ports:
        - carriage
        - closed
        output_ports:
        - part
        - holding

    ``carriage`` and ``part``, shape (12,), are a displacement, rad above m, and its rate.
    ``closed``, size 1, is 1 for closed fingers. A part is gripped when the fingers close within
    reach of it, as it is then; until that, and after the fingers have opened, it rests where it
    is. ``holding``, size 1, is 1 while it holds a part.

    Discrete state: whether it holds the part; the part's displacement relative to the carriage,
    shape (6,); where it rests, shape (6,); whether the fingers were closed at the last tick.

    Args:
        params: Reach and period.
        resting: Where the part is at first, rad above m, shape (6,).
        offset: Of a part that is held from the begin, shape (6,); None: it is not held.

    Raises:
        ParameterError: At construction if ``resting`` or ``offset`` is not six finite numbers; in
            a run if ``carriage`` is not finite.
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
        self._offset = self.DeclareDiscreteState(np.zeros(SIZE) if offset is None else offset)
        self._resting = self.DeclareDiscreteState(np.asarray(resting, dtype=np.float64))
        self._were_closed = self.DeclareDiscreteState([float(offset is not None)])
        held = {self.discrete_state_ticket(i) for i in (self._holds, self._offset, self._resting)}
        self.DeclareVectorOutputPort(
            "part", 2 * SIZE, self._calc_part, {self._carriage.ticket(), *held}
        )
        self.DeclareStateOutputPort("holding", self._holds)
        self.DeclarePeriodicUnrestrictedUpdateEvent(params.period, 0.0, self._tick)

    def _calc_part(self, context: Context, vector: BasicVector) -> None:
        if context.get_discrete_state(self._holds)[0]:
            carriage = self._read(context)
            offset = context.get_discrete_state(self._offset).value()
            vector.SetFromVector(carriage + np.concatenate([offset, np.zeros(SIZE)]))
        else:
            resting = context.get_discrete_state(self._resting).value()
            vector.SetFromVector(np.concatenate([resting, np.zeros(SIZE)]))

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
        carriage = self._read(context)[:SIZE]
        if closed:
            offset = context.get_discrete_state(self._resting).value() - carriage
            if math.hypot(*offset[3:]) <= self._params.reach:
                values.set_value(self._holds, [1.0])
                values.set_value(self._offset, offset)
        else:
            offset = context.get_discrete_state(self._offset).value()
            values.set_value(self._holds, [0.0])
            values.set_value(self._resting, carriage + offset)

    def _read(self, context: Context) -> Array:
        carriage: Array = self._carriage.Eval(context)
        if not np.isfinite(carriage).all():
            raise ParameterError("carriage", carriage.tolist(), "finite numbers")
        return carriage
