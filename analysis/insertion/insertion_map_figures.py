"""Outcomes over the region that theory predicts, the two against each other, and probabilities."""

from collections.abc import Sequence
from typing import Final, get_args

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from chamfer.analysis.drawing.figure_style import Style, dress, legend, new_figure
from chamfer.analysis.insertion.blind_feed_runs import FeedOutcome
from chamfer.analysis.scenario.experiment import Outcome, Table
from chamfer.diagrams.insertion.blind_feed import Plane
from chamfer.models.peg_theory.fed_insertion import Verdict

_REGION: Final = {
    Verdict.SAFE: ("#c9e7cf", "theory: goes in"),
    Verdict.MAY: ("#fbeebc", "theory: may wedge, or sit on the edge"),
    Verdict.STOPPED: ("#e3e3e3", "theory: stopped, or beside the mouth"),
}
_OUTCOMES: Final[dict[FeedOutcome, Style]] = {
    FeedOutcome.SEATED: {"marker": "o", "color": "#14733a", "label": "seated"},
    FeedOutcome.WEDGED: {"marker": "X", "color": "#b00020", "label": "wedged"},
    FeedOutcome.JAMMED: {"marker": "D", "color": "#e07b00", "label": "jammed"},
    FeedOutcome.ON_EDGE: {"marker": "^", "color": "#7a0060", "label": "stuck on the edge"},
    FeedOutcome.MISSED: {"marker": "x", "color": "#333333", "label": "missed"},
}
_WRONG: Final[Style] = {
    "marker": "o",
    "facecolors": "none",
    "edgecolors": "#000000",
    "linewidths": 1.8,
}
_MM, _MRAD = 1e3, 1e3


def plot_map(planes: Sequence[Plane], outcome: Outcome) -> Figure:
    """Draw the map of each plane, theory's force beside the simulated one, and probabilities."""
    drawn = outcome.tables.get("probability")
    columns = max(len(planes), 2)
    figure = new_figure(6.4 * columns, 11.0)
    above, lower = figure.subfigures(2, 1, height_ratios=[1.35, 1.0], squeeze=False)[:, 0]
    maps = above.subplots(1, len(planes), squeeze=False)[0]
    for axes, plane in zip(maps, planes, strict=True):
        _draw_map(axes, plane, outcome)
    above.legend(handles=_handles(), loc="outside lower center", ncols=5, fontsize=8)
    below = lower.subplots(1, 2 if drawn is None else 3)
    _draw_table(below[0], outcome.traces)
    _draw_force(below[1], outcome.traces)
    if drawn is not None:
        _draw_probability(below[2], drawn)
    return figure


def _handles() -> list[Patch | Line2D]:
    regions = [Patch(color=colour, label=label) for colour, label in _REGION.values()]
    symbols = [
        Line2D([], [], linestyle="none", markersize=6, **style) for style in _OUTCOMES.values()
    ]
    ring = Line2D(
        [],
        [],
        linestyle="none",
        marker="o",
        markersize=11,
        markerfacecolor="none",
        markeredgecolor="black",
        label="theory is sure, and wrong",
    )
    return [*regions, ring, *symbols]


def _draw_map(axes: Axes, plane: Plane, outcome: Outcome) -> None:
    """Draw what became of each cell, at its errors at touch, over the limits' region."""
    index = get_args(Plane).index(plane)
    region = outcome.tables["region"]
    _shade(axes, {name: values[region["plane"] == index] for name, values in region.items()})
    traces = outcome.traces
    cells = {name: values[traces["plane"] == index] for name, values in traces.items()}
    lateral = _MM * cells["touch_lateral_error"]
    tilt = _MRAD * cells["touch_rotational_error"]
    size = float(np.clip(1500 / len(lateral) ** 0.75, 12.0, 60.0))
    for became, style in _OUTCOMES.items():
        of = cells["outcome"] == became
        axes.scatter(lateral[of], tilt[of], s=size, zorder=3, **style)
    off = wrong(cells)
    axes.scatter(lateral[off], tilt[off], s=5 * size, zorder=4, **_WRONG)
    safe = cells["predicted_verdict"] == Verdict.SAFE
    failed = int(np.sum(safe & (cells["outcome"] != FeedOutcome.SEATED)))
    dress(
        axes,
        title=f"Errors in the hole's plane {plane.upper()}: of {int(safe.sum())} cells "
        f"that theory calls safe {failed} failed",
        x="lateral error at touch / mm",
        y="tilt at touch (equal signs add) / mrad",
    )


