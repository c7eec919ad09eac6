"""The states of a chart that a run visited, and the transitions that it took."""

import textwrap
from collections import Counter
from collections.abc import Mapping
from itertools import pairwise
from typing import Any, Final

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyBboxPatch
from numpy.typing import NDArray

from chamfer.analysis.drawing.figure_style import FSM, Style, new_figure
from chamfer.systems.statechart.chart import Chart

AnyChart = Chart[Any, Any]
Table = Mapping[str, NDArray[Any]]  # columns of equal length by name

_COLUMNS: Final = 4
_LEFT, _TOP = 0.4, 0.62  # in, of the first box
_BOX: Final = (1.2, 0.36)  # in
_PITCH: Final = (1.95, 1.0)  # in
_WIDTH: Final = 8.0  # in
_LINE: Final = 0.16  # in, of text
_MOST_LINES: Final = 8  # of other transitions
_FILL: Final = {"": "#fde3c3", "done": "#cdeacb", "failed": "#f6c4c4"}  # by outcome
_WAY: Final[Style] = {"color": FSM["color"], "linewidth": 1.6}


def plot_chart_path(chart: AnyChart, path: Table, *, result: str) -> Figure:
    """Draw the states that a run visited, in the order of their first visits.

    An arrow is a transition that the run took from a state to the next one of the picture, with
    its label and how often. The other transitions that it took are listed. Transitions that it
    did not take are left out.

    Args:
        chart: The chart that ran.
        path: Steps of the run in order, columns ``time``, s, ``source``, ``target`` and ``label``,
            that of the transition.
        result: How it ended, in a few words.
    """
    steps = list(zip(map(str, path["source"]), map(str, path["target"]), strict=True))
    begun = [(chart.initial, 0.0), *zip((to for _, to in steps), path["time"], strict=True)]
    first = dict(reversed(begun))
    order = list(dict.fromkeys(name for name, _ in begun))
    visits = Counter(name for name, _ in begun)
    taken: dict[tuple[str, str], Counter[str]] = {}
    for step, label in zip(steps, map(str, path["label"]), strict=True):
        taken.setdefault(step, Counter())[label.partition(",")[0]] += 1
    drawn = [pair for pair in pairwise(order) if pair in taken]
    others = [
        f"{source} to {to} ({_often(labels)})"
        for (source, to), labels in taken.items()
        if (source, to) not in drawn
    ]
    text = textwrap.wrap(f"Also taken: {'; '.join(others)}", 118) if others else []
    if len(text) > _MOST_LINES:
        text = [*text[: _MOST_LINES - 1], "and others"]
    rows = -(-len(order) // _COLUMNS)
    below = _TOP + rows * _PITCH[1] - 0.1
    height = below + _LINE * (len(text) + 2)
    caption = (
        f"Path of one run through the chart: {result}. States are in the order of their first "
        "visits; untaken transitions are hidden."
    )
    figure = new_figure(_WIDTH, height, caption=caption)
    figure.set_layout_engine(None)
    axes = figure.add_axes((0, 0, 1, 1))
    axes.set(xlim=(0, _WIDTH), ylim=(height, 0))
    axes.set_axis_off()
    axes.text(0.2, 0.26, f"{chart.name}: {result}", fontsize=10, fontweight="bold")
    _arrow(axes, [(_LEFT - 0.25, _TOP + _BOX[1] / 2), (_LEFT, _TOP + _BOX[1] / 2)])
    outcomes = {state.name: state.outcome or "" for state in chart.states}
    for i, name in enumerate(order):
        said = f"{first[name]:.2f} s" + (f", {visits[name]} visits" if visits[name] > 1 else "")
        _state(axes, *_place(i), name, said, _FILL[outcomes[name]])
    for i, pair in enumerate(pairwise(order)):
        if pair in taken:
            _way(axes, i, _often(taken[pair]))
    for i, line in enumerate([*text, "Untaken transitions are hidden."]):
        colour = "#6b7280" if i == len(text) else "black"
        axes.text(0.2, below + _LINE * (i + 1), line, fontsize=8, color=colour)
    return figure


def _often(labels: Mapping[str, int]) -> str:
    each = (
        f"{label} \N{MULTIPLICATION SIGN}{n}" if n > 1 else label for label, n in labels.items()
    )
    return "; ".join(each)


def _place(i: int) -> tuple[float, float]:
    row, column = divmod(i, _COLUMNS)
    return _LEFT + column * _PITCH[0], _TOP + row * _PITCH[1]


def _state(axes: Axes, x: float, y: float, name: str, said: str, fill: str) -> None:
    width, height = _BOX
    shape: Style = {"boxstyle": "round,pad=0,rounding_size=0.1", "linewidth": 1.0, "zorder": 3}
    axes.add_patch(FancyBboxPatch((x, y), width, height, fc=fill, ec="#1f2937", **shape))
    middle: Style = {"ha": "center", "va": "center", "fontsize": 8.5, "zorder": 4}
    axes.text(x + width / 2, y + height / 2, textwrap.fill(name, 17), linespacing=1.0, **middle)
    axes.text(
        x + width / 2, y + height + 0.1, said, **{**middle, "fontsize": 8, "color": "#374151"}
    )


def _way(axes: Axes, i: int, label: str) -> None:
    """Draw the transition from a state to the next one, which may be in the next row."""
    (x, y), (to_x, to_y) = _place(i), _place(i + 1)
    middle, beside = y + _BOX[1] / 2, x + _BOX[0]
    text: Style = {"fontsize": 8, "ha": "center", "va": "bottom", "linespacing": 1.0}
    if to_y == y:
        _arrow(axes, [(beside, middle), (to_x, middle)])
        axes.text((beside + to_x) / 2, middle - 0.04, textwrap.fill(label, 12), **text)
        return
    turn, down, left = beside + 0.2, to_y - 0.2, to_x - 0.2
    goal = to_y + _BOX[1] / 2
    _arrow(
        axes,
        [(beside, middle), (turn, middle), (turn, down), (left, down), (left, goal), (to_x, goal)],
    )
    axes.text(_WIDTH / 2, down - 0.04, label, **text)


def _arrow(axes: Axes, points: list[tuple[float, float]]) -> None:
    axes.plot(*zip(*points, strict=True), **_WAY)
    head: Style = {"arrowstyle": "-|>", "shrinkA": 0, "shrinkB": 0, **_WAY}
    axes.annotate("", xy=points[-1], xytext=points[-2], arrowprops=head)
