"""Where everything of a graph is drawn: a layered layout from left to right, without Graphviz.

Every cluster is laid out on its own and then counts as one box of the *level* around it, so that
it stays contiguous; a line that crosses its border is put together from a piece for every level.
The items of a level stand in columns, one for each layer, with a channel for vertical lines right
of each. A line passes a column through a *bend*, an item without a body. Feedback goes back
through bends at the lower end of the columns, and a block with one way in and one way back stands
there too. All lengths are px, y points down.
"""

import math
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Final, Literal

import numpy as np

from chamfer.analysis.drawing.graph import Cluster, Edge, Graph, Node
from chamfer.analysis.drawing.layering import (
    CLEARANCE,
    Gap,
    Sides,
    align,
    assign_layers,
    assign_tracks,
    connected,
    feedback,
    longest_paths,
    order_layers,
)
from chamfer.analysis.drawing.text import NO_TEXT, TextBlock, text_block

Point = tuple[float, float]
Net = tuple[str, str]  # a signal: the id of the node and the port that it comes from
Shape = Literal["box", "circle", "dot", "triangle", "text"]

TITLE_FONT: Final = 15.0
NODE_FONT: Final = 13.0
CLUSTER_FONT: Final = 12.0
EDGE_FONT: Final = 11.0

_LIMITS: Final = {"edge": 16, "block": 18, "port": 40, "cluster": 60, "title": 80}  # characters
_RETURN_KINDS: Final = ("block", "gain")  # what may stand in the feedback, mirrored
_BELOW_KINDS: Final = ("block", "sum", "state", "final", "failed")  # entered from below
_LEAST: Final = {"state": (88.0, 40.0), "any": (64.0, 34.0), "port": (0.0, 0.0)}  # of a box
_LEAST_BLOCK: Final = (72.0, 42.0)
_RADIUS: Final = {"sum": 13.0, "initial": 7.0}
_IN_TRIANGLE: Final = 7  # characters, the longest text

_PADDING: Final = 16.0  # inside a cluster's frame
_MARGIN: Final = 20.0  # around the picture
_TITLE_GAP: Final = 14.0
_PART_GAP: Final = 32.0  # between unconnected parts
_ITEM_GAP: Final = 24.0  # between boxes of a column
_LINE_GAP: Final = 6.0  # between a line and what is above or below it
_PORT_GAP: Final = 5.0  # between open ends
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
_CHANNEL: Final = 38.0  # least width
_STRAIGHT: Final = 0.02  # a step that is rounding only
_ATTEMPTS: Final = 10
_STEP: Final = 6.0  # a smaller one looks like a mistake
_MAIN: Final = 1000.0  # how much more a straight main path is worth than another line


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
    text: TextBlock
    caption: TextBlock  # below it
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
    sums = {node.id for node in graph.nodes if node.kind == "sum"}
    pairs = [(edge.source, edge.target) for edge in graph.edges]
    back = feedback([node.id for node in graph.nodes], pairs, sums.__contains__)
    panel = _lay_out_level(graph, None, back)
    panel.move(_MARGIN, top)
    routes = []
    for i, edge in enumerate(graph.edges):
        pieces = sorted(panel.pieces[i], key=lambda piece: piece[0])
        corners = [point for _, points in pieces for point in points]
        routes.append(Route(edge, _simplified(corners)))
    return GraphLayout(
        title=title,
        width=max(panel.width, title.width) + 2 * _MARGIN,
        height=top + panel.height + _MARGIN,
        boxes=tuple(panel.boxes),
        clusters=tuple(panel.clusters),
        routes=tuple(routes),
        branches=_branches(routes),
        labels=tuple(panel.labels),
    )


