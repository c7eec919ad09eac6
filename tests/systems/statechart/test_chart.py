from collections.abc import Callable, Sequence
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chamfer.systems.statechart.chart import (
    ANY,
    Chart,
    ChartError,
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


def on(event: str, source: str, target: str) -> TraceTransition:
    """Return a transition on an event, labelled with it, whose action is noted."""
    return Transition(
        source=source,
        target=target,
        guard=lambda tick: event in tick.inputs,
        label=event,
        action=note(f"{source}->{target}"),
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


@settings(deadline=None)
@given(
    period=st.sampled_from([1 / 80, 1 / 30, 0.1, 1e-3, 0.7]),
    first=st.integers(0, 100_000),
    count=st.integers(1, 1000),
)
def test_timeout_of_whole_periods_takes_that_many_ticks(
    period: float, first: int, count: int
) -> None:
    wait = noting("wait", timeout=count * period, on_timeout="late")
    chart = make_chart([wait, noting("late")], on("s", "wait", "wait"), on("y", "late", "wait"))
    entered, _ = chart.step(chart.start(), "", first * period)
    _, early = chart.step(entered, "", (first + count - 1) * period)
    _, due = chart.step(entered, "", (first + count) * period)
    assert early is None
    assert due is not None
    assert due.target == "late"


def test_paths_include_timeouts() -> None:
    chart = make_chart(
        [
            noting("a"),
            noting("b", timeout=1.0, on_timeout="c"),
            noting("c"),
            noting("d", outcome="failed"),
        ],
        on("x", "a", "b"),
        on("y", "b", "a"),
        on("z", "c", "d"),
    )
    assert chart.initial == "a"
    assert chart.state_names == ("a", "b", "c", "d")
    assert chart.successors("b") == {"a", "c"}
    assert chart.reachable("a") == {"a", "b", "c", "d"}
    assert chart.reachable("c") == {"d"}
    assert chart.reachable("d") == frozenset()


LOOP = "x:a>b y:b>a"


@pytest.mark.parametrize(
    ("names", "ways", "options", "message"),
    [
        ([], "", {}, "has no states"),
        (["a", "b", "a"], LOOP, {}, "has the state 'a' twice"),
        ([""], "", {}, ": '' can't be a state's name"),
        ([ANY], "", {}, ": '*' can't be a state's name"),
        (["a", "b"], f"{LOOP} z:a>c", {}, ": the transition a -> c names 'c', valid states: a, b"),
        (["a", "b"], f"{LOOP} z:c>a", {}, ": the transition c -> a names 'c', valid states: a, b"),
        (["a", "b"], f"{LOOP} z:a>*", {}, ": the transition a -> * names '*', valid states: a, b"),
        (["a"], "z:*>*", {}, ": the transition * -> * names '*', valid states: a"),
        (["a", "b"], f"{LOOP} :a>b", {}, ": the transition a -> b has no label"),
        (["a", "b", "c"], f"{LOOP} z:c>a", {}, ": state 'c' can't be reached"),
        (["a", "b", "c", "d"], f"{LOOP} z:c>d z:d>c", {}, ": state 'c' can't be reached"),
        (["a", "b"], "x:a>b", {}, ": state 'b' can't be left and isn't final"),
        (
            ["a", "b"],
            "x:a>b s:b>b",
            {"b": {"timeout": 1.0, "on_timeout": "b"}},
            ": state 'b' can't be left and isn't final",
        ),
        (["a", "b"], LOOP, {"b": {"outcome": "done"}}, ": the final state 'b' has a way out"),
        (
            ["a", "b"],
            "x:a>b",
            {"b": {"outcome": "failed", "timeout": 1.0, "on_timeout": "a"}},
            ": the final state 'b' has a way out",
        ),
        *[
            (["a", "b"], LOOP, {"a": options}, ": state 'a' needs both timeout and on_timeout")
            for options in ({"timeout": 1.0}, {"on_timeout": "b"})
        ],
        (
            ["a", "b"],
            LOOP,
            {"a": {"timeout": 1.0, "on_timeout": "c"}},
            ": on_timeout of 'a' names 'c', valid states: a, b",
        ),
        *[
            (
                ["a", "b"],
                LOOP,
                {"a": {"timeout": timeout, "on_timeout": "b"}},
                f": the timeout of 'a' is {timeout!r}, allowed: a finite number > 0",
            )
            for timeout in (0.0, -1.0, float("nan"), float("inf"))
        ],
    ],
)
def test_rejects(names: list[str], ways: str, options: dict[str, Any], message: str) -> None:
    transitions = [way.replace(">", ":").split(":") for way in ways.split()]
    with pytest.raises(ChartError) as raised:
        make_chart(
            [noting(name, **options.get(name, {})) for name in names],
            *[on(event, source, target) for event, source, target in transitions],
        )
    start, _, end = str(raised.value).partition("chart 'test'")
    assert (start, end.strip()) == ("", message)


def test_an_abort_is_a_transition_like_any_other_and_ends_them_all() -> None:
    states = [noting("a"), noting("b"), noting("end", outcome="failed")]
    ways = [on("x", "a", "b"), on("y", "b", "a"), on("z", "b", "end")]
    chart = Chart(
        "test",
        states=states,
        transitions=ways,
        memory=(),
        on_abort="b",
        abort_action=lambda state, tick: (*tick.memory, f"abort of {state}"),
    )
    snapshot, record = chart.step(chart.start(), "x", 1.0, abort=True)
    assert record == TransitionRecord(1.0, "a", "b", "abort", "x", ())
    trace = ("a.entry", "a.exit", "abort of a", "b.entry", "b.during")
    assert snapshot == Snapshot("b", 1.0, trace, True, True)
    for abort in (False, True):
        snapshot, record = chart.step(snapshot, "yz", 2.0, abort=abort)
        assert record is None
    assert snapshot == Snapshot("b", 1.0, (*trace, "b.during", "b.during"), True, True)
    assert make_chart(states, *ways).on_abort == "end"
    assert make_chart(states[:2], *ways[:2]).on_abort == "a"
    with pytest.raises(ChartError, match="on_abort names 'c', valid states: a, b, end"):
        Chart("test", states=states, transitions=ways, memory=(), on_abort="c")


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
