"""A state chart with the path that a run took through it."""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, FancyBboxPatch
from numpy.typing import NDArray

from chamfer.analysis.drawing.chart_graph import ANY_STATE, START, chart_graph, state_id
from chamfer.analysis.drawing.figure_style import FSM
from chamfer.analysis.drawing.graph import Edge, Graph, Node
from chamfer.analysis.drawing.layering import connected
from chamfer.analysis.drawing.layout import GraphLayout, NodeBox, Route, lay_out
from chamfer.systems.statechart.chart import ANY, Chart

AnyChart = Chart[Any, Any]
Table = Mapping[str, NDArray[Any]]  # columns of equal length by name

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
_LEFT_OUT: Final = "untaken failure branches are hidden"


@dataclass(frozen=True, kw_only=True)
class Row:
    """A part of a chart in which every step of a run is."""

    layout: GraphLayout
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
        rows: The states in each, ANY among them where the chart has transitions from it; none:
            two rows where a single transition leads on to a half, else one.
        seldom: States whose transitions are drawn only where they were taken.
        most: Numbers at a line, of more the last one after the first ones; None: all.
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
    visited = {START, *map(state_id, (chart.initial, *map(str, path["target"])))}
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
    """Return the chart laid out in rows; numbers of steps stand below the names of transitions."""
    steps = list(zip(path["source"], path["target"], path["label"], strict=True))
    full = chart_graph(chart, every=True)
    first, *edges = full.edges
    kept = [first]
    taken: set[str] = set()  # the ports of edges
    rare = _failing(chart) | set(seldom)
    for i, edge in enumerate(edges):
        if i < len(chart.transitions):
            one = chart.transitions[i]
            found = [
                number
                for number, (source, *way) in enumerate(steps, 1)
                if way == [one.target, one.label] and one.source in (source, ANY)
            ]
            if not found and not rare.isdisjoint((one.source, one.target)):
                continue
            label = one.label.partition(",")[0]
            if found:
                taken.add(edge.source_port)
                label += f"\n{_listed(found, most)}"
            edge = replace(edge, label=label)
        kept.append(edge)
    names = {end for edge in kept for end in (edge.source, edge.target)}
    states = {state_id(state.name): state.name for state in chart.states}
    nodes = [
        replace(one, label=states.get(one.id, one.label)) for one in full.nodes if one.id in names
    ]
    graph = Graph(title="", nodes=tuple(nodes), edges=tuple(kept))
    ids = [{ANY_STATE if name == ANY else state_id(name) for name in row} for row in rows]
    drawn = []
    for part in _groups(graph, ids) if ids else _halves(graph):
        layout = lay_out(part)
        inside = {node.id for node in part.nodes}
        entered = {first.target}
        entered |= {state_id(to) for since, to, _ in steps if state_id(since) not in inside}
        # The arrow into the second row has its number where it leaves the first one.
        ways = [route.edge for route in layout.routes]
        came = (way.source == START and way.target in entered for way in ways)
        done = (way.source_port in taken for way in ways)
        drawn.append(Row(layout=layout, taken=tuple(map(any, zip(came, done, strict=True)))))
    return drawn


def _failing(chart: AnyChart) -> set[str]:
    """Return the states from which a chart can only fail."""
    failing = {state.name for state in chart.states if state.outcome == "failed"}
    ways: dict[str, set[str]] = {}
    for one in chart.transitions:
        ways.setdefault(one.source, set()).add(one.target)
    while True:
        more = {source for source, targets in ways.items() if targets <= failing} - {ANY}
        if more <= failing:
            return failing
        failing |= more


