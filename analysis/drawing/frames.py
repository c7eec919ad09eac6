"""The size of every item of a level, and the points at which wires meet it.

A frame is measured from its *line*: y = 0 is the height at which the main path passes through,
x = 0 the item's left edge. All lengths are px.
"""

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Final, Literal

from chamfer.analysis.drawing.graph import Node
from chamfer.analysis.drawing.plan import EDGE_FONT, Key, Net, Plan, Wire
from chamfer.analysis.drawing.text import TextBlock, text_block

Point = tuple[float, float]
Shape = Literal["box", "circle", "dot", "triangle", "text", "frame"]

NODE_FONT: Final = 13.0
_LABEL_LIMIT: Final = 18  # characters in a line of a block's label
_PORT_LIMIT: Final = 40  # of an open end's label
_PITCH: Final = 22.0  # least distance of ports on a block
_ARC_PITCH: Final = 9.0  # the same on a summing circle
_CLEAR: Final = 5.0  # free space around a line
BORDER_GAP: Final = 6.0  # between the frames of two lines
LIFT: Final = 3.0  # a label stands this much above its line
_BOTTOM_PITCH: Final = 16.0
_RADIUS: Final = 13.0  # of a summing circle
_DOT: Final = 7.0  # of the initial dot
_STUB: Final = 18.0  # the last vertical piece of a line into a circle
_SIGN_ROOM: Final = 18.0
_LEAST_BLOCK: Final = (72.0, 42.0)
_LEAST_SIZE: Final = {"state": (88.0, 40.0), "any": (64.0, 34.0)}
_LONGEST_IN_TRIANGLE: Final = 7  # characters


@dataclass(frozen=True)
class Loop:
    """A wire from an item to itself, drawn on top of it."""

    wire: Wire
    points: tuple[Point, ...]
    label: TextBlock


@dataclass(eq=False)
class Frame:
    """The room that an item takes, its drawn body in it, and where wires meet it."""

    width: float
    above: float
    below: float
    shape: Shape = "frame"
    body: tuple[float, float, float, float] = (0.0, 0.0, 0.0, 0.0)  # x, y, width, height
    text: TextBlock | None = None
    caption: TextBlock | None = None  # below the body
    arrive: dict[Wire, tuple[Point, ...]] = field(default_factory=dict)  # the last on the border
    depart: dict[Net, Point] = field(default_factory=dict)
    loops: tuple[Loop, ...] = ()
    mirrored: bool = False  # stands in a feedback row: in on the right, out on the left


def bend_frame() -> Frame:
    """Return the frame of a place that a line passes between two columns."""
    return Frame(0.0, _CLEAR, _CLEAR)


def border_frame(label_height: float) -> Frame:
    """Return the frame of a place at which a line crosses the border of a cluster.

    Lines with labels outside are as far apart as ports with such labels on a block.
    """
    half = _PITCH / 2
    above = max(half, label_height + LIFT + _CLEAR - half)
    return Frame(0.0, above - BORDER_GAP / 2, half - BORDER_GAP / 2)


def node_frame(node: Node, key: Key, plan: Plan) -> Frame:
    """Return the frame of a node.

    Args:
        node: What is drawn.
        key: Its item in the plan.
        plan: Says which wires meet it on which side.

    Returns:
        The frame, with the points of all its wires.
    """
    if node.kind in ("sum", "initial"):
        frame = _circle(node, key, plan)
    elif _fits_triangle(node, key, plan):
        frame = _triangle(node, key, plan)
    else:
        frame = _box(node, key, plan)
    return frame


def stop_frame(node: Node, into: Wire, out: Wire) -> Frame:
    """Return the frame of a node in a feedback row, where signals run to the left.

    Args:
        node: What is drawn.
        into: The wire that enters it, from the right.
        out: The wire that leaves it, to the left.

    Returns:
        The frame.
    """
    if node.kind == "gain" and _short(node):
        frame = _triangle_body(node)
    else:
        frame = _box_body(node, 0.0, 0.0)
    x, _, width, _ = frame.body
    frame.arrive[into] = ((x + width, 0.0),)
    frame.depart[out.net] = (x, 0.0)
    frame.mirrored = True
    return frame


