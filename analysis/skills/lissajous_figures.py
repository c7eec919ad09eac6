"""Fig. 2: Lissajous figures, and how densely they cover."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from chamfer.analysis.drawing.figure_style import FSM, Style, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome

_PATTERN: Final[Style] = {"color": "#1b4f9c", "linewidth": 0.9}
_SHOWN: Final = 4  # patterns


def plot_lissajous(repeats: Sequence[int], amplitude: float, outcome: Outcome) -> Figure:
    """Draw the first patterns and the covering radius over N."""
    shown = list(repeats)[:_SHOWN]
    figure = new_figure(12.0, 6.2)
    grid = figure.add_gridspec(2, 4, height_ratios=(1.25, 1.0))
    traces = outcome.traces
    for i, n in enumerate(shown):
        axes = figure.add_subplot(grid[0, i])
        of = traces["repeats"] == n
        axes.plot(1e3 * traces["first"][of], 1e3 * traces["second"][of], **_PATTERN)
        corner = -1e3 * amplitude
        axes.add_patch(Rectangle((corner, corner), -2 * corner, -2 * corner, fill=False, lw=0.6))
        axes.set_aspect("equal")
        title = f"({'abcd'[i]}) N = {n}, ratio {n + 1}/{n}"
        dress(axes, title=title, x="slower axis / mm", y="y / mm" if i == 0 else "")
    axes = figure.add_subplot(grid[1, :])
    radii, expected = (
        np.array([outcome.metrics[f"{name}.n{n}"].value for n in repeats], dtype=np.float64)
        for name in ("covering_radius", "theory.covering_radius")
    )
    label = "measured: the farthest that a point of the square is from the pattern"
    axes.loglog(repeats, 1e3 * radii, marker="o", label=label, **FSM)
    axes.loglog(
        repeats,
        1e3 * expected,
        color="black",
        linestyle=":",
        label=r"$\pi A / (2 \sqrt{2} N)$, for large N",
    )
    axes.set_xticks(list(repeats), [str(n) for n in repeats])
    ticks = [0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0, 10.0]
    axes.set_yticks(ticks, [f"{one:g}" for one in ticks])
    axes.minorticks_off()
    axes.set_ylim(0.8e3 * float(np.nanmin(radii)), 1.25e3 * float(np.nanmax(expected)))
    title = f"({'abcde'[len(shown)]}) Denser patterns take longer"
    dress(axes, title=title, x="N, cycles until the pattern repeats", y="covering radius / mm")
    legend(axes)
    return figure
