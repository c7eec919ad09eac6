"""What a chart's construction rejects."""

from collections.abc import Sequence

import pytest

from chamfer.systems.statechart.chart import ANY, Chart, ChartError, State, Transition

PlainState = State[str, None]
PlainTransition = Transition[str, None]
PlainChart = Chart[str, None]


def named(name: str, **others: object) -> PlainState:
    return State(name=name, **others)  # type: ignore[arg-type]


def on(event: str, source: str, target: str) -> PlainTransition:
    """Return a transition on an event, labelled with it."""
    return Transition(
        source=source, target=target, guard=lambda tick: event in tick.inputs, label=event
    )


def make_chart(states: Sequence[PlainState], *transitions: PlainTransition) -> PlainChart:
    return Chart("test", states=states, transitions=transitions, memory=None)


BACK_AND_FORTH = (on("x", "a", "b"), on("y", "b", "a"))


@pytest.mark.parametrize(
    ("states", "transitions", "message"),
    [
        pytest.param([], [], "has no states", id="empty"),
        pytest.param(
            [named("a"), named("b"), named("a")],
            BACK_AND_FORTH,
            "has the state 'a' twice",
            id="duplicate",
        ),
        pytest.param([named("")], [], ": '' can't be a state's name", id="empty name"),
        pytest.param([named(ANY)], [], ": '*' can't be a state's name", id="reserved name"),
        pytest.param(
            [named("a"), named("b")],
            [*BACK_AND_FORTH, on("z", "a", "c")],
            ": the transition a -> c names 'c', valid states: a, b",
            id="unknown target",
        ),
        pytest.param(
            [named("a"), named("b")],
            [*BACK_AND_FORTH, on("z", "c", "a")],
            ": the transition c -> a names 'c', valid states: a, b",
            id="unknown source",
        ),
        pytest.param(
            [named("a"), named("b")],
            [*BACK_AND_FORTH, on("z", "a", ANY)],
            ": the transition a -> * names '*', valid states: a, b",
            id="any as a target",
        ),
        pytest.param(
            [named("a"), named("b")],
            [*BACK_AND_FORTH, on("", "a", "b")],
            ": the transition a -> b has no label",
            id="no label",
        ),
        pytest.param(
            [named("a"), named("b"), named("c")],
            [*BACK_AND_FORTH, on("z", "c", "a")],
            ": state 'c' can't be reached",
            id="unreachable",
        ),
        pytest.param(
            [named("a"), named("b"), named("c"), named("d")],
            [*BACK_AND_FORTH, on("z", "c", "d"), on("z", "d", "c")],
            ": state 'c' can't be reached",
            id="unreachable island",
        ),
        pytest.param(
            [named("a"), named("b")],
            [on("x", "a", "b")],
            ": state 'b' can't be left and isn't final",
            id="no way out",
        ),
        pytest.param(
            [named("a"), named("b", timeout=1.0, on_timeout="b")],
            [on("x", "a", "b"), on("s", "b", "b")],
            ": state 'b' can't be left and isn't final",
            id="only ways to itself",
        ),
        pytest.param(
            [named("a"), named("b", outcome="done")],
            BACK_AND_FORTH,
            ": the final state 'b' has a way out",
            id="final with transition",
        ),
        pytest.param(
            [named("a"), named("b", outcome="failed", timeout=1.0, on_timeout="a")],
            [on("x", "a", "b")],
            ": the final state 'b' has a way out",
            id="final with timeout",
        ),
        pytest.param(
            [named("a", timeout=1.0), named("b")],
            BACK_AND_FORTH,
            ": state 'a' needs both timeout and on_timeout",
            id="timeout without target",
        ),
        pytest.param(
            [named("a", on_timeout="b"), named("b")],
            BACK_AND_FORTH,
            ": state 'a' needs both timeout and on_timeout",
            id="target without timeout",
        ),
        pytest.param(
            [named("a", timeout=1.0, on_timeout="c"), named("b")],
            BACK_AND_FORTH,
            ": on_timeout of 'a' names 'c', valid states: a, b",
            id="unknown timeout target",
        ),
        *[
            pytest.param(
                [named("a", timeout=timeout, on_timeout="b"), named("b")],
                BACK_AND_FORTH,
                f": the timeout of 'a' is {timeout!r}, allowed: a finite number > 0",
                id=f"timeout {timeout}",
            )
            for timeout in (0.0, -1.0, float("nan"), float("inf"))
        ],
    ],
)
def test_rejects(
    states: Sequence[PlainState], transitions: Sequence[PlainTransition], message: str
) -> None:
    with pytest.raises(ChartError) as raised:
        make_chart(states, *transitions)
    start, _, end = str(raised.value).partition("chart 'test'")
    assert (start, end.strip()) == ("", message)


def test_any_is_no_target() -> None:
    with pytest.raises(ChartError, match=r"the transition \* -> \* names '\*', valid states: a"):
        make_chart([named("a")], on("!", ANY, ANY))
