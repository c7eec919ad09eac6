"""The figure of a replay: logged and replayed commands."""

from itertools import cycle
from typing import Final

import numpy as np
from matplotlib.artist import Artist
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from chamfer.analysis.drawing.figure_kit import VISITS, shade, state_visits, time_axes
from chamfer.analysis.drawing.figure_style import BESIDE, Style, dress, legend, new_figure
from chamfer.analysis.replay.replay import Output, Replay

_COLOURS: Final = ("#1b4f9c", "#e07b00", "#2e7d32", "#7a0060", "#00838f", "#6d4c41")
_DIFFERS: Final[Style] = {"color": "#d32f2f", "alpha": 0.25, "linewidth": 0.8}
_LOGGED: Final[Style] = {"linewidth": 3.6, "alpha": 0.35, "drawstyle": "steps-post"}
_REPLAYED: Final[Style] = {"linewidth": 1.1, "drawstyle": "steps-post"}
_A_STATE: Final = 0.16  # inches of height


def replay_figure(found: Replay) -> Figure:
    """Draw states and commands over time, logged and replayed, without constant ones.

    The visits to the replayed states are behind them, with the times at which an output differs.
    """
    times = found.times
    moving = {one.name: _moving(one) for one in found.outputs}
    # The state is on top; something is drawn of a controller that does nothing.
    drawn = sorted(found.outputs, key=lambda one: not one.states)
    drawn = [one for one in drawn if one.states or moving[one.name]] or drawn[:1]
    heights = [max(1.0, _A_STATE * len(one.states)) for one in drawn]
    state = drawn[0]
    visits = state_visits(times, state.replayed[:, 0], state.states) if state.states else []
    differ = sum(bool(one.differs.any()) for one in found.outputs)
    said = f"{differ} of {len(found.outputs)} outputs differ" if differ else "no output differs"
    caption = f"Outputs of {found.controller} as logged and as replayed from the log: {said}."
    figure = new_figure(8.0, 1.2 + 1.4 * sum(heights), caption=caption)
    for axes, one in zip(time_axes(figure, times, heights, visits=visits), drawn, strict=True):
        shade(axes, times, one.differs.any(axis=1), "", _DIFFERS)
        shown = moving[one.name] or [0]
        for i, colour in zip(shown, cycle(_COLOURS), strict=False):
            axes.plot(times, one.logged[:, i], color=colour, **_LOGGED)
            axes.plot(times, one.replayed[:, i], color=colour, label=f"[{i}]", **_REPLAYED)
        unit = ", ".join(dict.fromkeys(one.units[i] for i in shown))
        dress(axes, title=one.name, x="time / s" if one is drawn[-1] else "", y=unit)
        if one.states:
            axes.set_yticks(range(len(one.states)), one.states, fontsize=8)
        elif len(one.units) > 1:
            legend(axes, ncols=2 + len(shown) // 12, **BESIDE)
    figure.suptitle(f"{found.controller}: {said}", fontsize=10)
    key: list[Artist] = [
        Line2D([], [], label="log", **_LOGGED),
        Line2D([], [], label="replayed", **_REPLAYED),
        Patch(label="differs", **_DIFFERS),
    ]
    if visits:
        key.append(Patch(label="every other state replayed", color=VISITS[1]))
    below: Style = {"loc": "outside lower center", "fontsize": 8, "edgecolor": "none"}
    figure.legend(handles=key, ncols=len(key), **below)
    return figure


def _moving(one: Output) -> list[int]:
    """Return the elements that are not constant, or differ from the log."""
    values = np.nan_to_num(one.replayed)
    moves = (values != values[0]).any(axis=0) | one.differs.any(axis=0)
    return [int(i) for i in np.flatnonzero(moves)]
