"""What of a chart is drawn, and in Mermaid."""

import re
from typing import Any

from pydrake.systems.framework import Diagram

from chamfer.analysis.drawing.chart_graph import ANY_STATE, START, chart_graph, state_id
from chamfer.analysis.drawing.diagram_graph import diagram_graph
from chamfer.analysis.drawing.graph import Cluster, Edge, Graph, Node
from chamfer.analysis.drawing.mermaid import flowchart, state_diagram
from chamfer.systems.statechart.chart import Chart, State, Transition

AnyChart = Chart[None, None]

NODE = re.compile(r'\s+(n_\w*)[\[({>]+"([^"]*)"[\])}]+')
EDGE = re.compile(r'\s+(n_\w*) -->(?:\|"([^"]*)"\|)? (n_\w*)')
FRAME = re.compile(r'\s+subgraph (n_\w*)\["([^"]*)"\]')


def chart_of(states: list[State[Any, Any]], *ways: tuple[str, str, str, bool]) -> AnyChart:
    return Chart(
        "c",
        states=states,
        transitions=[
            Transition(source=a, target=b, label=label, guard=lambda _: True, history=history)
            for a, b, label, history in ways
        ],
        memory=None,
    )


def test_states_and_priorities_of_a_chart(axis: AnyChart) -> None:
    graph = chart_graph(axis)
    kinds = {"idle": "state", "moving": "state", "settling": "state"}
    kinds |= {"arrived": "final", "fault": "failed"}
    states = {state_id(name): kind for name, kind in kinds.items()}
    assert {node.id: node.kind for node in graph.nodes} == {START: "initial"} | states
    assert [edge.target for edge in graph.edges if edge.source == START] == [state_id("idle")]
    # Numbers only where there is a choice, and none for a timeout.
    assert [edge.label for edge in graph.edges] == [
        *("", "command", "(1) near the goal", "(2) new goal"),
        *("(1) overshoot", "(2) settled", "after 5 s"),
    ]


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
    lines = [(edge.source, edge.source_port) for edge in graph.edges]
    assert len(set(lines)) == len(lines)  # every transition is a line of its own


def test_notes_and_ways_back() -> None:
    states = [State(name="a", note="push -z"), State(name="b"), State(name="halted")]
    chart = chart_of(
        states,
        ("*", "halted", "halt", False),
        ("halted", "a", "on with a", True),
        ("halted", "b", "on with b", True),
        ("a", "b", "go", False),
    )
    graph = chart_graph(chart)
    labels = {node.id: node.label for node in graph.nodes}
    assert labels[state_id("a")] == "a: push -z"
    ways = [(labels[one.source], labels[one.target], one.label) for one in graph.edges]
    assert ways == [
        ("", "a: push -z", ""),
        ("any state", "halted", "(1) halt"),
        ("halted", "state before", "(2) back"),
        ("a: push -z", "b", "(4) go"),
    ]


def test_a_flowchart_has_every_node_edge_and_cluster(loops: Diagram) -> None:
    graph = diagram_graph(loops)
    lines = flowchart(graph).splitlines()
    assert lines[:4] == ["---", f'title: "{graph.title}"', "---", "flowchart LR"]
    nodes = [match for line in lines if (match := NODE.fullmatch(line))]
    edges = [match for line in lines if (match := EDGE.fullmatch(line))]
    frames = [match for line in lines if (match := FRAME.fullmatch(line))]
    assert len(nodes) == len({match[1] for match in nodes}) == len(graph.nodes)
    assert len(edges) == len(graph.edges)
    labels = ["PID loop", "computer vision", "plant", "FSM loop", "plant"]
    assert [match[2] for match in frames] == labels
    assert sum(line.strip() == "end" for line in lines) == len(graph.clusters)
    ids = {match[1] for match in nodes}
    assert all(match[1] in ids and match[3] in ids for match in edges)
    assert len(lines) == 4 + len(nodes) + len(edges) + 2 * len(frames)


def test_ids_are_words_and_labels_cannot_end_early() -> None:
    graph = Graph(
        title='a "b"',
        nodes=(
            Node(id="end", label='<"x"> & #1; [a]|`'),
            Node(id="a/b", label="", kind="sum", parent="c"),
            Node(id="a b", label="é"),
        ),
        edges=(Edge(source="end", target="a/b", label='"|', sign="-"),),
        clusters=(Cluster(id="c", label="c"),),
    )
    assert flowchart(graph).splitlines() == [
        "---",
        'title: "a \\"b\\""',
        "---",
        "flowchart LR",
        '    n_end["#60;#34;x#34;#62; #38; #35;1#59; #91;a#93;#124;#96;"]',
        '    n_a_b_2["é"]',
        '    subgraph n_c["c"]',
        '        n_a_b(("\N{GREEK CAPITAL LETTER SIGMA}"))',
        "    end",
        '    n_end -->|"#34;#124; \N{MINUS SIGN}"| n_a_b',
    ]


def test_a_state_diagram_has_every_state_and_transition(
    axis: AnyChart, compensator: AnyChart
) -> None:
    lines = [line.strip() for line in state_diagram(axis).splitlines()]
    assert lines[3:5] == ["stateDiagram-v2", "direction LR"]
    for name in axis.state_names:
        assert f'state "{name}" as n_state_{name}' in lines
    assert "[*] --> n_state_idle" in lines
    assert "n_state_idle --> n_state_moving : command" in lines
    assert "n_state_moving --> n_state_moving : (2) new goal" in lines
    assert "n_state_moving --> n_state_fault : after 5 s" in lines
    assert "n_state_arrived --> [*]" in lines
    assert "class n_state_fault failed" in lines
    text = state_diagram(compensator)
    for transition in compensator.transitions:
        assert text.count(f") {transition.label}") == 1
    assert text.count("n_any -->") == 4
    assert 'n_state_arrived((("arrived")))' in flowchart(chart_graph(axis))
    # A label stays on its line.
    states = [State(name="a: b"), State(name="b", outcome="done")]
    lines = state_diagram(chart_of(states, ("a: b", "b", "x: 1;\n<y>", False))).splitlines()
    assert '    state "a#58; b" as n_state_a_b' in lines
    assert "    n_state_a_b --> n_state_b : x#58; 1#59; #60;y#62;" in lines
