"""Overviews, readable on a page, of block diagrams and state charts that are wider."""

import re
from collections import deque
from dataclasses import replace
from typing import Any, Final

from chamfer.analysis.drawing.graph import Edge, Graph, Node
from chamfer.analysis.drawing.layout import (
    EDGE_FONT,
    NODE_FONT,
    TITLE_FONT,
    GraphLayout,
    NodeBox,
    PlacedText,
    Route,
    lay_out,
)
from chamfer.analysis.drawing.text import text_block

PAGE: Final = 900.0  # px, shown at 736 the smallest letters have 9
_MOST_BLOCKS: Final = 14
_MINOR: Final = ("random", "noise", "at rest")  # ends of blocks' names
_COLUMNS: Final = 4
_PITCH: Final = (212.0, 98.0)  # of the states, px
_STATE: Final = (112.0, 44.0)
_FIRST: Final = (50.0, 74.0)  # upper left corner of the first one
_TURN: Final = 20.0  # from a row's ends to the line to the next row
_PRIORITY: Final = re.compile(r"^\(\d+\) ")


def overview(graph: Graph) -> tuple[Graph, GraphLayout] | None:
    """Return the part of a graph that a page shows, and its layout; None if all of it fits.

    Of a state chart it is the shortest path to success. Of a block diagram these are the blocks
    with the most connections: open ends are left out, and blocks without which the picture has
    the fewest lines, one after the other, until it fits. A signal that passes through such a
    block goes from the block before it to the one behind.
    """
    if lay_out(graph).width <= PAGE:
        return None
    way = _shortest_way(graph)
    if way:
        return graph, _rows(graph, way)
    kinds = {node.id: node.kind for node in graph.nodes}
    if "initial" in kinds.values():
        return None
    found = _bare(graph, [id_ for id_, kind in kinds.items() if kind != "port"])
    while len(found.nodes) > 2:
        layout = None if len(found.nodes) > _MOST_BLOCKS else lay_out(found)
        if layout is not None and layout.width <= PAGE:
            others = sum(kind != "port" for kind in kinds.values()) - len(found.nodes)
            said = (
                f"The blocks with the most connections. Lines may pass through {others} other "
                "blocks, which are in the full diagram."
            )
            return found, _noted(layout, said)
        found = _without_least(found)
    return None


def _bare(graph: Graph, kept: list[str]) -> Graph:
    """Return the nodes that are kept, with one line without a name between two of them."""
    edges = {
        (edge.source, edge.target): Edge(source=edge.source, target=edge.target, sign=edge.sign)
        for edge in graph.edges
        if edge.source in kept and edge.target in kept and edge.source != edge.target
    }
    nodes = tuple(node for node in graph.nodes if node.id in kept)
    bare = replace(graph, nodes=nodes, edges=tuple(edges.values()))
    occupied = {above for node in nodes for above in bare.ancestors(node.id)}
    return replace(bare, clusters=tuple(one for one in graph.clusters if one.id in occupied))


def _without_least(graph: Graph) -> Graph:
    """Take out the node without which there are the fewest lines, and connect its neighbours."""

    def cost(node: Node) -> tuple[bool, int, bool, int]:
        into = [edge.source for edge in graph.edges if edge.target == node.id]
        out = [edge.target for edge in graph.edges if edge.source == node.id]
        ways = max(len(into), 1) * max(len(out), 1)
        minor = node.kind in ("sum", "gain") or node.label.endswith(_MINOR)
        source = minor and not into
        return not source, ways - len(into) - len(out), not minor, len(into) + len(out)

    least = min(graph.nodes, key=cost)
    before = [edge for edge in graph.edges if edge.target == least.id]
    behind = [edge for edge in graph.edges if edge.source == least.id]
    joined = [replace(end, source=start.source) for start in before for end in behind]
    kept = [node.id for node in graph.nodes if node is not least]
    return _bare(replace(graph, edges=(*graph.edges, *joined)), kept)


