"""Where everything of a graph is drawn: a layered layout from left to right, without Graphviz.

Every cluster is laid out on its own and then counts as one box of the *level* around it, so that
it stays contiguous; a line that crosses its border is put together from a piece for every level.
The items of a level stand in columns, one for each layer, with a channel for vertical lines right
of each. Feedback runs back in rows below the columns, and a block with one way in and one way
back stands in such a row. All lengths are px, y points down.
"""

import math
from collections import defaultdict
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count, pairwise
from typing import Final, Literal

from chamfer.analysis.drawing.graph import Cluster, Edge, Graph, Node
from chamfer.analysis.drawing.layering import (
    CLEARANCE,
    Gap,
    TrackPiece,
    align,
    assign_layers,
    assign_tracks,
    feedback,
    longest_paths,
    order_layers,
)
from chamfer.analysis.drawing.text import TextBlock, text_block

Point = tuple[float, float]
Net = tuple[str, str]  # a signal: the id of the node and the port that it comes from
Shape = Literal["box", "circle", "dot", "triangle", "text"]

TITLE_FONT: Final = 15.0
NODE_FONT: Final = 13.0
CLUSTER_FONT: Final = 12.0
EDGE_FONT: Final = 11.0

_LIMITS: Final = {"edge": 16, "block": 18, "port": 40, "cluster": 60, "title": 80}  # characters
_RETURN_KINDS: Final = ("block", "gain")  # what may stand in a feedback row, mirrored
_BELOW_KINDS: Final = ("block", "sum", "state", "final", "failed")  # entered from below
_LEAST: Final = {"state": (88.0, 40.0), "any": (64.0, 34.0)}  # width and height of a box
_LEAST_BLOCK: Final = (72.0, 42.0)
_RADIUS: Final = {"sum": 13.0, "initial": 7.0}
_IN_TRIANGLE: Final = 7  # characters, the longest text

_PADDING: Final = 16.0  # inside a cluster's frame
_MARGIN: Final = 20.0  # around the picture
_TITLE_GAP: Final = 14.0
_PART_GAP: Final = 32.0  # between unconnected parts
_ROW_WIDTH: Final = 640.0  # after which unconnected nodes start a new row
_ITEM_GAP: Final = 24.0  # between boxes of a column
_LINE_GAP: Final = 6.0  # between a line and what is above or below it
_PORT_GAP: Final = 5.0  # between open ends
_ROW_GAP: Final = 14.0
_CLEAR: Final = 5.0  # free space around a line
_LIFT: Final = 3.0  # a label stands this much above its line
_LABEL_ROOM: Final = 16.0  # beside a label
_PITCH: Final = 22.0  # least distance of lines at a block's side
_UNDER_PITCH: Final = 16.0  # the same below it
_ARC_PITCH: Final = 9.0  # the same on a circle
_STUB: Final = 18.0  # the last vertical piece of a line into a circle
_TRACK: Final = 12.0
_START: Final = 12.0  # least length of a line before its first bend
_END: Final = 18.0  # after its last bend: an arrow head
_CHANNEL: Final = 38.0  # least width with lines
_LOOP_HEIGHT: Final = 14.0
_STRAIGHT: Final = 0.02  # a step that is rounding only
_ATTEMPTS: Final = 8


@dataclass(frozen=True)
class PlacedText:
    """Text with its upper left corner; its lines are centred."""

    text: TextBlock
    x: float
    y: float


@dataclass(frozen=True)
class NodeBox:
    """A node as drawn."""

    node: Node
    x: float
    y: float
    width: float
    height: float
    shape: Shape
    text: TextBlock | None
    caption: TextBlock | None  # below it
    mirrored: bool  # in on the right, out on the left


@dataclass(frozen=True)
class ClusterBox:
    """A cluster's frame as drawn."""

    cluster: Cluster
    x: float
    y: float
    width: float
    height: float
    title: TextBlock


@dataclass(frozen=True)
class Route:
    """An edge as drawn: corners from border to border, all lines horizontal or vertical."""

    edge: Edge
    points: tuple[Point, ...]


@dataclass(frozen=True)
class GraphLayout:
    """A picture without its ink."""

    title: TextBlock
    width: float
    height: float
    boxes: tuple[NodeBox, ...]
    clusters: tuple[ClusterBox, ...]
    routes: tuple[Route, ...]  # in the order of the graph's edges
    branches: tuple[Point, ...]  # where a signal's line forks
    labels: tuple[PlacedText, ...]


def lay_out(graph: Graph) -> GraphLayout:
    """Lay out a graph; the same graph gives the same layout."""
    title = text_block(graph.title, size=TITLE_FONT, limit=_LIMITS["title"])
    top = _MARGIN + (title.height + _TITLE_GAP if title.lines else 0.0)
    panel = _Levels(graph).panel(None)
    width, height = panel.width, panel.height
    panel.move(_MARGIN, top)
    routes = []
    for i, edge in enumerate(graph.edges):
        pieces = sorted(panel.pieces[i], key=lambda piece: piece[0])
        corners = [point for _, points in pieces for point in points]
        routes.append(Route(edge, _simplified(corners)))
    return GraphLayout(
        title=title,
        width=max(width, title.width) + 2 * _MARGIN,
        height=top + height + _MARGIN,
        boxes=tuple(panel.boxes),
        clusters=tuple(panel.clusters),
        routes=tuple(routes),
        branches=_branches(routes),
        labels=tuple(panel.labels),
    )


