"""Error, coverage and normalised square of observers that are told wrong."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_style import PUBLISHED, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome

_COVERAGE: Final = 99.0  # %
_SQUARES: Final = (0.5, 1.5)
_LOOK: Final = {
    "thesis": ("thesis", "#555555"),
    "trusting": ("adaptive, trusting what it is told", "#6fa0e8"),
    "adaptive": ("adaptive, knowing of errors", "#e07b00"),
}
# Where what it is told is right, wrong by chance, and at the worst corner.
_KINDS: Final = {
    "right": ("told right", "|", "full"),
    "drawn": ("wrong by chance", "o", "full"),
    "corner": ("worst corner", "D", "none"),
}


def plot_model_error(
    outcome: Outcome, *, surfaces: Sequence[str], observers: Sequence[str]
) -> Figure:
    """Draw rms, coverage and normalised error squared of each observer on each surface."""
    figure = new_figure(14.0, 8.0)
    panels = figure.subplots(1, 3, sharey=True, width_ratios=(3, 2, 3))
    rows = np.arange(len(surfaces))
    offsets = np.linspace(-0.26, 0.26, len(observers))
    for axes, quantity in zip(panels, ("rms", "coverage", "nees"), strict=True):
        for observer, offset in zip(observers, offsets, strict=True):
            label, color = _LOOK[observer]
            for kind, (name, marker, fill) in _KINDS.items():
                values = [
                    outcome.metrics[f"{one}.{observer}.{kind}.{quantity}"].value
                    for one in surfaces
                ]
                axes.plot(
                    np.array(values, dtype=np.float64),
                    rows + offset,
                    linestyle="",
                    marker=marker,
                    fillstyle=fill,
                    color=color,
                    markersize=7 if marker == "|" else 5,
                    label=f"{label}: {name}",
                )
        for row in rows[1:]:
            axes.axhline(row - 0.5, color="#dddddd", linewidth=0.8)
    errors, coverage, squares = panels
    for axes in (errors, squares):
        axes.set_xscale("log")
    coverage.axvline(_COVERAGE, label=f"asked for, {_COVERAGE:g} %", **PUBLISHED)
    low, high = _SQUARES
    label = f"asked for, {low:g} to {high:g}"
    squares.axvspan(low, high, color="#cccccc", alpha=0.5, linewidth=0, label=label)
    dress(errors, title="Error of the normal", x="rms error / °", y="")
    dress(coverage, title="Within 3 deviations", x="coverage / %", y="")
    dress(
        squares,
        title="Normalised error squared",
        x="error squared over variance / 1",
        y="",
    )
    coverage.set_xlim(0, 102)
    for axes in panels:
        axes.grid(False, axis="y")
    errors.set_yticks(rows, [one.replace("_", " ") for one in surfaces])
    errors.invert_yaxis()  # all share it
    legend(squares, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure
