"""What must hold for every picture, and what makes a control engineer recognise it."""

from itertools import combinations, pairwise
from typing import get_args

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pydrake.systems.framework import Diagram

from chamfer.analysis.drawing.chart_graph import chart_graph
from chamfer.analysis.drawing.diagram_graph import diagram_graph
from chamfer.analysis.drawing.graph import Cluster, Edge, Graph, Kind, Node
from chamfer.analysis.drawing.layout import GraphLayout, NodeBox, lay_out
from chamfer.systems.statechart.chart import Chart

Rectangle = tuple[float, float, float, float]
LABELS = ["", "x", "actual_trajectory", "error outside the dead zone", "K_p"]


@st.composite
def graphs(draw: st.DrawFn) -> Graph:
    clusters = [
        Cluster(id=f"c{i}", label=f"cluster {i}", parent=draw(_parent(i)))
        for i in range(draw(st.integers(0, 3)))
    ]
    nodes = [
        Node(
            id=f"n{i}",
            label=draw(st.sampled_from(LABELS)),
            kind=draw(st.sampled_from(get_args(Kind))),
            detail=draw(st.sampled_from(["", "3"])),
            parent=draw(_parent(len(clusters))),
        )
        for i in range(draw(st.integers(1, 9)))
    ]
    ends = st.sampled_from([node.id for node in nodes])
    edges = [
        Edge(
            source=draw(ends),
            target=draw(ends),
            label=draw(st.sampled_from(LABELS)),
            source_port=draw(st.sampled_from("ab")),
            target_port=str(i),
        )
        for i in range(draw(st.integers(0, 14)))
    ]
    return Graph(title="", nodes=tuple(nodes), edges=tuple(edges), clusters=tuple(clusters))


def _parent(count: int) -> st.SearchStrategy[str | None]:
    return st.sampled_from([None, *(f"c{i}" for i in range(count))])


def _rectangle(box: NodeBox) -> Rectangle:
    return box.x, box.y, box.x + box.width, box.y + box.height


def _labels(layout: GraphLayout) -> list[Rectangle]:
    return [
        (label.x, label.y, label.x + label.text.width, label.y + label.text.height)
        for label in layout.labels
    ]


def _overlap(a: Rectangle, b: Rectangle, depth: float = 0.05) -> bool:
    across = min(a[2], b[2]) - max(a[0], b[0])
    down = min(a[3], b[3]) - max(a[1], b[1])
    return across > depth and down > depth


def _lines(layout: GraphLayout) -> list[tuple[Edge, Rectangle]]:
    return [
        (route.edge, (min(x0, x1), min(y0, y1), max(x0, x1), max(y0, y1)))
        for route in layout.routes
        for (x0, y0), (x1, y1) in pairwise(route.points)
    ]


def _thick(line: Rectangle) -> Rectangle:
    return line[0] - 0.2, line[1] - 0.2, line[2] + 0.2, line[3] + 0.2


def _check(graph: Graph) -> None:
    layout = lay_out(graph)
    boxes = {box.node.id: _rectangle(box) for box in layout.boxes}
    labels = _labels(layout)
    lines = _lines(layout)
    assert set(boxes) == {node.id for node in graph.nodes}
    assert [route.edge for route in layout.routes] == list(graph.edges)
    for a, b in combinations([*boxes.values(), *labels], 2):
        assert not _overlap(a, b)
    for edge, line in lines:
        assert min(line[2] - line[0], line[3] - line[1]) < 0.02, "oblique"
        for id_, box in boxes.items():
            assert id_ in (edge.source, edge.target) or not _overlap(_thick(line), box)
        for label in labels:
            assert not _overlap(_thick(line), label)
    for route in layout.routes:
        _check_on_border(route.points[0], boxes[route.edge.source])
        _check_on_border(route.points[-1], boxes[route.edge.target])
    _check_lines_apart(lines)
    _check_clusters(graph, layout)
    everything = np.array([*boxes.values(), *labels, *(line for _, line in lines)])
    assert everything.min() >= 0
    assert (everything[:, 2:] <= (layout.width, layout.height)).all()