@dataclass(eq=False)
class _Panel:
    """The picture of a cluster (or of everything), its upper left corner at (0, 0)."""

    cluster: Cluster | None
    title: TextBlock
    width: float = 0.0
    height: float = 0.0
    entries: dict[Net, float] = field(default_factory=dict)  # y at which a signal comes in
    exits: dict[Net, float] = field(default_factory=dict)
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
        self.labels = [replace(one, x=one.x + dx, y=one.y + dy) for one in self.labels]
        for pieces in self.pieces.values():
            pieces[:] = [(place, _moved(points, dx, dy)) for place, points in pieces]

    def draw(self, item: "_Item") -> None:
        """Put a node or a cluster with all in it into the picture."""
        x, y, width, height = item.body
        x, y = item.x + x, item.y + y
        if item.node:
            look = item.shape, item.text, item.caption, item.mirrored
            self.boxes.append(NodeBox(item.node, x, y, width, height, *look))
        elif (inner := item.panel) and inner.cluster:
            self.clusters.append(ClusterBox(inner.cluster, x, y, width, height, inner.title))
            inner.move(x, y)
            self.boxes += inner.boxes
            self.clusters += inner.clusters
            self.labels += inner.labels
            for i, pieces in inner.pieces.items():
                self.pieces[i] += pieces


@dataclass(eq=False)
class _Item:
    """Something in a column: its x is that of its left edge, its y that of its main line.

    It takes the room ``above`` and ``below`` the line; its drawn body, and where wires meet it,
    are measured from (x, y).
    """

    kind: str  # of a node; or cluster, entry, exit (places on the level's border), bend
    node: Node | None = None
    panel: _Panel | None = None
    part: int = 0  # number of the connected part of the level
    layer: int = 0
    low: bool = False  # is feedback: stands below the rest of its column
    mirrored: bool = False
    x: float = 0.0
    y: float = 0.0
    width: float = 0.0
    above: float = _CLEAR
    below: float = _CLEAR
    shape: Shape = "box"
    body: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # x, y, width, height
    text: TextBlock = NO_TEXT
    caption: TextBlock = NO_TEXT
    # The wires that meet it, from top to bottom or from left to right.
    lefts: "list[_Wire]" = field(default_factory=list)
    rights: list[Net] = field(default_factory=list)
    unders: "list[_Wire]" = field(default_factory=list)
    arrive: "dict[_Wire, tuple[Point, ...]]" = field(default_factory=dict)  # last on the border
    depart: dict[Net, Point] = field(default_factory=dict)

    def start(self, wire: "_Wire") -> float:
        """Return how far below the item's line a wire leaves it."""
        return self.depart[wire.net][1] if self.depart else 0.0

    def end(self, wire: "_Wire") -> float:
        """Return how far below the item's line a wire comes in."""
        return self.arrive[wire][0][1] if self.arrive else 0.0


@dataclass(eq=False)
class _Wire:
    """A line between two items of a level."""

    net: Net
    source: _Item
    target: _Item
    returns: bool  # is feedback where it comes from
    edges: list[tuple[int, int]] = field(default_factory=list)  # and its place in their lines
    rank: int = 0  # 0: the most important one
    stations: list[_Item] = field(default_factory=list)  # source, bends, target

    def hops(self) -> Iterator[tuple[int, _Item, _Item]]:
        """Yield the channel between each station and the next one, from -1: left of the first."""
        for start, end in pairwise(self.stations):
            if start.layer != end.layer:
                yield min(start.layer, end.layer), start, end
            elif end is not self.target or end.mirrored:
                yield end.layer, start, end
            elif self not in end.unders:
                yield end.layer - 1, start, end


def _lay_out_level(graph: Graph, cluster: Cluster | None, back: set[int]) -> _Panel:
    """Lay out a cluster (None: the whole graph) with everything in it.

    ``back`` are the edges that are feedback in the whole graph.
    """
    title = text_block(
        cluster.label if cluster else "", size=CLUSTER_FONT, limit=_LIMITS["cluster"]
    )
    panel = _Panel(cluster, title)
    here = cluster.id if cluster else None
    inside = {node.id: _Item(node.kind, node=node) for node in graph.nodes if node.parent == here}
    for child in graph.clusters:
        if child.parent == here:
            inside[child.id] = _Item("cluster", panel=_lay_out_level(graph, child, back))
    entries: defaultdict[Net, _Item] = defaultdict(lambda: _Item("entry"))
    exits: defaultdict[Net, _Item] = defaultdict(lambda: _Item("exit"))
    depth = 1 + len(list(graph.ancestors(cluster.id))) if cluster else 0
    wires: dict[object, _Wire] = {}
    for i, edge in enumerate(graph.edges):
        net = (edge.source, edge.source_port)
        source, target = (
            next((inside[one] for one in (id_, *graph.ancestors(id_)) if one in inside), None)
            for id_ in (edge.source, edge.target)
        )
        if source is target and (source is None or source.panel):
            continue
        place = -depth if target is None else depth if source is None else 0
        source, target = source or entries[net], target or exits[net]
        key = i if target.node else (net, source, target)
        wires.setdefault(key, _Wire(net, source, target, i in back)).edges.append((i, place))
    items = [*entries.values(), *inside.values(), *exits.values()]
    _Level(items, list(wires.values()), _labels(graph), panel).fill()
    panel.entries = {net: item.y for net, item in entries.items()}
    panel.exits = {net: item.y for net, item in exits.items()}
    return panel