@dataclass(eq=False)
class _Panel:
    """The picture of a cluster (or of everything), its upper left corner at (0, 0)."""

    width: float
    height: float
    line: float  # y of its main path
    entries: dict[Net, float]  # y at which a signal comes in
    exits: dict[Net, float]
    boxes: list[NodeBox] = field(default_factory=list)
    clusters: list[ClusterBox] = field(default_factory=list)
    labels: list[PlacedText] = field(default_factory=list)
    # By edge: the pieces of its line, each with its place in the line.
    pieces: defaultdict[int, list[tuple[int, Sequence[Point]]]] = field(
        default_factory=lambda: defaultdict(list)
    )

    def move(self, dx: float, dy: float) -> None:
        self.boxes = [replace(box, x=box.x + dx, y=box.y + dy) for box in self.boxes]
        self.clusters = [replace(box, x=box.x + dx, y=box.y + dy) for box in self.clusters]
        self.labels = [PlacedText(one.text, one.x + dx, one.y + dy) for one in self.labels]
        for pieces in self.pieces.values():
            pieces[:] = [(place, _moved(points, dx, dy)) for place, points in pieces]

    def add(self, inner: "_Panel") -> None:
        self.boxes += inner.boxes
        self.clusters += inner.clusters
        self.labels += inner.labels
        for i, pieces in inner.pieces.items():
            self.pieces[i] += pieces


@dataclass(eq=False)
class _Item:
    """Something in a column: its y is that of its line, its x that of its left edge.

    It takes the room ``above`` and ``below`` the line; its drawn body, and where wires meet it,
    are measured from (x, y).
    """

    kind: str  # of a node; or cluster, entry, exit (places on the level's border), bend
    node: Node | None = None
    cluster: Cluster | None = None
    panel: _Panel | None = None
    layer: int = -1  # -1: stands in a feedback row
    x: float = 0.0
    y: float = 0.0
    width: float = 0.0
    above: float = _CLEAR
    below: float = _CLEAR
    shape: Shape = "box"
    body: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # x, y, width, height
    text: TextBlock | None = None
    caption: TextBlock | None = None
    mirrored: bool = False
    # The wires that meet it, from top to bottom or from left to right.
    lefts: "list[_Wire]" = field(default_factory=list)
    rights: list[Net] = field(default_factory=list)
    unders: "list[_Wire]" = field(default_factory=list)
    loops: "list[_Wire]" = field(default_factory=list)
    arrive: "dict[_Wire, tuple[Point, ...]]" = field(default_factory=dict)  # last on the border
    depart: dict[Net, Point] = field(default_factory=dict)


@dataclass(eq=False)
class _Wire:
    """A line between two items of a level."""

    net: Net
    source: _Item
    target: _Item
    label: str
    returns: bool  # is feedback where it comes from
    edges: list[tuple[int, int]] = field(default_factory=list)  # and its place in their lines
    rank: int = -1  # of a forward wire, 0: on the main path
    stations: list[_Item] = field(default_factory=list)  # source, bends, target
    points: Sequence[Point] = ()


@dataclass(eq=False)
class _Return:
    """Feedback of one signal: down, back in a row through the stop if any, up to the targets."""

    source: _Item
    net: Net  # that comes down
    arrivals: list[_Wire]
    into: _Wire | None = None  # to the stop
    row: int = 0
    y: float = 0.0


class _Levels:
    """Lays out the levels of a graph from the inside out."""

    def __init__(self, graph: Graph) -> None:
        self._graph = graph
        pairs = [(edge.source, edge.target) for edge in graph.edges]
        sums = {node.id for node in graph.nodes if node.kind == "sum"}
        self._feedback = feedback([node.id for node in graph.nodes], pairs, sums.__contains__)
        ids = [*(node.id for node in graph.nodes), *(cluster.id for cluster in graph.clusters)]
        self._path = {id_: (id_, *graph.ancestors(id_)) for id_ in ids}  # from the inside out
        names: defaultdict[Net, dict[str, None]] = defaultdict(dict)
        for edge in graph.edges:
            if edge.label and edge.source != edge.target:
                names[edge.source, edge.source_port][edge.label] = None
        self._labels = {
            net: text_block(" / ".join(texts), size=EDGE_FONT, limit=_LIMITS["edge"])
            for net, texts in names.items()
        }

    def panel(self, cluster: Cluster | None) -> _Panel:
        """Lay out a cluster with everything in it; None for the whole graph."""
        here = cluster.id if cluster else None
        inside: dict[str, _Item] = {}
        for node in self._graph.nodes:
            if node.parent == here:
                inside[node.id] = _Item(node.kind, node=node)
        for child in self._graph.clusters:
            if child.parent == here:
                inside[child.id] = _Item("cluster", cluster=child, panel=self.panel(child))
        entries: dict[Net, _Item] = {}
        exits: dict[Net, _Item] = {}
        wires = self._wires(cluster, inside, entries, exits)
        items = [*entries.values(), *inside.values(), *exits.values()]
        title = text_block(
            cluster.label if cluster else "", size=CLUSTER_FONT, limit=_LIMITS["cluster"]
        )
        padding = _PADDING if cluster else 0.0
        head = padding + (title.height + 4 if title.lines else 0.0)
        parts = [
            _Part(own, [wire for wire in wires if wire.source in own], self._labels)
            for own in _connected(items, wires)
        ]
        width, height = _stack(parts, padding, head)
        width = max(width, title.width + 2 * padding)
        for item in exits.values():
            item.x = width
        for wire in wires:
            if wire.target.kind == "exit":
                wire.points = _simplified([*wire.points, (width, wire.points[-1][1])])
        main = max(parts, key=lambda part: len(part.items), default=None)
        panel = _Panel(
            width,
            height + padding,
            main.main.y if main else head,
            {net: item.y for net, item in entries.items()},
            {net: item.y for net, item in exits.items()},
        )
        for part in parts:
            panel.labels += part.labels
        for wire in wires:
            for i, place in wire.edges:
                panel.pieces[i].append((place, wire.points))
        for item in inside.values():
            _draw(item, panel)
        return panel

    def _wires(
        self,
        cluster: Cluster | None,
        inside: dict[str, _Item],
        entries: dict[Net, _Item],
        exits: dict[Net, _Item],
    ) -> list[_Wire]:
        """Return the wires of a level, and find the places where they cross its border."""
        depth = len(self._path[cluster.id]) if cluster else 0
        known: dict[tuple[Net, _Item, _Item], _Wire] = {}
        wires: list[_Wire] = []
        for i, edge in enumerate(self._graph.edges):
            net = (edge.source, edge.source_port)
            source, target = (
                next((inside[one] for one in self._path[id_] if one in inside), None)
                for id_ in (edge.source, edge.target)
            )
            if source is target and (source is None or source.panel):
                continue
            place = -depth if target is None else depth if source is None else 0
            source = source or entries.setdefault(net, _Item("entry"))
            target = target or exits.setdefault(net, _Item("exit"))
            wire = known.get((net, source, target))
            if wire is None or target.node:
                wire = _Wire(net, source, target, edge.label, i in self._feedback)
                known[net, source, target] = wire
                wires.append(wire)
            wire.edges.append((i, place))
        return wires


