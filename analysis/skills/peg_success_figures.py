"""Searches side by side: how long insertions take with each, world by world."""

import math
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_style import FSM, LIMIT, PID, Style, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Table

_STYLES: Final[tuple[Style, ...]] = (FSM, PID, {**PID, "color": "#2a7f3f", "linestyle": ":"})
_WORLD: Final[Style] = {"s": 26, "edgecolor": "white", "linewidth": 0.6}


def plot_searches(rows: Table) -> Figure:
    """Draw which share of the worlds is done after which time, and times against the first's.

    Worlds with an obstacle are left out.

    Args:
        rows: Of two searches or three, with the columns ``search``, ``trial``, ``success``,
            ``duration``, s, and ``obstacle``, NaN without one.
    """
    free = np.isnan(rows["obstacle"])
    figure = new_figure(11.0, 4.6)
    share, pairs = figure.subplots(1, 2)
    times = {}
    for search, style in zip(dict.fromkeys(rows["search"].tolist()), _STYLES, strict=False):
        its = free & (rows["search"] == search)
        done = np.where(rows["success"][its] > 0, rows["duration"][its], np.inf)
        times[search] = dict(zip(rows["trial"][its].tolist(), done.tolist(), strict=True))
        reached = np.sort(done[np.isfinite(done)])
        steps = 100 * np.arange(len(reached) + 1) / max(len(done), 1)
        share.step([0.0, *reached], steps, where="post", label=search, **style)
    share.set_ylim(0.0, 102.0)
    dress(
        share,
        title="(a) Done after",
        x="time / s",
        y="share of the worlds without an obstacle / %",
    )
    legend(share, loc="lower right")
    (first, its), *rest = times.items()
    ends = [math.inf, 0.0]
    for (search, others), style in zip(rest, _STYLES[1:], strict=False):
        both = np.array([(its[trial], others[trial]) for trial in its if trial in others])
        both = both[np.isfinite(both).all(axis=1)]
        if len(both):
            pairs.scatter(*both.T, label=search, color=style["color"], **_WORLD)
            ends = [min(ends[0], both.min()), max(ends[1], both.max())]
    if ends[1]:
        line = [0.95 * ends[0], 1.05 * ends[1]]
        pairs.plot(line, line, label="the same time", **LIMIT)
        legend(pairs, loc="upper left")
    pairs.set_aspect("equal", adjustable="datalim")
    dress(
        pairs,
        title="(b) The same worlds",
        x=f"time with {first} / s",
        y="time with another search / s",
    )
    return figure
