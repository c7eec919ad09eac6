"""A state chart with the path that a run took through it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import pairwise, product
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch
from numpy.typing import NDArray

from chamfer.analysis.drawing.chart_graph import ANY_STATE, START, chart_graph, state_id
from chamfer.analysis.drawing.chart_rows import groups, halves
from chamfer.analysis.drawing.figure_style import FSM
from chamfer.analysis.drawing.frames import Point
from chamfer.analysis.drawing.graph import Graph
from chamfer.analysis.drawing.layout import Box, Layout, Route, lay_out
from chamfer.analysis.drawing.text import text_width
from chamfer.systems.statechart.chart import ANY, Chart, Transition

AnyChart = Chart[Any, Any]
Table = Mapping[str, NDArray[Any]]  # columns of equal length by name
Array = NDArray[np.float64]
Rectangle = tuple[float, float, float, float]  # left, top, right, bottom, px

_WIDTH: Final = 13.0  # in, of the figure
_LEAST: Final = 1100.0  # px, so that a small chart is not blown up
_GAP: Final = 10.0  # px between the rows of a chart
_LIST: Final = (4, 20.0)  # columns, and px of a line, of the list of steps
_INK: Final = "#1f2937"
_FAINT: Final = "#a9b0bb"
_TAKEN: Final = str(FSM["color"])
_FILL: Final = {"state": "#fde3c3", "final": "#cdeacb", "failed": "#f6c4c4"}  # visited
_EMPTY: Final = "#f6f7f8"
_FONT: Final = 0.86  # of a font size that the layout assumes: Matplotlib's font is wider
_NUMBER: Final = 11.0  # px
_HEAD: Final = 11.0  # px, length of an arrow's head
_LEFT_OUT: Final = "what leads to failure alone is drawn only where it was taken"


@dataclass(frozen=True, kw_only=True)
class Row:
    """A part of a chart in which every step of a run is."""

    layout: Layout
    steps: tuple[tuple[int, ...], ...]  # numbers of the steps along each route, 1 the first
    taken: tuple[bool, ...]  # whether a route was taken


def plot_chart_path(
    chart: AnyChart,
    path: Table,
    *,
    result: str,
    rows: Sequence[Collection[str]] = (),
    seldom: Collection[str] = (),
    most: int | None = None,
) -> Figure:
    """Draw a chart; what a run took of it is coloured, numbered and listed.

    What leads to a state of failure is drawn only where it was taken.

    Args:
        chart: Which ran.
        path: Steps of the run in order, columns ``time``, s, ``source``, ``target``,
            ``outcome`` and ``label``, that of the transition.
        result: How it ended, in a few words.
        rows: See :func:`path_rows`.
        seldom: Likewise.
        most: Numbers at a line, see :func:`number_places`.
    """
    drawn = path_rows(chart, path, rows=rows, seldom=seldom)
    width = max(_LEAST, *(row.layout.width for row in drawn))
    count = len(path["time"])
    lines = -(-count // _LIST[0])
    tops = [40.0]
    for row in drawn:
        tops.append(tops[-1] + row.layout.height + _GAP)
    height = tops[-1] + (lines + 1) * _LIST[1]
    figure = Figure(figsize=(_WIDTH, _WIDTH * height / width))
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, width), ylim=(height, 0))
    axes.set_axis_off()
    ink = _Ink(axes, 72 * _WIDTH / width)
    ink.text(20, 24, f"{chart.name}: {result}", 15, ha="left", weight="bold")
    ink.text(width - 20, 24, _LEFT_OUT, 11, ha="right", color="#6b7280")
    visited = {START, state_id(chart.initial)}
    visited |= {state_id(str(name)) for name in path["target"]}
    for row, top in zip(drawn, tops, strict=False):
        ink.row(row, top, visited, most)
    for i in range(count):
        column, line = divmod(i, lines)
        x, y = 20 + column * (width - 40) / _LIST[0], tops[-1] + (line + 0.5) * _LIST[1]
        ink.number(x + 10, y, str(i + 1))
        step = f"{path['source'][i]}: {path['outcome'][i]}"
        ink.text(x + 30, y, f"{path['time'][i]:.2f} s  {step}", 12, ha="left")
    return figure


def path_rows(
    chart: AnyChart,
    path: Table,
    *,
    rows: Sequence[Collection[str]] = (),
    seldom: Collection[str] = (),
) -> list[Row]:
    """Return the chart laid out in rows.

    Args:
        chart: Which ran.
        path: As for :func:`plot_chart_path`.
        rows: The states in each, ANY among them where the chart has transitions from it; none:
            two rows where a single transition leads on to a half, else one.
        seldom: States whose transitions are drawn only where they were taken.
    """
    steps: dict[tuple[str, str, str], list[int]] = {}
    for i, key in enumerate(zip(path["source"], path["target"], path["label"], strict=True)):
        steps.setdefault((str(key[0]), str(key[1]), str(key[2])), []).append(i + 1)
    full = chart_graph(chart, every=True)
    numbers: dict[str, tuple[int, ...]] = {}  # of the steps by the edge's port
    kept = [full.edges[0]]
    rare = _failing(chart) | set(seldom)
    for transition, edge in zip(chart.transitions, full.edges[1:], strict=False):
        found = _of(transition, steps)
        if not found and not rare.isdisjoint((transition.source, transition.target)):
            continue
        numbers[edge.source_port] = found
        kept.append(replace(edge, label=transition.label.partition(",")[0]))
    for edge in full.edges[1 + len(chart.transitions) :]:
        numbers[edge.source_port] = ()
        kept.append(edge)
    names = {edge.source for edge in kept} | {edge.target for edge in kept}
    states = {state_id(state.name): state.name for state in chart.states}
    nodes = [
        replace(node, label=states.get(node.id, node.label))
        for node in full.nodes
        if node.id in names
    ]
    graph = Graph(title="", nodes=tuple(nodes), edges=tuple(kept))
    ways = {(state_id(source), state_id(target)) for source, target, _ in steps}
    ways.add((START, state_id(chart.initial)))
    ids = [{_node_id(name) for name in row} for row in rows]
    parts = groups(graph, ids) if ids else halves(graph)
    return [_row(part, numbers, ways) for part in parts]


def _node_id(state: str) -> str:
    return ANY_STATE if state == ANY else state_id(state)


def _of(
    transition: Transition[Any, Any], steps: Mapping[tuple[str, str, str], list[int]]
) -> tuple[int, ...]:
    """Return the numbers of the steps in which a transition was taken."""
    return tuple(
        sorted(
            number
            for (source, target, label), numbers in steps.items()
            for number in numbers
            if (target, label) == (transition.target, transition.label)
            and transition.source in (source, ANY)
        )
    )


def _failing(chart: AnyChart) -> set[str]:
    """Return the states from which a chart can only fail."""
    failing = {state.name for state in chart.states if state.outcome == "failed"}
    while True:
        ways: dict[str, set[str]] = {}
        for one in chart.transitions:
            ways.setdefault(one.source, set()).add(one.target)
        more = {source for source, targets in ways.items() if targets <= failing} - {ANY}
        if more <= failing:
            return failing
        failing |= more


def _row(graph: Graph, numbers: dict[str, tuple[int, ...]], ways: set[tuple[str, str]]) -> Row:
    """Return a part of the chart, with ways that were taken from node to node."""
    inside = {node.id for node in graph.nodes} - {START}
    entered = {target for source, target in ways if source not in inside}
    layout = lay_out(graph)
    ports = [route.edge.source_port for route in layout.routes]
    first = [
        route.edge.source == START and route.edge.target in entered for route in layout.routes
    ]
    steps = tuple(numbers.get(port, ()) for port in ports)
    # The arrow into the second row has its number where it leaves the first one.
    taken = tuple(bool(found) or begins for found, begins in zip(steps, first, strict=True))
    return Row(layout=layout, steps=steps, taken=taken)


class _Ink:
    """Draws in px, y down."""

    def __init__(self, axes: Axes, points: float) -> None:
        self._axes = axes
        self._points = points  # of a px

    def text(self, x: float, y: float, text: str, size: float, **options: Any) -> None:
        style = {"ha": "center", "va": "center", "color": _INK, **options}
        self._axes.text(x, y, text, fontsize=_FONT * size * self._points, **style)

    def number(self, x: float, y: float, text: str) -> None:
        box = {"boxstyle": "round,pad=0.25", "facecolor": _TAKEN, "edgecolor": "none"}
        self.text(x, y, text, _NUMBER, color="white", weight="bold", bbox=box, zorder=6)

    def row(self, row: Row, top: float, visited: set[str], most: int | None) -> None:
        layout = row.layout
        for route, taken in sorted(
            zip(layout.routes, row.taken, strict=True), key=lambda one: one[1]
        ):
            self._route(route, top, taken=taken)
        for box in layout.boxes:
            self._box(box, top, visited=box.node.id in visited)
        for label in layout.labels:
            block = label.text
            for i, line in enumerate(block.lines):
                y = label.y + (i + 0.5) * block.line_height
                self.text(label.x + block.width / 2, top + y, line, block.size, zorder=4)
        for (x, y), numbers in number_places(row, most):
            self.number(x, top + y, numbers)

    def _route(self, route: Route, top: float, *, taken: bool) -> None:
        points = np.array(route.points) + np.array([0.0, top])
        colour, order = (_TAKEN, 3) if taken else (_FAINT, 2)
        width = 2.4 if taken else 1.2
        self._axes.plot(*points.T, linewidth=width * self._points, color=colour, zorder=order)
        self._axes.annotate(
            "",
            xy=points[-1],
            xytext=points[-1] + 0.9 * _towards(points[-1], points[-2]),
            arrowprops={
                "arrowstyle": "-|>",
                "mutation_scale": (14 if taken else 11) * self._points,
                "shrinkA": 0,
                "shrinkB": 0,
                "linewidth": 0,
                "color": colour,
            },
            zorder=order,
        )

    def _box(self, box: Box, top: float, *, visited: bool) -> None:
        kind = box.node.kind
        edge = _INK if visited else _FAINT
        if box.shape in ("circle", "dot"):
            radius = box.width / 2
            place = box.x + radius, top + box.y + radius
            self._axes.add_patch(Circle(place, radius, facecolor=_TAKEN, edgecolor="none"))
            return
        fill = _FILL.get(kind, "white") if visited else _EMPTY
        inset = 3.0
        for shrink in (0.0, inset) if kind in ("final", "failed") else (0.0,):
            self._axes.add_patch(
                FancyBboxPatch(
                    (box.x + shrink, top + box.y + shrink),
                    box.width - 2 * shrink,
                    box.height - 2 * shrink,
                    boxstyle=f"round,pad=0,rounding_size={10 - shrink}",
                    facecolor=fill if not shrink else "none",
                    edgecolor=edge,
                    linewidth=1.3 * self._points,
                    linestyle="--" if kind == "any" else "-",
                    zorder=3.5,
                )
            )
        if box.text is not None:
            for i, line in enumerate(box.text.lines):
                middle = box.y + (box.height - box.text.height) / 2
                y = middle + (i + 0.5) * box.text.line_height
                ink = _INK if visited or kind == "any" else "#6b7280"
                x = box.x + box.width / 2
                self.text(x, top + y, line, box.text.size, zorder=5, color=ink)


def number_places(row: Row, most: int | None = None) -> list[tuple[Point, str]]:
    """Return where the numbers of the steps stand, px, and what they read.

    They stand on or beside their line, where they hide the least.

    Args:
        row: Whose.
        most: Numbers at a line, of more the last one after the first ones; None: all.
    """
    layout = row.layout
    kept: list[Rectangle] = [
        (one.x, one.y, one.x + one.text.width, one.y + one.text.height) for one in layout.labels
    ]
    kept += [(box.x, box.y, box.x + box.width, box.y + box.height) for box in layout.boxes]
    ends = [one.points[-1] for one in layout.routes]
    kept += [(x - _HEAD, y - _HEAD, x + _HEAD, y + _HEAD) for x, y in ends]
    lines = [[_around(a, b) for a, b in pairwise(one.points)] for one in layout.routes]
    placed = []
    for k, (route, numbers) in enumerate(zip(layout.routes, row.steps, strict=True)):
        if not numbers:
            continue
        text = _listed(numbers, most)
        half = np.array([text_width(text, _NUMBER) / 2 + 4, 0.5 * _NUMBER + 3])
        others = [piece for i, pieces in enumerate(lines) if i != k for piece in pieces]
        ways, places = _candidates(route.points)
        own = np.hstack([places - half, places + half])
        cost = _overlaps(own, np.array([*kept, *others])) + 0.05 * ways
        best = int(np.argmin(cost))
        left, top, right, bottom = own[best].tolist()
        kept.append((left, top, right, bottom))
        placed.append(((float(places[best, 0]), float(places[best, 1])), text))
    return placed


def _listed(numbers: Sequence[int], most: int | None) -> str:
    if most is None or len(numbers) <= most:
        return ", ".join(map(str, numbers))
    return f"{', '.join(map(str, numbers[: most - 1]))} ... {numbers[-1]}"


def _around(a: Point, b: Point) -> Rectangle:
    """Return the room that a straight line takes."""
    (left, right), (top, bottom) = (sorted(ends) for ends in zip(a, b, strict=True))
    return left - 1, top - 1, right + 1, bottom + 1


def _candidates(points: Sequence[Point]) -> tuple[Array, Array]:
    """Return places along a line and beside it, shape (n, 2), and what speaks against each, (n,).

    That is its distance from the begin, px, and more for one beside the line.
    """
    ways, places = [0.0], [points[0]]
    way = 0.0
    for a, b in pairwise(points):
        start, along = np.array(a), _towards(np.array(a), np.array(b))
        length = abs(b[0] - a[0]) + abs(b[1] - a[1])
        across = np.abs(along[::-1])
        for share, beside in product(np.arange(4.0, length - 3.0, 4.0), (0.0, 9.0, -9.0)):
            x, y = start + share * along + beside * across
            ways.append(way + share + 10 * abs(beside))
            places.append((float(x), float(y)))
        way += length
    return np.array(ways), np.array(places)


def _towards(start: Array, goal: Array) -> Array:
    """Return the unit vector from one point to another, 0 if they are the same."""
    way = goal - start
    return way / max(float(np.abs(way).sum()), 1e-9)


def _overlaps(own: Array, others: Array) -> Array:
    """Return the area that each rectangle, shape (n, 4), hides of others, (m, 4), px^2, (n,)."""
    ends = np.minimum(own[:, np.newaxis, 2:], others[np.newaxis, :, 2:])
    begins = np.maximum(own[:, np.newaxis, :2], others[np.newaxis, :, :2])
    areas = np.clip(ends - begins, 0.0, None).prod(axis=2)
    hidden: Array = areas.sum(axis=1)
    return hidden
