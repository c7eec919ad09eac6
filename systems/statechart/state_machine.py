"""The state machine block: runs a chart inside a Drake diagram."""

import math
from collections.abc import Callable, Collection, Mapping
from dataclasses import dataclass
from typing import Any, Generic

from pydrake.common.value import Value
from pydrake.systems.framework import BasicVector, Context, LeafSystem
from pydrake.systems.framework import State as DrakeState

from chamfer.models.validation import ParameterError
from chamfer.systems.statechart.chart import Chart, Inputs, Memory, Snapshot, TransitionRecord


@dataclass(frozen=True, kw_only=True)
class MachineOutput(Generic[Memory]):
    """An output port of a :class:`StateMachine`, computed from the chart's memory."""

    size: int
    read: Callable[[Memory], tuple[float, ...]]


def number(name: str) -> MachineOutput[Any]:
    """Return the output that is a number of the memory, by its name there."""
    return MachineOutput(size=1, read=lambda memory: (float(getattr(memory, name)),))


@dataclass(slots=True, eq=False)
class _Content:
    """The block's state. It is never changed, so that contexts may share it without copying."""

    snapshot: Snapshot[Any]
    log: tuple[TransitionRecord, ...]  # oldest first

    def __deepcopy__(self, memo: object) -> "_Content":
        return self


class StateMachine(LeafSystem, Generic[Inputs, Memory]):
    """Runs a chart at a fixed period.

    .. pydrake_system::

        name: StateMachine
        input_ports:
        - (one per field of ``inputs``)
        output_ports:
        - (one per entry of ``outputs``)
        - state

    The chart reads its inputs as a named tuple whose fields are the input ports; an optional one
    that is not connected reads as None. Outputs are functions of the chart's memory, which has to
    be immutable, and are held between ticks. ``state`` is the index of the current state in
    ``chart.state_names``.

    The tick is an unrestricted update. Drake runs those before the discrete updates of the same
    instant, so a discrete plant that steps at the tick already sees the new output: the loop has
    the delay of a zero-order hold and nothing more.

    Abstract state: the chart's snapshot and the log of the transitions taken.

    ``inputs`` is a ``NamedTuple`` class, whose fields are the names of the input ports; of these
    the optional ones need not be connected. The period, s, is the time between ticks.

    Raises:
        ParameterError: If the period or a size is not allowed.
    """

    def __init__(
        self,
        chart: Chart[Inputs, Memory],
        *,
        inputs: Callable[..., Inputs],
        sizes: Mapping[str, int],
        outputs: Mapping[str, MachineOutput[Memory]],
        optional: Collection[str] = (),
        period: float,
    ) -> None:
        super().__init__()
        if not (math.isfinite(period) and period > 0):
            raise ParameterError("period", period, "a finite number > 0")
        fields: tuple[str, ...] = getattr(inputs, "_fields", ())
        if set(fields) != set(sizes):
            raise ParameterError("sizes", dict(sizes), f"one size for each of {', '.join(fields)}")
        sized = {**sizes, **{name: output.size for name, output in outputs.items()}}
        for name, size in sized.items():
            if size < 1:
                raise ParameterError(f"size of {name}", size, "a whole number >= 1")
        if "state" in outputs:
            raise ParameterError("outputs", list(outputs), "names other than state")
        if not set(optional) <= set(fields):
            raise ParameterError("optional", list(optional), ", ".join(fields))
        self.chart = chart
        self.period = period
        self._make_inputs = inputs
        self._input_ports = [
            (self.DeclareVectorInputPort(name, sizes[name]), name in optional) for name in fields
        ]
        held = self.DeclareAbstractState(Value[object](_Content(chart.start(), ())))
        index = {name: float(i) for i, name in enumerate(chart.state_names)}

        def declare(
            name: str, size: int, read: Callable[[Snapshot[Memory]], tuple[float, ...]]
        ) -> None:
            def calc(context: Context, vector: BasicVector) -> None:
                vector.SetFromVector(read(self.snapshot(context)))

            self.DeclareVectorOutputPort(name, size, calc, {self.abstract_state_ticket(held)})

        for name, output in outputs.items():
            declare(name, output.size, lambda now, read=output.read: read(now.memory))  # type: ignore[misc]
        declare("state", 1, lambda now: (index[now.state],))
        self.DeclarePeriodicUnrestrictedUpdateEvent(period, 0.0, self._tick)

    def snapshot(self, context: Context) -> Snapshot[Memory]:
        """Return where the chart is: state, time of entry and memory."""
        snapshot: Snapshot[Memory] = self._content(context).snapshot
        return snapshot

    def transitions(self, context: Context) -> tuple[TransitionRecord, ...]:
        """Return every transition taken so far, oldest first."""
        return self._content(context).log

    def _content(self, context: Context) -> _Content:
        content: _Content = context.get_abstract_state(0).get_value()
        return content

    def _tick(self, context: Context, state: DrakeState) -> None:
        content = self._content(context)
        inputs = self._make_inputs(
            *[
                None
                if optional and not port.HasValue(context)
                else tuple(port.Eval(context).tolist())
                for port, optional in self._input_ports
            ]
        )
        snapshot, record = self.chart.step(content.snapshot, inputs, context.get_time())
        log = content.log if record is None else (*content.log, record)
        state.get_mutable_abstract_state().get_mutable_value(0).set_value(_Content(snapshot, log))
