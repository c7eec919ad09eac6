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


def test_transition_runs_exit_action_entry_during_in_one_tick() -> None:
    snapshots, _ = run(there_and_back(), ["", "x"])
    assert snapshots[1].memory[2:] == ("a.exit", "a->b", "b.entry", "b.during")
    assert (snapshots[1].state, snapshots[1].entered_at) == ("b", 1.0)


def test_first_tick_can_enter_and_leave_the_initial_state() -> None:
    snapshots, records = run(there_and_back(), ["x"])
    assert snapshots[0].memory == ("a.entry", "a.exit", "a->b", "b.entry", "b.during")
    assert records == [TransitionRecord(0.0, "a", "b", "x", "x", ())]


def test_one_transition_in_a_tick_at_most() -> None:
    snapshots, records = run(there_and_back(), ["xy", "xy", "xy"])
    assert [snapshot.state for snapshot in snapshots] == ["b", "a", "b"]
    assert [record.time for record in records] == [0.0, 1.0, 2.0]


def test_self_transition_leaves_and_enters() -> None:
    chart = make_chart(
        [noting("a"), noting("b")], on("s", "a", "a"), on("x", "a", "b"), on("y", "b", "a")
    )
    snapshots, records = run(chart, ["", "s"])
    assert snapshots[1].memory[2:] == ("a.exit", "a->a", "a.entry", "a.during")
    assert snapshots[1].entered_at == 1.0
    assert [(record.source, record.target) for record in records] == [("a", "a")]


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


@pytest.mark.parametrize("order", ["pqr", "rqp", "qpr"])
def test_first_true_guard_in_the_given_order_wins(order: str) -> None:
    targets = {"p": "b", "q": "c", "r": "d"}
    chart = make_chart(
        [noting(name) for name in "abcd"],
        *[on(event, "a", targets[event]) for event in order],
        *[on("y", name, "a") for name in "bcd"],
    )
    (snapshot,), (record,) = run(chart, ["pqr"])
    assert snapshot.state == record.target == targets[order[0]]
    assert record.label == order[0]
    assert record.also_true == (order[1], order[2])


def test_only_true_guards_of_lower_priority_are_recorded_as_also_true() -> None:
    chart = make_chart(
        [noting("a"), noting("b")],
        *[on(event, "a", "b") for event in "pqrs"],
        on("y", "b", "a"),
    )
    _, (record,) = run(chart, ["qs"])
    assert (record.label, record.also_true) == ("q", ("s",))


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


def test_guard_has_priority_over_timeout() -> None:
    snapshots, (record,) = run(waiting(2.0), ["", "", "x"])
    assert snapshots[-1].state == "seen"
    assert record.label == "x"


def test_entering_again_restarts_the_timeout() -> None:
    snapshots, _ = run(waiting(2.0), ["", "s", "", "", ""])
    assert [snapshot.state for snapshot in snapshots] == ["wait"] * 3 + ["late"] * 2


def test_timeout_into_the_state_itself_repeats() -> None:
    chart = make_chart(
        [noting("a", timeout=2.0, on_timeout="a"), noting("b")],
        on("x", "a", "b"),
        on("y", "b", "a"),
    )
    _, records = run(chart, [""] * 7)
    assert [record.time for record in records] == [2.0, 4.0, 6.0]


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


@pytest.mark.parametrize("any_first", [True, False])
def test_any_keeps_its_place_in_the_order(any_first: bool) -> None:
    ways = [on("!", ANY, "stop"), on("x", "a", "b")]
    chart = make_chart(
        [noting("a"), noting("b"), noting("stop")],
        *(ways if any_first else reversed(ways)),
        on("y", "stop", "a"),
    )
    (snapshot,), _ = run(chart, ["x!"])
    assert snapshot.state == ("stop" if any_first else "b")


def test_any_that_leads_to_the_current_state_keeps_it_against_lower_priorities() -> None:
    chart = make_chart(
        [noting("a"), noting("stop")],
        on("!", ANY, "stop"),
        on("x", ANY, "a"),
    )
    snapshots, records = run(chart, ["x!", "x!", "x", "x!"])
    assert [snapshot.state for snapshot in snapshots] == ["stop", "stop", "a", "stop"]
    assert [record.target for record in records] == ["stop", "a", "stop"]
    assert snapshots[1].memory[-2:] == ("stop.during", "stop.during")


def test_a_kept_state_still_times_out() -> None:
    chart = make_chart(
        [noting("a"), noting("hold", timeout=0.2, on_timeout="lost"), noting("lost")],
        on("!", ANY, "hold"),
        on("y", "lost", "a"),
    )
    snapshots, _ = run(chart, ["!", "!", "!"], period=0.1)
    assert [snapshot.state for snapshot in snapshots] == ["hold", "hold", "lost"]


# Final states


@pytest.mark.parametrize("outcome", ["done", "failed"])
def test_final_state_is_never_left_and_keeps_acting(outcome: str) -> None:
    chart = make_chart([noting("a"), noting("end", outcome=outcome)], on("x", "a", "end"))
    snapshots, records = run(chart, ["x"] * 4)
    assert [snapshot.state for snapshot in snapshots] == ["end"] * 4
    assert snapshots[-1].memory[3:] == ("end.entry",) + ("end.during",) * 4
    assert len(records) == 1
    assert chart.state("end").outcome == outcome


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


def test_chart_of_one_state_may_stay_there() -> None:
    snapshots, _ = run(make_chart([noting("a")]), ["", ""])
    assert snapshots[-1].memory == ("a.entry", "a.during", "a.during")


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
