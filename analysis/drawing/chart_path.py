"""A state chart with the path that a run took through it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch
from numpy.typing import NDArray

from chamfer.analysis.drawing.chart_graph import ANY_STATE, START, chart_graph, state_id
from chamfer.analysis.drawing.figure_style import FSM
from chamfer.analysis.drawing.graph import Edge, Graph, Node
from chamfer.analysis.drawing.layout import GraphLayout, NodeBox, Route, lay_out
from chamfer.systems.statechart.chart import ANY, Chart, Transition

AnyChart = Chart[Any, Any]
Table = Mapping[str, NDArray[Any]]  # columns of equal length by name
Array = NDArray[np.float64]

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
_FEWEST: Final = 4  # nodes in a row
_ONWARD: Final = "onward"  # a stub for what another row goes on with
_LEFT_OUT: Final = "what leads to failure alone is drawn only where it was taken"


@dataclass(frozen=True, kw_only=True)
class Row:
    """A part of a chart in which every step of a run is."""

    layout: GraphLayout
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
        most: Likewise.
    """
    drawn = path_rows(chart, path, rows=rows, seldom=seldom, most=most)
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
        ink.row(row, top, visited)
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
    most: int | None = None,
) -> list[Row]:
    """Return the chart laid out in rows; numbers of steps stand below the names of transitions.

    Args:
        chart: Which ran.
        path: As for :func:`plot_chart_path`.
        rows: The states in each, ANY among them where the chart has transitions from it; none:
            two rows where a single transition leads on to a half, else one.
        seldom: States whose transitions are drawn only where they were taken.
        most: Numbers at a line, of more the last one after the first ones; None: all.
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
        label = transition.label.partition(",")[0]
        kept.append(replace(edge, label=f"{label}\n{_listed(found, most)}" if found else label))
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
    best: tuple[int, set[str]] | None = None
    for edge in graph.edges[1:]:
        before = _connected(graph, START, without=edge)
        least = min(len(before), len(graph.nodes) - len(before))
        if edge.target not in before and least >= _FEWEST and (best is None or least > best[0]):
            best = least, before
    if best is None:
        return [graph]
    after = {node.id for node in graph.nodes} - best[1]
    return groups(graph, [best[1] - {START}, after])


def _connected(graph: Graph, start: str, *, without: Edge) -> set[str]:
    """Return the nodes that edges in either direction connect to a node."""
    found, more = set[str](), {start}
    while more:
        found |= more
        ends = [{edge.source, edge.target} for edge in graph.edges if edge is not without]
        more = set[str]().union(*(pair for pair in ends if pair & found)) - found
    return found


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

    def row(self, row: Row, top: float, visited: set[str]) -> None:
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
                x, y = label.x + block.width / 2, top + label.y + (i + 0.5) * block.line_height
                if line.startswith("["):
                    self.number(
                        x, y - 1, line.strip("[]").replace(",", ", ").replace("...", " ... ")
                    )
                else:
                    self.text(x, y, line, block.size, zorder=4)

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

    def _box(self, box: NodeBox, top: float, *, visited: bool) -> None:
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


def _listed(numbers: Sequence[int], most: int | None) -> str:
    """Return the numbers of steps as one word in brackets; of too many the first and the last."""
    if most is None or len(numbers) <= most:
        return f"[{','.join(map(str, numbers))}]"
    return f"[{','.join(map(str, numbers[: most - 1]))}...{numbers[-1]}]"


def _towards(start: Array, goal: Array) -> Array:
    """Return the unit vector from one point to another, 0 if they are the same."""
    way = goal - start
    return way / max(float(np.abs(way).sum()), 1e-9)
