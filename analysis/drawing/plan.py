"""What goes where in one level of a drawing, before any coordinate is known.

A level is the inside of one cluster (or of the whole picture): its *items* are nodes, clusters
that count as one box, and the places on the border where lines come in (entries) and go out
(exits). Items stand in columns; the gap right of column ``c`` is channel ``c``. Feedback runs
back in rows below the columns.
"""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from chamfer.analysis.drawing.layering import (
    Link,
    assign_layers,
    feedback,
    longest_paths,
    order_layers,
)
from chamfer.analysis.drawing.text import TextBlock, text_block

Key = tuple[str, ...]  # ("node", id), ("cluster", id), ("entry", *net), ("exit", *net)
Net = tuple[str, str]  # a signal: the id of the node and the port that it comes from

EDGE_FONT: Final = 11.0  # px
_EDGE_LIMIT: Final = 16  # characters in a line
_RETURN_KINDS: Final = ("block", "gain")  # what may stand in a feedback line, mirrored
_STATE_KINDS: Final = ("state", "final", "failed")
_BELOW_KINDS: Final = ("block", "sum", *_STATE_KINDS)  # entered from below


@dataclass(frozen=True, eq=False)
class Wire:
    """A line between two items of a level."""

    net: Net
    source: Key
    target: Key
    label: str
    leaves_at: float = 0.0  # how far down a cluster, 0 to 1
    enters_at: float = 0.0
    returns: bool = False  # is feedback where it comes from


@dataclass(eq=False)
class ReturnPath:
    """Feedback of one signal: down, back in a row through the stops, up to the arrivals."""

    source: Key
    wires: list[Wire]  # to the stops, one after the other
    arrivals: list[Wire]  # from the last stop (or the source) to the targets
    row: int = 0

    @property
    def stops(self) -> list[Key]:
        """The items in the row, in the direction of the signal."""
        return [wire.target for wire in self.wires]


@dataclass(eq=False)
class Plan:
    """Columns, rows, and the side and order in which wires meet the items."""

    kinds: Mapping[Key, str]
    loops: dict[Key, list[Wire]] = field(default_factory=lambda: defaultdict(list))
    forward: list[Wire] = field(default_factory=list)
    rank: dict[Wire, int] = field(default_factory=dict)  # 0: on the main path
    layer: dict[Key, int] = field(default_factory=dict)
    columns: list[list[Key]] = field(default_factory=list)  # top to bottom, with bends
    station: dict[tuple[Net, int], Key] = field(default_factory=dict)
    paths: list[ReturnPath] = field(default_factory=list)
    stop_column: dict[Key, int] = field(default_factory=dict)
    left_in: dict[Key, list[Wire]] = field(default_factory=lambda: defaultdict(list))
    right_out: dict[Key, list[Net]] = field(default_factory=lambda: defaultdict(list))
    bottom_in: dict[Key, list[Wire]] = field(default_factory=lambda: defaultdict(list))
    bottom_out: dict[Key, list[Net]] = field(default_factory=lambda: defaultdict(list))
    net_label: dict[Net, TextBlock] = field(default_factory=dict)  # at the source
    wire_label: dict[Wire, TextBlock] = field(default_factory=dict)  # at the target
    lane_label: dict[tuple[int, int], list[tuple[Wire, TextBlock]]] = field(
        default_factory=lambda: defaultdict(list)
    )  # in a row, by channel and row

    def net_rank(self) -> dict[Net, int]:
        """Return the rank of every signal that runs forward: that of its most important wire."""
        ranks: dict[Net, int] = {}
        for wire, rank in self.rank.items():
            ranks[wire.net] = min(rank, ranks.get(wire.net, rank))
        return ranks

    def channels(self, wire: Wire) -> range:
        """Return the channels that a forward wire passes."""
        return range(self.layer[wire.source], self.layer[wire.target])


