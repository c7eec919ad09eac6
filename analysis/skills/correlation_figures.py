"""Command, motion and their correlation, case by case."""

from typing import Final

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_style import (
    DESIRED,
    FSM,
    PUBLISHED,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.systems.primitives.correlation import FREE

_LABELS: Final = {
    "free": "free",
    "constrained": "spring on both sides",
    "one_sided": "stop on one side",
    "noisy": "noisy force sensor",
    "biased": "biased force sensor",
}
_LATER: Final[Style] = {"color": "#1b4f9c", "linestyle": "--", "linewidth": 1.4}
_THEORY: Final[Style] = {"color": "black", "marker": "_", "markersize": 26, "linestyle": "none"}
_MEASURED: Final[Style] = {"color": "#e07b00", "marker": "o", "markersize": 3, "alpha": 0.5}


def plot_correlation(samples: int, outcome: Outcome) -> Figure:
    """Draw a cycle of every case, and C of all windows beside what theory says."""
    figure = new_figure(11.0, 7.0)
    grid = figure.add_gridspec(2, 6)
    table = outcome.tables["cycles"]
    phase = 360 * table["sample"] / samples
    for i, (name, label) in enumerate(_LABELS.items()):
        row, k = divmod(i, 3)
        axes = figure.add_subplot(grid[row, 2 * k : 2 * k + 2])
        axes.plot(phase, 1e3 * table["command"], label="commanded", **DESIRED)
        axes.plot(phase, 1e3 * table[f"{name}_motion"], label="motion, first cycle", **FSM)
        axes.plot(phase, 1e3 * table[f"{name}_later"], label="motion, third cycle", **_LATER)
        title = f"({'abcde'[i]}) {label[0].upper()}{label[1:]}"
        dress(axes, title=title, x="phase / deg", y="velocity / (mm/s)" if k == 0 else "")
        axes.set_xticks([0, 90, 180, 270, 360])
        if i == 0:
            legend(axes, loc="upper center")
            axes.margins(y=0.35)
    axes = figure.add_subplot(grid[1, 4:])
    axes.axhline(FREE, label=r"published: $\pi^2/8$", **PUBLISHED)
    for i, name in enumerate(_LABELS):
        windows = outcome.traces[name]
        spread = 0.5 * (np.arange(len(windows)) / len(windows) - 0.5)
        axes.plot(i + spread, windows, linestyle="none", **_MEASURED)
        expected = outcome.metrics[f"theory.{name}"].value
        if expected is not None:
            axes.plot(i, expected, **_THEORY)
    axes.plot([], [], label="windows", linestyle="none", **_MEASURED)
    axes.plot([], [], label="theory", **_THEORY | {"markersize": 10})
    axes.set_xticks(range(len(_LABELS)), ["free", "both", "one", "noisy", "biased"])
    axes.set_ylim(0.0, 1.75)
    dress(axes, title="(f) Correlation, window by window", x="", y="C")
    legend(axes, loc="lower right")
    return figure