def _groups(graph: Graph, rows: Sequence[Collection[str]]) -> list[Graph]:
    """Cut a graph into rows of ids, in one of which is every node but the start."""
    labels = {node.id: node.label for node in graph.nodes}
    inward = [{edge.target for edge in graph.edges if edge.source not in row} for row in rows]
    found = []
    for row, entered in zip(rows, inward, strict=True):
        inside = [node for node in graph.nodes if node.id in row]
        entries = [node.id for node in inside if node.id in entered]
        leaving = [edge for edge in graph.edges if edge.source in row]
        edges = [
            edge if edge.target in row else replace(edge, target=f"{_ONWARD} {edge.target}")
            for edge in leaving
        ]
        stubs = dict.fromkeys(edge.target for edge in leaving if edge.target not in row)
        nodes = [
            *graph.nodes[: bool(entries)],
            *inside,
            *(Node(id=f"{_ONWARD} {one}", label=labels[one], kind="any") for one in stubs),
        ]
        starts = [Edge(source=START, target=one) for one in entries]
        if inside:
            found.append(Graph(title="", nodes=tuple(nodes), edges=(*starts, *edges)))
    return found


def _halves(graph: Graph) -> list[Graph]:
    """Cut a graph at the edge without which it has two parts, the most even ones, if there is."""
    ids = [node.id for node in graph.nodes]
    best: list[set[str]] = []
    for edge in graph.edges[1:]:
        pairs = [(one.source, one.target) for one in graph.edges if one is not edge]
        part = connected(ids, pairs)
        before = {id_ for id_ in ids if part[id_] == part[START]}
        pair = [before, set(ids) - before]
        least = min(map(len, pair))
        if edge.target not in before and least >= max(_FEWEST, 1 + min(map(len, best), default=0)):
            best = pair
    return _groups(graph, [best[0] - {START}, best[1]]) if best else [graph]


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
        for route, taken in zip(row.layout.routes, row.taken, strict=True):
            self._route(route, top, taken=taken)
        for box in row.layout.boxes:
            self._box(box, top, visited=box.node.id in visited)
        for label in row.layout.labels:
            block = label.text
            for i, line in enumerate(block.lines):
                x, y = label.x + block.width / 2, top + label.y + (i + 0.5) * block.line_height
                if line.startswith("["):
                    numbers = line.strip("[]").replace(",", ", ").replace("...", " ... ")
                    self.number(x, y - 1, numbers)
                else:
                    self.text(x, y, line, block.size, zorder=4)

    def _route(self, route: Route, top: float, *, taken: bool) -> None:
        points = [(x, y + top) for x, y in route.points]
        colour, order = (_TAKEN, 3) if taken else (_FAINT, 2)
        width, head = (2.4, 14) if taken else (1.2, 11)
        self._axes.plot(
            *zip(*points, strict=True), linewidth=width * self._points, color=colour, zorder=order
        )
        arrow = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, "linewidth": 0, "color": colour}
        arrow["mutation_scale"] = head * self._points
        self._axes.annotate("", xy=points[-1], xytext=points[-2], arrowprops=arrow, zorder=order)

    def _box(self, box: NodeBox, top: float, *, visited: bool) -> None:
        kind = box.node.kind
        x, y = box.x + box.width / 2, top + box.y + box.height / 2
        if box.shape == "dot":
            self._axes.add_patch(Circle((x, y), box.width / 2, color=_TAKEN))
            return
        fill = _FILL.get(kind, "white") if visited else _EMPTY
        for shrink in (0.0, 3.0) if kind in ("final", "failed") else (0.0,):
            self._axes.add_patch(
                FancyBboxPatch(
                    (box.x + shrink, top + box.y + shrink),
                    box.width - 2 * shrink,
                    box.height - 2 * shrink,
                    boxstyle=f"round,pad=0,rounding_size={10 - shrink}",
                    facecolor=fill if not shrink else "none",
                    edgecolor=_INK if visited else _FAINT,
                    linewidth=1.3 * self._points,
                    linestyle="--" if kind == "any" else "-",
                    zorder=3.5,
                )
            )
        ink = _INK if visited or kind == "any" else "#6b7280"
        for i, line in enumerate(box.text.lines):
            height = y - box.text.height / 2 + (i + 0.5) * box.text.line_height
            self.text(x, height, line, box.text.size, zorder=5, color=ink)


def _listed(numbers: Sequence[int], most: int | None) -> str:
    """Return the numbers of steps as one word in brackets; of too many the first and the last."""
    if most is None or len(numbers) <= most:
        return f"[{','.join(map(str, numbers))}]"
    return f"[{','.join(map(str, numbers[: most - 1]))}...{numbers[-1]}]"
