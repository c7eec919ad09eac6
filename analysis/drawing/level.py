"""One level laid out: frames in their places, the corners of every wire, the labels."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Final

from chamfer.analysis.drawing.frames import (
    LIFT,
    Frame,
    Point,
    bend_frame,
    border_frame,
    node_frame,
    stop_frame,
)
from chamfer.analysis.drawing.graph import Node
from chamfer.analysis.drawing.placement import Placement, lane_room, place
from chamfer.analysis.drawing.plan import Key, Net, Plan, Wire, make_plan
from chamfer.analysis.drawing.text import TextBlock

_PART_GAP: Final = 32.0  # px between unconnected parts
_ROW_WIDTH: Final = 640.0  # px, after which unconnected nodes start a new row
_ARROW: Final = 12.0  # px kept free before a border
_SAME: Final = 0.01  # px


@dataclass(frozen=True)
class PlacedText:
    """Text with its upper left corner; its lines are centred."""

    text: TextBlock
    x: float
    y: float

    def moved(self, dx: float, dy: float) -> "PlacedText":
        """Return the text in another place."""
        return PlacedText(self.text, self.x + dx, self.y + dy)


@dataclass(frozen=True)
class Placed:
    """A frame, the x of its left edge and the y of its line."""

    frame: Frame
    x: float
    y: float


@dataclass(eq=False)
class Level:
    """A level, its upper left corner at (0, 0)."""

    width: float = 0.0
    height: float = 0.0
    line: float = 0.0  # y of the main path
    placed: dict[Key, Placed] = field(default_factory=dict)
    wires: dict[Wire, tuple[Point, ...]] = field(default_factory=dict)
    labels: list[PlacedText] = field(default_factory=list)

    def add(self, part: "Level", dx: float, dy: float) -> None:
        """Put a part into this level."""
        for key, item in part.placed.items():
            self.placed[key] = Placed(item.frame, item.x + dx, item.y + dy)
        for wire, points in part.wires.items():
            self.wires[wire] = tuple((x + dx, y + dy) for x, y in points)
        self.labels += [label.moved(dx, dy) for label in part.labels]
        self.width = max(self.width, part.width + dx)
        self.height = max(self.height, part.height + dy)


@dataclass(frozen=True)
class Border:
    """A place at which a line crosses a cluster's border."""

    label_height: float  # of what may stand on the line outside, px


@dataclass(eq=False)
class Inside:
    """A cluster as seen from outside: its size and the heights at which lines cross its border."""

    width: float
    height: float
    line: float
    entries: Mapping[Net, float]
    exits: Mapping[Net, float]

    def entry_share(self, net: Net) -> float:
        """Return how far down a signal comes in, 0 to 1."""
        return self.entries[net] / self.height

    def exit_share(self, net: Net) -> float:
        """Return how far down a signal goes out, 0 to 1."""
        return self.exits[net] / self.height


def lay_out_level(
    items: Mapping[Key, Node | Inside | Border],
    wires: Sequence[Wire],
    padding: float,
    least: float,
) -> Level:
    """Lay out one level.

    Args:
        items: What is drawn, in order.
        wires: The wires between them.
        padding: Free space left and right, which entries and exits bridge, in px.
        least: The least width, in px.

    Returns:
        The level; entries are at its left edge and exits at its right edge.
    """
    parts: list[tuple[list[Key], Level]] = []
    singles: list[tuple[list[Key], Level]] = []
    for keys in _parts(items, wires):
        inside = set(keys)
        own = [wire for wire in wires if wire.source in inside]
        part = _lay_out_part({key: items[key] for key in keys}, own)
        (parts if own or len(keys) > 1 else singles).append((keys, part))
    level = Level()
    dy = 0.0
    for keys, part in parts:
        dx = 0.0 if any(key[0] == "entry" for key in keys) else padding
        level.add(part, dx, dy)
        dy = level.height + _PART_GAP
    row_width = max(_ROW_WIDTH, level.width)
    dx, row_y = padding, dy
    for _, part in singles:
        if dx > padding and dx + part.width > row_width:
            dx, row_y = padding, level.height + _PART_GAP
        level.add(part, dx, row_y)
        dx += part.width + _PART_GAP
    right = max(
        (
            item.x + item.frame.width + (0.0 if key[0] == "exit" else padding)
            for key, item in level.placed.items()
        ),
        default=0.0,
    )
    level.width = max(level.width, right, least)
    for key, item in level.placed.items():
        if key[0] == "exit":
            level.placed[key] = Placed(item.frame, level.width, item.y)
    for wire, points in level.wires.items():
        if wire.target[0] == "exit":
            level.wires[wire] = simplified([*points, (level.width, points[-1][1])])
    largest = max(parts + singles, key=lambda entry: len(entry[0]), default=None)
    if largest is not None:
        keys, part = largest
        level.line = level.placed[keys[0]].y - part.placed[keys[0]].y + part.line
    return level


