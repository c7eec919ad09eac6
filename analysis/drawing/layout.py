"""Where everything of a graph is drawn: a layered layout from left to right, without Graphviz.

Every cluster is laid out on its own and then counts as one box of the level around it, so that
it stays contiguous; a line that crosses its border is put together from a piece for every level.
Unconnected parts of a level stand below one another.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Final

from chamfer.analysis.drawing.frames import Point, Shape
from chamfer.analysis.drawing.graph import Cluster, Edge, Graph, Node
from chamfer.analysis.drawing.layering import feedback
from chamfer.analysis.drawing.level import (
    Border,
    Inside,
    Placed,
    PlacedText,
    lay_out_level,
    simplified,
)
from chamfer.analysis.drawing.plan import Key, Net, Wire, edge_label
from chamfer.analysis.drawing.text import TextBlock, text_block

TITLE_FONT: Final = 15.0
CLUSTER_FONT: Final = 12.0
_PADDING: Final = 16.0  # px inside a cluster's frame
_MARGIN: Final = 20.0  # px around the picture
_TITLE_GAP: Final = 14.0


@dataclass(frozen=True, kw_only=True)
class Box:
    """A node as drawn."""

    node: Node
    x: float
    y: float
    width: float
    height: float
    shape: Shape
    text: TextBlock | None
    caption: TextBlock | None
    mirrored: bool


@dataclass(frozen=True, kw_only=True)
class ClusterBox:
    """A cluster's frame as drawn."""

    cluster: Cluster
    x: float
    y: float
    width: float
    height: float
    title: TextBlock


@dataclass(frozen=True, kw_only=True)
class Route:
    """An edge as drawn: corners from border to border, all lines horizontal or vertical."""

    edge: Edge
    points: tuple[Point, ...]


@dataclass(frozen=True, kw_only=True)
class Layout:
    """A picture without its ink; all lengths are px, y points down."""

    title: TextBlock
    width: float
    height: float
    boxes: tuple[Box, ...]
    clusters: tuple[ClusterBox, ...]
    routes: tuple[Route, ...]  # in the order of the graph's edges
    branches: tuple[Point, ...]  # where a signal's line forks
    labels: tuple[PlacedText, ...]


@dataclass(eq=False)
class _Panel:
    """The picture of a cluster (or of everything), its upper left corner at (0, 0)."""

    inside: Inside
    boxes: list[Box] = field(default_factory=list)
    clusters: list[ClusterBox] = field(default_factory=list)
    labels: list[PlacedText] = field(default_factory=list)
    # By edge: the pieces of its line, each with its place in the line.
    pieces: dict[int, list[tuple[int, tuple[Point, ...]]]] = field(default_factory=dict)

    def add(self, cluster: Cluster, content: "_Panel", dx: float, dy: float) -> None:
        """Put the picture of a cluster into this one."""
        frame = ClusterBox(
            cluster=cluster,
            x=dx,
            y=dy,
            width=content.inside.width,
            height=content.inside.height,
            title=text_block(cluster.label, size=CLUSTER_FONT, limit=60),
        )
        self.clusters.append(frame)
        self._take(content, dx, dy)

    def moved(self, dx: float, dy: float) -> "_Panel":
        """Return the picture in another place."""
        panel = _Panel(self.inside)
        panel._take(self, dx, dy)
        return panel

    def _take(self, content: "_Panel", dx: float, dy: float) -> None:
        self.boxes += [replace(box, x=box.x + dx, y=box.y + dy) for box in content.boxes]
        self.clusters += [replace(box, x=box.x + dx, y=box.y + dy) for box in content.clusters]
        self.labels += [label.moved(dx, dy) for label in content.labels]
        for i, pieces in content.pieces.items():
            own = self.pieces.setdefault(i, [])
            own += [(place, _moved(points, dx, dy)) for place, points in pieces]


def lay_out(graph: Graph) -> Layout:
    """Lay out a graph.

    Args:
        graph: What to draw.

    Returns:
        The layout; the same graph gives the same layout.
    """
    title = text_block(graph.title, size=TITLE_FONT, limit=80)
    top = _MARGIN + (title.height + _TITLE_GAP if title.lines else 0.0)
    panel = _Composer(graph).panel(None)
    drawn = panel.moved(_MARGIN, top)
    routes = []
    for i, edge in enumerate(graph.edges):
        pieces = sorted(drawn.pieces[i], key=lambda piece: piece[0])
        corners = [point for _, points in pieces for point in points]
        routes.append(Route(edge=edge, points=simplified(corners)))
    return Layout(
        title=title,
        width=max(panel.inside.width, title.width) + 2 * _MARGIN,
        height=top + panel.inside.height + _MARGIN,
        boxes=tuple(drawn.boxes),
        clusters=tuple(drawn.clusters),
        routes=tuple(routes),
        branches=_branches(routes),
        labels=tuple(drawn.labels),
    )


