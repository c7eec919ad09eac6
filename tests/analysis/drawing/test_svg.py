import subprocess
import sys
from xml.etree import ElementTree

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pydrake.systems.framework import Diagram

from chamfer.analysis.drawing.diagram_graph import diagram_graph
from chamfer.analysis.drawing.graph import Edge, Graph, Node
from chamfer.analysis.drawing.svg import render
from chamfer.analysis.drawing.text import text_width, typeset, wrap

NAMESPACE = "{http://www.w3.org/2000/svg}"


def _texts(svg: str) -> list[str]:
    root = ElementTree.fromstring(svg)
    return ["".join(text.itertext()) for text in root.iter(f"{NAMESPACE}text")]


def _groups(svg: str, kind: str) -> list[ElementTree.Element]:
    root = ElementTree.fromstring(svg)
    return [group for group in root.iter(f"{NAMESPACE}g") if group.get("class") == kind]


def test_everything_of_the_graph_is_drawn(loops: Diagram) -> None:
    graph = diagram_graph(loops)
    svg = render(graph)
    root = ElementTree.fromstring(svg)
    assert root.get("viewBox") == f"0 0 {root.get('width')} {root.get('height')}"
    assert root.findtext(f"{NAMESPACE}title") == graph.title != ""
    kinds = {node.kind for node in graph.nodes}
    assert sum(len(_groups(svg, kind)) for kind in kinds) == len(graph.nodes)
    assert sum(len(one) - 2 for one in _groups(svg, "edge")) == len(graph.edges)  # arrow heads
    assert len(_groups(svg, "cluster")) == len(graph.clusters)
    titles = {title.text for title in root.iter(f"{NAMESPACE}title")}
    assert {one.label for one in (*graph.nodes, *graph.clusters)} <= titles
    texts = _texts(svg)
    assert (texts.count("+"), texts.count("\N{MINUS SIGN}")) == (3, 3)


def test_the_bytes_do_not_depend_on_addresses_or_hashes() -> None:
    program = """
from chamfer.analysis.drawing.graph import Edge, Graph, Node
from chamfer.analysis.drawing.svg import render
ids = "abcdefgh"
nodes = tuple(Node(id=i, label=i) for i in ids)
edges = tuple(Edge(source=s, target=t, label=s + t) for s in ids for t in "afh")
print(render(Graph(title="g", nodes=nodes, edges=edges)))
"""
    outputs = {
        subprocess.run(
            [sys.executable, "-c", program],
            env={"PYTHONHASHSEED": seed, "PYTHONPATH": ":".join(sys.path)},
            capture_output=True,
            check=True,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(outputs) == 1


def test_special_characters_are_escaped() -> None:
    label = """<b> & "q" 'a'"""
    graph = Graph(
        title=label,
        nodes=(Node(id="<a>", label=label), Node(id="b", label=label, kind="gain", detail="<1>")),
        edges=(Edge(source="<a>", target="b", label=label, sign="&"),),
    )
    texts = _texts(render(graph))
    assert texts.count(label) == 4
    assert {"<1>", "&"} <= set(texts)


@pytest.mark.parametrize(
    ("name", "shown"),
    [
        ("next_desired_position", "next desired position"),
        ("x_WC and y_position", "x_WC and y position"),
        ("q_1_2", "q 1 2"),
    ],
)
def test_underscores_are_spaces_but_in_subscripts(name: str, shown: str) -> None:
    assert typeset(name) == shown


def test_lines_are_filled_evenly() -> None:
    assert wrap("error outside the dead zone", 18) == ("error outside", "the dead zone")
    assert wrap("impedance control A(s)", 18) == ("impedance", "control A(s)")
    assert wrap("one\ntwo three", 18) == ("one", "two three")


@given(st.text("ab ", max_size=60), st.integers(1, 20))
def test_wrapping_keeps_the_words_and_the_limit(text: str, limit: int) -> None:
    lines = wrap(text, limit)
    assert " ".join(lines).split() == text.split()
    assert all(len(line) <= limit or " " not in line for line in lines)


def test_wide_letters_are_wide() -> None:
    assert text_width("WWW", 10) > text_width("aaa", 10) > text_width("iii", 10)
    assert text_width("K_p", 10) == text_width("Kp", 10)
