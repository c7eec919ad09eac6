"""The state machine block: runs a chart inside a Drake diagram."""

from typing import Generic

from pydrake.systems.framework import Context

from chamfer.systems.law_block import LawBlock
from chamfer.systems.statechart.chart import Inputs, Memory, Snapshot, TransitionRecord
from chamfer.systems.statechart.chart_law import ChartLaw


class StateMachine(LawBlock[ChartLaw[Inputs, Memory]], Generic[Inputs, Memory]):
    """Runs a chart at a fixed period.

    .. pydrake_system::

        name: StateMachine
        input_ports:
        - (one per input of the law)
        output_ports:
        - (one per output of the law)
        - state

    Outputs are functions of the chart's memory, which has to be immutable, and are held between
    ticks. ``state`` is the index of the current state in ``chart.state_names``.

    Abstract state: the chart's snapshot and the log of the transitions taken.
    """

    def __init__(self, law: ChartLaw[Inputs, Memory]) -> None:
        super().__init__(law)
        self.chart = law.chart

    def snapshot(self, context: Context) -> Snapshot[Memory]:
        """Return the snapshot of the chart: state, time of entry and memory."""
        snapshot: Snapshot[Memory] = self.state(context).snapshot
        return snapshot

    def transitions(self, context: Context) -> tuple[TransitionRecord, ...]:
        """Return every transition taken so far, oldest first."""
        log: tuple[TransitionRecord, ...] = self.state(context).log
        return log
