"""How a chart's graph is cut into rows."""

from chamfer.analysis.drawing.chart_graph import START
from chamfer.analysis.drawing.chart_rows import groups, halves
from chamfer.analysis.drawing.graph import Edge, Graph, Node


def chain(*pairs: tuple[str, str]) -> Graph:
    """Return a graph that begins with the first pair's first node."""
    names = dict.fromkeys(name for pair in pairs for name in pair)
    return Graph(
        title="",
        nodes=(
            Node(id=START, label="", kind="initial"),
            *(Node(id=name, label=name.upper(), kind="state") for name in names),
        ),
        edges=(
            Edge(source=START, target=pairs[0][0]),
            *(
                Edge(source=a, target=b, label=f"{a}{b}", source_port=str(i), target_port=str(i))
                for i, (a, b) in enumerate(pairs)
            ),
        ),
    )


def ends(graph: Graph) -> set[tuple[str, str]]:
    return {(edge.source, edge.target) for edge in graph.edges}


def test_groups_lead_on_to_stubs() -> None:
    first, second = groups(
        chain(("a", "b"), ("b", "c"), ("a", "c"), ("c", "a")), [{"a", "b"}, {"c"}]
    )
    # Two ways lead to c: one stub, which says where it goes on.
    assert ends(first) == {(START, "a"), ("a", "b"), ("b", "onward c"), ("a", "onward c")}
    assert [(node.id, node.label) for node in first.nodes[1:]] == [
        ("a", "A"),
        ("b", "B"),
        ("onward c", "C"),
    ]
    assert ends(second) == {(START, "c"), ("c", "onward a")}
    assert {edge.label for edge in second.edges} == {"", "ca"}


def test_a_row_without_a_node_is_left_out() -> None:
    assert len(groups(chain(("a", "b")), [{"a"}, {"x"}, {"b"}])) == 2


def test_halves_are_cut_where_one_edge_leads_on() -> None:
    pairs = [("a", "b"), ("b", "a"), ("b", "c"), ("c", "b"), ("c", "d")]
    pairs += [("d", "e"), ("e", "d"), ("e", "f"), ("f", "e"), ("f", "g"), ("g", "f")]
    first, second = halves(chain(*pairs))
    assert {node.id for node in first.nodes} == {START, "a", "b", "c", "onward"}
    assert ("c", "onward") in ends(first)
    assert next(node.label for node in first.nodes if node.id == "onward") == "D"
    assert {node.id for node in second.nodes} == {START, "d", "e", "f", "g"}
    assert (START, "d") in ends(second)


def test_what_is_short_or_has_a_way_back_stays_whole() -> None:
    short = chain(("a", "b"), ("b", "c"))
    ring = chain(*(pair for pair in zip("abcdefgh", "bcdefgha", strict=True)))
    assert halves(short) == [short]
    assert halves(ring) == [ring]


def test_a_row_into_which_nothing_leads_has_no_start() -> None:
    first, second = groups(chain(("a", "b"), ("c", "b")), [{"a", "b"}, {"c"}])
    assert [node.id for node in first.nodes] == [START, "a", "b"]
    assert [node.id for node in second.nodes] == ["c", "onward b"]
    assert ends(second) == {("c", "onward b")}