def _draw(item: _Item, panel: _Panel) -> None:
    """Put a node or a cluster with all in it into the picture."""
    x, y, width, height = item.body
    x, y = item.x + x, item.y + y
    if item.node:
        look = item.shape, item.text, item.caption, item.mirrored
        panel.boxes.append(NodeBox(item.node, x, y, width, height, *look))
    elif item.cluster and item.panel:
        title = text_block(item.cluster.label, size=CLUSTER_FONT, limit=_LIMITS["cluster"])
        panel.clusters.append(ClusterBox(item.cluster, x, y, width, height, title))
        item.panel.move(x, y)
        panel.add(item.panel)


def _connected(items: Sequence[_Item], wires: Sequence[_Wire]) -> list[list[_Item]]:
    """Return the connected parts of a level."""
    part = {item: [item] for item in items}
    for wire in wires:
        one, other = part[wire.source], part[wire.target]
        if one is not other:
            one += other
            for item in other:
                part[item] = one
    found = {id(part[item]): part[item] for item in items}.values()
    place = {item: i for i, item in enumerate(items)}
    return [sorted(one, key=lambda item: place[item]) for one in found]


def _stack(parts: "Sequence[_Part]", padding: float, head: float) -> tuple[float, float]:
    """Put the parts below one another, single items in rows; return width and lower end."""
    right, y = 0.0, head
    bottom = head
    large = [part for part in parts if part.wires or len(part.items) > 1]
    for part in large:
        dx = 0.0 if any(item.kind == "entry" for item in part.items) else padding
        part.move(dx, y)
        right, bottom = max(right, part.right(padding)), y + part.height
        y = bottom + _PART_GAP
    row_width, x = max(_ROW_WIDTH, right), padding
    for part in parts:
        if part in large:
            continue
        if x > padding and x + part.width > row_width:
            x, y = padding, bottom + _PART_GAP
        part.move(x, y)
        right, bottom = max(right, part.right(padding)), max(bottom, y + part.height)
        x += part.width + _PART_GAP
    return right, bottom