def make_plan(kinds: Mapping[Key, str], wires: Sequence[Wire]) -> Plan:
    """Plan one connected part of a level.

    Args:
        kinds: The items and what they are: the kind of a node, "cluster", "entry" or "exit".
        wires: The wires between them.

    Returns:
        The plan; every wire is forward, part of a return path or a loop.
    """
    plan = Plan(kinds)
    keys = list(kinds)
    pairs = [(wire.source, wire.target) for wire in wires]
    back = feedback(keys, pairs, lambda key: kinds[key] == "sum")
    backward = [wires[i] for i in range(len(wires)) if i in back]
    for wire in wires:
        if wire.source == wire.target:
            plan.loops[wire.source].append(wire)
    forward = [
        wire for i, wire in enumerate(wires) if i not in back and wire.source != wire.target
    ]
    chains = _return_chains(plan, forward, backward)
    while True:
        stops = {wire.target for chain in chains for wire in chain.wires}
        in_chain = {wire for chain in chains for wire in chain.wires}
        plan.forward = [wire for wire in forward if wire not in in_chain]
        standing = [key for key in keys if key not in stops]
        plan.layer = assign_layers(
            standing,
            [(wire.source, wire.target) for wire in plan.forward],
            lambda key: kinds[key] == "entry",
            lambda key: kinds[key] == "exit",
        )
        fitting = [chain for chain in chains if len(chain.wires) <= _room(plan, chain)]
        if len(fitting) == len(chains):
            break
        chains = fitting
    chained = {wire for chain in chains for wire in chain.arrivals}
    direct: dict[Net, ReturnPath] = {}
    for wire in backward:
        if wire not in chained:
            path = direct.setdefault(wire.net, ReturnPath(wire.source, [], []))
            path.arrivals.append(wire)
    plan.paths = [*chains, *direct.values()]
    for chain in chains:
        target, source = plan.layer[chain.arrivals[0].target], plan.layer[chain.source]
        for i, stop in enumerate(chain.stops):
            share = (i + 0.5) / len(chain.stops)
            plan.stop_column[stop] = source - int(share * (source - target))
    _rank_wires(plan, standing)
    _fill_columns(plan, standing)
    _choose_sides(plan)
    _assign_rows(plan)
    _order_ports(plan)
    _place_labels(plan, wires)
    return plan


def edge_label(*texts: str) -> TextBlock:
    """Return the label of a line that has these names."""
    return text_block(" / ".join(texts), size=EDGE_FONT, limit=_EDGE_LIMIT)


def _return_chains(
    plan: Plan, forward: Sequence[Wire], backward: Sequence[Wire]
) -> list[ReturnPath]:
    """Find the blocks that stand in a feedback line: one way in, one way back."""
    entering: defaultdict[Key, list[Wire]] = defaultdict(list)
    leaving: defaultdict[Key, list[Wire]] = defaultdict(list)
    for wire in forward:
        entering[wire.target].append(wire)
        leaving[wire.source].append(wire)
    returning: defaultdict[Key, list[Wire]] = defaultdict(list)
    arriving = set(plan.loops)
    for wire in backward:
        returning[wire.source].append(wire)
        arriving.add(wire.target)
    chains = []
    for last in plan.kinds:
        if len(returning[last]) != 1 or leaving[last]:
            continue
        path = ReturnPath(last, [], returning[last])
        while (
            plan.kinds[path.source] in _RETURN_KINDS
            and len(entering[path.source]) == 1
            and path.source not in arriving
        ):
            path.wires.insert(0, entering[path.source][0])
            path.source = path.wires[0].source
            if len(leaving[path.source]) > 1 or returning[path.source]:
                break
        if path.wires and len(leaving[path.source]) > 1:
            chains.append(path)
    # Two chains that leave a source with nothing else would leave no forward path.
    taken: defaultdict[Key, int] = defaultdict(int)
    kept = []
    for path in chains:
        if taken[path.source] + 1 < len(leaving[path.source]):
            taken[path.source] += 1
            kept.append(path)
    return kept


def _room(plan: Plan, chain: ReturnPath) -> int:
    stops = set(chain.stops)
    if chain.source in stops or chain.source not in plan.layer:
        return 0
    return plan.layer[chain.source] - plan.layer[chain.arrivals[0].target]


