"""Coordinates of one level: heights, rows of feedback, tracks in the channels, then widths."""

from collections import defaultdict
from collections.abc import Mapping
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Final

from chamfer.analysis.drawing.alignment import Gap, align
from chamfer.analysis.drawing.frames import BORDER_GAP, LIFT, Frame
from chamfer.analysis.drawing.plan import Key, Net, Plan, Wire
from chamfer.analysis.drawing.text import TextBlock
from chamfer.analysis.drawing.tracks import CLEARANCE, Piece, assign_tracks

TrackId = tuple[int, Net | Wire]  # channel, and the signal or (from a row to the left side) wire

_ITEM_GAP: Final = 24.0  # px between boxes of a column
_PORT_GAP: Final = 5.0  # px between open ends
_LINE_GAP: Final = BORDER_GAP  # px between a line and what is above or below it
_ROW_GAP: Final = 14.0
_TRACK: Final = 12.0
_LEAST_START: Final = 12.0  # of a line before its first bend
_LEAST_END: Final = 18.0  # of a line after its last bend: an arrow head
_LEAST_CHANNEL: Final = 38.0
_LABEL_ROOM: Final = 16.0  # beside a label
_STRAIGHT: Final = 0.02  # px, a step that is rounding only
_ATTEMPTS: Final = 8


@dataclass(frozen=True)
class _End:
    """Where a horizontal line of a channel ends: at an item, or in a row of feedback."""

    key: Key | None
    offset: float = 0.0
    row: int = 0


@dataclass(eq=False)
class Placement:
    """Coordinates in px; an item's y is that of its line, its x that of its left edge."""

    x: dict[Key, float] = field(default_factory=dict)
    y: dict[Key, float] = field(default_factory=dict)
    row_y: list[float] = field(default_factory=list)
    track_x: dict[TrackId, float] = field(default_factory=dict)
    start_zone: list[tuple[float, float]] = field(default_factory=list)  # free of verticals
    end_zone: list[tuple[float, float]] = field(default_factory=list)
    has_tracks: list[bool] = field(default_factory=list)
    width: float = 0.0
    height: float = 0.0


def place(plan: Plan, frames: Mapping[Key, Frame]) -> Placement:
    """Compute the coordinates of a planned level.

    Args:
        plan: Where things go.
        frames: The room that every item and every bend takes.

    Returns:
        The placement, with its upper left corner at (0, 0).
    """
    placement = Placement()
    ends = _channel_ends(plan, frames)
    extra: list[Gap] = []
    index = {key: i for i, key in enumerate(key for column in plan.columns for key in column)}
    for _ in range(_ATTEMPTS):
        heights = align(
            len(index), [*_separations(plan, frames, index), *extra], _ties(plan, frames, index)
        )
        top = min((heights[i] - frames[key].above for key, i in index.items()), default=0.0)
        placement.y = {key: round(heights[i] - top, 3) for key, i in index.items()}
        _place_rows(plan, frames, placement)
        tracks, clashes = _route(ends, placement)
        if not clashes:
            break
        extra += [
            Gap(index[right.key], index[left.key], right.offset - left.offset + CLEARANCE + 1)
            for right, left in clashes
            if right.key is not None and left.key is not None
        ]
    _place_columns(plan, frames, tracks, placement)
    return placement


def _separations(plan: Plan, frames: Mapping[Key, Frame], index: Mapping[Key, int]) -> list[Gap]:
    gaps = []
    for column in plan.columns:
        for upper, lower in pairwise(column):
            boxes = [key for key in (upper, lower) if key[0] in ("node", "cluster")]
            space = _ITEM_GAP if len(boxes) == 2 else _LINE_GAP * (1 + len(boxes))
            if all(plan.kinds.get(key) == "port" for key in (upper, lower)):
                space = _PORT_GAP
            distance = frames[upper].below + space + frames[lower].above
            gaps.append(Gap(index[upper], index[lower], distance))
    return gaps


def _ties(plan: Plan, frames: Mapping[Key, Frame], index: Mapping[Key, int]) -> list[Gap]:
    """Return the wish of every piece of wire to be straight, the main path first."""
    ranked: dict[tuple[int, int], tuple[int, int, float]] = {}
    for wire in plan.forward:
        for channel in plan.channels(wire):
            left = plan.station[wire.net, channel]
            start = frames[left].depart[wire.net][1] if left[0] != "bend" else 0.0
            if channel + 1 == plan.layer[wire.target]:
                right, end = wire.target, frames[wire.target].arrive[wire][0][1]
            else:
                right, end = plan.station[wire.net, channel + 1], 0.0
            # Of two pieces of equal rank, the one between two bends must not become a step.
            bends = (left[0] == "bend") + (right[0] == "bend")
            pair = (index[left], index[right])
            wish = (plan.rank[wire], -bends, start - end)
            ranked[pair] = min(ranked.get(pair, wish), wish)
    order = sorted(ranked, key=lambda pair: ranked[pair][:2])
    return [Gap(*pair, ranked[pair][2]) for pair in order]