class _Part:
    """Connected items of a level, laid out; the upper left corner is at (0, 0)."""

    def __init__(
        self, items: list[_Item], wires: list[_Wire], labels: dict[Net, TextBlock]
    ) -> None:
        self.items, self.wires, self._labels = items, wires, labels
        self.labels: list[PlacedText] = []
        self.width = self.height = 0.0
        self._returns: list[_Return] = []
        self._stops: dict[_Item, _Return] = {}
        self._columns: list[list[_Item]] = []
        self._zones: list[float] = []  # where what is free of verticals ends, left of columns
        self._forward = self._split()
        self._rank_wires()
        self._fill_columns()
        self._order_ports()
        ranks: dict[Net, int] = {}
        for wire in sorted(self._forward, key=lambda wire: -wire.rank):
            ranks[wire.net] = wire.rank
        for item in items:
            _Frame(item, self._label, ranks).make()
        self._tracks = self._place_heights()
        self._place_columns()
        for wire in wires:
            wire.points = self._line(wire)
        self._place_labels()
        self.main = next((one.target for one in self._forward if one.rank == 0), items[0])

    def move(self, dx: float, dy: float) -> None:
        """Put everything in another place."""
        for item in self.items:
            item.x, item.y = item.x + dx, item.y + dy
        for wire in self.wires:
            wire.points = _moved(wire.points, dx, dy)
        self.labels = [PlacedText(one.text, one.x + dx, one.y + dy) for one in self.labels]
        self.width += dx

    def right(self, padding: float) -> float:
        """Return how wide a level with this part has to be."""
        edges = (one.x + one.width + (one.kind != "exit") * padding for one in self.items)
        return max(self.width, *edges)

    def _label(self, net: Net) -> TextBlock | None:
        return self._labels.get(net)

    # Layers.

    def _split(self) -> list[_Wire]:
        """Find loops, feedback and what stands in its rows; give the rest layers."""
        wires = [wire for wire in self.wires if wire.source is not wire.target]
        for wire in self.wires:
            if wire.source is wire.target:
                wire.source.loops.append(wire)
        pairs = [(wire.source, wire.target) for wire in wires]
        back = feedback(self.items, pairs, lambda item: item.kind == "sum")
        backward = [wire for i, wire in enumerate(wires) if i in back]
        ahead = [wire for i, wire in enumerate(wires) if i not in back]
        stops = self._find_stops(ahead, backward)
        while True:
            self._stops = {one.into.target: one for one in stops if one.into}
            forward = [wire for wire in ahead if wire.target not in self._stops]
            layers = assign_layers(
                [item for item in self.items if item not in self._stops],
                [(wire.source, wire.target) for wire in forward],
                lambda item: item.kind == "entry",
                lambda item: item.kind == "exit",
            )
            fitting = [one for one in stops if layers[one.source] > layers[one.arrivals[0].target]]
            if len(fitting) == len(stops):
                break
            stops = fitting
        for item, layer in layers.items():
            item.layer = layer
        direct: dict[Net, _Return] = {}
        for wire in backward:
            if wire.source not in self._stops:
                new = _Return(wire.source, wire.net, [])
                direct.setdefault(wire.net, new).arrivals.append(wire)
        self._returns = [*stops, *direct.values()]
        return forward

    def _find_stops(self, ahead: Sequence[_Wire], backward: Sequence[_Wire]) -> list[_Return]:
        """Find the blocks that stand in a feedback row: one way in, one way back."""
        found: list[_Return] = []
        targets = {wire.target for wire in backward}
        for item in self.items:
            ins = [wire for wire in ahead if wire.target is item]
            outs = [wire for wire in backward if wire.source is item]
            if item.kind not in _RETURN_KINDS or item.loops or item in targets:
                continue
            if len(ins) != 1 or len(outs) != 1 or any(wire.source is item for wire in ahead):
                continue
            source = ins[0].source
            # Something has to stay in front of the source, and what stands in a row is no source.
            others = sum(wire.source is source for wire in ahead) - 1
            if others > sum(one.source is source for one in found):
                found.append(_Return(source, ins[0].net, outs, ins[0]))
        return found

    def _rank_wires(self) -> None:
        """Number the forward wires by the paths that they belong to, the longest path first."""
        pairs = [(wire.source, wire.target) for wire in self._forward]
        before, after = longest_paths([one for one in self.items if one.layer >= 0], pairs)
        length = {wire: before[wire.source] + after[wire.target] for wire in self._forward}
        order = sorted(self._forward, key=lambda wire: (wire.returns, -length[wire]))
        for path, start in enumerate(order):
            if start.rank >= 0:
                continue
            start.rank = path
            for onward in (True, False):
                wire: _Wire | None = start
                while wire:
                    end = wire.target if onward else wire.source
                    wire = next(
                        (
                            other
                            for other in order
                            if other.rank < 0 and end is (other.source if onward else other.target)
                        ),
                        None,
                    )
                    if wire:
                        wire.rank = path

    def _fill_columns(self) -> None:
        columns: list[list[_Item]] = [[] for _ in range(max(one.layer for one in self.items) + 1)]
        main = {end for one in self._forward if one.rank == 0 for end in (one.source, one.target)}
        entered = {wire.target for wire in self._forward}
        returning = {wire.source for wire in self._forward if wire.returns}
        # Disturbances start above the path that they act on, whose feedback then has room below.
        for item in sorted(
            [one for one in self.items if one.layer >= 0],
            key=lambda item: (item in returning, item in main or item in entered),
        ):
            columns[item.layer].append(item)
        bends: dict[tuple[Net, int], _Item] = {}
        links: dict[tuple[_Item, float, _Item, float], None] = {}
        for wire in self._forward:
            wire.stations = [wire.source]
            for layer in range(wire.source.layer + 1, wire.target.layer):
                bend = bends.get((wire.net, layer))
                if bend is None:
                    bend = bends[wire.net, layer] = _Item("bend", layer=layer)
                    columns[layer].append(bend)
                wire.stations.append(bend)
            wire.stations.append(wire.target)
            for left, right in pairwise(wire.stations):
                leaves = enters = 0.0
                if left.panel:
                    leaves = left.panel.exits[wire.net] / left.panel.height
                if right.panel:
                    enters = right.panel.entries[wire.net] / right.panel.height
                links[left, leaves, right, enters] = None
        self._columns = order_layers(columns, list(links))

    # Sides of the items.

    def _order_ports(self) -> None:
        """Choose rows for the feedback, and at which side and place every wire meets an item."""
        busy = {self._stop_column(item) for item in self._stops}
        lowest = [
            next((item for item in reversed(column) if item.kind != "bend"), None)
            for column in self._columns
        ]
        for one in self._returns:
            for wire in one.arrivals:
                item = wire.target
                free = item is lowest[item.layer] and item.layer not in busy
                full = item.kind == "sum" and item.unders
                if free and item.kind in _BELOW_KINDS and not full:
                    item.unders.append(wire)
        self._assign_rows()
        place = {item: i for column in self._columns for i, item in enumerate(column)}
        goals: defaultdict[Net, list[int]] = defaultdict(list)
        for wire in self._forward:
            goals[wire.net].append(place[wire.stations[1]])
            if wire.net not in wire.source.rights:
                wire.source.rights.append(wire.net)
            wire.target.lefts.append(wire)
        depth: dict[Net, int] = {}
        for one in self._returns:
            depth[one.net] = max(one.row, depth.get(one.net, 0))
            if one.net not in one.source.rights:
                one.source.rights.append(one.net)

        def goal(net: Net) -> tuple[float, int]:
            heights = goals[net]
            return (sum(heights) / len(heights), 0) if heights else (len(place), -depth[net])

        port: dict[Net, int] = {}
        for item in self.items:
            item.rights.sort(key=goal)
            port.update({net: i for i, net in enumerate(item.rights)})
        row = {wire: one.row for one in self._returns for wire in one.arrivals}
        for item in self.items:
            item.lefts.sort(key=lambda wire: (place[wire.stations[-2]], port[wire.net]))
            item.unders.sort(key=lambda wire: -row[wire])
        for wire in sorted(row, key=lambda wire: -row[wire]):
            if wire not in wire.target.unders:
                wire.target.lefts.append(wire)
        for stop, one in self._stops.items():
            stop.lefts, stop.rights = [one.into] if one.into else [], [one.arrivals[0].net]

    def _stop_column(self, stop: _Item) -> int:
        one = self._stops[stop]
        return (one.arrivals[0].target.layer + 1 + one.source.layer) // 2

    def _assign_rows(self) -> None:
        """Give all feedback the highest row in which nothing else runs; inner loops first."""
        spans = {
            one: (
                min(2 * w.target.layer - (w not in w.target.unders) for w in one.arrivals),
                2 * one.source.layer + 1,
            )
            for one in self._returns
        }
        rows: list[list[tuple[int, int]]] = []
        for one in sorted(self._returns, key=lambda one: spans[one][1] - spans[one][0]):
            low, high = spans[one]
            for number in count():
                if number == len(rows):
                    rows.append([])
                if all(high < other[0] or other[1] < low for other in rows[number]):
                    rows[number].append((low, high))
                    one.row = number
                    break

    # Coordinates.

    def _place_heights(self) -> dict[tuple[int, object], tuple[int, float]]:
        """Place the items and rows vertically; return the tracks, their x still open."""
        keys = [item for column in self._columns for item in column]
        gaps: list[Gap[_Item]] = []
        for column in self._columns:
            for upper, lower in pairwise(column):
                boxes = sum(bool(one.node or one.cluster) for one in (upper, lower))
                space = _ITEM_GAP if boxes == 2 else _LINE_GAP * (1 + boxes)
                if upper.kind == lower.kind == "port":
                    space = _PORT_GAP
                gaps.append((upper, lower, upper.below + space + lower.above))
        ends = self._channel_ends()
        tracks: dict[tuple[int, object], tuple[int, float]] = {}
        for _ in range(_ATTEMPTS):
            heights = align(keys, gaps, self._ties())
            top = min(heights[item] - item.above for item in keys)
            for item in keys:
                item.y = round(heights[item] - top, 3)
            self._place_rows()
            channels: defaultdict[int, list[TrackPiece[tuple[int, object]]]] = defaultdict(list)
            for id_, sides in ends.items():
                lefts, rights = ([y + one.y for one, y in side] for side in sides)
                piece = TrackPiece(id_, tuple(lefts), tuple(rights))
                if piece.high - piece.low > _STRAIGHT:
                    channels[id_[0]].append(piece)
            tracks, clashes = {}, []
            for pieces in channels.values():
                assigned, pairs = assign_tracks(pieces)
                tracks.update({id_: (number, 0.0) for id_, number in assigned.items()})
                clashes += pairs
            more = [
                (b, a, y_a - y_b + CLEARANCE + 1)
                for left, right in clashes
                for a, y_a in ends[left][1]
                for b, y_b in ends[right][0]
                if isinstance(a, _Item) and isinstance(b, _Item)
                if abs(a.y + y_a - b.y - y_b) < CLEARANCE
            ]
            if not clashes:
                break
            gaps += more
        return tracks

    def _ties(self) -> list[Gap[_Item]]:
        """Return the wish of every piece of wire to be straight, the main path first."""
        wishes: dict[tuple[_Item, _Item], tuple[int, int, float]] = {}
        for wire in self._forward:
            for left, right in pairwise(wire.stations):
                start = left.depart[wire.net][1] if wire.net in left.depart else 0.0
                end = right.arrive[wire][0][1] if wire in right.arrive else 0.0
                # Of two pieces of equal rank, the one between bends must not become a step.
                bends = (left.kind == "bend") + (right.kind == "bend")
                wish = (wire.rank, -bends, start - end)
                wishes[left, right] = min(wishes.get((left, right), wish), wish)
        order = sorted(wishes, key=lambda pair: wishes[pair][:2])
        return [(*pair, wishes[pair][2]) for pair in order]

    def _channel_ends(
        self,
    ) -> dict[tuple[int, object], tuple[list[tuple[_Item | _Return, float]], ...]]:
        """Return what each vertical line has at its left and right, with how far from its y.

        Lines are known by their channel, and the signal or (from a row to a left side) the wire.
        """
        ends: defaultdict[tuple[int, object], tuple[list[tuple[_Item | _Return, float]], ...]]
        ends = defaultdict(lambda: ([], []))
        for wire in self._forward:
            for left, right in pairwise(wire.stations):
                lefts, rights = ends[left.layer, wire.net]
                if not lefts:
                    lefts.append((left, left.depart[wire.net][1] if left.depart else 0.0))
                end = right.arrive[wire][0][1] if wire in right.arrive else 0.0
                if (right, end) not in rights:
                    rights.append((right, end))
        for one in self._returns:
            lefts, _ = ends[one.source.layer, one.net]
            if not lefts:
                lefts.append((one.source, one.source.depart[one.net][1]))
            lefts.append((one, 0.0))
            for wire in one.arrivals:
                if wire not in wire.target.unders:
                    item = wire.target
                    rights = ends[item.layer - 1, wire][1]
                    rights += [(one, 0.0), (item, item.arrive[wire][0][1])]
        return dict(ends)

    def _place_rows(self) -> None:
        y = max(item.y + item.below for column in self._columns for item in column)
        rows: defaultdict[int, list[_Return]] = defaultdict(list)
        for one in self._returns:
            rows[one.row].append(one)
        for number in sorted(rows):
            stops = [one.into.target for one in rows[number] if one.into]
            y += _ROW_GAP + max([0.0, *(stop.above for stop in stops)])
            for one in rows[number]:
                one.y = y
            for stop in stops:
                stop.y = y
            y += max([0.0, *(stop.below for stop in stops)])
        self.height = y + (_LINE_GAP if rows else 0.0)

    def _place_columns(self) -> None:
        """Place channels and columns from left to right."""
        number = len(self._columns)
        starts, ends = [0.0] * (number + 1), [0.0] * (number + 1)  # free of verticals
        for item in self.items:
            for net in item.rights if item.node and item not in self._stops else ():
                label = self._label(net)
                if label:
                    starts[item.layer + 1] = max(starts[item.layer + 1], label.width + _LABEL_ROOM)
        for stop, one in self._stops.items():
            label = self._label(one.arrivals[0].net)
            if label:
                column = self._stop_column(stop)
                ends[column] = max(ends[column], label.width + _LABEL_ROOM)
        straight = {left.layer + 1 for wire in self._forward for left in wire.stations[:-1]}
        x = 0.0
        for slot in range(number + 1):
            own = [id_ for id_ in self._tracks if id_[0] == slot - 1]
            wide = _TRACK * max((self._tracks[id_][0] + 1 for id_ in own), default=0)
            start, end = starts[slot], ends[slot]
            if own:
                start = max(start, _START) if slot else 0.0
                end = max(end, _END) if slot < number else _LINE_GAP
            elif slot in straight:
                start = max(start + 14, _CHANNEL - end)
            if slot in straight or 0 < slot < number:
                start = max(start, _CHANNEL - wide - end)
            for id_ in own:
                track = self._tracks[id_][0]
                self._tracks[id_] = track, x + start + (track + 0.5) * _TRACK
            zone = start if own else start + end - _LINE_GAP - _CLEAR
            self._zones.append(x + zone)
            x += start + wide + end
            if slot < number:
                x += self._place_column(slot, x)
        self.width = x

    def _place_column(self, slot: int, x: float) -> float:
        """Place the items of a column; return its width."""
        column = [*self._columns[slot]]
        column += [stop for stop in self._stops if self._stop_column(stop) == slot]
        width = max(item.width for item in column)
        for item in column:
            # What has one line stands near to where that goes, so that arrows are equally long.
            share = 0.5
            if item.kind in ("port", "initial"):
                share = 0.0 if item.lefts else 1.0
            item.x = x + share * (width - item.width)
        return width

    # Lines and labels.

    def _line(self, wire: _Wire) -> Sequence[Point]:
        """Return the corners of a wire."""
        source, target = wire.source, wire.target
        if source is target:
            return _moved(source.arrive[wire], source.x, source.y)
        points = _moved([source.depart[wire.net]], source.x, source.y)
        arrival = _moved(target.arrive[wire], target.x, target.y)
        for left, right in pairwise(wire.stations):
            y = arrival[0][1] if right is target else right.y
            if (left.layer, wire.net) in self._tracks:
                x = self._tracks[left.layer, wire.net][1]
                points += [(x, points[-1][1]), (x, y)]
        if not wire.stations:
            if source not in self._stops:
                x = self._tracks[source.layer, wire.net][1]
                points += [(x, points[0][1]), (x, self._row(wire))]
            if target not in self._stops:
                under = wire in target.unders
                x = arrival[0][0] if under else self._tracks[target.layer - 1, wire][1]
                points += [(x, self._row(wire)), (x, arrival[0][1])]
        return _simplified([*points, *arrival])

    def _row(self, wire: _Wire) -> float:
        return next(one.y for one in self._returns if wire is one.into or wire in one.arrivals)

    def _place_labels(self) -> None:
        for item in self.items:
            if not item.node:
                continue
            for net, (x, y) in item.depart.items():
                label = self._label(net)
                if label and not item.mirrored:
                    middle = (item.x + item.width + self._zones[item.layer + 1]) / 2
                    self._add_label(label, middle - label.width / 2, item.y + y)
                elif label:
                    self._add_label(label, item.x + x - 8 - label.width, item.y + y)
            for wire in item.loops:
                if wire.label:
                    label = _loop_label(wire)
                    (x, _), (_, y), *_ = _moved(item.arrive[wire], item.x, item.y)
                    middle = item.x + item.body[0] + item.body[2] / 2
                    self._add_label(label, middle - label.width / 2, y)

    def _add_label(self, label: TextBlock, x: float, line: float) -> None:
        self.labels.append(PlacedText(label, x, line - _LIFT - label.height))


