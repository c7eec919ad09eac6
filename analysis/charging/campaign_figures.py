"""Drawn cycles: shares that keep each limit, and how hard nuggets slide down the wall."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_style import LIMIT, dress, new_figure
from chamfer.analysis.scenario.experiment import Outcome

_LABELS: Final = {
    "none": ("as it is", "#555555"),
    "decoupling": ("sensor decoupled", "#1b4f9c"),
    "compensation": ("friction compensated by a base sensor", "#2e8b57"),
    "soft_gripper": ("softer gripper", "#e07b00"),
    "all": ("all three", "#7a0060"),
}
_CYCLE: Final = ("cycle.finished", "cycle.all_limits")
_MOST: Final = 2.0  # N, while sliding; section 1.1.2
_APART: Final = 0.2  # N of the quill's friction, between remedies of the same cycle


def plot_campaign(
    remedies: Sequence[str], limits: Sequence[str], trials: int, outcome: Outcome
) -> Figure:
    """Draw the share of cycles within each limit, and the force on the wall, a colour a remedy.

    The force only where cycles come to slide.
    """
    names = (*_CYCLE, *limits)
    slides = bool(np.isfinite(outcome.traces["wall.slide_force"]).any())
    figure = new_figure(14.0 if slides else 10.0, 0.34 * len(names) + 1.4)
    columns = figure.subplots(1, 2 if slides else 1, squeeze=False)[0]
    _shares(columns[0], remedies, names, trials, outcome)
    if slides:
        _slides(columns[1], remedies, outcome)
    handles, labels = columns[0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, fontsize=8, frameon=False)
    return figure


def _shares(
    axes: Axes, remedies: Sequence[str], names: Sequence[str], trials: int, outcome: Outcome
) -> None:
    rows = np.arange(len(names))
    offsets = np.linspace(-0.3, 0.3, len(remedies)) if len(remedies) > 1 else [0.0]
    for remedy, offset in zip(remedies, offsets, strict=True):
        label, color = _LABELS[remedy]
        found = [
            [outcome.metrics[f"{remedy}.{name}{end}"].value for end in ("", ".low", ".high")]
            for name in names
        ]
        share, low, high = np.array(found, dtype=np.float64).T
        axes.hlines(rows + offset, low, high, color=color, linewidth=1.6, alpha=0.6)
        axes.plot(share, rows + offset, "o", color=color, markersize=4, label=label)
    dress(
        axes,
        title=f"Share of drawn cycles (n = {trials}) within each limit, with 95 % intervals",
        x="share / %",
        y="",
    )
    axes.set_yticks(rows, names)
    axes.set_xlim(-2, 102)
    axes.axhline(len(_CYCLE) - 0.5, color="#bbbbbb", linewidth=0.8)
    axes.invert_yaxis()


def _slides(axes: Axes, remedies: Sequence[str], outcome: Outcome) -> None:
    """Draw the range of each cycle's force on the wall over the quill's drawn dry friction."""
    traces = outcome.traces
    lost = traces["wall.losses"] > 0
    axes.axhline(_MOST, **LIMIT)
    offsets = _APART * (np.arange(len(remedies)) - (len(remedies) - 1) / 2)
    for index, offset in enumerate(offsets):
        _, color = _LABELS[remedies[index]]
        mine = (traces["remedy"] == index) & np.isfinite(traces["wall.slide_force"])
        friction = traces["quill_friction"] + offset
        least, most = traces["wall.slide_force_min"], traces["wall.slide_force"]
        axes.vlines(friction[mine], least[mine], most[mine], color=color, linewidth=1.8)
        axes.plot(friction[mine], most[mine], "_", color=color, markersize=6)
        axes.plot(friction[mine], least[mine], "_", color=color, markersize=6)
        gone = friction[mine & lost]
        axes.plot(gone, np.zeros(len(gone)), "x", color=color, markersize=7)
    dress(
        axes,
        title="Force on the wall while a nugget slides; less than 2 N asked; x: contact lost",
        x="dry friction of the quill as drawn / N",
        y="least to most / N",
    )
    axes.set_ylim(bottom=-0.1)
