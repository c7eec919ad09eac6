"""Chart semantics: what one tick does.

The charts here take a string as input, in which every letter is an event; their memory is the
trace of the actions that ran.
"""

from collections.abc import Callable, Sequence

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
from chamfer.systems.statechart.chart_design import not_connected, not_local, not_used, replay

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


def there_and_back() -> TraceChart:
    return make_chart([noting("a"), noting("b")], on("x", "a", "b"), on("y", "b", "a"))


# One tick


def test_first_tick_enters_the_initial_state_once() -> None:
    chart = there_and_back()
    before = chart.start()
    assert before == Snapshot("a", 0.0, (), False)
    snapshots, records = run(chart, ["", ""], first=3)
    assert snapshots[0] == Snapshot("a", 3.0, ("a.entry", "a.during"), True)
    assert snapshots[1] == Snapshot("a", 3.0, ("a.entry", "a.during", "a.during"), True)
    assert records == []


def test_guards_and_actions_see_time_inputs_and_memory() -> None:
    seen: list[tuple[str, float, float, str, Trace]] = []

    def look(where: str) -> Callable[[Tick[str, Trace]], Trace]:
        def action(tick: Tick[str, Trace]) -> Trace:
            seen.append((where, tick.time, tick.time_in_state, tick.inputs, tick.memory))
            return (*tick.memory, where)

        return action

    def guard(tick: Tick[str, Trace]) -> bool:
        look("guard")(tick)
        return tick.inputs == "go"

    chart = make_chart(
        [
            State(name="a", entry=look("entry a"), exit=look("exit a")),
            State(name="b", entry=look("entry b"), during=look("during b")),
        ],
        Transition(source="a", target="b", guard=guard, label="go", action=look("action")),
        on("y", "b", "a"),
    )
    run(chart, ["wait", "go"], period=0.5, first=2)
    assert seen == [
        ("entry a", 1.0, 0.0, "wait", ()),
        ("guard", 1.0, 0.0, "wait", ("entry a",)),
        ("guard", 1.5, 0.5, "go", ("entry a",)),
        ("exit a", 1.5, 0.5, "go", ("entry a",)),
        ("action", 1.5, 0.5, "go", ("entry a", "exit a")),
        ("entry b", 1.5, 0.0, "go", ("entry a", "exit a", "action")),
        ("during b", 1.5, 0.0, "go", ("entry a", "exit a", "action", "entry b")),
    ]


# Priority


# Timeouts


def waiting(timeout: float) -> TraceChart:
    return make_chart(
        [noting("wait", timeout=timeout, on_timeout="late"), noting("late"), noting("seen")],
        on("x", "wait", "seen"),
        on("s", "wait", "wait"),
        on("y", "late", "wait"),
        on("y", "seen", "wait"),
    )


def test_timeout_leaves_at_the_first_tick_that_is_late_enough() -> None:
    snapshots, records = run(waiting(2.5), [""] * 5, first=7)
    assert [snapshot.state for snapshot in snapshots] == ["wait"] * 3 + ["late"] * 2
    assert snapshots[3].memory[-3:] == ("wait.exit", "late.entry", "late.during")
    assert records == [TransitionRecord(10.0, "wait", "late", "after 2.5 s", "", ())]


@settings(deadline=None)
@given(
    period=st.sampled_from([1 / 80, 1 / 30, 0.1, 1e-3, 0.7]),
    first=st.integers(0, 100_000),
    count=st.integers(1, 1000),
)
def test_timeout_of_whole_periods_takes_that_many_ticks(
    period: float, first: int, count: int
) -> None:
    chart = waiting(count * period)
    entered, _ = chart.step(chart.start(), "", first * period)
    _, early = chart.step(entered, "", (first + count - 1) * period)
    _, due = chart.step(entered, "", (first + count) * period)
    assert early is None
    assert due is not None
    assert due.target == "late"


# Transitions from any state


def test_any_leaves_every_state_but_the_target_and_final_ones() -> None:
    chart = make_chart(
        [noting("a"), noting("b"), noting("stop"), noting("end", outcome="done")],
        on("x", "a", "b"),
        on("!", ANY, "stop"),
        on("e", "stop", "end"),
    )
    successors = {name: set(chart.successors(name)) for name in chart.state_names}
    assert successors == {"a": {"b", "stop"}, "b": {"stop"}, "stop": {"end"}, "end": set()}
    snapshots, records = run(chart, ["!", "!", "e", "!"])
    assert [snapshot.state for snapshot in snapshots] == ["stop", "stop", "end", "end"]
    assert [(record.source, record.target) for record in records] == [
        ("a", "stop"),
        ("stop", "end"),
    ]


