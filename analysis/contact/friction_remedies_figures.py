"""What each remedy leaves of the deviations."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_style import FORCE, POSITION, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome

_LABELS: Final = {
    "none": "as it is",
    "rubber_cover": "rubber cover",
    "decoupling": "sensor decoupled",
    "full_dynamics": "full dynamics",
    "half_friction": "half the friction",
    "compensation": "friction compensated",
    "compensation_decoupling": "compensated, decoupled",
    "all": "all three",
    "no_friction": "no friction",
    "no_friction_decoupling": "no friction, decoupled",
}


def plot_remedies(tests: Sequence[str], remedies: Sequence[str], outcome: Outcome) -> Figure:
    """Draw force deviation and position error for each test and remedy, a dot a seed."""
    figure = new_figure(11.0, 7.0)
    panels = figure.subplots(2, 2, sharey=True, width_ratios=(3, 2))
    traces = outcome.traces
    rows = np.arange(len(remedies))
    for i, test in enumerate(tests):
        of = traces["test"] == i
        remedy = traces["remedy"][of]
        force, position = panels[i]
        for name, label, offset, color in (
            ("measured", "measured, with sensor noise and cross-talk", -0.2, FORCE["color"]),
            ("true", "true", 0.2, POSITION["color"]),
        ):
            values = traces[name][of]
            mean = [float(values[remedy == j].mean()) for j in rows]
            force.barh(rows + offset, mean, height=0.36, color=color, alpha=0.55, label=label)
            force.plot(values, remedy + offset, ".", color=color, ms=4)
        values = 1e3 * traces["position"][of]
        mean = [float(values[remedy == j].mean()) for j in rows]
        position.barh(rows, mean, height=0.5, color="#9a9a9a", alpha=0.6)
        position.plot(values, remedy, ".", color="#555555", ms=4)
        dress(
            force,
            title=f"{test}: largest deviation of the force",
            x="force / N",
            y="",
        )
        dress(position, title=f"{test}: largest position error", x="error / mm", y="")
        force.set_yticks(rows, [_LABELS[name] for name in remedies])
    panels[0, 0].invert_yaxis()  # all share it
    legend(panels[0, 0], loc="lower right")
    return figure
