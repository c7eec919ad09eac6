"""The figure of a replay: what was commanded in the log, and what would be."""

from typing import Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from chamfer.analysis.drawing.figure_kit import BESIDE, shade, state_visits, time_axes
from chamfer.analysis.drawing.figure_style import PUBLISHED, Style, dress, legend, new_figure
from chamfer.analysis.replay.replay import Output, Replay

_MOST: Final = 6  # outputs that are drawn, those that differ before others
_COLOURS: Final = ("#1b4f9c", "#e07b00", "#2e7d32", "#7a0060", "#00838f", "#6d4c41")
_DIFFERS: Final[Style] = {"color": "#d32f2f", "alpha": 0.25, "linewidth": 0}
_LOGGED: Final[Style] = {"linewidth": 3.6, "alpha": 0.35, "drawstyle": "steps-post"}
_REPLAYED: Final[Style] = {"linewidth": 1.1, "drawstyle": "steps-post"}
_A_STATE: Final = 0.14  # inches of height


def replay_figure(found: Replay) -> Figure:
    """Draw states and commands over time, in the log and replayed; what is constant is left out.

    Behind them are the visits to the replayed states, and where an output differs.
    """
    state, times, differs = found.state, found.times, found.differs.any()
    elements = {one.name: _moving(one) for one in found.outputs if one is not state}
    moving = [one for one in found.outputs if elements.get(one.name)]
    moving.sort(key=lambda one: not one.differs.any())
    drawn, heights, visits = moving[:_MOST], [1.0] * len(moving[:_MOST]), []
    if state is not None or not drawn:
        drawn.insert(0, state or found.outputs[0])
        heights.insert(0, 1.0)
    if state is not None:
        indices = np.unique(np.concatenate([state.replayed, state.logged]))
        visited = [int(one) for one in indices if 0 <= one < len(found.states)]
        heights[0] = max(1.0, _A_STATE * len(visited))
        visits = state_visits(times, state.replayed[:, 0], found.states)
    figure = new_figure(11.0, 1.2 + 1.4 * sum(heights))
    for axes, one in zip(time_axes(figure, times, heights, visits=visits), drawn, strict=True):
        shade(axes, times, one.differs.any(axis=1), "", _DIFFERS)
        if differs:
            axes.axvline(times[np.argmax(found.differs)], **PUBLISHED)
        shown = elements.get(one.name) or [0]
        for n, i in enumerate(shown):
            for values, style in ((one.logged[:, i], _LOGGED), (one.replayed[:, i], _REPLAYED)):
                known = np.isfinite(values)
                rows = np.searchsorted(visited, values) if one is state else values
                label = f"[{i}]" if style is _REPLAYED else None
                look = {"color": _COLOURS[n % len(_COLOURS)], "label": label, **style}
                axes.plot(times, np.where(known, rows, np.nan), **look)
        unit = ", ".join(dict.fromkeys(one.units[i] for i in shown))
        last = one is drawn[-1]
        dress(axes, title=one.name.partition(".")[2], x="time / s" if last else "", y=unit)
        if one is state:
            axes.set_yticks(range(len(visited)), [found.states[i] for i in visited], fontsize=7)
        elif one.replayed.shape[1] > 1:
            legend(axes, ncols=2 + len(shown) // 12, **BESIDE)
    left = len(found.outputs) - len(drawn)
    figure.suptitle(
        f"{found.controller}{f'; {left} more, not drawn' if left else ''}", fontsize=10
    )
    key = [
        *([Line2D([], [], label="log", **_LOGGED)] if found.compared else []),
        Line2D([], [], label="replayed", **_REPLAYED),
        *([Line2D([], [], label="first difference", **PUBLISHED)] if differs else []),
        *([Patch(label="differs", **_DIFFERS)] if differs else []),
    ]
    below: Style = {"loc": "outside lower center", "fontsize": 8, "edgecolor": "none"}
    figure.legend(handles=key, ncols=len(key), **below)
    return figure


def _moving(one: Output) -> list[int]:
    """Return the elements that are not constant, or differ from the log."""
    values = np.nan_to_num(one.replayed)
    moves = (values != values[0]).any(axis=0) | one.differs.any(axis=0)
    return [int(i) for i in np.flatnonzero(moves)]
