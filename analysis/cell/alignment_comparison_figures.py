"""Errors over time of the state machine and the PID law in the same cell."""

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from chamfer.analysis.cell.alignment_trials import AlignmentTrialsScenario
from chamfer.analysis.drawing.figure_style import LOOPS, PUBLISHED, dress, legend, new_figure
from chamfer.analysis.published.work_cell import MEAN_ERROR
from chamfer.analysis.scenario.experiment import Outcome

_CONTROLLERS: Final = ("fsm", "pid")
_KINDS: Final = (("lateral", "mm", MEAN_ERROR[0]), ("rotational", "mrad", MEAN_ERROR[1]))


def plot_comparison(scenario: AlignmentTrialsScenario, outcome: Outcome) -> Figure:
    """Draw every trial and the median over time, and the errors at the end, trial by trial."""
    figure = new_figure(11.0, 7.6)
    panels = figure.subplots(2, 2, width_ratios=(1.5, 1.0))
    for row, (name, unit, published) in enumerate(_KINDS):
        over_time, ends = panels[row]
        _over_time(over_time, scenario, outcome, name)
        over_time.axhline(1e3 * published, label="published mean, FSM", **PUBLISHED)
        over_time.set_ylim(1e3 * published / 1000, None)
        title = f"({'ac'[row]}) True {name} error: trials thin, median thick"
        dress(
            over_time,
            title=title,
            x="time since the compensation's begin / s",
            y=f"error / {unit}",
        )
        legend(over_time, loc="lower left")
        _ends(ends, outcome, name)
        ends.axhline(1e3 * published, label="published mean, FSM", **PUBLISHED)
        title = f"({'bd'[row]}) After {scenario.compensation_time:g} s, same starts joined"
        dress(ends, title=title, x="", y=f"error / {unit}")
    return figure


def _over_time(axes: Axes, scenario: AlignmentTrialsScenario, outcome: Outcome, name: str) -> None:
    table = outcome.tables["errors"]
    for i, controller in enumerate(_CONTROLLERS):
        label, style = LOOPS[controller]
        of = table["controller"] == i
        shape = (len(np.unique(table["trial"][of])), -1)
        time = table["time"][of].reshape(shape)[0] - scenario.begin
        errors = 1e3 * np.maximum(table[f"{name}_error"][of], 1e-7).reshape(shape)
        axes.semilogy(time, errors.T, color=style["color"], linewidth=0.5, alpha=0.45)
        axes.semilogy(time, np.median(errors, axis=0), label=label, **style | {"linewidth": 2.4})
    axes.set_xlim(-0.25, scenario.compensation_time)


def _ends(axes: Axes, outcome: Outcome, name: str) -> None:
    pairs = 1e3 * np.array(
        [outcome.traces[f"{controller}.{name}_error"] for controller in _CONTROLLERS]
    )
    axes.semilogy(range(len(_CONTROLLERS)), pairs, color="#999999", linewidth=0.7)
    for i, controller in enumerate(_CONTROLLERS):
        color = LOOPS[controller][1]["color"]
        axes.semilogy(np.full(pairs.shape[1], i), pairs[i], "o", color=color, markersize=4)
    axes.set_xticks(range(len(_CONTROLLERS)), [LOOPS[one][0] for one in _CONTROLLERS])
    axes.set_xlim(-0.5, len(_CONTROLLERS) - 0.5)
