from xml.etree import ElementTree

from chamfer.analysis.drawing.graph import Edge, Graph, Kind, Node
from chamfer.analysis.drawing.overview import PAGE, overview
from chamfer.analysis.drawing.svg import render


def graph(*edges: tuple[str, str], **kinds: Kind) -> Graph:
    names = dict.fromkeys(name for edge in edges for name in edge)
    nodes = tuple(
        Node(id=name, label="" if name == "start" else name, kind=kinds.get(name, "block"))
        for name in names
    )
    return Graph(
        title="Long",
        nodes=nodes,
        edges=tuple(Edge(source=a, target=b, label="on") for a, b in edges),
    )


def test_what_fits_a_page_has_no_overview() -> None:
    assert overview(graph(("a", "b"))) is None


def test_diagram_keeps_the_blocks_with_the_most_connections() -> None:
    chain = [f"c{i}" for i in range(20)]
    hubs = [("hub", "desk"), ("desk", "hub"), ("hub", "eye"), ("eye", "hub"), ("eye", "desk")]
    whole = graph(
        *hubs, *zip(["desk", *chain], [*chain, "eye"], strict=True), ("hub", "end"), end="port"
    )
    found = overview(whole)
    assert found is not None
    shown, layout = found
    assert {"hub", "desk", "eye"} <= {node.id for node in shown.nodes}
    assert "end" not in {node.id for node in shown.nodes}
    assert layout.width <= PAGE
    kept = [node.id for node in shown.nodes if node.id in chain]
    first = kept[0] if kept else "eye"
    assert any((edge.source, edge.target) == ("desk", first) for edge in shown.edges)
    assert f"through {23 - len(shown.nodes)} other" in render(*found)


def test_chart_is_the_shortest_path_to_success_in_rows() -> None:
    states = [f"s{i}" for i in range(9)]
    ways = list(zip(["start", *states], [*states, "done"], strict=True))
    kinds: dict[str, Kind] = {
        **dict.fromkeys(states, "state"),
        "start": "initial",
        "done": "final",
    }
    found = overview(graph(*ways, ("s1", "bad"), ("bad", "s0"), bad="state", **kinds))
    assert found is not None
    _, layout = found
    assert [box.node.id for box in layout.boxes] == ["start", *states, "done"]
    assert len({box.y for box in layout.boxes[1:]}) == 3  # rows
    assert layout.width <= PAGE
    assert all(box.x + box.width <= layout.width for box in layout.boxes)
    root = ElementTree.fromstring(render(*found))
    texts = "".join(root.itertext())
    assert "+1 exit" in texts
    assert "10 of 11 states" in texts
    assert "State chart with 10 states" in texts  # for those who do not see it