def simplified(points: Sequence[Point]) -> tuple[Point, ...]:
    """Return the corners of a line without repeated points and points on a straight piece."""
    kept: list[Point] = []
    for point in points:
        if kept and _same(kept[-1], point, 0) and _same(kept[-1], point, 1):
            continue
        while len(kept) > 1 and any(
            _same(kept[-2], kept[-1], axis) and _same(kept[-1], point, axis) for axis in (0, 1)
        ):
            kept.pop()
        kept.append(point)
    return tuple(kept)


def _same(a: Point, b: Point, axis: int) -> bool:
    return abs(a[axis] - b[axis]) < _SAME


def _parts(items: Mapping[Key, object], wires: Sequence[Wire]) -> list[list[Key]]:
    neighbours: dict[Key, list[Key]] = {key: [] for key in items}
    for wire in wires:
        neighbours[wire.source].append(wire.target)
        neighbours[wire.target].append(wire.source)
    number: dict[Key, int] = {}
    count = 0
    for start in items:
        if start in number:
            continue
        front = [start]
        while front:
            key = front.pop()
            if key not in number:
                number[key] = count
                front += neighbours[key]
        count += 1
    parts: list[list[Key]] = [[] for _ in range(count)]
    for key in items:
        parts[number[key]].append(key)
    return parts


def _lay_out_part(items: Mapping[Key, Node | Inside | Border], wires: Sequence[Wire]) -> Level:
    kinds = {key: item.kind if isinstance(item, Node) else key[0] for key, item in items.items()}
    plan = make_plan(kinds, wires)
    frames: dict[Key, Frame] = {}
    for column in plan.columns:
        for key in column:
            item = items.get(key)
            if isinstance(item, Node):
                frames[key] = node_frame(item, key, plan)
            elif isinstance(item, Inside):
                frames[key] = _inside_frame(item, key, plan)
            elif isinstance(item, Border):
                frames[key] = _border_frame(item, key, plan)
            else:
                frames[key] = bend_frame()
    for path in plan.paths:
        for into, out in zip(path.wires, [*path.wires[1:], path.arrivals[0]], strict=False):
            item = items[into.target]
            if isinstance(item, Node):
                frames[into.target] = stop_frame(item, into, out)
    placement = place(plan, frames)
    level = Level(placement.width, placement.height)
    for key in items:
        level.placed[key] = Placed(frames[key], placement.x[key], placement.y[key])
    for wire in plan.forward:
        level.wires[wire] = _forward_line(wire, plan, level, placement)
    for path in plan.paths:
        for wire in (*path.wires, *path.arrivals):
            level.wires[wire] = _return_line(wire, path.row, plan, level, placement)
    for key in plan.loops:
        item_x, item_y = level.placed[key].x, level.placed[key].y
        for loop in frames[key].loops:
            level.wires[loop.wire] = tuple((item_x + x, item_y + y) for x, y in loop.points)
            middle = (loop.points[1][0] + loop.points[2][0]) / 2
            level.labels.append(_above(loop.label, item_x + middle, item_y + loop.points[1][1]))
    level.labels += _labels(plan, level, placement)
    main = next((wire.target for wire in plan.forward if plan.rank[wire] == 0), next(iter(items)))
    level.line = level.placed[main].y
    return level