def _labels(graph: Graph) -> dict[Net, TextBlock]:
    names: defaultdict[Net, dict[str, None]] = defaultdict(dict)
    for edge in graph.edges:
        if edge.label:
            names[edge.source, edge.source_port][edge.label] = None
    return {
        net: text_block(" / ".join(texts), size=EDGE_FONT, limit=_LIMITS["edge"])
        for net, texts in names.items()
    }


class _Level:
    """Lays out the items of a level and fills its panel."""

    def __init__(
        self, items: list[_Item], wires: list[_Wire], labels: dict[Net, TextBlock], panel: _Panel
    ) -> None:
        self._items, self._wires, self._labels, self._panel = items, wires, labels, panel
        self._assign_layers()
        self._columns = self._fill_columns()
        self._order_ports()
        for item in items:
            self._frame(item)
        self._tracks = self._place_heights()  # of a signal in a channel: the number of its line

    def fill(self) -> None:
        """Draw everything into the panel."""
        panel = self._panel
        padding = _PADDING if panel.cluster else 0.0
        head = padding + (panel.title.height + 4 if panel.title.lines else 0.0)
        lines, width = self._place_columns(padding)
        panel.width = max(width, panel.title.width + 2 * padding)
        everything = [item for column in self._columns for item in column]
        for item in everything:
            item.y += head
        panel.height = max([head, *(item.y + item.below for item in everything)]) + padding
        for item in self._items:
            if item.kind in ("entry", "exit"):
                item.x = 0.0 if item.kind == "entry" else panel.width
            panel.draw(item)
            for net, (_, y) in item.depart.items() if item.node else ():
                if net in self._labels:
                    text, beside = self._labels[net], _LABEL_ROOM / 2
                    x = -text.width - beside if item.mirrored else item.width + beside
                    top = item.y + y - _LIFT - text.height
                    panel.labels.append(PlacedText(text, item.x + x, top))
        for wire in self._wires:
            for i, place in wire.edges:
                panel.pieces[i].append((place, self._line(wire, lines)))

    def _line(self, wire: _Wire, lines: dict[tuple[int, Net], float]) -> Sequence[Point]:
        """Return the corners of a wire."""
        points = _moved([wire.source.depart[wire.net]], wire.source.x, wire.source.y)
        for channel, _, end in wire.hops():
            if (channel, wire.net) in lines:
                x = lines[channel, wire.net]
                points += [(x, points[-1][1]), (x, end.y + end.end(wire))]
        arrival = _moved(wire.target.arrive[wire], wire.target.x, wire.target.y)
        if wire in wire.target.unders:
            points.append((arrival[0][0], points[-1][1]))
        return _simplified([*points, *arrival])

    # Layers.

    def _assign_layers(self) -> None:
        """Give every item a layer and every wire a rank; find out what is feedback."""
        pairs = [(wire.source, wire.target) for wire in self._wires]
        back = feedback(self._items, pairs, lambda item: item.kind == "sum")
        ahead = [
            wire
            for i, wire in enumerate(self._wires)
            if i not in back and wire.source is not wire.target
        ]
        upright = []
        between: list[tuple[_Item, _Item, _Item]] = []
        for item in self._items:
            ins = [wire for wire in self._wires if wire.target is item]
            outs = [wire for wire in self._wires if wire.source is item]
            item.mirrored = item.low = (
                item.kind in _RETURN_KINDS
                and len(ins) == len(outs) == 1
                and ins[0] in ahead
                and outs[0] not in ahead
                and outs[0].target is not item
            )
            if item.mirrored:
                between.append((outs[0].target, item, ins[0].source))
            else:
                upright.append(item)
        forward = [wire for wire in ahead if not wire.target.mirrored]
        pairs = [(wire.source, wire.target) for wire in forward]
        inner = [item for item in upright if item.kind not in ("entry", "exit")]
        layers = assign_layers(inner, [pair for pair in pairs if set(pair) <= set(inner)])
        first = int(any(item.kind == "entry" for item in upright))
        last = max(layers.values(), default=-1) + 1 + first
        for item in upright:
            border = last if item.kind == "exit" else 0
            item.layer = layers[item] + first if item in layers else border
        for target, item, source in between:
            item.layer = (target.layer + 1 + source.layer) // 2
        before, after = longest_paths(upright, pairs)
        length = {wire: before[wire.source] + after[wire.target] for wire in forward}
        forward.sort(key=lambda wire: (wire.returns, -length[wire], before[wire.source]))
        main = forward[:1]
        for rank, wire in enumerate(forward):
            if rank and wire.source is main[-1].target and length[wire] == length[main[0]]:
                main.append(wire)
            wire.rank = 0 if wire in main else rank
        self._forward = forward
        self._back = [wire for wire in self._wires if wire not in forward]
        for wire in self._back:
            wire.rank = len(forward)
        everything = [(wire.source, wire.target) for wire in self._wires]
        for item, number in connected(self._items, everything).items():
            item.part = number

    def _fill_columns(self) -> list[list[_Item]]:
        columns: list[list[_Item]] = [[] for _ in self._items]
        main = {end for one in self._forward if one.rank == 0 for end in (one.source, one.target)}
        entered = {wire.target for wire in self._forward}
        # Disturbances start above the path that they act on, whose feedback then has room below.
        returning = {wire.source for wire in self._forward if wire.returns}
        for item in sorted(
            self._items, key=lambda item: (item in returning, item in main or item in entered)
        ):
            columns[item.layer].append(item)
        bends: dict[tuple[Net, int, bool], _Item] = {}
        links: dict[tuple[_Item, float, _Item, float], None] = {}
        inner_first = sorted(self._back, key=lambda wire: wire.source.layer - wire.target.layer)
        for wire in [*self._forward, *inner_first]:
            first, last = wire.source, wire.target
            low = wire not in self._forward
            layers = range(first.layer + 1, last.layer)
            if low:
                layers = range(first.layer - first.mirrored, last.layer + last.mirrored - 1, -1)
            wire.stations = [first]
            for layer in layers:
                bend = bends.get((wire.net, layer, low))
                if bend is None:
                    bend = _Item("bend", layer=layer, part=first.part, low=low)
                    bends[wire.net, layer, low] = bend
                    columns[layer].append(bend)
                wire.stations.append(bend)
            wire.stations.append(last)
            for _, start, end in wire.hops():
                leaves = enters = 0.0
                if start.panel:
                    leaves = start.panel.exits[wire.net] / start.panel.height
                if end.panel:
                    enters = end.panel.entries[wire.net] / end.panel.height
                if start.layer < end.layer:
                    links[start, leaves, end, enters] = None
                elif end.layer < start.layer:
                    links[end, enters, start, leaves] = None
        return order_layers(
            [one for one in columns if one], list(links), lambda item: (item.part, item.low)
        )

    # Sides of the items.

    def _order_ports(self) -> None:
        """Choose at which side and place every wire meets an item."""
        place = {item: i for column in self._columns for i, item in enumerate(column)}
        goals: defaultdict[Net, list[tuple[bool, int]]] = defaultdict(list)
        for wire in self._wires:
            first, second = wire.stations[:2]
            turns = first.layer == second.layer
            goals[wire.net].append((turns, -place[second] if turns else place[second]))
            if wire.net not in first.rights:
                first.rights.append(wire.net)
            target, bend = wire.target, wire.stations[-2]
            between = self._columns[target.layer][place[target] + 1 : place[bend]]
            if (
                bend.layer == target.layer
                and not target.mirrored
                and target.kind in _BELOW_KINDS
                and all(item.kind == "bend" for item in between)
                and not (target.kind == "sum" and target.unders)
            ):
                target.unders.append(wire)
            else:
                target.lefts.append(wire)

        def goal(net: Net) -> tuple[bool, float]:
            least = min(turns for turns, _ in goals[net])
            heights = [height for turns, height in goals[net] if turns == least]
            return least, sum(heights) / len(heights)

        def origin(wire: _Wire) -> tuple[bool, int, int]:
            before = wire.stations[-2]
            if before.layer == wire.target.layer:
                return True, -place[before], 0
            return False, place[before], port.get((before, wire.net), 0)

        port: dict[tuple[_Item, Net], int] = {}
        for item in self._items:
            item.rights.sort(key=goal)
            port.update({(item, net): i for i, net in enumerate(item.rights)})
        for item in self._items:
            item.lefts.sort(key=origin)
            item.unders.sort(key=lambda wire: -place[wire.stations[-2]])

    # Coordinates.

    def _place_heights(self) -> dict[tuple[int, Net], int]:
        """Place the items vertically; return the number of every vertical line in its channel."""
        items = [item for column in self._columns for item in column]
        gaps: list[Gap[_Item]] = []
        for column in self._columns:
            for upper, lower in pairwise(column):
                boxes = sum(bool(one.node or one.panel) for one in (upper, lower))
                space = _ITEM_GAP if boxes == 2 else _LINE_GAP * (1 + boxes)
                if upper.kind == lower.kind == "port":
                    space = _PORT_GAP
                if upper.part != lower.part:
                    space = _PART_GAP
                gaps.append((upper, lower, upper.below + space + lower.above))
        # What a vertical line has at its left and right, with how far from its y.
        ends: defaultdict[tuple[int, Net], tuple[dict[tuple[_Item, float], None], ...]]
        ends = defaultdict(lambda: ({}, {}))
        # Every piece of wire wishes to be straight, the main path most of all. Of two of equal
        # rank, the one between bends must not become a step.
        wishes: dict[Gap[_Item], float] = {}
        for wire in self._wires:
            for channel, start, end in wire.hops():
                here, there = start.start(wire), end.end(wire)
                for item, y in ((start, here), (end, there)):
                    ends[channel, wire.net][item.layer > channel][item, y] = None
                if start.layer != end.layer:
                    bends = (start.kind == "bend") + (end.kind == "bend")
                    wishes[start, end, here - there] = 4.0**bends * (1.0 if wire.rank else _MAIN)
        tracks: dict[tuple[int, Net], int] = {}
        for attempt in range(_ATTEMPTS):
            heights = align(items, gaps, wishes)
            if heights is None:
                break
            small = {
                (one, other, drop): _MAIN * weight
                for (one, other, drop), weight in wishes.items()
                if _STRAIGHT < abs(heights[other] - heights[one] - drop) < _STEP
            }
            if attempt < 2 and small:  # rather a large step elsewhere
                wishes |= small
                continue
            top = min((heights[item] - item.above for item in items), default=0.0)
            for item in items:
                item.y = round(heights[item] - top, 3)
            channels: defaultdict[int, dict[tuple[int, Net], Sides]] = defaultdict(dict)
            for id_, sides in ends.items():
                lefts, rights = ([item.y + y for item, y in side] for side in sides)
                if max(lefts + rights) - min(lefts + rights) > _STRAIGHT:
                    channels[id_[0]][id_] = lefts, rights
            tracks, clashes = {}, []
            for pieces in channels.values():
                assigned, pairs = assign_tracks(pieces)
                tracks |= assigned
                clashes += pairs
            if not clashes:
                break
            gaps += [
                (b, a, y_b - y_a + CLEARANCE + 1)
                for left, right in clashes
                for a, y_a in ends[left][1]
                for b, y_b in ends[right][0]
                if abs(a.y + y_a - b.y - y_b) < CLEARANCE
            ]
        return tracks

    def _place_columns(self, x: float) -> tuple[dict[tuple[int, Net], float], float]:
        """Place the columns from left to right; return the vertical lines' x and the right end."""
        lines: dict[tuple[int, Net], float] = {}
        number = len(self._columns)
        labels: defaultdict[tuple[int, bool], float] = defaultdict(float)  # widths
        for item in self._items:
            for net in item.rights if item.node else ():
                if net in self._labels:
                    side = item.layer - item.mirrored, item.mirrored
                    labels[side] = max(labels[side], self._labels[net].width + _LABEL_ROOM)
        for channel in range(-1, number):
            own = [id_ for id_ in self._tracks if id_[0] == channel]
            start, end = labels[channel, False], labels[channel, True]
            if own or start or end or -1 < channel < number - 1:
                start, end = max(start, _START), max(end, _END)
            wide = _TRACK * max((self._tracks[id_] + 1 for id_ in own), default=0)
            if -1 < channel < number - 1:
                start = max(start, _CHANNEL - wide - end)
            for id_ in own:
                lines[id_] = x + start + (self._tracks[id_] + 0.5) * _TRACK
            x += start + wide + end
            if channel + 1 < number:
                column = self._columns[channel + 1]
                width = max(item.width for item in column)
                for item in column:
                    # What has one line stands near to where that goes: arrows are equally long.
                    share = 0.0 if item.panel else 0.5
                    if item.kind in ("port", "initial"):
                        share = 0.0 if item.lefts else 1.0
                    item.x = x + share * (width - item.width)
                x += width
        return lines, x + (_PADDING if self._panel.cluster else 0.0)

    # Sizes of the items, and the points at which wires meet them.

    def _frame(self, item: _Item) -> None:
        if item.panel:
            panel = item.panel
            item.width, item.above, item.below = panel.width, 0.0, panel.height
            item.body = (0.0, 0.0, panel.width, panel.height)
            item.arrive = {wire: ((0.0, panel.entries[wire.net]),) for wire in item.lefts}
            item.depart = {net: (panel.width, panel.exits[net]) for net in item.rights}
        elif item.node is None:
            item.above = item.below = _PITCH / 2 - _LINE_GAP / 2
            item.arrive = dict.fromkeys(item.lefts, ((0.0, 0.0),))
            item.depart = dict.fromkeys(item.rights, (0.0, 0.0))
        else:
            if item.kind in _RADIUS:
                self._circle(item)
            else:
                self._box(item, item.node)
            for points in item.arrive.values():
                item.above = max(item.above, _LIFT - points[0][1])
                item.below = max(item.below, points[0][1] + _CLEAR)
            for net, (_, y) in item.depart.items():
                item.above = max(item.above, self._label_height(net) + _LIFT - y)
                item.below = max(item.below, y + _CLEAR)

    def _label_height(self, net: Net) -> float:
        return self._labels[net].height if net in self._labels else 0.0

    def _rights(self, item: _Item, pitch: float) -> list[float]:
        """Return the heights at which signals leave an item, the most important one at 0."""
        ranks = {wire.net: wire.rank for wire in reversed(self._wires)}
        main = min(range(len(item.rights)), key=lambda i: ranks[item.rights[i]], default=0)
        return _spread([self._label_height(net) for net in item.rights], main, pitch)

    def _box(self, item: _Item, node: Node) -> None:
        text, caption = f"{node.label}\n{node.detail}" if node.detail else node.label, ""
        main = min(range(len(item.lefts)), key=lambda i: item.lefts[i].rank, default=0)
        left = _spread([0.0] * len(item.lefts), main, _PITCH)
        right = self._rights(item, _PITCH)
        is_port = node.kind == "port"
        if (
            node.kind == "gain"
            and 0 < len(node.detail) <= _IN_TRIANGLE
            and len(left) <= 1 >= len(right)
            and not item.unders
        ):
            item.shape, text, caption = "triangle", node.detail, node.label
            item.text = text_block(text, size=NODE_FONT - 1, limit=_LIMITS["block"])
            width = max(46.0, 2 * item.text.width + 6)
            height = max(42.0, 0.85 * width)
        else:
            item.shape = "text" if is_port else "box"
            limit = _LIMITS["port" if is_port else "block"]
            item.text = text_block(text, size=NODE_FONT, limit=limit)
            least = _LEAST.get(node.kind, _LEAST_BLOCK)
            under = (len(item.unders) + bool(item.unders)) * _UNDER_PITCH
            width = max(item.text.width + (8 if is_port else 24), under, least[0])
            height = max(item.text.height + (0 if is_port else 18), least[1])
        item.caption = text_block(caption, size=EDGE_FONT, limit=_LIMITS["block"])
        low, high = min([0.0, *left, *right]), max([0.0, *left, *right])
        height = max(height, high - low + _PITCH)
        item.width = max(width, item.caption.width)
        x, y = (item.width - width) / 2, (low + high - height) / 2
        item.above, item.below = -y, y + height
        if item.caption.lines:
            item.below += item.caption.height + _LIFT + _CLEAR
        item.body = (x, y, width, height)
        back, front = (x + width, x) if item.mirrored else (x, x + width)
        for wire, end in zip(item.lefts, left, strict=True):
            item.arrive[wire] = ((back, end),)
        for net, end in zip(item.rights, right, strict=True):
            item.depart[net] = (front, end)
        for i, wire in enumerate(item.unders):
            item.arrive[wire] = ((x + width * (i + 1) / (len(item.unders) + 1), y + height),)

    def _circle(self, item: _Item) -> None:
        """Frame a circle: the main path from the left, others from above and below."""
        arcs = list(item.lefts)
        main = min(range(len(arcs)), key=lambda i: arcs[i].rank, default=0)
        top = arcs.pop(0) if main > 0 else None
        main -= top is not None
        bottom = arcs.pop() if main < len(arcs) - 1 and not item.unders else None
        left = _spread([0.0] * len(arcs), main, _ARC_PITCH)
        right = self._rights(item, _ARC_PITCH)
        radius = max([_RADIUS[item.kind], *(abs(y) + _CLEAR for y in left + right)])
        centre = radius + (_STUB if item.kind == "sum" and item.lefts else 0.0)
        item.width, item.above, item.below = centre + radius, radius + _CLEAR, radius + _CLEAR
        item.shape = "circle" if item.kind == "sum" else "dot"
        item.body = (centre - radius, -radius, 2 * radius, 2 * radius)
        for wire, y in zip(arcs, left, strict=True):
            item.arrive[wire] = ((0.0, y), (centre - math.sqrt(radius**2 - y**2), y))
        for net, y in zip(item.rights, right, strict=True):
            item.depart[net] = (centre + math.sqrt(radius**2 - y**2), y)
        for wire in item.unders:
            item.arrive[wire] = ((centre, radius),)
            item.below += _STUB
        for one, side in ((top, -1), (bottom, 1)):
            if one:
                y = side * (radius + _STUB)
                item.arrive[one] = ((0.0, y), (centre, y), (centre, side * radius))


