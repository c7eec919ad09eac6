"""Gore's two criteria for the design of a state machine, checked on a chart.

Source: D. Gore, "A Stable Design for the State Design Pattern", 2009, as restated by Ruybal, Lumia
and Wood, section 3: (1) a change to the behaviour of one state should not affect the rest of the
machine; (2) every state is used during a run, and there are sufficient interfaces to move to each.
"""

from collections.abc import Sequence
from dataclasses import replace

from chamfer.systems.statechart.chart import Chart, Inputs, Memory, State


def replay(
    chart: Chart[Inputs, Memory], inputs: Sequence[Inputs], *, period: float
) -> tuple[str, ...]:
    """Run a chart on recorded inputs, one per tick of ``period`` s, and return its states."""
    snapshot = chart.start()
    states = []
    for i, value in enumerate(inputs):
        snapshot, _ = chart.step(snapshot, value, i * period)
        states.append(snapshot.state)
    return tuple(states)


def not_local(
    chart: Chart[Inputs, Memory], inputs: Sequence[Inputs], *, period: float
) -> tuple[str, ...]:
    """Return the states whose behaviour the rest of the chart depends on (criterion 1).

    A state is named if it shares an action with another one, so that a change to it changes both,
    or if replaying the inputs without its actions changes the sequence of states, so that other
    states' transitions depend on what it did.
    """
    expected = replay(chart, inputs, period=period)
    named = []
    for state in chart.states:
        shared = any(
            action == others
            for action in _actions(state)
            for other in chart.states
            if other is not state
            for others in _actions(other)
        )
        without = Chart(
            chart.name,
            states=[
                replace(other, entry=None, during=None, exit=None) if other is state else other
                for other in chart.states
            ],
            transitions=chart.transitions,
            memory=chart.memory,
        )
        if shared or replay(without, inputs, period=period) != expected:
            named.append(state.name)
    return tuple(named)


def not_used(chart: Chart[Inputs, Memory], run: Sequence[str]) -> tuple[str, ...]:
    """Return the states that no tick of a replay ends in (criterion 2, first half)."""
    return tuple(name for name in chart.state_names if name not in run)


def not_connected(chart: Chart[Inputs, Memory]) -> tuple[tuple[str, str], ...]:
    """Return the pairs of states without a way from the first to the second (criterion 2).

    A final state is only ever entered and needs no way out.
    """
    starts = [state.name for state in chart.states if state.outcome is None]
    return tuple(
        (start, end)
        for start in starts
        for end in chart.state_names
        if start != end and end not in chart.reachable(start)
    )


def _actions(state: State[Inputs, Memory]) -> list[object]:
    return [action for action in (state.entry, state.during, state.exit) if action is not None]
