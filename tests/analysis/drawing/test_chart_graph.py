from chamfer.analysis.drawing.chart_graph import ANY_STATE, START, chart_graph, state_id
from chamfer.systems.statechart.chart import Chart, State, Transition

AnyChart = Chart[None, None]


def test_states_have_the_kind_of_their_outcome(axis: AnyChart) -> None:
    kinds = {node.id: node.kind for node in chart_graph(axis).nodes}
    assert kinds == {
        START: "initial",
        state_id("idle"): "state",
        state_id("moving"): "state",
        state_id("settling"): "state",
        state_id("arrived"): "final",
        state_id("fault"): "failed",
    }


def test_the_dot_leads_to_the_initial_state(axis: AnyChart) -> None:
    graph = chart_graph(axis)
    assert [edge.target for edge in graph.edges if edge.source == START] == [state_id("idle")]


def test_transitions_from_any_state_are_drawn_once(compensator: AnyChart) -> None:
    graph = chart_graph(compensator)
    leaving = [(edge.target, edge.label) for edge in graph.edges if edge.source == ANY_STATE]
    assert leaving == [
        (state_id("trajectory_ended"), "(1) trajectory ended"),
        (state_id("hold"), "(2) no valid measurement"),
        (state_id("modify_compensation"), "(3) error outside the dead zone"),
        (state_id("aligned"), "(4) error inside the dead zone"),
    ]
    assert len(graph.edges) == 5
    assert next(node.kind for node in graph.nodes if node.id == ANY_STATE) == "any"


def test_priorities_are_numbered_where_there_is_a_choice(axis: AnyChart) -> None:
    labels = [edge.label for edge in chart_graph(axis).edges]
    assert labels == [
        "",
        "command",
        "(1) near the goal",
        "(2) new goal",
        "(1) overshoot",
        "(2) settled",
        "after 5 s",
    ]


def test_transitions_that_compete_with_those_from_any_state_share_their_numbers() -> None:
    def transition(source: str, target: str, label: str) -> Transition[None, None]:
        return Transition(source=source, target=target, label=label, guard=lambda _: True)

    chart: AnyChart = Chart(
        "c",
        states=[State(name="a"), State(name="b"), State(name="c", outcome="failed")],
        transitions=[
            transition("a", "b", "go"),
            transition("*", "c", "stop"),
            transition("b", "a", "back"),
        ],
        memory=None,
    )
    labels = {edge.label for edge in chart_graph(chart).edges}
    assert labels == {"", "(1) go", "(2) stop", "(3) back"}


def test_every_transition_is_a_line_of_its_own(compensator: AnyChart) -> None:
    graph = chart_graph(compensator)
    lines = [(edge.source, edge.source_port) for edge in graph.edges]
    assert len(set(lines)) == len(lines)


def test_a_note_stands_behind_its_states_name() -> None:
    def leave(source: str, target: str) -> Transition[None, None]:
        return Transition(source=source, target=target, label="go", guard=lambda _: True)

    chart: AnyChart = Chart(
        "c",
        states=[
            State(name="push", note="push -z, hold rx"),
            State(name="rest"),
            State(name="end", outcome="done", note="stands still"),
        ],
        transitions=[leave("push", "rest"), leave("rest", "end")],
        memory=None,
    )
    graph = chart_graph(chart)
    labels = {node.id: node.label for node in graph.nodes}
    assert labels == {
        START: "",
        state_id("push"): "push: push -z, hold rx",
        state_id("rest"): "rest",
        state_id("end"): "end: stands still",
    }
    # What a transition leads to does not depend on the note.
    assert {(edge.source, edge.target) for edge in graph.edges} == {
        (START, state_id("push")),
        (state_id("push"), state_id("rest")),
        (state_id("rest"), state_id("end")),
    }


def test_ways_back_to_the_state_before_are_drawn_as_one() -> None:
    def transition(
        source: str, target: str, label: str, *, history: bool = False
    ) -> Transition[None, None]:
        return Transition(
            source=source, target=target, label=label, guard=lambda _: True, history=history
        )

    chart: AnyChart = Chart(
        "c",
        states=[State(name="a"), State(name="b"), State(name="halted")],
        transitions=[
            transition("*", "halted", "halt"),
            transition("halted", "a", "on with a", history=True),
            transition("halted", "b", "on with b", history=True),
            transition("a", "b", "go"),
        ],
        memory=None,
    )
    graph = chart_graph(chart)
    labels = {node.id: node.label for node in graph.nodes}
    ways = [(labels[one.source], labels[one.target], one.label) for one in graph.edges]
    assert ways == [
        ("", "a", ""),
        ("any state", "halted", "(1) halt"),
        ("halted", "state before", "(2) back"),
        ("a", "b", "(4) go"),
    ]
    assert len(chart_graph(chart, every=True).edges) == 1 + len(chart.transitions)
