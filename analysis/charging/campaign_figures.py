"""Shares of drawn cycles that keep each limit."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from analysis.drawing.figure_style import dress, legend, new_figure
from analysis.run.experiment import Outcome

_LABELS: Final = {
    "none": ("as it is", "#555555"),
    "decoupling": ("sensor decoupled", "#1b4f9c"),
    "compensation": ("friction compensated by a base sensor", "#2e8b57"),
    "soft_gripper": ("softer gripper", "#e07b00"),
    "all": ("all three", "#7a0060"),
}
_CYCLE: Final = ("cycle.finished", "cycle.all_limits")


def plot_campaign(
    remedies: Sequence[str], limits: Sequence[str], trials: int, outcome: Outcome
) -> Figure:
    """Draw the share of cycles within each limit and its interval, a colour a remedy."""
    names = (*_CYCLE, *limits)
    figure = new_figure(10.0, 0.34 * len(names) + 1.4)
    axes = figure.subplots()
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
    legend(axes, loc="lower left")
    return figure
