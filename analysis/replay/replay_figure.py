"""The figure of a replay: what was commanded in the log, and what would be."""

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

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
    state = found.state
    others = [one for one in found.outputs if one is not state]
    moving = sorted(filter(_moves, others), key=lambda one: not one.differs.any())[:_MOST]
    drawn = [one for one in others if any(one is other for other in moving)] or others[:1]
    visited: list[int] = []
    visits = []
    if state is not None:
        drawn, visited = [state, *drawn], _visited(found, state)
        visits = state_visits(found.times, state.replayed[:, 0], found.states)
    heights = [max(1.0, _A_STATE * len(visited)) if one is state else 1.0 for one in drawn]
    figure = new_figure(11.0, 1.2 + 1.4 * sum(heights))
    panels = time_axes(figure, found.times, heights, visits=visits)
    for axes, one in zip(panels, drawn, strict=True):
        shade(axes, found.times, one.differs.any(axis=1), "", _DIFFERS)
        if found.differs.any():
            axes.axvline(found.times[np.argmax(found.differs)], **PUBLISHED)
        _draw(axes, found.times, one, visited if one is state else None)
    if state is not None:
        panels[0].set_yticks(range(len(visited)), [found.states[i] for i in visited], fontsize=7)
    panels[-1].set_xlabel("time / s")
    left = len(found.outputs) - len(drawn)
    rest = f"; {left} more outputs, not drawn" if left else ""
    figure.suptitle(f"{found.controller}{rest}", fontsize=10)
    _key(figure, found)
    return figure


def _moves(one: Output) -> bool:
    values = np.nan_to_num(one.replayed)
    return bool((values != values[0]).any() or one.differs.any())


def _visited(found: Replay, state: Output) -> list[int]:
    """Return the indices of the replayed and the logged states, in order."""
    indices = np.unique(np.concatenate([state.replayed, state.logged]))
    return [int(index) for index in indices if 0 <= index < len(found.states)]


def _draw(axes: Axes, times: NDArray[np.float64], one: Output, states: list[int] | None) -> None:
    for i, replayed in enumerate(one.replayed.T):
        colour = _COLOURS[i % len(_COLOURS)]
        for values, style in ((one.logged[:, i], _LOGGED), (replayed, _REPLAYED)):
            rows = values if states is None else np.searchsorted(states, values)
            label = f"[{i}]" if style is _REPLAYED and one.replayed.shape[1] > 1 else None
            axes.plot(times, rows, color=colour, label=label, **style)
    title, unit = one.name.removeprefix("command."), ", ".join(dict.fromkeys(one.units))
    dress(axes, title=title, x="", y=unit)
    if one.replayed.shape[1] > 1:
        legend(axes, ncols=2, **BESIDE)


def _key(figure: Figure, found: Replay) -> None:
    lines = [Line2D([], [], color=_COLOURS[0], label="replayed", **_REPLAYED)]
    if found.compared:
        lines.insert(0, Line2D([], [], color=_COLOURS[0], label="log", **_LOGGED))
    patches = []
    if found.differs.any():
        lines.append(Line2D([], [], label="first difference", **PUBLISHED))
        patches.append(Patch(label="differs", **_DIFFERS))
    figure.legend(
        handles=[*lines, *patches],
        loc="outside lower center",
        ncols=4,
        fontsize=8,
        edgecolor="none",
    )


def side_by_side(found: Replay) -> dict[str, NDArray[np.float64]]:
    """Return a table of what was commanded, NaN where it is not logged, and what would be."""
    columns = {"time": found.times}
    for one in found.outputs:
        for i, pair in enumerate(zip(one.logged.T, one.replayed.T, strict=True)):
            name = f"{one.name.removeprefix('command.')}[{i}]"
            columns |= {f"logged.{name}": pair[0], f"replayed.{name}": pair[1]}
    return columns