def spread(heights: Sequence[float], main: int | None, pitch: float) -> list[float]:
    """Return the heights of ports, below one another, round 0.

    Args:
        heights: The height of the label above every port's line.
        main: The port that should be at 0 unless that makes the block lopsided.
        pitch: The least distance of two ports.

    Returns:
        Their offsets, increasing.
    """
    offsets = [0.0]
    for height in heights[1:]:
        offsets.append(offsets[-1] + max(pitch, height + LIFT + _CLEAR))
    middle = offsets[-1] / 2
    if main is not None and abs(offsets[main] - middle) <= 1.5 * pitch:
        middle = offsets[main]
    return [offset - middle for offset in offsets[: len(heights)]]


def _short(node: Node) -> bool:
    return 0 < len(node.detail) <= _LONGEST_IN_TRIANGLE


def _fits_triangle(node: Node, key: Key, plan: Plan) -> bool:
    return (
        node.kind == "gain"
        and _short(node)
        and len(plan.left_in[key]) <= 1
        and len(plan.right_out[key]) <= 1
        and not (plan.bottom_in[key] or plan.loops.get(key))
    )


def _box(node: Node, key: Key, plan: Plan) -> Frame:
    lefts, rights = plan.left_in[key], plan.right_out[key]
    main_in, main_out = _main_wire(lefts, plan), _main_net(rights, plan)
    left_heights = [_wire_height(wire, plan) for wire in lefts]
    right_heights = [_net_height(net, plan) for net in rights]
    left = spread([_room_above(wire, plan) for wire in lefts], main_in, _PITCH)
    right = spread([_room_above_net(net, plan) for net in rights], main_out, _PITCH)
    if main_in is not None and main_out is not None:
        # What comes in on the main path goes out at the same height.
        shift = left[main_in] - right[main_out]
        if abs(left[main_in]) >= abs(right[main_out]):
            right = [offset + shift for offset in right]
        else:
            left = [offset - shift for offset in left]
    reach = max((abs(offset) for offset in left + right), default=0.0)
    count = len(plan.bottom_in[key]) + len(plan.bottom_out[key])
    loops = plan.loops.get(key, [])
    spans = _loop_spans(loops)
    across = max([(count + 1) * _BOTTOM_PITCH if count else 0.0, *(2 * s + 20 for s in spans)])
    frame = _box_body(node, across, 2 * reach + _PITCH)
    x, y, width, height = frame.body
    for wire, offset in zip(lefts, left, strict=True):
        frame.arrive[wire] = ((0.0, offset), (x, offset))
    for net, offset in zip(rights, right, strict=True):
        frame.depart[net] = (x + width, offset)
    bottom = y + height
    step = width / (count + 1)
    places = iter([x + step * (i + 1) for i in range(count)])
    for net in plan.bottom_out[key]:
        frame.depart[net] = (next(places), bottom)
    for wire in plan.bottom_in[key]:
        frame.arrive[wire] = ((next(places), bottom),)
    _make_room(frame, left, left_heights, right, right_heights)
    _add_loops(frame, loops, spans, lambda _: y)
    return frame