def _inside_frame(inside: Inside, key: Key, plan: Plan) -> Frame:
    frame = Frame(inside.width, inside.line, inside.height - inside.line)
    frame.body = (0.0, -inside.line, inside.width, inside.height)
    for wire in plan.left_in[key]:
        frame.arrive[wire] = ((0.0, inside.entries[wire.net] - inside.line),)
    for net in plan.right_out[key]:
        frame.depart[net] = (inside.width, inside.exits[net] - inside.line)
    return frame


def _border_frame(border: Border, key: Key, plan: Plan) -> Frame:
    frame = border_frame(border.label_height)
    for wire in plan.left_in[key]:
        frame.arrive[wire] = ((0.0, 0.0),)
    for net in plan.right_out[key]:
        frame.depart[net] = (0.0, 0.0)
    return frame


def _forward_line(wire: Wire, plan: Plan, level: Level, placement: Placement) -> tuple[Point, ...]:
    points = [_departure(wire, level)]
    arrival = _arrival(wire, level)
    for channel in plan.channels(wire):
        if channel + 1 == plan.layer[wire.target]:
            y = arrival[0][1]
        else:
            y = placement.y[plan.station[wire.net, channel + 1]]
        if (channel, wire.net) in placement.track_x:
            x = placement.track_x[channel, wire.net]
            points += [(x, points[-1][1]), (x, y)]
    return simplified([*points, *arrival])


def _return_line(
    wire: Wire, row: int, plan: Plan, level: Level, placement: Placement
) -> tuple[Point, ...]:
    points = [_departure(wire, level)]
    arrival = _arrival(wire, level)
    y = placement.row_y[row]
    if wire.source not in plan.stop_column:
        channel = plan.layer[wire.source]
        below = wire.net in plan.bottom_out[wire.source]
        x = points[0][0] if below else placement.track_x[channel, wire.net]
        points += [(x, points[0][1]), (x, y)]
    if wire.target not in plan.stop_column:
        channel = plan.layer[wire.target] - 1
        below = wire in plan.bottom_in[wire.target]
        x = arrival[0][0] if below else placement.track_x[channel, wire]
        points += [(x, y), (x, arrival[0][1])]
    return simplified([*points, *arrival])


def _departure(wire: Wire, level: Level) -> Point:
    item = level.placed[wire.source]
    x, y = item.frame.depart[wire.net]
    return item.x + x, item.y + y


def _arrival(wire: Wire, level: Level) -> list[Point]:
    item = level.placed[wire.target]
    return [(item.x + x, item.y + y) for x, y in item.frame.arrive[wire]]


def _labels(plan: Plan, level: Level, placement: Placement) -> list[PlacedText]:
    labels = []
    for key, nets in plan.right_out.items():
        slot = plan.layer[key] + 1
        for net in nets:
            if net not in plan.net_label:
                continue
            item = level.placed[key]
            start, y = item.x + item.frame.width, item.frame.depart[net][1]
            end = placement.start_zone[slot][1]
            if not placement.has_tracks[slot]:
                end = placement.end_zone[slot][1] - _ARROW
            labels.append(_above(plan.net_label[net], (start + end) / 2, item.y + y))
    for wire, label in plan.wire_label.items():
        slot = plan.layer[wire.target]
        item = level.placed[wire.target]
        x, y = _arrival(wire, level)[0]
        end = x - (4 if item.frame.body[0] > 0 else _ARROW)
        start = end - label.width
        if not placement.has_tracks[slot]:
            start = placement.start_zone[slot][0]
        labels.append(_above(label, (start + end) / 2, y))
    for (channel, row), entries in plan.lane_label.items():
        start, end = placement.start_zone[channel + 1]
        x = (start + end - lane_room([label for _, label in entries])) / 2 + 3
        for _, label in entries:
            labels.append(_above(label, x + 5 + label.width / 2, placement.row_y[row]))
            x += label.width + 10
    return labels


def _above(label: TextBlock, middle: float, y: float) -> PlacedText:
    return PlacedText(label, middle - label.width / 2, y - LIFT - label.height)
