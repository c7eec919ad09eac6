"""The figure of the designs' accuracy: verdicts against what became of the insertions."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from chamfer.analysis.design.design_figures import VERDICTS
from chamfer.analysis.drawing.figure_style import Style, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Metric, Table

_BECAME: Final = ("all", "some", "none")
_MARKERS: Final = {"certain": "o", "likely": "s", "no": "X"}
_MOST_MARGIN: Final = 1.5  # that is drawn, to both sides
_ERROR: Final[Style] = {"elinewidth": 0.8, "capsize": 2, "linestyle": ""}


def plot_accuracy(traces: Table, metrics: Mapping[str, Metric]) -> Figure:
    """Draw the confusion table, and the seated share over the margin and the predicted share."""
    figure = new_figure(12.0, 4.4)
    table, margin, share = figure.subplots(1, 3, width_ratios=[0.9, 1.2, 1.0])
    _confusion(table, metrics)
    # That of a link without bound is undefined.
    bounded = np.clip(np.nan_to_num(traces["margin"], nan=-np.inf), -_MOST_MARGIN, _MOST_MARGIN)
    _seated(margin, traces, bounded)
    margin.axvline(0.0, color="#555555", linewidth=0.8)
    dress(
        margin,
        title="Seated, over the smallest margin",
        x="smallest margin / of what is allowed",
        y="seated / share of the insertions",
    )
    _seated(share, traces, traces["share"])
    share.plot([0, 1], [0, 1], color="#555555", linewidth=0.8)
    dress(
        share,
        title="Seated, over the predicted share",
        x="drawn errors inside / share",
        y="seated / share of the insertions",
    )
    if len(margin.get_legend_handles_labels()[0]):
        legend(margin, loc="center right")
    return figure


def _confusion(axes: Axes, metrics: Mapping[str, Metric]) -> None:
    counts = np.array(
        [
            [metrics[f"confusion.{said}.{became}"].value or 0.0 for became in _BECAME]
            for said in VERDICTS
        ]
    )
    axes.imshow(counts, cmap="Blues", vmin=0, vmax=1.6 * max(1.0, float(counts.max())))
    for row, column in np.ndindex(*counts.shape):
        axes.text(column, row, f"{counts[row, column]:.0f}", ha="center", va="center", fontsize=13)
    dress(axes, title="Designs", x="", y="")
    axes.set_xticks(range(len(_BECAME)), labels=[f"{one} seated" for one in _BECAME])
    axes.set_yticks(range(len(VERDICTS)), labels=[f"called\n{one}" for one in VERDICTS])
    axes.grid(False)


def _seated(axes: Axes, traces: Table, over: np.ndarray) -> None:
    simulated = traces["trials"] > 0
    for said, colour in VERDICTS.items():
        of = simulated & (traces["verdict"] == said)
        if not of.any():
            continue
        seated = traces["seated"][of] / traces["trials"][of]
        ends = np.array([seated - traces["low"][of], traces["high"][of] - seated])
        axes.errorbar(
            over[of],
            seated,
            yerr=np.maximum(ends, 0.0),
            marker=_MARKERS[said],
            color=colour,
            label=said,
            **_ERROR,
        )
    axes.set_ylim(-0.05, 1.05)