def _circle(node: Node, key: Key, plan: Plan) -> Frame:
    lefts, rights = plan.left_in[key], plan.right_out[key]
    loops = plan.loops.get(key, [])
    heights = {wire: _wire_height(wire, plan) for wire in lefts}
    main = _main_wire(lefts, plan) or 0
    top = lefts[0] if main > 0 and not loops else None
    under = plan.bottom_in[key]
    bottom = lefts[-1] if main < len(lefts) - 1 and not under else None
    arcs = [wire for wire in lefts if wire not in (top, bottom)]
    place = arcs.index(lefts[main]) if lefts else None
    arc_heights = [heights[wire] for wire in arcs]
    left = spread(arc_heights, place, _ARC_PITCH)
    right_heights = [_net_height(net, plan) for net in rights]
    right = spread(right_heights, _main_net(rights, plan), _ARC_PITCH)
    spans = _loop_spans(loops)
    least = _RADIUS if node.kind == "sum" else _DOT
    reach = max((abs(offset) for offset in left + right), default=-_CLEAR)
    radius = max([least, reach + _CLEAR, *(span + _CLEAR for span in spans)])
    margin = _SIGN_ROOM if node.kind == "sum" and lefts else 0.0
    centre = margin + radius
    frame = Frame(centre + radius, radius + _CLEAR, radius + _CLEAR)
    frame.shape = "circle" if node.kind == "sum" else "dot"
    frame.body = (margin, -radius, 2 * radius, 2 * radius)

    def half_chord(offset: float) -> float:
        return math.sqrt(radius**2 - offset**2)

    for wire, offset in zip(arcs, left, strict=True):
        frame.arrive[wire] = ((0.0, offset), (centre - half_chord(offset), offset))
    for net, offset in zip(rights, right, strict=True):
        frame.depart[net] = (centre + half_chord(offset), offset)
    for wire in under:
        frame.arrive[wire] = ((centre, radius),)
        frame.below += _STUB
    _make_room(frame, left, arc_heights, right, right_heights)
    if top is not None:
        y = -radius - _STUB - max(arc_heights[:1], default=0.0)
        frame.arrive[top] = ((0.0, y), (centre, y), (centre, -radius))
        frame.above = max(frame.above, heights[top] + LIFT + _CLEAR - y)
    if bottom is not None:
        y = radius + _STUB + heights[bottom]
        frame.arrive[bottom] = ((0.0, y), (centre, y), (centre, radius))
        frame.below = max(frame.below, y + _CLEAR)
    _add_loops(frame, loops, spans, lambda span: -half_chord(span))
    return frame


def _triangle(node: Node, key: Key, plan: Plan) -> Frame:
    frame = _triangle_body(node)
    x, _, width, _ = frame.body
    lefts, rights = plan.left_in[key], plan.right_out[key]
    for wire in lefts:
        frame.arrive[wire] = ((0.0, 0.0), (x, 0.0))
    for net in rights:
        frame.depart[net] = (x + width, 0.0)
    _make_room(
        frame,
        [0.0] * len(lefts),
        [_wire_height(wire, plan) for wire in lefts],
        [0.0] * len(rights),
        [_net_height(net, plan) for net in rights],
    )
    return frame


def _triangle_body(node: Node) -> Frame:
    text = text_block(node.detail, size=NODE_FONT - 1, limit=_LABEL_LIMIT)
    caption = text_block(node.label, size=EDGE_FONT, limit=_LABEL_LIMIT)
    width = max(46.0, text.width / 0.5 + 6)
    height = max(42.0, 0.85 * width)
    room = max(width, caption.width)
    below = height / 2 + (caption.height + LIFT if caption.lines else 0.0)
    frame = Frame(room, height / 2, below + _CLEAR, "triangle")
    frame.body = ((room - width) / 2, -height / 2, width, height)
    frame.text, frame.caption = text, caption if caption.lines else None
    return frame


def _box_body(node: Node, least_width: float, least_height: float) -> Frame:
    label = f"{node.label}\n{node.detail}" if node.detail else node.label
    text = text_block(label, size=NODE_FONT, limit=_LABEL_LIMIT)
    if node.kind == "port":
        text = text_block(label, size=NODE_FONT, limit=_PORT_LIMIT)
        width, height = max(text.width + 8, least_width), max(text.height, least_height)
    else:
        least = _LEAST_SIZE.get(node.kind, _LEAST_BLOCK)
        width = max(text.width + 24, least_width, least[0])
        height = max(text.height + 18, least_height, least[1])
    frame = Frame(width, height / 2, height / 2)
    frame.shape = "text" if node.kind == "port" else "box"
    frame.body = (0.0, -height / 2, width, height)
    frame.text = text
    return frame


