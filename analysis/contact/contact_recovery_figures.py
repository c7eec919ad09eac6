"""Lost contact: the force after a blow, and the bounces over the force integral."""

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.contact.loop_figures import note_stability
from chamfer.analysis.drawing.figure_style import (
    DESIRED,
    FORCE,
    LIMIT,
    POSITION,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.contact.planar_scenarios import RecoveryScenario
from chamfer.models.surfaces.damage import SAFE_SPEED

_WITHOUT = {"color": "#b00020", "linestyle": "--", "linewidth": 1.2}


def plot_recovery(scenario: RecoveryScenario, outcome: Outcome) -> Figure:
    """Draw force and distance after the blow, with and without the loss mode, and the bounces."""
    figure = new_figure(11.0, 7.5)
    panels = figure.subplot_mosaic([["force", "bounces"], ["distance", "bounces"]])
    blow = scenario.task.kick_time or 0.0
    for table, label, style in (
        (outcome.tables["without_loss_mode"], "force integral goes on", _WITHOUT),
        (outcome.traces, "loss mode", FORCE),
    ):
        shown = (table["time"] > blow - 0.1) & (table["time"] < blow + 2.0)
        time = table["time"][shown] - blow
        panels["force"].plot(time, table["force"][shown], label=label, **style)
        panels["distance"].plot(time, 1e3 * table["gap"][shown], label=label, **style)
    panels["force"].axhline(scenario.task.force, label="desired", **DESIRED)
    panels["distance"].axhline(0.0, **DESIRED)
    dress(panels["force"], title="(a) Force after a blow", x="", y="force / N")
    dress(
        panels["distance"],
        title="(b) Distance from the surface",
        x="time after the blow / s",
        y="distance / mm",
    )
    legend(panels["force"], loc="upper right")
    axes, table = panels["bounces"], outcome.tables["bounces"]
    gains = np.unique(table["force_integral"])
    for i, gain in enumerate(gains):
        of = table["force_integral"] == gain
        shade = 0.25 + 0.75 * i / max(1, len(gains) - 1)
        axes.semilogy(
            table["bounce"][of] + 1,
            table["speed"][of],
            marker="o",
            ms=4,
            label=f"{gain:g} 1/s",
            color=POSITION["color"],
            alpha=shade,
        )
    axes.axhline(SAFE_SPEED, label=f"safe for glass, {SAFE_SPEED:g} m/s", **LIMIT)
    dress(
        axes,
        title="(c) Without the loss mode, by force integral",
        x="impact",
        y="speed of the impact / (m/s)",
    )
    axes.yaxis.set_major_formatter("{x:g}")
    axes.yaxis.set_minor_formatter("{x:g}")
    legend(axes, loc="best")
    note_stability(figure, outcome)
    return figure
