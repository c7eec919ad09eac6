"""Force and wrist angle with the wrist's integrator on and off."""

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.contact.loop_figures import note_stability
from chamfer.analysis.drawing.figure_style import (
    DESIRED,
    FORCE,
    POSITION,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.contact.adept_scenarios import WristContentionScenario


def plot_contention(scenario: WristContentionScenario, outcome: Outcome) -> Figure:
    """Draw force and wrist error of both runs."""
    figure = new_figure(11.0, 6.5)
    force, angle = figure.subplots(2, 1, sharex=True)
    for table, label, style in (
        (outcome.traces, "integrator on", POSITION),
        (outcome.tables["wrist_integrator_off"], "integrator off in contact", FORCE),
    ):
        force.plot(table["time"], table["force"], label=label, **style)
        error = np.degrees(table["desired_phi"] - table["phi"])
        angle.plot(table["time"], error, label=label, **style)
    force.axhline(scenario.task.force, label="desired", **DESIRED)
    angle.axhline(0.0, **DESIRED)
    force.set_ylim(bottom=0)
    angle.set_xlim(0, scenario.duration)
    dress(force, title="(a) Contact force", x="", y="force / N")
    dress(angle, title="(b) Wrist", x="time / s", y="desired minus actual / degrees")
    legend(force, loc="lower right")
    note_stability(figure, outcome)
    return figure