def _channel_ends(
    plan: Plan, frames: Mapping[Key, Frame]
) -> dict[TrackId, tuple[list[_End], list[_End]]]:
    ends: defaultdict[TrackId, tuple[list[_End], list[_End]]] = defaultdict(lambda: ([], []))

    def leave(net: Net, source: Key) -> tuple[list[_End], list[_End]]:
        channel = plan.layer[source]
        entry = ends[channel, net]
        if not entry[0]:
            entry[0].append(_End(source, frames[source].depart[net][1]))
        return entry

    for wire in plan.forward:
        for channel in plan.channels(wire):
            left = plan.station[wire.net, channel]
            entry = ends[channel, wire.net] if left[0] == "bend" else leave(wire.net, left)
            if not entry[0]:
                entry[0].append(_End(left))
            if channel + 1 == plan.layer[wire.target]:
                end = _End(wire.target, frames[wire.target].arrive[wire][0][1])
            else:
                end = _End(plan.station[wire.net, channel + 1])
            if end not in entry[1]:
                entry[1].append(end)
    for path in plan.paths:
        net = (path.wires or path.arrivals)[0].net
        if net not in plan.bottom_out[path.source]:
            leave(net, path.source)[0].append(_End(None, row=path.row))
        for wire in path.arrivals:
            if wire not in plan.bottom_in[wire.target]:
                end = _End(wire.target, frames[wire.target].arrive[wire][0][1])
                ends[plan.layer[wire.target] - 1, wire] = ([], [_End(None, row=path.row), end])
    return dict(ends)


def _place_rows(plan: Plan, frames: Mapping[Key, Frame], placement: Placement) -> None:
    y = max((placement.y[key] + frames[key].below for key in placement.y), default=0.0)
    placement.row_y = []
    count = max((path.row for path in plan.paths), default=-1) + 1
    for row in range(count):
        stops = [frames[key] for path in plan.paths if path.row == row for key in path.stops]
        labels = [
            label.height + LIFT
            for (_, of_row), entries in plan.lane_label.items()
            if of_row == row
            for _, label in entries
        ]
        y += _ROW_GAP + max([0.0, *labels, *(frame.above for frame in stops)])
        placement.row_y.append(y)
        y += max([0.0, *(frame.below for frame in stops)])
    for path in plan.paths:
        for key in path.stops:
            placement.y[key] = placement.row_y[path.row]
    placement.height = y + (_LINE_GAP if count else 0.0)


def _route(
    ends: Mapping[TrackId, tuple[list[_End], list[_End]]], placement: Placement
) -> tuple[dict[TrackId, int], list[tuple[_End, _End]]]:
    def height(end: _End) -> float:
        return placement.row_y[end.row] if end.key is None else placement.y[end.key] + end.offset

    channels: defaultdict[int, list[Piece[TrackId]]] = defaultdict(list)
    for id_, (lefts, rights) in ends.items():
        piece = Piece[TrackId](id_, tuple(map(height, lefts)), tuple(map(height, rights)))
        if piece.high - piece.low > _STRAIGHT:
            channels[id_[0]].append(piece)
    tracks: dict[TrackId, int] = {}
    clashes = []
    for pieces in channels.values():
        assigned, pairs = assign_tracks(pieces)
        tracks.update(assigned)
        for left, right in pairs:
            clashes += [
                (a, b)
                for a in ends[left][1]
                for b in ends[right][0]
                if abs(height(a) - height(b)) < CLEARANCE
            ]
    return tracks, clashes


def _place_columns(
    plan: Plan, frames: Mapping[Key, Frame], tracks: Mapping[TrackId, int], placement: Placement
) -> None:
    count = len(plan.columns)
    starts, finishes = [0.0] * (count + 1), [0.0] * (count + 1)  # by channel + 1
    used = {id_[0] for id_ in tracks}
    for net, label in plan.net_label.items():
        source = next(key for key, nets in plan.right_out.items() if net in nets)
        starts[plan.layer[source] + 1] = max(
            starts[plan.layer[source] + 1], label.width + _LABEL_ROOM
        )
    for wire, label in plan.wire_label.items():
        channel = plan.layer[wire.target]
        finishes[channel] = max(finishes[channel], label.width + _LABEL_ROOM + _LEAST_END)
    for (channel, _), entries in plan.lane_label.items():
        room = lane_room([label for _, label in entries])
        starts[channel + 1] = max(starts[channel + 1], room)
    lines = {channel + 1 for wire in plan.forward for channel in plan.channels(wire)}
    x = 0.0
    for slot in range(count + 1):
        channel = slot - 1
        number = max((track + 1 for id_, track in tracks.items() if id_[0] == channel), default=0)
        start, finish = starts[slot], finishes[slot]
        if channel in used:
            start = max(start, _LEAST_START) if channel >= 0 else 0.0
            finish = max(finish, _LEAST_END) if slot < count else 6.0
            if slot in lines:
                start = max(start, _LEAST_CHANNEL - number * _TRACK - finish)
        elif slot in lines:
            start = max(start + 14, finish, _LEAST_CHANNEL)
            finish = 0.0
        elif 0 < slot < count:
            start = max(start, _LEAST_CHANNEL)
        for id_, track in tracks.items():
            if id_[0] == channel:
                placement.track_x[id_] = x + start + (track + 0.5) * _TRACK
        end = x + start + number * _TRACK + finish
        placement.start_zone.append((x, x + start))
        placement.end_zone.append((end - finish, end))
        placement.has_tracks.append(channel in used)
        x = end
        if slot < count:
            x = _place_column(plan, frames, slot, x, placement)
    placement.width = x


def _place_column(
    plan: Plan, frames: Mapping[Key, Frame], column: int, x: float, placement: Placement
) -> float:
    keys = [*plan.columns[column]]
    keys += [key for key, of_column in plan.stop_column.items() if of_column == column]
    width = max(frames[key].width for key in keys)
    for key in keys:
        spare = width - frames[key].width
        # What has one line stands near to where that goes, so that arrows are equally long.
        open_end = plan.kinds.get(key) in ("port", "initial")
        share = 0.5 if not open_end else 0.0 if plan.left_in[key] else 1.0
        placement.x[key] = x + share * spare
    return x + width


def lane_room(labels: list[TextBlock]) -> float:
    """Return the width that labels beside one another in a row of feedback need."""
    return sum(label.width + 10 for label in labels) + 6