@dataclass
class _Frame:
    """Gives an item its size and the points at which wires meet it."""

    item: _Item
    label: Callable[[Net], TextBlock | None]
    ranks: dict[Net, int]  # of the signals that run forward

    def make(self) -> None:
        item = self.item
        if item.node is None:
            self._border()
        elif item.layer < 0:
            self._stop(item.node)
        elif item.kind in _RADIUS:
            self._circle()
        elif (
            _in_triangle(item.node)
            and len(item.lefts) <= 1 >= len(item.rights)
            and not (item.unders or item.loops)
        ):
            self._triangle(item.node)
            self._sides([0.0] * len(item.lefts), [0.0] * len(item.rights))
        else:
            self._box(item.node)

    def _border(self) -> None:
        """Frame a cluster, or a place on the border of the level."""
        item = self.item
        if item.panel:
            panel = item.panel
            item.width, item.above, item.below = panel.width, panel.line, panel.height - panel.line
            item.body = (0.0, -panel.line, panel.width, panel.height)
            item.arrive = {w: ((0.0, panel.entries[w.net] - panel.line),) for w in item.lefts}
            item.depart = {
                net: (panel.width, panel.exits[net] - panel.line) for net in item.rights
            }
        else:
            item.above = item.below = _PITCH / 2 - _LINE_GAP / 2
            item.arrive = dict.fromkeys(item.lefts, ((0.0, 0.0),))
            item.depart = dict.fromkeys(item.rights, (0.0, 0.0))

    def _stop(self, node: Node) -> None:
        """Frame a node in a feedback row, where signals run to the left."""
        item = self.item
        if _in_triangle(node):
            self._triangle(node)
        else:
            self._body(node, 0.0, 0.0)
        x, _, width, _ = item.body
        item.mirrored = True
        item.arrive = dict.fromkeys(item.lefts, ((x + width, 0.0),))
        item.depart = dict.fromkeys(item.rights, (x, 0.0))
        self._make_room()

    def _box(self, node: Node) -> None:
        item = self.item
        main_in, main_out = _main(item.lefts), self._main_net()
        left = _spread([0.0] * len(item.lefts), main_in, _PITCH)
        right = _spread([self._height(net) for net in item.rights], main_out, _PITCH)
        if main_in is not None and main_out is not None:
            # What comes in on the main path goes out at the same height.
            shift = left[main_in] - right[main_out]
            if abs(left[main_in]) >= abs(right[main_out]):
                right = [offset + shift for offset in right]
            else:
                left = [offset - shift for offset in left]
        reach = max((abs(offset) for offset in left + right), default=0.0)
        under = len(item.unders)
        loops = max((2 * span + 20 for span in _spans(item.loops)), default=0.0)
        across = max((under + 1) * _UNDER_PITCH if under else 0.0, loops)
        self._body(node, across, 2 * reach + _PITCH)
        x, y, width, height = item.body
        for i, wire in enumerate(item.unders):
            item.arrive[wire] = ((x + width * (i + 1) / (under + 1), y + height),)
        self._sides(left, right)
        self._loops(lambda _: y)

    def _body(self, node: Node, width: float, height: float) -> None:
        item = self.item
        port = node.kind == "port"
        label = f"{node.label}\n{node.detail}" if node.detail else node.label
        text = text_block(label, size=NODE_FONT, limit=_LIMITS["port" if port else "block"])
        least = (0.0, 0.0) if port else _LEAST.get(node.kind, _LEAST_BLOCK)
        width = max(text.width + (8 if port else 24), width, least[0])
        height = max(text.height + (0 if port else 18), height, least[1])
        item.width, item.above, item.below = width, height / 2, height / 2
        item.shape = "text" if port else "box"
        item.body, item.text = (0.0, -height / 2, width, height), text

    def _triangle(self, node: Node) -> None:
        item = self.item
        item.text = text_block(node.detail, size=NODE_FONT - 1, limit=_LIMITS["block"])
        caption = text_block(node.label, size=EDGE_FONT, limit=_LIMITS["block"])
        width = max(46.0, 2 * item.text.width + 6)
        height = max(42.0, 0.85 * width)
        item.width, item.above = max(width, caption.width), height / 2
        item.below = height / 2 + (caption.height + _LIFT if caption.lines else 0.0) + _CLEAR
        item.body = ((item.width - width) / 2, -height / 2, width, height)
        item.shape, item.caption = "triangle", caption if caption.lines else None

    def _circle(self) -> None:
        """Frame a summing circle: the main path from the left, others from above and below."""
        item = self.item
        arcs = list(item.lefts)
        main = _main(arcs) or 0
        top = arcs.pop(0) if main > 0 and not item.loops else None
        main -= top is not None
        bottom = arcs.pop() if main < len(arcs) - 1 and not item.unders else None
        left = _spread([0.0] * len(arcs), main if arcs else None, _ARC_PITCH)
        heights = [self._height(net) for net in item.rights]
        right = _spread(heights, self._main_net(), _ARC_PITCH)
        reach = max((abs(offset) for offset in left + right), default=-_CLEAR)
        spans = [span + _CLEAR for span in _spans(item.loops)]
        radius = max([_RADIUS[item.kind], reach + _CLEAR, *spans])
        margin = _STUB if item.kind == "sum" and item.lefts else 0.0
        centre = margin + radius
        item.width, item.above, item.below = centre + radius, radius + _CLEAR, radius + _CLEAR
        item.shape = "circle" if item.kind == "sum" else "dot"
        item.body = (margin, -radius, 2 * radius, 2 * radius)

        def chord(offset: float) -> float:
            return math.sqrt(radius**2 - offset**2)

        for wire, y in zip(arcs, left, strict=True):
            item.arrive[wire] = ((0.0, y), (centre - chord(y), y))
        for net, y in zip(item.rights, right, strict=True):
            item.depart[net] = (centre + chord(y), y)
        for wire in item.unders:
            item.arrive[wire] = ((centre, radius),)
            item.below += _STUB
        reach = radius + _STUB
        for one, side in ((top, -1), (bottom, 1)):
            if one:
                item.arrive[one] = (
                    (0.0, side * reach),
                    (centre, side * reach),
                    (centre, side * radius),
                )
        self._make_room()
        self._loops(lambda span: -chord(span))

    def _sides(self, left: Sequence[float], right: Sequence[float]) -> None:
        """Let lines meet the body at these heights."""
        item = self.item
        x, _, width, _ = item.body
        for wire, y in zip(item.lefts, left, strict=True):
            item.arrive[wire] = ((0.0, y), (x, y))
        for net, y in zip(item.rights, right, strict=True):
            item.depart[net] = (x + width, y)
        self._make_room()

    def _make_room(self) -> None:
        item = self.item
        for points in item.arrive.values():
            item.above = max(item.above, _LIFT - points[0][1])
            item.below = max(item.below, points[0][1] + _CLEAR)
        for net, (_, y) in item.depart.items():
            item.above = max(item.above, self._height(net) + _LIFT - y)
            item.below = max(item.below, y + _CLEAR)

    def _loops(self, top: Callable[[float], float]) -> None:
        """Draw wires from the item to itself on top of it, one over the other."""
        item = self.item
        if not item.loops:
            return
        x, y, width, body_height = item.body
        half = max(_loop_label(wire).width for wire in item.loops) / 2 - width / 2
        shift, more = max(0.0, half - x), max(0.0, half - (item.width - x - width))
        item.body = (x + shift, y, width, body_height)
        item.width += shift + more
        item.depart = {net: (px + shift, py) for net, (px, py) in item.depart.items()}
        for wire, points in item.arrive.items():
            # A line from the left still begins at the edge.
            first = points[0] if points[0][0] == 0.0 and len(points) > 1 else None
            moved = _moved(points, shift, 0.0)
            item.arrive[wire] = (first, *moved[1:]) if first else tuple(moved)
        centre, height = item.body[0] + width / 2, y - 4.0
        for wire, span in zip(item.loops, _spans(item.loops), strict=True):
            height -= _LOOP_HEIGHT
            right, left = (centre + span, top(span)), (centre - span, top(span))
            item.arrive[wire] = (right, (right[0], height), (left[0], height), left)
            height -= _loop_label(wire).height + _LIFT
        item.above = max(item.above, -height)

    def _height(self, net: Net) -> float:
        label = self.label(net)
        return label.height if label else 0.0

    def _main_net(self) -> int | None:
        rights = enumerate(self.item.rights)
        found = [(self.ranks[net], i) for i, net in rights if net in self.ranks]
        return min(found)[1] if found else None


