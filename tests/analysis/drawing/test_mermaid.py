import re

from pydrake.systems.framework import Diagram

from chamfer.analysis.drawing.chart_graph import chart_graph
from chamfer.analysis.drawing.diagram_graph import diagram_graph
from chamfer.analysis.drawing.graph import Cluster, Edge, Graph, Node
from chamfer.analysis.drawing.mermaid import flowchart, state_diagram
from chamfer.systems.statechart.chart import Chart, State, Transition

NODE = re.compile(r'\s+(n_\w*)[\[({>]+"([^"]*)"[\])}]+')
EDGE = re.compile(r'\s+(n_\w*) -->(?:\|"([^"]*)"\|)? (n_\w*)')
FRAME = re.compile(r'\s+subgraph (n_\w*)\["([^"]*)"\]')


def test_a_flowchart_has_every_node_edge_and_cluster(loops: Diagram) -> None:
    graph = diagram_graph(loops)
    lines = flowchart(graph).splitlines()
    assert lines[:4] == ["---", 'title: "FSM against PID"', "---", "flowchart LR"]
    nodes = [match for line in lines if (match := NODE.fullmatch(line))]
    edges = [match for line in lines if (match := EDGE.fullmatch(line))]
    frames = [match for line in lines if (match := FRAME.fullmatch(line))]
    assert len(nodes) == len({match[1] for match in nodes}) == len(graph.nodes)
    assert len(edges) == len(graph.edges)
    assert [match[2] for match in frames] == ["PID loop", "plant", "FSM loop", "plant"]
    assert sum(line.strip() == "end" for line in lines) == len(graph.clusters)
    ids = {match[1] for match in nodes}
    assert all(match[1] in ids and match[3] in ids for match in edges)
    assert len(lines) == 4 + len(nodes) + len(edges) + 2 * len(frames)


def test_members_are_written_inside_their_cluster() -> None:
    graph = Graph(
        title="",
        nodes=(Node(id="a", label="a", parent="c"), Node(id="b", label="b")),
        clusters=(Cluster(id="c", label="c"),),
    )
    assert flowchart(graph).splitlines() == [
        "flowchart LR",
        '    n_b["b"]',
        '    subgraph n_c["c"]',
        '        n_a["a"]',
        "    end",
    ]


def test_ids_are_words_and_labels_cannot_end_early() -> None:
    graph = Graph(
        title='a "b"',
        nodes=(
            Node(id="end", label='<"x"> & #1; [a]|`'),
            Node(id="a/b", label="", kind="sum"),
            Node(id="a b", label="é"),
        ),
        edges=(Edge(source="end", target="a/b", label='"|', sign="-"),),
    )
    text = flowchart(graph)
    assert 'title: "a \\"b\\""' in text
    assert 'n_end["#60;#34;x#34;#62; #38; #35;1#59; #91;a#93;#124;#96;"]' in text
    assert 'n_a_b(("\N{GREEK CAPITAL LETTER SIGMA}"))' in text
    assert 'n_a_b_2["é"]' in text
    assert 'n_end -->|"#34;#124; \N{MINUS SIGN}"| n_a_b' in text


def test_a_state_diagram_has_every_state_and_transition(axis: Chart[None, None]) -> None:
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


def test_transitions_from_any_state_are_written_once(compensator: Chart[None, None]) -> None:
    text = state_diagram(compensator)
    for transition in compensator.transitions:
        assert text.count(f") {transition.label}") == 1
    assert text.count("n_any -->") == 4


def test_a_label_of_a_transition_stays_on_its_line() -> None:
    chart: Chart[None, None] = Chart(
        "c",
        states=[State(name="a: b"), State(name="b", outcome="done")],
        transitions=[
            Transition(source="a: b", target="b", guard=lambda _: True, label="x: 1;\n<y>")
        ],
        memory=None,
    )
    lines = state_diagram(chart).splitlines()
    assert '    state "a#58; b" as n_state_a_b' in lines
    assert "    n_state_a_b --> n_state_b : x#58; 1#59; #60;y#62;" in lines


def test_a_chart_is_also_a_flowchart(axis: Chart[None, None]) -> None:
    graph = chart_graph(axis)
    text = flowchart(graph)
    assert text.count("-->") == len(graph.edges)
    assert 'n_state_arrived((("arrived")))' in text