def test_a_kept_state_still_times_out() -> None:
    chart = make_chart(
        [noting("a"), noting("hold", timeout=0.2, on_timeout="lost"), noting("lost")],
        on("!", ANY, "hold"),
        on("y", "lost", "a"),
    )
    snapshots, _ = run(chart, ["!", "!", "!"], period=0.1)
    assert [snapshot.state for snapshot in snapshots] == ["hold", "hold", "lost"]


# Final states


# Paths


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


# Values


def test_step_leaves_its_snapshot_alone() -> None:
    chart = there_and_back()
    (_, before), _ = run(chart, ["", ""])
    copy = Snapshot(*before)
    first = chart.step(before, "x", 2.0)
    second = chart.step(before, "x", 2.0)
    assert before == copy
    assert first == second
    assert chart.step(before, "", 2.0)[0].state == "a"
    with pytest.raises(AttributeError):
        before.state = "b"  # type: ignore[misc]


# Random charts against the documented rules, read off their declarations


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


# What construction rejects


AB = [noting("a"), noting("b")]
BACK_AND_FORTH = (on("x", "a", "b"), on("y", "b", "a"))


@pytest.mark.parametrize(
    ("states", "transitions", "message"),
    [
        ([], [], "has no states"),
        ([noting("a"), noting("b"), noting("a")], BACK_AND_FORTH, "has the state 'a' twice"),
        ([noting("")], [], ": '' can't be a state's name"),
        ([noting(ANY)], [], ": '*' can't be a state's name"),
        (
            AB,
            [*BACK_AND_FORTH, on("z", "a", "c")],
            ": the transition a -> c names 'c', valid states: a, b",
        ),
        (
            AB,
            [*BACK_AND_FORTH, on("z", "c", "a")],
            ": the transition c -> a names 'c', valid states: a, b",
        ),
        (
            AB,
            [*BACK_AND_FORTH, on("z", "a", ANY)],
            ": the transition a -> * names '*', valid states: a, b",
        ),
        (AB, [*BACK_AND_FORTH, on("", "a", "b")], ": the transition a -> b has no label"),
        (
            [noting("a"), noting("b"), noting("c")],
            [*BACK_AND_FORTH, on("z", "c", "a")],
            ": state 'c' can't be reached",
        ),
        (
            [noting("a"), noting("b"), noting("c"), noting("d")],
            [*BACK_AND_FORTH, on("z", "c", "d"), on("z", "d", "c")],
            ": state 'c' can't be reached",
        ),
        (AB, [on("x", "a", "b")], ": state 'b' can't be left and isn't final"),
        (
            [noting("a"), noting("b", timeout=1.0, on_timeout="b")],
            [on("x", "a", "b"), on("s", "b", "b")],
            ": state 'b' can't be left and isn't final",
        ),
        (
            [noting("a"), noting("b", outcome="done")],
            BACK_AND_FORTH,
            ": the final state 'b' has a way out",
        ),
        (
            [noting("a"), noting("b", outcome="failed", timeout=1.0, on_timeout="a")],
            [on("x", "a", "b")],
            ": the final state 'b' has a way out",
        ),
        (
            [noting("a", timeout=1.0), noting("b")],
            BACK_AND_FORTH,
            ": state 'a' needs both timeout and on_timeout",
        ),
        (
            [noting("a", on_timeout="b"), noting("b")],
            BACK_AND_FORTH,
            ": state 'a' needs both timeout and on_timeout",
        ),
        (
            [noting("a", timeout=1.0, on_timeout="c"), noting("b")],
            BACK_AND_FORTH,
            ": on_timeout of 'a' names 'c', valid states: a, b",
        ),
        *[
            (
                [noting("a", timeout=timeout, on_timeout="b"), noting("b")],
                BACK_AND_FORTH,
                f": the timeout of 'a' is {timeout!r}, allowed: a finite number > 0",
            )
            for timeout in (0.0, -1.0, float("nan"), float("inf"))
        ],
    ],
)
def test_rejects(
    states: Sequence[TraceState], transitions: Sequence[TraceTransition], message: str
) -> None:
    with pytest.raises(ChartError) as raised:
        make_chart(states, *transitions)
    start, _, end = str(raised.value).partition("chart 'test'")
    assert (start, end.strip()) == ("", message)