def _in_triangle(node: Node) -> bool:
    return node.kind == "gain" and 0 < len(node.detail) <= _IN_TRIANGLE


def _main(wires: Sequence[_Wire]) -> int | None:
    """Return the place of the wire of the most important path."""
    ranks = [(wire.rank, i) for i, wire in enumerate(wires) if wire.rank >= 0]
    return min(ranks)[1] if ranks else None


def _spread(heights: Sequence[float], main: int | None, pitch: float) -> list[float]:
    """Return the heights of lines with labels that high, below one another, round 0.

    The main one is at 0 unless that makes the block lopsided.
    """
    offsets = [0.0]
    for height in heights[1:]:
        offsets.append(offsets[-1] + max(pitch, height + _LIFT + _CLEAR))
    middle = offsets[-1] / 2
    if main is not None and abs(offsets[main] - middle) <= 1.5 * pitch:
        middle = offsets[main]
    return [offset - middle for offset in offsets[: len(heights)]]


def _loop_label(wire: _Wire) -> TextBlock:
    return text_block(wire.label, size=EDGE_FONT, limit=_LIMITS["block"])


def _spans(loops: Sequence[_Wire]) -> list[float]:
    """Return half the width of every loop, the innermost first; a loop clears inner labels."""
    spans: list[float] = []
    inside = 9.0
    for wire in loops:
        spans.append(inside)
        inside = max(inside + 9.0, _loop_label(wire).width / 2 + _CLEAR)
    return spans