def _check_on_border(point: tuple[float, float], box: Rectangle) -> None:
    x, y = point
    # Circles lie inside their rectangle, hence the tolerance inwards.
    inwards = min(x - box[0], box[2] - x, y - box[1], box[3] - y)
    assert -0.05 <= inwards <= (box[2] - box[0]) / 3


def _check_lines_apart(lines: list[tuple[Edge, Rectangle]]) -> None:
    for (edge, a), (other, b) in combinations(lines, 2):
        if (edge.source, edge.source_port) == (other.source, other.source_port):
            continue
        for axis in (0, 1):
            along = 1 - axis
            parallel = a[axis] == a[axis + 2] and b[axis] == b[axis + 2]
            beside = min(a[along + 2], b[along + 2]) - max(a[along], b[along]) > 1
            assert not (parallel and beside and abs(a[axis] - b[axis]) < 3)


def _check_clusters(graph: Graph, layout: GraphLayout) -> None:
    members = [(box.node.id, _rectangle(box)) for box in layout.boxes]
    frames = {
        box.cluster.id: (box.x, box.y, box.x + box.width, box.y + box.height)
        for box in layout.clusters
    }
    for id_, rectangle in [*members, *frames.items()]:
        around = set(graph.ancestors(id_)) | {id_}
        for cluster, frame in frames.items():
            if cluster in around:
                assert np.all(np.subtract(rectangle, frame) * (1, 1, -1, -1) >= 0)
            elif id_ not in graph.ancestors(cluster):
                assert not _overlap(rectangle, frame)
    for box in layout.clusters:
        title = (box.x + 10, box.y + 7, box.x + 10 + box.title.width, box.y + 7 + box.title.height)
        assert title[2] <= box.x + box.width
        assert not any(_overlap(_thick(line), title) for _, line in _lines(layout))


@settings(max_examples=100, deadline=None)
@given(graphs())
def test_nothing_overlaps_and_everything_is_connected(graph: Graph) -> None:
    _check(graph)


def test_loops_and_charts_can_be_read(
    loops: Diagram, compensator: Chart[None, None], axis: Chart[None, None]
) -> None:
    for graph in (diagram_graph(loops), chart_graph(compensator), chart_graph(axis)):
        _check(graph)
    assert lay_out(Graph(title="", nodes=())).boxes == ()


@pytest.fixture
def servo(loops: Diagram) -> GraphLayout:
    return lay_out(diagram_graph(loops))


def _route(layout: GraphLayout, source: str, target: str) -> tuple[tuple[float, float], ...]:
    return next(
        route.points
        for route in layout.routes
        if (route.edge.source, route.edge.target) == (source, target)
    )


def test_the_forward_path_is_one_straight_line(servo: GraphLayout) -> None:
    plant = ("stiffness K_p", "force balance", "impedance control A(s)", "actual trajectory")
    path = ["desired trajectory", "computer vision", "controller FSM"]
    path = [f"FSM loop/{name}" for name in [*path, *(f"plant/{name}" for name in plant)]]
    pairs = pairwise([*path, "output fsm.actual_trajectory"])
    assert len({round(y, 2) for pair in pairs for _, y in _route(servo, *pair)}) == 1


@pytest.mark.parametrize(
    ("loop", "vision"),
    [("PID loop", "PID loop/computer vision/error"), ("FSM loop", "FSM loop/computer vision")],
)
def test_feedback_runs_back_below_the_forward_path(
    servo: GraphLayout, loop: str, vision: str
) -> None:
    boxes = {box.node.id: _rectangle(box) for box in servo.boxes}
    plant = f"{loop}/plant"
    inner = _route(servo, f"{plant}/environment B(s)", f"{plant}/force balance")
    outer = _route(servo, f"{plant}/actual trajectory", vision)
    forward = boxes[f"{plant}/impedance control A(s)"]
    assert boxes[f"{plant}/environment B(s)"][1] > forward[3]
    assert inner[0][0] > inner[1][0], "leaves to the left"
    frame = next(box for box in servo.clusters if box.cluster.id == plant)
    assert max(y for _, y in outer) > frame.y + frame.height
    for points in (inner, outer):
        assert points[-2][1] > points[-1][1], "comes from below"
