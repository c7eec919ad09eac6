"""Random charts against the documented rules, read off their declarations.

A chart takes a string as input, in which every letter is an event; its memory is the trace of the
actions that ran.
"""

from collections.abc import Callable, Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chamfer.systems.statechart.chart import (
    ANY,
    Chart,
    Snapshot,
    State,
    Tick,
    Transition,
    TransitionRecord,
)

Trace = tuple[str, ...]
TraceState = State[str, Trace]
TraceTransition = Transition[str, Trace]
TraceChart = Chart[str, Trace]


def note(text: str) -> Callable[[Tick[str, Trace]], Trace]:
    return lambda tick: (*tick.memory, text)


def noting(name: str, **others: object) -> TraceState:
    """Return a state whose actions leave their name in the trace."""
    return State(
        name=name,
        entry=note(f"{name}.entry"),
        during=note(f"{name}.during"),
        exit=note(f"{name}.exit"),
        **others,  # type: ignore[arg-type]
    )


def make_chart(states: Sequence[TraceState], *transitions: TraceTransition) -> TraceChart:
    return Chart("test", states=states, transitions=transitions, memory=())


def run(
    chart: TraceChart, inputs: Sequence[str], *, period: float = 1.0, first: int = 0
) -> tuple[list[Snapshot[Trace]], list[TransitionRecord]]:
    """Run a chart from tick ``first`` on; return the snapshot after each tick and the log."""
    snapshot, snapshots, records = chart.start(), [], []
    for i, events in enumerate(inputs):
        snapshot, record = chart.step(snapshot, events, (first + i) * period)
        snapshots.append(snapshot)
        if record is not None:
            records.append(record)
    return snapshots, records


@st.composite
def charts(draw: st.DrawFn) -> TraceChart:
    """Draw a ring of states, so that each can be reached and left, with more ways across it."""
    count = draw(st.integers(2, 5))
    names = [f"s{i}" for i in range(count)]
    final = draw(st.lists(st.sampled_from(["done", "failed"]), max_size=2))
    ends = [f"end{i}" for i in range(len(final))]
    event = st.sampled_from("abcd")
    ways = [(names[i], names[(i + 1) % count], draw(event)) for i in range(count)]
    ways += [(draw(st.sampled_from(names)), end, draw(event)) for end in ends]
    ways += draw(
        st.lists(
            st.tuples(st.sampled_from([*names, ANY]), st.sampled_from([*names, *ends]), event),
            max_size=8,
        )
    )
    states = []
    for name in names:
        timeout = draw(st.none() | st.integers(1, 4))
        target = None if timeout is None else draw(st.sampled_from([*names, *ends]))
        states.append(
            noting(name, timeout=None if timeout is None else timeout / 80, on_timeout=target)
        )
    states += [noting(end, outcome=outcome) for end, outcome in zip(ends, final, strict=True)]
    order = draw(st.permutations(ways))
    return make_chart(
        states,
        *[
            Transition(
                source=source,
                target=target,
                guard=lambda tick, event=event: event in tick.inputs,
                label=f"{i} {event}",
                action=note(f"{i} {event}"),
            )
            for i, (source, target, event) in enumerate(order)
        ],
    )


EVENTS = st.lists(st.text("abcd", max_size=3), min_size=1, max_size=40)


def expected_transition(
    chart: TraceChart, state: TraceState, events: str, ticks_in_state: int
) -> tuple[str, str, Trace] | None:
    """Return (target, label, also true) by the documented rules, read off the declarations."""
    ways = [
        way
        for way in chart.transitions
        if way.label.split()[1] in events
        and state.outcome is None
        and way.source in (state.name, ANY)
    ]
    if ways and (ways[0].source, ways[0].target) != (ANY, state.name):
        return ways[0].target, ways[0].label, tuple(way.label for way in ways[1:])
    if state.timeout is not None and ticks_in_state >= round(state.timeout * 80):
        return str(state.on_timeout), f"after {state.timeout:g} s", ()
    return None


@settings(deadline=None)
@given(chart=charts(), inputs=EVENTS, first=st.integers(0, 1000))
def test_random_chart_follows_its_declaration(
    chart: TraceChart, inputs: list[str], first: int
) -> None:
    snapshots, records = run(chart, inputs, period=1 / 80, first=first)
    name, entered, trace, log = chart.initial, 0, [f"{chart.initial}.entry"], []
    for i, (snapshot, events) in enumerate(zip(snapshots, inputs, strict=True)):
        expected = expected_transition(chart, chart.state(name), events, i - entered)
        if expected is not None:
            target, label, also_true = expected
            log.append(TransitionRecord((first + i) / 80, name, target, label, events, also_true))
            action = [] if label.startswith("after") else [label]
            trace += [f"{name}.exit", *action, f"{target}.entry"]
            name, entered = target, i
        trace.append(f"{name}.during")
        assert snapshot.state == name
        assert snapshot.entered_at == pytest.approx((first + entered) / 80)
        assert snapshot.memory == tuple(trace)
    assert [record._replace(time=0.0) for record in records] == [
        record._replace(time=0.0) for record in log
    ]
    assert [record.time for record in records] == pytest.approx([record.time for record in log])


@settings(deadline=None)
@given(chart=charts(), inputs=EVENTS)
def test_random_chart_is_deterministic_and_resumes_from_any_snapshot(
    chart: TraceChart, inputs: list[str]
) -> None:
    snapshots, _ = run(chart, inputs)
    assert run(chart, inputs)[0] == snapshots
    middle = len(inputs) // 2
    snapshot = snapshots[middle]
    for i in range(middle + 1, len(inputs)):
        snapshot, _ = chart.step(snapshot, inputs[i], float(i))
    assert snapshot == snapshots[-1]