def _spread(heights: Sequence[float], main: int, pitch: float) -> list[float]:
    """Return the heights of lines with labels that high, below one another, the main one at 0."""
    offsets = [0.0]
    for height in heights[1:]:
        offsets.append(offsets[-1] + max(pitch, height + _LIFT + _CLEAR))
    return [offset - offsets[main] for offset in offsets[: len(heights)]]


def _moved(points: Sequence[Point], dx: float, dy: float) -> list[Point]:
    return [(x + dx, y + dy) for x, y in points]


def _simplified(points: Sequence[Point]) -> tuple[Point, ...]:
    """Return the corners of a line without repeated points and points on a straight piece."""
    kept: list[Point] = []
    for point in points:
        while len(kept) > 1 and min(np.ptp([*kept[-2:], point], axis=0)) < _STRAIGHT / 2:
            kept.pop()
        if not kept or math.dist(kept[-1], point) >= _STRAIGHT / 2:
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
        for x, y in dict.fromkeys(point for corners in lines for point in corners):
            ways = {
                (np.sign(end[0] - x), np.sign(end[1] - y))
                for a, b in pieces
                if min(a[0], b[0]) <= x <= max(a[0], b[0])
                and min(a[1], b[1]) <= y <= max(a[1], b[1])
                for end in (a, b)
            }
            if len(ways - {(0, 0)}) > 2:
                branches.append((x, y))
    return tuple(branches)
