"""What each imperfection of sensors and computer costs, loop by loop."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import StrMethodFormatter

from chamfer.analysis.drawing.figure_style import FORCE, LIMIT, NOTE, POSITION, dress, new_figure
from chamfer.analysis.scenario.experiment import Outcome

_LABELS: Final = {
    "none": "none: ideal",
    "noise": "noise",
    "cross_talk": "cross-talk",
    "drift": "bias and drift, tared",
    "no_tare": "bias and drift, no tare",
    "filter": "filter and delay of the sensor",
    "quanta": "resolution and range, counts",
    "velocity": "differenced velocity",
    "computation": "computation delay",
    "sample_late": "torque a period late",
    "all": "all but a period late",
    "all_sample_late": "all, and a period late",
}
_SAID: Final = ("diverged", "growth", "losses")
_LOOPS: Final = {
    "planar": "planar arm, slides",
    "puma": "Puma, presses",
    "adept": "Adept, slides",
}


def plot_sensitivity(
    desired: Mapping[str, float], imperfections: Sequence[str], outcome: Outcome
) -> Figure:
    """Draw force deviation and position error for each loop and imperfection, a dot a seed.

    Args:
        desired: N, the desired force, by loop.
        imperfections: In the order of the traces' numbers.
        outcome: Of the campaign.
    """
    figure = new_figure(12.0, 8.0)
    panels = figure.subplots(2, len(desired), sharey=True, sharex="row")
    traces = outcome.traces
    force, position = panels
    for i, (loop, newtons) in enumerate(desired.items()):
        of = traces["loop"] == i
        which = traces["imperfection"][of]
        _bars(force[i], 100 * traces["force"][of] / newtons, which, FORCE["color"])
        _bars(position[i], 1e3 * traces["position"][of], which, POSITION["color"])
        force[i].axvline(100, **LIMIT)
        dress(
            force[i],
            title=f"{_LOOPS[loop]}, {newtons:g} N",
            x="largest deviation of the force / % of what is desired",
            y="",
        )
        dress(position[i], title="", x="largest position error / mm", y="")
        _say(force[i], {name: traces[name][of] for name in _SAID}, which)
    values = 100 * traces["force"] / np.array(list(desired.values()))[traces["loop"].astype(int)]
    known = values[np.isfinite(values) & (values > 0)]
    force[0].set_xscale("log")
    if len(known):
        force[0].set_xlim(known.min() / 2, max(100.0, known.max()) * 8)  # with room to say more
    force[0].xaxis.set_major_formatter(StrMethodFormatter("{x:g}"))
    for panel in (force[0], position[0]):
        panel.set_yticks(range(len(imperfections)), [_LABELS[name] for name in imperfections])
    force[0].set_ylim(len(imperfections) - 0.4, -0.6)  # all share it
    figure.suptitle(
        "What each imperfection of sensors and computer costs, alone and together", fontsize=11
    )
    return figure


def _bars(axes: Axes, values: np.ndarray, which: np.ndarray, color: str) -> None:
    """Draw the means as bars, every seed, and the ideal loop's mean as a line."""
    known = np.isfinite(values)
    for row in np.unique(which[known]):
        here = values[known & (which == row)]
        axes.barh(row, float(here.mean()), color=color, alpha=0.55)
        axes.plot(here, np.full(len(here), row), ".", color=color, ms=4)
    ideal = values[known & (which == 0)]
    if len(ideal):
        axes.axvline(float(ideal.mean()), color="#555555", linewidth=0.8, linestyle=":")


def _say(axes: Axes, measured: Mapping[str, np.ndarray], which: np.ndarray) -> None:
    """Write which loops are unstable and diverge, and where contact is lost unlike the ideal."""
    ideal = measured["losses"][which == 0]
    for row in np.unique(which):
        diverged, growth, lost = (measured[name][which == row] for name in _SAID)
        said = []
        if np.any(diverged > 0):
            said = ["diverges"]
        elif np.all(np.isfinite(lost)) and lost.mean() != ideal.mean():
            said = [f"losses: {lost.mean():.3g}"]
        if growth.max() > 0:
            said.insert(0, "unstable")
        place = axes.get_yaxis_transform()
        if said:
            text = ", ".join(said)
            box = {"facecolor": "white", "edgecolor": "none", "pad": 1.5}
            axes.text(0.99, row, text, transform=place, ha="right", va="center", bbox=box, **NOTE)
