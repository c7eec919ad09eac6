"""Errors of calibrations beside the standard deviations that they were given."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.drawing.figure_style import BAND, LIMIT, Style, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome

Array = NDArray[np.float64]

_POINT: Final[Style] = {"color": "#1b4f9c", "linestyle": "none", "marker": "o", "markersize": 3}
_SPREAD: Final = 0.3  # of a column, to either side


def plot_calibrations(
    outcome: Outcome,
    parameters: Sequence[str],
    focal: Array,
    *,
    near: float,
    deviations: float,
) -> Figure:
    """Draw errors over standard deviations, how many are within, and focal lengths' errors.

    Args:
        outcome: With the traces and the metrics.
        parameters: Their names.
        focal: Errors of the focal lengths, %, shape (sets,).
        near: What they should be within, %.
        deviations: Within how many standard ones parameters should be.
    """
    figure = new_figure(13.0, 4.6)
    over, within, lengths = figure.subplots(1, 3, width_ratios=(1.5, 1.0, 1.0))
    _over(over, outcome, parameters, deviations)
    _within(within, outcome, parameters, deviations)
    _lengths(lengths, focal, near)
    return figure


def _over(axes: Axes, outcome: Outcome, parameters: Sequence[str], deviations: float) -> None:
    for i, name in enumerate(parameters):
        off = outcome.traces[f"{name}_error"] / outcome.traces[f"{name}_sd"]
        places = i + np.linspace(-_SPREAD, _SPREAD, len(off))
        axes.plot(places, off, **_POINT, alpha=0.6, label="a set" if i == 0 else None)
    axes.axhspan(-deviations, deviations, **BAND)
    axes.set_xticks(range(len(parameters)), parameters)
    largest = max(np.abs(axes.get_ylim()).max(), deviations + 1)
    axes.set_ylim(-largest, largest)
    y = "error / standard deviation"
    dress(axes, title="Each parameter in each set", x="", y=y)
    legend(axes, loc="upper right")


def _within(axes: Axes, outcome: Outcome, parameters: Sequence[str], deviations: float) -> None:
    def values(key: str) -> Array:
        return np.array([outcome.metrics[f"{name}.{key}"].value for name in parameters], float)

    shares, low, high = values("within"), values("within.low"), values("within.high")
    places = np.arange(len(parameters))
    axes.errorbar(places, shares, [shares - low, high - shares], **_POINT, capsize=3)
    axes.axhline(95, **LIMIT, label="asked: 95 %")
    axes.set_xticks(places, parameters)
    axes.set_ylim(min(80, *low) - 1, 101)
    dress(axes, title=f"Within {deviations:g} standard deviations", x="", y="sets / %")
    legend(axes, loc="lower right")


def _lengths(axes: Axes, focal: Array, near: float) -> None:
    shares = 100 * np.arange(1, len(focal) + 1) / len(focal)
    axes.step(np.sort(focal), shares, where="post", color=_POINT["color"], label="drawn sets")
    axes.axvline(near, **LIMIT, label=f"asked: {near:g} %")
    axes.set_xlim(0, 1.1 * max(near, float(focal.max())))
    axes.set_ylim(0, 101)
    axes.locator_params(axis="x", nbins=5)
    dress(axes, title="Focal lengths", x="error, at most / %", y="sets / %")
    legend(axes, loc="lower right")