def _rank_wires(plan: Plan, keys: Sequence[Key]) -> None:
    """Number the forward wires by the paths that they belong to, the longest path first."""
    before, after = longest_paths(keys, [(wire.source, wire.target) for wire in plan.forward])
    length = {wire: before[wire.source] + after[wire.target] for wire in plan.forward}
    entering: defaultdict[Key, list[Wire]] = defaultdict(list)
    leaving: defaultdict[Key, list[Wire]] = defaultdict(list)
    for wire in plan.forward:
        entering[wire.target].append(wire)
        leaving[wire.source].append(wire)
    for path, start in enumerate(
        sorted(plan.forward, key=lambda wire: (wire.returns, -length[wire]))
    ):
        if start in plan.rank:
            continue
        plan.rank[start] = path
        for side, end in ((leaving, 1), (entering, 0)):
            wire = start
            while True:
                open_wires = [w for w in side[_ends(wire)[end]] if w not in plan.rank]
                if not open_wires:
                    break
                wire = max(open_wires, key=lambda other: (not other.returns, length[other]))
                plan.rank[wire] = path


def _fill_columns(plan: Plan, keys: Sequence[Key]) -> None:
    count = max(plan.layer.values(), default=-1) + 1
    columns: list[list[Key]] = [[] for _ in range(count)]
    main = {key for wire in plan.forward if plan.rank[wire] == 0 for key in _ends(wire)}
    before, _ = longest_paths(keys, [(wire.source, wire.target) for wire in plan.forward])
    # Disturbances start above the path that they act on, whose feedback then has room below.
    returning = {wire.source for wire in plan.forward if wire.returns}
    for key in sorted(
        _reading_order(plan, keys),
        key=lambda key: (key in returning, key in main or before[key] > 0),
    ):
        columns[plan.layer[key]].append(key)
    for wire in plan.forward:
        plan.station[wire.net, plan.layer[wire.source]] = wire.source
        for layer in plan.channels(wire)[1:]:
            bend = ("bend", str(layer), *wire.net)
            if (wire.net, layer) not in plan.station:
                plan.station[wire.net, layer] = bend
                columns[layer].append(bend)
    links: dict[tuple[Key, Key, float, float], None] = {}
    for wire in plan.forward:
        for channel in plan.channels(wire):
            left = plan.station[wire.net, channel]
            ends = channel + 1 == plan.layer[wire.target]
            right = wire.target if ends else plan.station[wire.net, channel + 1]
            leaves_at = wire.leaves_at if left == wire.source else 0.0
            links[left, right, leaves_at, wire.enters_at if ends else 0.0] = None
    plan.columns = order_layers(columns, [Link(*link) for link in links])


def _reading_order(plan: Plan, keys: Sequence[Key]) -> list[Key]:
    """Return the keys as they are met on the way from the sources; what returns comes last."""
    leaving: defaultdict[Key, list[Key]] = defaultdict(list)
    entered = {wire.target for wire in plan.forward}
    returning = {wire.source for wire in plan.forward if wire.returns}
    for wire in plan.forward:
        leaving[wire.source].append(wire.target)
    starts = [key for key in keys if key not in entered]
    starts.sort(key=lambda key: key in returning)
    met: dict[Key, None] = {}
    stack = starts[::-1]
    while stack:
        key = stack.pop()
        if key not in met:
            met[key] = None
            stack += reversed(leaving[key])
    return list(met)


def _ends(wire: Wire) -> tuple[Key, Key]:
    return wire.source, wire.target


def _choose_sides(plan: Plan) -> None:
    """Let feedback enter from below, and leave a state downwards, where nothing is in the way."""
    lowest = [
        next((key for key in reversed(column) if key[0] != "bend"), None)
        for column in plan.columns
    ]
    busy = set(plan.stop_column.values())
    forward_nets = {wire.net for wire in plan.forward}
    free = {
        key: lowest[layer] == key and layer not in busy and plan.kinds[key] in _BELOW_KINDS
        for key, layer in plan.layer.items()
    }
    for path in plan.paths:
        net = path.arrivals[0].net
        alone = not path.stops and net not in forward_nets
        if alone and free[path.source] and plan.kinds[path.source] in _STATE_KINDS:
            plan.bottom_out[path.source].append(net)
        for wire in path.arrivals:
            one_only = plan.kinds[wire.target] == "sum" and plan.bottom_in[wire.target]
            if free[wire.target] and not one_only:
                plan.bottom_in[wire.target].append(wire)


