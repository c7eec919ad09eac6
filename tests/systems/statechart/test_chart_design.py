"""Gore's criteria find the charts that violate them, and only those."""

from collections.abc import Callable, Sequence

import pytest

from chamfer.systems.statechart.chart import Chart, State, Tick, Transition
from chamfer.systems.statechart.chart_design import not_connected, not_local, not_used, replay

Action = Callable[[Tick[str, int]], int]
CounterChart = Chart[str, int]


def add(number: int) -> Action:
    return lambda tick: tick.memory + number


def way(source: str, target: str, event: str) -> Transition[str, int]:
    return Transition(
        source=source, target=target, guard=lambda tick: tick.inputs == event, label=event
    )


def make_chart(
    states: Sequence[State[str, int]], *transitions: Transition[str, int]
) -> CounterChart:
    return Chart("counter", states=states, transitions=transitions, memory=0)


def ring() -> CounterChart:
    """Return a chart whose states act, each in its own way, and whose guards read inputs only."""
    return make_chart(
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
    chart = make_chart(
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
    chart = make_chart(
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
    chart = make_chart(
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
    assert not_connected(make_chart(states, *back, way("b", "end", "z"))) == ()
    trap = [*states[:2], State[str, int](name="t"), State[str, int](name="u"), states[2]]
    chart = make_chart(
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
    chart = make_chart(
        [State(name="a"), State(name="b"), State(name="c", timeout=1.0, on_timeout="a")],
        way("a", "b", "x"),
        way("b", "c", "x"),
    )
    assert not_connected(chart) == ()
