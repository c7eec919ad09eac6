"""The steps of both controllers under every disturbance, and what is measured of them."""

from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_style import BAND, LOOPS, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.analysis.servo.comparison_trials import (
    CONDITIONS,
    CONTROLLERS,
    CRITERIA,
    ResolvedServoComparisonScenario,
)

_SHOWN: Final = 10  # trials


def plot_comparison(scenario: ResolvedServoComparisonScenario, outcome: Outcome) -> Figure:
    """Draw the error's course under each condition, and the criteria with their intervals."""
    figure = new_figure(11.0, 10.0)
    parts: Any = figure.subfigures(2, 1, height_ratios=[1.6, 1.0])
    courses, criteria = parts
    panels = courses.subplots(2, 3, sharex=True, sharey=True)
    for i, (axes, condition) in enumerate(zip(panels.flat, CONDITIONS, strict=True)):
        _draw_courses(axes, scenario, outcome, i, condition)
    legend(panels[0, 0], loc="upper right")
    below = criteria.subplots(1, len(CRITERIA), sharey=True)
    for axes, criterion in zip(below, CRITERIA, strict=True):
        _draw_criterion(axes, outcome, criterion)
    handles, labels = below[0].get_legend_handles_labels()
    criteria.legend(handles, labels, loc="outside lower center", ncols=2, frameon=False)
    criteria.suptitle("Means with their 95 % intervals", fontsize="medium")
    return figure


def _draw_courses(
    axes: Axes,
    scenario: ResolvedServoComparisonScenario,
    outcome: Outcome,
    number: int,
    condition: str,
) -> None:
    table = outcome.tables["courses"]
    tolerance = 1e3 * scenario.tolerance
    axes.axhspan(-tolerance, tolerance, label="tolerance", **BAND)
    axes.axvline(
        scenario.settling_time,
        color="#999999",
        linewidth=0.8,
        linestyle=":",
        label="asked to be settled",
    )
    trials = np.unique(table["trial"])[:_SHOWN]
    for j, controller in enumerate(CONTROLLERS):
        name, style = LOOPS[controller]
        for k, trial in enumerate(trials):
            mine = (
                (table["condition"] == number)
                & (table["controller"] == j)
                & (table["trial"] == trial)
            )
            label = name if k == 0 else None
            thin = {**style, "linewidth": 0.9}
            axes.plot(table["time"][mine], 1e3 * table["error"][mine], label=label, **thin)
    title = f"({'abcdef'[number]}) {CONDITIONS[condition]}"
    dress(axes, title=title, x="time / s", y="error / mm")


def _draw_criterion(axes: Axes, outcome: Outcome, criterion: str) -> None:
    unit, says = CRITERIA[criterion]
    factor, unit = (1e3, "mm") if unit == "m" else (1.0, unit)
    for j, controller in enumerate(CONTROLLERS):
        label, style = LOOPS[controller]
        for i, condition in enumerate(CONDITIONS):
            name = f"{condition}.{controller}.{criterion}"
            value = outcome.metrics[name].value
            if value is None:
                continue
            place = len(CONDITIONS) - 1 - i + (0.14 if j == 0 else -0.14)
            ends = [outcome.metrics[f"{name}.{end}"].value for end in ("low", "high")]
            if None not in ends:
                axes.plot(
                    [factor * float(end or 0.0) for end in ends],
                    [place, place],
                    color=style["color"],
                    linewidth=2.0,
                )
            axes.plot(
                factor * value,
                place,
                marker="o" if j == 0 else "s",
                markersize=4,
                color=style["color"],
                linestyle="none",
                label=label if i == 0 else None,
            )
    dress(axes, title=says, x=f"{says.split()[0]} / {unit}", y="")
    axes.set_yticks(range(len(CONDITIONS)), list(CONDITIONS.values())[::-1])
    axes.set_xlim(left=0.0)