def _make_room(
    frame: Frame,
    left: Sequence[float],
    left_heights: Sequence[float],
    right: Sequence[float],
    right_heights: Sequence[float],
) -> None:
    offsets = [*left, *right]
    for offset, height in zip(offsets, [*left_heights, *right_heights], strict=True):
        frame.above = max(frame.above, height + LIFT - offset)
        frame.below = max(frame.below, offset + _CLEAR)


def _loop_spans(loops: Sequence[Wire]) -> list[float]:
    """Return half the width of every loop, the innermost first; a loop clears inner labels."""
    spans: list[float] = []
    inside = 0.0
    for wire in loops:
        spans.append(max(spans[-1] + 9.0 if spans else 9.0, inside))
        inside = _loop_label(wire).width / 2 + _CLEAR
    return spans


def _loop_label(wire: Wire) -> TextBlock:
    return text_block(wire.label, size=EDGE_FONT, limit=_LABEL_LIMIT)


def _add_loops(
    frame: Frame, loops: Sequence[Wire], spans: Sequence[float], top: Callable[[float], float]
) -> None:
    if not loops:
        return
    labels = [_loop_label(wire) for wire in loops]
    half = max(label.width for label in labels) / 2
    before, y, width, _ = frame.body
    after = frame.width - before - width
    _shift_right(frame, max(0.0, half - width / 2 - before))
    frame.width += max(0.0, half - width / 2 - after)
    x = frame.body[0]
    centre = x + width / 2
    height = y - 4.0
    drawn = []
    for wire, span, label in zip(loops, spans, labels, strict=True):
        height -= 14.0
        right, left = (centre + span, top(span)), (centre - span, top(span))
        drawn.append(
            Loop(wire, (right, (right[0], height), (left[0], height), left), label),
        )
        height -= label.height + LIFT
    frame.loops = tuple(drawn)
    frame.above = max(frame.above, -height)


def _shift_right(frame: Frame, by: float) -> None:
    """Make room at the left of the body."""
    x, y, width, height = frame.body
    frame.width += by
    frame.body = (x + by, y, width, height)
    frame.depart = {net: (px + by, py) for net, (px, py) in frame.depart.items()}
    for wire, points in frame.arrive.items():
        first, *rest = points
        moved = tuple((px + by, py) for px, py in rest)
        kept = first if first[0] == 0.0 and rest else (first[0] + by, first[1])
        frame.arrive[wire] = (kept, *moved)


def _wire_height(wire: Wire, plan: Plan) -> float:
    label = plan.wire_label.get(wire)
    return label.height if label else 0.0


def _net_height(net: Net, plan: Plan) -> float:
    label = plan.net_label.get(net)
    return label.height if label else 0.0


def _room_above(wire: Wire, plan: Plan) -> float:
    """Return the height of the labels on a wire, at both ends if these are next to one another.

    Ports with the same labels are then equally far apart on both sides, and the wires straight.
    """
    height = _wire_height(wire, plan)
    if wire in plan.rank and len(plan.channels(wire)) == 1:
        height = max(height, _net_height(wire.net, plan))
    return height


def _room_above_net(net: Net, plan: Plan) -> float:
    heights = [_room_above(wire, plan) for wire in plan.rank if wire.net == net]
    return max([_net_height(net, plan), *heights])


def _main_wire(wires: Sequence[Wire], plan: Plan) -> int | None:
    ranks = [(plan.rank[wire], i) for i, wire in enumerate(wires) if wire in plan.rank]
    return min(ranks)[1] if ranks else None


def _main_net(nets: Sequence[Net], plan: Plan) -> int | None:
    best = plan.net_rank()
    ranks = [(best[net], i) for i, net in enumerate(nets) if net in best]
    return min(ranks)[1] if ranks else None
