"""A state chart as a law: its inputs, and outputs computed from its memory."""

from collections import namedtuple
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, Generic, NamedTuple

from chamfer.models.validation import ParameterError
from chamfer.systems.law import HeldLaw, Signal, Vectors, vectors
from chamfer.systems.statechart.chart import Chart, Inputs, Memory, Snapshot, TransitionRecord


@dataclass(frozen=True, kw_only=True)
class MachineOutput(Generic[Memory]):
    """An output, computed from the chart's memory."""

    size: int = 1
    unit: str | tuple[str, ...] = ""  # of all elements, or of each
    read: Callable[[Memory], tuple[float, ...]]


def number(name: str, unit: str = "") -> MachineOutput[Any]:
    """Return the output that is a number of the memory, by its name there."""
    return MachineOutput(unit=unit, read=lambda memory: (float(getattr(memory, name)),))


class ChartState(NamedTuple, Generic[Memory]):
    """The chart's snapshot and the transitions that led there."""

    snapshot: Snapshot[Memory]
    log: tuple[TransitionRecord, ...] = ()  # every transition taken, oldest first


class ChartLaw(HeldLaw[ChartState[Memory], Inputs, Any], Generic[Inputs, Memory]):
    """Runs a chart once a period, s.

    The chart reads a named tuple, ``observation``, whose fields are the ``inputs``, each a tuple
    of numbers, or None where an optional one is missing. The ``outputs`` are functions of its
    memory; ``state``, the index of the current state in ``chart.state_names``, comes last.

    Raises:
        ParameterError: If the period or a size is not allowed, or the inputs are not the fields.
    """

    def __init__(
        self,
        chart: Chart[Inputs, Memory],
        *,
        observation: Callable[..., Inputs],
        inputs: Mapping[str, Signal],
        outputs: Mapping[str, MachineOutput[Memory]],
        period: float,
    ) -> None:
        fields: tuple[str, ...] = getattr(observation, "_fields", ())
        if set(fields) != set(inputs):
            raise ParameterError("inputs", list(inputs), f"one for each of {', '.join(fields)}")
        if "state" in outputs:
            raise ParameterError("outputs", list(outputs), "names other than state")
        given = {name: Signal(one.size, one.unit) for name, one in outputs.items()}
        super().__init__(
            period=period,
            inputs={name: inputs[name] for name in fields},
            outputs={**given, "state": Signal()},
            start=ChartState(chart.start()),
        )
        self.chart = chart
        self.observation = observation
        self._command: Any = namedtuple("Command", self.outputs)  # type: ignore[misc]
        self._reads = tuple(one.read for one in outputs.values())
        self._index = {name: float(i) for i, name in enumerate(chart.state_names)}

    def observe(self, values: Vectors) -> Inputs:
        """Return the chart's inputs from vectors by name."""
        seen = vectors(self.inputs, values)
        read = [None if one is None else tuple(one.tolist()) for one in seen]
        return self.observation(*read)

    def update(
        self, state: ChartState[Memory], observation: Inputs, time: float, *, abort: bool = False
    ) -> ChartState[Memory]:
        """Return the chart's state after a tick."""
        snapshot, record = self.chart.step(state.snapshot, observation, time, abort=abort)
        return ChartState(snapshot, state.log if record is None else (*state.log, record))

    def abort(
        self, state: ChartState[Memory], observation: Inputs, time: float
    ) -> ChartState[Memory]:
        """Return the chart's state after a tick that aborts it; it then stays there."""
        return self.update(state, observation, time, abort=True)

    def command(self, state: ChartState[Memory]) -> Any:
        """Return the outputs of a state, a named tuple."""
        memory = state.snapshot.memory
        index = self._index[state.snapshot.state]
        return self._command(*(read(memory) for read in self._reads), (index,))