def _shade(axes: Axes, region: Table) -> None:
    lateral, tilt = np.unique(region["lateral"]), np.unique(region["tilt"])
    verdict = region["verdict"].reshape(len(tilt), len(lateral))
    colours = ListedColormap([colour for colour, _ in _REGION.values()])
    axes.pcolormesh(
        _MM * lateral, _MRAD * tilt, verdict, cmap=colours, vmin=-0.5, vmax=2.5, rasterized=True
    )


def wrong(cells: Table) -> np.ndarray:
    """Say where theory is sure, and the opposite happens."""
    seated = cells["outcome"] == FeedOutcome.SEATED
    said = cells["predicted_verdict"]
    found: np.ndarray = ((said == Verdict.SAFE) & ~seated) | ((said == Verdict.STOPPED) & seated)
    return found


def _draw_table(axes: Axes, traces: Table) -> None:
    """Write how often each outcome was each verdict's."""
    verdict, became = traces["predicted_verdict"], traces["outcome"]
    counts = np.array(
        [[np.sum((verdict == said) & (became == one)) for one in _OUTCOMES] for said in _REGION]
    )
    dress(axes, title="Cells: what theory says of them, and what happens", x="", y="")
    axes.grid(False)
    axes.set_xticks(
        range(len(_OUTCOMES)),
        [style["label"].replace(" ", "\n", 1) for style in _OUTCOMES.values()],
    )
    axes.set_yticks(range(len(_REGION)), ["theory:\ngoes in", "theory:\nmay", "theory:\nstopped"])
    axes.set_xlim(-0.5, len(_OUTCOMES) - 0.5)
    axes.set_ylim(len(_REGION) - 0.5, -0.5)
    for i, (said, (colour, _)) in enumerate(_REGION.items()):
        axes.axhspan(i - 0.5, i + 0.5, color=colour, linewidth=0)
        for k, one in enumerate(_OUTCOMES):
            wrong = said != Verdict.MAY and (said == Verdict.SAFE) != (one == FeedOutcome.SEATED)
            axes.text(
                k,
                i,
                str(counts[i, k]),
                ha="center",
                va="center",
                fontsize=13,
                fontweight="bold" if counts[i, k] else "normal",
                color="#b00020" if wrong and counts[i, k] else "#222222",
            )


def _draw_force(axes: Axes, traces: Table) -> None:
    """Draw the simulated push over the predicted one."""
    seated = traces["outcome"] == FeedOutcome.SEATED
    largest = 1.0
    for said, label in ((Verdict.SAFE, "goes in"), (Verdict.MAY, "may")):
        of = seated & (traces["predicted_verdict"] == said)
        force = traces["predicted_force_axial"][of], traces["force_axial"][of]
        if of.any():
            largest = max(largest, *(float(np.nanmax(one, initial=0.0)) for one in force))
        colour = "#14733a" if said == Verdict.SAFE else "#c79a00"
        axes.plot(*force, "o", markersize=3.5, color=colour, alpha=0.8, label=f"theory: {label}")
    axes.plot([0, largest], [0, largest], color="#555555", linewidth=1.0, label="equal")
    dress(
        axes,
        title="Largest push of the seated cells",
        x="by exact statics, without friction in the joints / N",
        y="simulated, 10 ms median / N",
    )
    legend(axes, loc="best")


def _draw_probability(axes: Axes, table: Table) -> None:
    """Draw the share of draws that is seated in each cell, with its interval."""
    lateral, tilt = np.unique(table["lateral"]), np.unique(table["tilt"])
    share = np.full((len(tilt), len(lateral)), np.nan)
    for k in range(len(table["rate"])):
        i = np.searchsorted(tilt, table["tilt"][k]), np.searchsorted(lateral, table["lateral"][k])
        share[i] = table["rate"][k]
    axes.pcolormesh(
        _MM * lateral, _MRAD * tilt, share, cmap="RdYlGn", vmin=0.0, vmax=100.0, alpha=0.75
    )
    small = len(lateral) > 5
    for k in range(len(table["rate"])):
        text = f"{table['rate'][k]:.0f}"
        if not small:
            text += f" %\n{table['low'][k]:.0f} to {table['high'][k]:.0f}"
        axes.text(
            _MM * table["lateral"][k],
            _MRAD * table["tilt"][k],
            text,
            ha="center",
            va="center",
            fontsize=7,
        )
    draws = int(table["draws"].max())
    dress(
        axes,
        title=f"Seated of {draws} draws of model errors, %, with 95 % interval"
        if not small
        else f"Seated of {draws} draws of model errors, %",
        x="lateral error at the start / mm",
        y="tilt at the start / mrad",
    )
    axes.grid(False)