def _moved(points: Sequence[Point], dx: float, dy: float) -> list[Point]:
    return [(x + dx, y + dy) for x, y in points]


def _simplified(points: Sequence[Point]) -> tuple[Point, ...]:
    """Return the corners of a line without repeated points and points on a straight piece."""

    def same(a: Point, b: Point, axis: int) -> bool:
        return abs(a[axis] - b[axis]) < _STRAIGHT / 2

    kept: list[Point] = []
    for point in points:
        if kept and same(kept[-1], point, 0) and same(kept[-1], point, 1):
            continue
        while len(kept) > 1 and any(
            same(kept[-2], kept[-1], axis) and same(kept[-1], point, axis) for axis in (0, 1)
        ):
            kept.pop()
        kept.append(point)
    return tuple(kept)


def _branches(routes: Sequence[Route]) -> tuple[Point, ...]:
    """Return the points at which lines of one signal go in three or four directions."""
    nets: defaultdict[Net, list[list[Point]]] = defaultdict(list)
    for route in routes:
        corners = [(round(x, 1), round(y, 1)) for x, y in route.points]
        nets[route.edge.source, route.edge.source_port].append(corners)
    branches: list[Point] = []
    for lines in nets.values():
        pieces = {piece for corners in lines for piece in pairwise(corners)}
        branches += [
            corner
            for corner in dict.fromkeys(point for corners in lines for point in corners)
            if len({way for piece in pieces for way in _directions(corner, *piece)}) > 2
        ]
    return tuple(branches)


def _directions(corner: Point, a: Point, b: Point) -> Iterator[tuple[int, int]]:
    """Yield the directions in which a straight piece leaves a point, none if it is not on it."""
    for axis in (0, 1):
        low, high = sorted((a[axis], b[axis]))
        if a[1 - axis] == b[1 - axis] == corner[1 - axis] and low <= corner[axis] <= high:
            for end, sign in ((low, -1), (high, 1)):
                if end != corner[axis]:
                    yield axis, sign
