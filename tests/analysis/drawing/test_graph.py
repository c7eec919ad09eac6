import pytest

from chamfer.analysis.drawing.graph import Cluster, Edge, Graph, Node


def test_the_clusters_around_a_node_come_from_the_inside_out() -> None:
    graph = Graph(
        title="",
        nodes=(Node(id="a", label="a", parent="inner"),),
        clusters=(Cluster(id="outer", label=""), Cluster(id="inner", label="", parent="outer")),
    )
    assert list(graph.ancestors("a")) == ["inner", "outer"]
    assert list(graph.ancestors("outer")) == []


@pytest.mark.parametrize(
    ("parts", "message"),
    [
        ({"nodes": (Node(id="a", label=""), Node(id="a", label=""))}, "'a' 2 times"),
        (
            {"nodes": (Node(id="a", label=""),), "edges": (Edge(source="a", target="b"),)},
            "unknown node 'b'",
        ),
        ({"nodes": (Node(id="a", label="", parent="c"),)}, "unknown cluster 'c'"),
        (
            {
                "nodes": (),
                "clusters": (
                    Cluster(id="a", label="", parent="b"),
                    Cluster(id="b", label="", parent="a"),
                ),
            },
            "lies in itself",
        ),
    ],
)
def test_contradictory_parts_are_rejected(
    parts: dict[str, tuple[Node, ...]], message: str
) -> None:
    with pytest.raises(ValueError, match=message):
        Graph(title="g", **parts)  # type: ignore[arg-type]