def _shortest_way(graph: Graph) -> list[Edge]:
    """Return the fewest transitions of a chart from its start to its first final state."""
    kinds = {node.id: node.kind for node in graph.nodes}
    start = next((id_ for id_, kind in kinds.items() if kind == "initial"), None)
    came: dict[str, Edge] = {}
    queue = deque([start] if start else [])
    while queue:
        here = queue.popleft()
        if kinds[here] == "final":
            way = []
            while here != start:
                way.append(came[here])
                here = came[here].source
            return way[::-1]
        for edge in graph.edges:
            if edge.source == here and edge.target not in came and edge.target != start:
                came[edge.target] = edge
                queue.append(edge.target)
    return []


def _rows(graph: Graph, way: list[Edge]) -> GraphLayout:
    """Lay out a way through a chart in rows from left to right."""
    nodes = {node.id: node for node in graph.nodes}
    (width, height), (dx, dy), (left, top) = _STATE, _PITCH, _FIRST
    middle = top + height / 2
    none = text_block("", size=EDGE_FONT, limit=1)
    dot: dict[str, Any] = {
        "width": 14.0,
        "height": 14.0,
        "text": none,
        "caption": none,
        "mirrored": False,
    }
    boxes = [NodeBox(node=nodes[way[0].source], x=14.0, y=middle - 7, shape="dot", **dot)]
    routes, labels = [], []
    for i, edge in enumerate(way):
        row, column = divmod(i, _COLUMNS)
        x, y = left + column * dx, top + row * dy
        exits = sum(one.source == edge.target for one in graph.edges) - (i + 1 < len(way))
        name = nodes[edge.target].label.partition(":")[0]
        said = f"+{exits} exit{'s' if exits > 1 else ''}" if exits else ""
        box: dict[str, Any] = {"width": width, "height": height, "shape": "box", "mirrored": False}
        box["text"] = text_block(name, size=NODE_FONT, limit=14)
        box["caption"] = text_block(said, size=EDGE_FONT, limit=20)
        boxes.append(NodeBox(node=nodes[edge.target], x=x, y=y, **box))
        line = y + height / 2
        label = text_block(_PRIORITY.sub("", edge.label), size=EDGE_FONT, limit=14)
        if not i:
            points = [(28.0, line), (x, line)]
        elif column:
            points = [(x - dx + width, line), (x, line)]
            label_x, label_y = x - (dx - width) / 2, line
        else:
            end, turn = left + (_COLUMNS - 1) * dx + width, y - 20
            points = [(end, line - dy), (end + _TURN, line - dy), (end + _TURN, turn)]
            points += [(left - _TURN, turn), (left - _TURN, line), (x, line)]
            label_x, label_y = end - width - (dx - width) / 2, turn
        routes.append(Route(edge, tuple(points)))
        if i:
            at = (label_x - label.width / 2, label_y - label.height - 3)
            labels.append(PlacedText(label, *at))
    rows = -(-len(way) // _COLUMNS)
    states = sum(node.kind in ("state", "final", "failed") for node in graph.nodes)
    said = (
        f"The shortest path to success, {len(way)} of {states} states. Retries and failures are "
        "in the full chart."
    )
    layout = GraphLayout(
        title=text_block(graph.title, size=TITLE_FONT, limit=80),
        width=left + (_COLUMNS - 1) * dx + width + 2 * _TURN,
        height=top + rows * dy - 20,
        boxes=tuple(boxes),
        clusters=(),
        routes=tuple(routes),
        branches=(),
        labels=tuple(labels),
    )
    return _noted(layout, said)


def _noted(layout: GraphLayout, said: str) -> GraphLayout:
    """Write a note below a layout."""
    note = text_block(said, size=EDGE_FONT + 1, limit=120)
    placed = PlacedText(note, 20.0, layout.height)
    height = layout.height + note.height + 14
    width = max(layout.width, note.width + 40)
    return replace(layout, height=height, width=width, labels=(*layout.labels, placed))