Action = Callable[[Tick[str, int]], int]
CounterChart = Chart[str, int]


def add(number: int) -> Action:
    return lambda tick: tick.memory + number


def way(source: str, target: str, event: str) -> Transition[str, int]:
    return Transition(
        source=source, target=target, guard=lambda tick: tick.inputs == event, label=event
    )


def counter_chart(
    states: Sequence[State[str, int]], *transitions: Transition[str, int]
) -> CounterChart:
    return Chart("counter", states=states, transitions=transitions, memory=0)


def ring() -> CounterChart:
    """Return a chart whose states act, each in its own way, and whose guards read inputs only."""
    return counter_chart(
        [
            State(name="a", entry=add(1)),
            State(name="b", during=add(2)),
            State(name="c", exit=add(3)),
        ],
        way("a", "b", "x"),
        way("b", "c", "y"),
        way("c", "a", "z"),
    )


RUN = ["x", "", "y", "", "z", ""]


def test_replay_returns_the_state_after_every_tick() -> None:
    assert replay(ring(), RUN, period=0.5) == ("b", "b", "c", "c", "a", "a")


def test_sound_chart_has_no_findings() -> None:
    chart = ring()
    assert not_local(chart, RUN, period=0.5) == ()
    assert not_used(chart, replay(chart, RUN, period=0.5)) == ()
    assert not_connected(chart) == ()


# Criterion 1


@pytest.mark.parametrize("other", ["entry", "during", "exit"])
def test_states_that_share_an_action_are_not_local(other: str) -> None:
    shared = add(1)
    chart = counter_chart(
        [
            State(name="a", during=shared),
            State(name="b", **{other: shared}),
            State(name="c", during=add(1)),
        ],
        way("a", "b", "x"),
        way("b", "c", "y"),
        way("c", "a", "z"),
    )
    assert not_local(chart, RUN, period=0.5) == ("a", "b")


@pytest.mark.parametrize("action", ["entry", "during", "exit"])
def test_state_whose_action_others_transitions_depend_on_is_not_local(action: str) -> None:
    chart = counter_chart(
        [State(name="a", during=add(1)), State(name="b", **{action: add(100)}), State(name="c")],
        way("a", "b", "x"),
        way("b", "c", "y"),
        Transition(
            source="c", target="a", guard=lambda tick: tick.memory >= 100, label="b has acted"
        ),
    )
    assert not_local(chart, RUN, period=0.5) == ("b",)


# Criterion 2


def test_states_that_a_run_skips_are_not_used() -> None:
    chart = ring()
    assert not_used(chart, replay(chart, ["", ""], period=0.5)) == ("b", "c")
    assert not_used(chart, replay(chart, ["", "x"], period=0.5)) == ("c",)


def test_states_that_cannot_be_reached_again_are_not_connected() -> None:
    chart = counter_chart(
        [State(name=name) for name in "abcd"],
        way("a", "b", "x"),
        way("b", "c", "x"),
        way("c", "d", "x"),
        way("d", "c", "y"),
    )
    assert not_connected(chart) == (("b", "a"), ("c", "a"), ("c", "b"), ("d", "a"), ("d", "b"))


def test_final_state_has_to_be_reachable_but_not_left() -> None:
    back = [way("a", "b", "x"), way("b", "a", "y")]
    states = [State(name="a"), State(name="b"), State[str, int](name="end", outcome="done")]
    assert not_connected(counter_chart(states, *back, way("b", "end", "z"))) == ()
    trap = [*states[:2], State[str, int](name="t"), State[str, int](name="u"), states[2]]
    chart = counter_chart(
        trap,
        *back,
        way("b", "end", "z"),
        way("a", "t", "t"),
        way("t", "u", "x"),
        way("u", "t", "x"),
    )
    assert not_connected(chart) == (
        ("t", "a"),
        ("t", "b"),
        ("t", "end"),
        ("u", "a"),
        ("u", "b"),
        ("u", "end"),
    )


def test_timeout_is_a_connection() -> None:
    chart = counter_chart(
        [State(name="a"), State(name="b"), State(name="c", timeout=1.0, on_timeout="a")],
        way("a", "b", "x"),
        way("b", "c", "x"),
    )
    assert not_connected(chart) == ()
