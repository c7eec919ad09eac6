import itertools
import math
from collections.abc import Callable, Sequence

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from chamfer.systems.statechart.chart import Chart, State, Tick, Transition
from chamfer.systems.statechart.chart_design import not_connected, not_local, not_used, replay
from chamfer.systems.statechart.finite_machine import (
    FiniteMachine,
    explore,
    storage,
    tarraf_properties,
)

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


def test_sound_chart_has_no_findings() -> None:
    chart = ring()
    assert not_local(chart, RUN, period=0.5) == ()
    assert not_used(chart, replay(chart, RUN, period=0.5)) == ()
    assert not_connected(chart) == ()


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
    assert not_connected(chart) == (
        ("b", "a"),
        ("c", "a"),
        ("c", "b"),
        ("d", "a"),
        ("d", "b"),
    )


def test_final_state_has_to_be_reachable_but_not_left() -> None:
    states = [State(name=name) for name in "abt"] + [State[str, int](name="end", outcome="done")]
    ways = [way("a", "b", "x"), way("b", "a", "y"), way("b", "end", "z"), way("a", "t", "t")]
    assert not_connected(make_chart(states, *ways, way("t", "a", "u"))) == ()
    chart = make_chart([*states, State(name="u")], *ways, way("t", "u", "x"), way("u", "t", "x"))
    assert not_connected(chart) == tuple(
        (start, end) for start in "tu" for end in ("a", "b", "end")
    )


def machine(
    next_state: list[list[int]], output: list[list[float]], input_size: list[float]
) -> FiniteMachine:
    return FiniteMachine(np.array(next_state), np.array(output, dtype=float), np.array(input_size))


@st.composite
def machines(draw: st.DrawFn) -> FiniteMachine:
    count, inputs = draw(st.integers(1, 4)), draw(st.integers(1, 2))

    def table(values: st.SearchStrategy[int]) -> list[list[int]]:
        return [[draw(values) for _ in range(inputs)] for _ in range(count)]

    sizes = [float(draw(st.integers(0, 3))) for _ in range(inputs)]
    return machine(table(st.integers(0, count - 1)), table(st.integers(-2, 2)), sizes)


def gain_by_cycles(example: FiniteMachine) -> float:
    """Return the largest ratio of outputs to inputs over all simple cycles, by listing them."""
    count, inputs = example.next_state.shape
    largest = 0.0
    for length in range(1, count + 1):
        for start, *word in itertools.product(range(count), *[range(inputs)] * length):
            state, seen, out, size = start, [start], 0.0, 0.0
            for u in word:
                out += abs(example.output[state, u])
                size += example.input_size[u]
                state = int(example.next_state[state, u])
                seen.append(state)
            if state == start and len(set(seen)) == length and out > 0:
                largest = max(largest, out / size if size else math.inf)
    return largest


def outputs_agree_in_the_end(example: FiniteMachine) -> bool:
    """Return whether no pair of states with different outputs can come back to itself."""
    count, inputs = example.next_state.shape
    pairs = list(itertools.product(range(count), repeat=2))
    steps = {
        (pair, u): (int(example.next_state[pair[0], u]), int(example.next_state[pair[1], u]))
        for pair in pairs
        for u in range(inputs)
    }
    reach = {pair: {pair} for pair in pairs}
    for _ in pairs:
        for (pair, _), following in steps.items():
            reach[pair] |= reach[following]
    return not any(
        example.output[p, u] != example.output[q, u] and (p, q) in reach[steps[(p, q), u]]
        for p, q in pairs
        for u in range(inputs)
    )


@settings(deadline=None)
@given(machines())
def test_properties_agree_with_a_search_of_all_cycles(example: FiniteMachine) -> None:
    properties = tarraf_properties(example)
    assert properties.gain == pytest.approx(gain_by_cycles(example), rel=1e-8, abs=1e-8)
    assert properties.merges == outputs_agree_in_the_end(example)
    assert properties.count == math.isfinite(properties.gain) + 2 * properties.merges


@settings(deadline=None)
@given(machines(), st.floats(0.0, 3.0))
def test_storage_function_satisfies_its_inequality_on_every_edge(
    example: FiniteMachine, spare: float
) -> None:
    least = gain_by_cycles(example)
    if math.isinf(least):
        assert storage(example, 1e6) is None
        return
    if least:
        assert storage(example, least * (1 - 1e-6)) is None
    gain = least + spare
    stored = storage(example, gain)
    assert stored is not None
    assert stored.shape == (len(example.next_state),)
    assert stored.min() == 0.0
    supply = gain * example.input_size - np.abs(example.output)
    assert np.all(stored[example.next_state] <= stored[:, None] + supply + 1e-9)


def test_explore_numbers_states_as_it_finds_them() -> None:
    def count_up(state: str, value: float) -> tuple[str, float]:
        following = {"zero": "one", "one": "two", "two": "two"}[state] if value else "zero"
        return following, 10 * value + len(state)

    found = explore("zero", [0.0, 1.0], count_up, input_size=[0.0, 2.0])
    np.testing.assert_array_equal(found.next_state, [[0, 1], [0, 2], [0, 2]])
    np.testing.assert_array_equal(found.output, [[4, 14], [3, 13], [3, 13]])
    np.testing.assert_array_equal(found.input_size, [0.0, 2.0])


def test_explore_stops_at_2000_states() -> None:
    def wrap_at(count: int) -> FiniteMachine:
        return explore(0, [1.0], lambda q, _: ((q + 1) % count, 0.0), input_size=[1.0])

    assert len(wrap_at(2000).next_state) == 2000
    with pytest.raises(ValueError, match=r"^machine has more than 2000 states$"):
        wrap_at(2001)
