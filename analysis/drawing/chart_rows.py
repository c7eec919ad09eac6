"""The rows in which a chart is drawn: what leads on to another row has a stub for an end."""

from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Final

from chamfer.analysis.drawing.chart_graph import START
from chamfer.analysis.drawing.graph import Edge, Graph, Node

_FEWEST: Final = 4  # nodes in a row
_ONWARD: Final = "onward"


def groups(graph: Graph, rows: Sequence[Collection[str]]) -> list[Graph]:
    """Cut a graph into given rows, those without a node left out.

    Args:
        graph: A chart's.
        rows: Ids of the nodes in each; every node but the start is in one of them.
    """
    labels = {node.id: node.label for node in graph.nodes}
    found = []
    for row in rows:
        inside = [node for node in graph.nodes if node.id in row]
        if not inside:
            continue
        outward = [edge for edge in graph.edges if edge.source in row and edge.target not in row]
        inward = {edge.target for edge in graph.edges if edge.source not in row}
        stubs = dict.fromkeys(edge.target for edge in outward)
        entries = [node.id for node in inside if node.id in inward]
        found.append(
            Graph(
                title="",
                nodes=(
                    *graph.nodes[: bool(entries)],
                    *inside,
                    *(Node(id=f"{_ONWARD} {one}", label=labels[one], kind="any") for one in stubs),
                ),
                edges=(
                    *(Edge(source=START, target=one) for one in entries),
                    *(
                        replace(edge, target=f"{_ONWARD} {edge.target}")
                        if edge in outward
                        else edge
                        for edge in graph.edges
                        if edge.source in row
                    ),
                ),
            )
        )
    return found


def halves(graph: Graph) -> list[Graph]:
    """Cut a graph at the edge without which it has two parts, the most even ones, if there is."""
    best: tuple[int, Edge, set[str]] | None = None
    for edge in graph.edges[1:]:
        before = _connected(graph, START, without=edge)
        least = min(len(before), len(graph.nodes) - len(before))
        if edge.target not in before and least >= _FEWEST and (best is None or least > best[0]):
            best = least, edge, before
    if best is None:
        return [graph]
    _, cut, before = best
    onward = Node(
        id=_ONWARD,
        label=next(node.label for node in graph.nodes if node.id == cut.target),
        kind="any",
    )
    first = Graph(
        title="",
        nodes=(*(node for node in graph.nodes if node.id in before), onward),
        edges=tuple(
            replace(edge, target=_ONWARD) if edge is cut else edge
            for edge in graph.edges
            if edge.source in before
        ),
    )
    second = Graph(
        title="",
        nodes=(
            graph.nodes[0],
            *(node for node in graph.nodes if node.id not in before),
        ),
        edges=(
            Edge(source=START, target=cut.target),
            *(edge for edge in graph.edges if edge.source not in before),
        ),
    )
    return [first, second]


def _connected(graph: Graph, start: str, *, without: Edge) -> set[str]:
    """Return the nodes that edges in either direction connect to a node."""
    found, more = set[str](), {start}
    while more:
        found |= more
        ends = [{edge.source, edge.target} for edge in graph.edges if edge is not without]
        more = set[str]().union(*(pair for pair in ends if pair & found)) - found
    return found