def _assign_rows(plan: Plan) -> None:
    """Give every return path the highest row in which nothing else runs; inner loops first."""
    spans = {}
    for path in plan.paths:
        net = path.arrivals[0].net
        start = 2 * plan.layer[path.source] + (net not in plan.bottom_out[path.source])
        ends = [
            2 * plan.layer[wire.target] - (wire not in plan.bottom_in[wire.target])
            for wire in path.arrivals
        ]
        spans[path] = (min(ends), start)
    rows: list[list[tuple[int, int]]] = []
    for path in sorted(plan.paths, key=lambda path: spans[path][1] - spans[path][0]):
        low, high = spans[path]
        for row in range(len(rows) + 1):
            if row == len(rows):
                rows.append([])
            if all(high < other[0] or other[1] < low for other in rows[row]):
                rows[row].append((low, high))
                path.row = row
                break


def _order_ports(plan: Plan) -> None:
    place = {key: i for column in plan.columns for i, key in enumerate(column)}
    row = {wire: path.row for path in plan.paths for wire in path.arrivals}
    goal: defaultdict[Net, list[int]] = defaultdict(list)
    leaving: defaultdict[Key, dict[Net, None]] = defaultdict(dict)
    for wire in plan.forward:
        layer = plan.layer[wire.source]
        leaving[wire.source][wire.net] = None
        bend = layer + 1 < plan.layer[wire.target]
        goal[wire.net].append(place[plan.station[wire.net, layer + 1] if bend else wire.target])
    depth: dict[Net, int] = {}
    for path in plan.paths:
        net = (path.wires or path.arrivals)[0].net
        depth[net] = max(path.row, depth.get(net, 0))
        if net not in plan.bottom_out[path.source]:
            leaving[path.source][net] = None
    below = len(place)
    for key, nets in leaving.items():
        plan.right_out[key] = sorted(
            nets,
            key=lambda net: (
                (sum(goal[net]) / len(goal[net]), 0) if goal[net] else (below, -depth[net])
            ),
        )
    port = {net: i for nets in plan.right_out.values() for i, net in enumerate(nets)}
    for wire in plan.forward:
        plan.left_in[wire.target].append(wire)
    for wires in plan.left_in.values():
        wires.sort(
            key=lambda wire: (
                place[plan.station[wire.net, plan.layer[wire.target] - 1]],
                port[wire.net],
            )
        )
    for wire in sorted(row, key=lambda wire: -row[wire]):
        if wire not in plan.bottom_in[wire.target]:
            plan.left_in[wire.target].append(wire)
    out_row = {path.arrivals[0].net: path.row for path in plan.paths}
    for wires in plan.bottom_in.values():
        wires.sort(key=lambda wire: -row[wire])
    for bottom_nets in plan.bottom_out.values():
        bottom_nets.sort(key=lambda net: out_row[net])


def _place_labels(plan: Plan, wires: Sequence[Wire]) -> None:
    labels: defaultdict[Net, dict[str, None]] = defaultdict(dict)
    for wire in wires:
        if wire.label and wire.source != wire.target:
            labels[wire.net][wire.label] = None
    right = {net for nets in plan.right_out.values() for net in nets}
    to_stop = {wire for path in plan.paths for wire in path.wires}
    stuck = {wire.net for wire in to_stop if wire.label}
    for net, texts in labels.items():
        if net in right and (len(texts) == 1 or net in stuck):
            plan.net_label[net] = edge_label(*texts)
    for wire in plan.forward:
        if wire.label and wire.net not in plan.net_label:
            plan.wire_label[wire] = edge_label(wire.label)
    for path in plan.paths:
        start = plan.stop_column[path.stops[-1]] if path.stops else plan.layer[path.source]
        for wire in path.arrivals:
            if not wire.label or wire.net in plan.net_label:
                continue
            channel = (plan.layer[wire.target] + start - 1) // 2
            plan.lane_label[channel, path.row].append((wire, edge_label(wire.label)))
