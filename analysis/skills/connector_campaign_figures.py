"""Campaigns of insertions: success over the initial errors, searches and skills side by side."""

import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import MaxNLocator
from numpy.typing import NDArray

from chamfer.analysis.drawing.figure_kit import (
    colour_bar,
    draw_cumulative,
    draw_distribution,
    draw_intervals,
    metric_value,
    name_rows,
)
from chamfer.analysis.drawing.figure_style import (
    FORCE,
    FSM,
    LIMIT,
    PID,
    PUBLISHED,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Outcome, Table

AIM: Final = 1.5  # of the mating force
_GOOD: Final[Style] = {"marker": "o", "s": 36, "edgecolor": "white", "linewidth": 0.6}
_FAILED: Final[Style] = {"marker": "x", "s": 60, "color": "#b00020", "linewidth": 2.0}
_LISTED: Final = 6  # reasons in the figure
_STYLES: Final[tuple[Style, ...]] = (FSM, PID, {**PID, "color": "#2a7f3f", "linestyle": ":"})
_TRIAL: Final[Style] = {"s": 26, "edgecolor": "white", "linewidth": 0.6}


def plot_success(outcome: Outcome, *, middle: Sequence[float]) -> Figure:
    """Draw the trials over their initial errors, rad above m, and peak forces and durations."""
    rows = outcome.traces
    figure = new_figure(11.0, 8.0)
    (lateral, angular), (force, duration) = figure.subplots(2, 2)
    free = np.isnan(rows["obstacle"])
    good, failed = free & (rows["success"] > 0), free & ~(rows["success"] > 0)
    others = "" if free.all() else f"; {(~free).sum()} more with an obstacle"
    figure.suptitle(
        f"{good.sum()} of {free.sum()} insertions succeed{_interval(outcome)}{others}",
        fontsize=12,
        fontweight="bold",
    )
    _errors(
        lateral,
        [1e3 * rows[f"initial_{axis}"] for axis in "xy"],
        good,
        failed,
        shade=rows["retries"],
        shaded="retries",
    )
    dress(lateral, title="(a) Lateral errors", x="x / mm", y="y / mm")
    degrees = [np.rad2deg(rows[f"initial_r{axis}"] - middle[i]) for i, axis in enumerate("xyz")]
    about = f" beyond {math.degrees(middle[2]):.0f}°" if middle[2] else ""
    _errors(angular, degrees[:2], good, failed, shade=degrees[2], shaded=f"about z{about} / deg")
    dress(angular, title="(b) Angular errors", x="about x / deg", y="about y / deg")
    for text, count in list(_reasons(rows["reason"][free]).items())[:_LISTED]:
        lateral.scatter([], [], label=f"{text} ({count})", **_FAILED)
    if failed.any():
        figure.legend(loc="outside lower left", ncols=2, fontsize=8, frameon=False)
    draw_distribution(force, rows["force.peak_share"], least=AIM)
    force.axvline(1.0, label="mating force", **LIMIT)
    force.axvline(AIM, label=f"our aim, {AIM:g} times that", **PUBLISHED)
    dress(
        force,
        title="(c) Largest force of a run over its true mating force",
        x="force along the insertion / mating force",
        y="runs",
    )
    legend(force, loc="upper right")
    draw_distribution(duration, rows["duration"])
    dress(duration, title="(d) Duration of a run", x="time / s", y="runs")
    return figure


def _interval(outcome: Outcome) -> str:
    """Return the rate of success with its interval; nothing if there is none."""
    ends = [metric_value(outcome.metrics, f"success_rate{end}") for end in ("", ".low", ".high")]
    return (
        ""
        if np.isnan(ends).any()
        else ": {:.0f} %, 95 % interval {:.1f} to {:.1f} %".format(*ends)
    )


def _reasons(reasons: NDArray[np.str_]) -> dict[str, int]:
    """Return how many runs failed for each reason, the most frequent first."""
    texts, counts = np.unique(reasons[reasons != ""], return_counts=True)
    order = np.argsort(-counts, kind="stable")
    return {str(texts[i]): int(counts[i]) for i in order}


def _errors(
    axes: Axes,
    errors: Sequence[NDArray[np.float64]],
    good: NDArray[np.bool_],
    failed: NDArray[np.bool_],
    *,
    shade: NDArray[np.float64],
    shaded: str,
) -> None:
    x, y = errors
    dots = axes.scatter(x[good], y[good], c=shade[good], cmap="viridis", **_GOOD)
    axes.scatter(x[failed], y[failed], zorder=3, **_FAILED)
    axes.set_aspect("equal", adjustable="datalim")
    if good.any():
        colour_bar(axes, dots, shaded, ticks=MaxNLocator(integer=True))


def plot_searches(rows: Table) -> Figure:
    """Draw which share of the trials is done after which time, and times against the first's.

    Trials with an obstacle are left out.
    """
    free = np.isnan(rows["obstacle"])
    figure = new_figure(11.0, 4.6)
    share, pairs = figure.subplots(1, 2)
    times = {}
    for search, style in zip(dict.fromkeys(rows["search"].tolist()), _STYLES, strict=False):
        its = free & (rows["search"] == search)
        done = np.where(rows["success"][its] > 0, rows["duration"][its], np.inf)
        times[search] = dict(zip(rows["trial"][its].tolist(), done.tolist(), strict=True))
        draw_cumulative(share, done, style, search)
    share.set_ylim(0.0, 102.0)
    share.set_xlim(0.0, None)
    dress(
        share,
        title="(a) Done after",
        x="time / s",
        y="share of the trials without an obstacle / %",
    )
    legend(share, loc="lower right")
    (first, its), *rest = times.items()
    ends = [math.inf, 0.0]
    for (search, others), style in zip(rest, _STYLES[1:], strict=False):
        both = np.array([(its[trial], others[trial]) for trial in its if trial in others])
        both = both[np.isfinite(both).all(axis=1)]
        if len(both):
            pairs.scatter(*both.T, label=search, color=style["color"], **_TRIAL)
            ends = [min(ends[0], both.min()), max(ends[1], both.max())]
    if ends[1]:
        line = [0.95 * ends[0], 1.05 * ends[1]]
        pairs.plot(line, line, label="the same time", **LIMIT)
        legend(pairs, loc="upper left")
    pairs.set_aspect("equal", adjustable="datalim")
    dress(
        pairs,
        title="(b) The same randomised scenarios",
        x=f"time with {first} / s",
        y="time with another search / s",
    )
    return figure


def plot_ablation(outcome: Outcome, skills: Sequence[str]) -> Figure:
    """Draw the rate of success, the duration and the peak force of every skill."""
    figure = new_figure(11.0, 1.6 + 0.45 * len(skills))
    rate, duration, force = figure.subplots(1, 3, sharey=True)
    middle, low, high = (
        [metric_value(outcome.metrics, f"{name}.success_rate{end}") for name in skills]
        for end in ("", ".low", ".high")
    )
    draw_intervals(rate, np.arange(len(skills)), middle, low, high, {"color": FORCE["color"]})
    for place, name in enumerate(skills):
        own = outcome.traces["skill"] == name
        for axes, column in ((duration, "duration"), (force, "force.peak_share")):
            values = outcome.traces[column][own]
            axes.plot(values, np.full(len(values), place), "|", color=FORCE["color"])
            axes.plot([values.mean()], [place], "o", color=FORCE["color"])
    name_rows(rate, [name.replace("_", " ") for name in skills])
    rate.set_xlim(-3, 103)
    force.axvline(1.0, **LIMIT)
    for axes in (duration, force):
        axes.set_xlim(left=0.0)
    dress(rate, title="(a) Success, 95 % interval", x="runs with a free way / %", y="")
    dress(duration, title="(b) Duration, runs and mean", x="time / s", y="")
    dress(force, title="(c) Peak force, runs and mean", x="force / true mating force", y="")
    return figure