class _Composer:
    """Lays out the levels of a graph from the inside out."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        pairs = [(edge.source, edge.target) for edge in graph.edges]
        sums = {node.id for node in graph.nodes if node.kind == "sum"}
        self._feedback = feedback([node.id for node in graph.nodes], pairs, sums.__contains__)
        self._clusters = {cluster.id for cluster in graph.clusters}
        ids = [*(node.id for node in graph.nodes), *(cluster.id for cluster in graph.clusters)]
        self._path = {  # from the outside in, with itself
            id_: (*reversed(tuple(graph.ancestors(id_))), id_) for id_ in ids
        }

    def panel(self, cluster: Cluster | None) -> _Panel:
        """Lay out a cluster with everything in it; None for the whole graph."""
        here = cluster.id if cluster else None
        nodes: dict[Key, Node] = {
            ("node", node.id): node for node in self._graph.nodes if node.parent == here
        }
        inner: dict[Key, tuple[Cluster, _Panel]] = {
            ("cluster", child.id): (child, self.panel(child))
            for child in self._graph.clusters
            if child.parent == here
        }
        insides = {key: panel.inside for key, (_, panel) in inner.items()}
        wires = self._wires(cluster, insides)
        items: dict[Key, Node | Inside | Border] = {
            wire.source: self._border(wire.net, coming_in=True)
            for wire in wires
            if wire.source[0] == "entry"
        }
        items.update(nodes)
        items.update(insides)
        items.update(
            {
                wire.target: self._border(wire.net, coming_in=False)
                for wire in wires
                if wire.target[0] == "exit"
            }
        )
        padding = _PADDING if cluster else 0.0
        title = text_block(cluster.label if cluster else "", size=CLUSTER_FONT, limit=60)
        head = padding + (title.height + 4 if title.lines else 0.0)
        level = lay_out_level(items, list(wires), padding, title.width + 2 * padding)

        def heights(role: str) -> dict[Net, float]:
            return {
                (key[1], key[2]): head + item.y
                for key, item in level.placed.items()
                if key[0] == role
            }

        inside = Inside(
            level.width,
            head + level.height + padding,
            head + level.line,
            heights("entry"),
            heights("exit"),
        )
        panel = _Panel(inside)
        panel.labels += [label.moved(0.0, head) for label in level.labels]
        for wire, edges in wires.items():
            corners = _moved(level.wires[wire], 0.0, head)
            for i, place in edges:
                panel.pieces.setdefault(i, []).append((place, corners))
        for key, node in nodes.items():
            panel.boxes.append(_box(node, level.placed[key], head))
        for key, (child, content) in inner.items():
            item = level.placed[key]
            panel.add(child, content, item.x, head + item.y - content.inside.line)
        return panel

    def _wires(
        self, cluster: Cluster | None, insides: Mapping[Key, Inside]
    ) -> dict[Wire, list[tuple[int, int]]]:
        """Return the wires of a level, each with its edges and its place in their lines."""
        depth = len(self._path[cluster.id]) if cluster else 0
        wires: dict[Wire, list[tuple[int, int]]] = {}
        known: dict[tuple[Net, Key, Key], Wire] = {}
        for i, edge in enumerate(self._graph.edges):
            net = (edge.source, edge.source_port)
            source = self._member(edge.source, cluster)
            target = self._member(edge.target, cluster)
            if source is None and target is None:
                continue
            if source == target and source is not None and source[0] == "cluster":
                continue
            place = -depth if target is None else depth if source is None else 0
            label = edge.label if source is not None and target is not None else ""
            source = source or ("entry", *net)
            target = target or ("exit", *net)
            wire = known.get((net, source, target))
            if wire is None or target[0] == "node":
                wire = Wire(
                    net,
                    source,
                    target,
                    label,
                    insides[source].exit_share(net) if source in insides else 0.0,
                    insides[target].entry_share(net) if target in insides else 0.0,
                    i in self._feedback,
                )
                known[net, source, target] = wire
            wires.setdefault(wire, []).append((i, place))
        return wires

    def _border(self, net: Net, *, coming_in: bool) -> Border:
        """Return the place for a signal that crosses a border, with room for its labels.

        One name stands at the source, several may stand at the targets.
        """
        labels = dict.fromkeys(
            edge.label
            for edge in self._graph.edges
            if (edge.source, edge.source_port) == net and edge.label
        )
        here = not coming_in or len(labels) > 1
        return Border(edge_label(*labels).height if here else 0.0)

    def _member(self, id_: str, cluster: Cluster | None) -> Key | None:
        """Return the item of a level that a node is or lies in; None if it lies outside."""
        path = self._path[id_]
        if cluster is None:
            member = path[0]
        elif cluster.id in path:
            member = path[path.index(cluster.id) + 1]
        else:
            return None
        return ("cluster" if member in self._clusters else "node", member)


def _box(node: Node, item: Placed, dy: float) -> Box:
    x, y, width, height = item.frame.body
    return Box(
        node=node,
        x=item.x + x,
        y=item.y + y + dy,
        width=width,
        height=height,
        shape=item.frame.shape,
        text=item.frame.text,
        caption=item.frame.caption,
        mirrored=item.frame.mirrored,
    )


def _moved(points: Sequence[Point], dx: float, dy: float) -> tuple[Point, ...]:
    return tuple((x + dx, y + dy) for x, y in points)


def _branches(routes: Sequence[Route]) -> tuple[Point, ...]:
    """Return the points at which lines of one signal go in three or four directions."""
    by_net: dict[Net, list[Route]] = {}
    for route in routes:
        by_net.setdefault((route.edge.source, route.edge.source_port), []).append(route)
    branches = []
    for group in by_net.values():
        pieces = {(_rounded(a), _rounded(b)) for route in group for a, b in pairwise(route.points)}
        corners = dict.fromkeys(_rounded(point) for route in group for point in route.points)
        for corner in corners:
            directions = set()
            for a, b in pieces:
                directions |= _directions(corner, a, b)
            if len(directions) > 2:
                branches.append(corner)
    return tuple(branches)


def _rounded(point: Point) -> Point:
    return round(point[0], 1), round(point[1], 1)


def _directions(corner: Point, a: Point, b: Point) -> set[tuple[int, int]]:
    """Return the directions in which a straight piece leaves a point, none if it is not on it."""
    found = set()
    for axis in (0, 1):
        other = 1 - axis
        low, high = sorted((a[axis], b[axis]))
        if a[other] == b[other] == corner[other] and low <= corner[axis] <= high:
            for end, sign in ((low, -1), (high, 1)):
                if end != corner[axis]:
                    found.add((axis, sign))
    return found
