"""Success, time and force of skills that lack one of their primitives, side by side."""

from collections.abc import Sequence

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_style import FORCE, LIMIT, dress, new_figure
from chamfer.analysis.scenario.experiment import Outcome


def plot_ablation(outcome: Outcome, skills: Sequence[str]) -> Figure:
    """Draw the rate of success, the duration and the peak force of every skill.

    Args:
        outcome: Metrics ``<skill>.<metric>``; rows with a column ``skill``.
        skills: Their names, the whole one first.
    """
    figure = new_figure(11.0, 1.6 + 0.45 * len(skills))
    rate, duration, force = figure.subplots(1, 3, sharey=True)
    places = np.arange(len(skills))
    for place, name in zip(places, skills, strict=True):
        found = [
            outcome.metrics[f"{name}.success_rate{end}"].value for end in ("", ".low", ".high")
        ]
        known = [one for one in found if one is not None]
        if len(known) == len(found):
            middle, low, high = known
            rate.plot([low, high], [place, place], color=FORCE["color"], linewidth=2)
            rate.plot([middle], [place], "o", color=FORCE["color"])
        own = outcome.traces["skill"] == name
        for axes, values in (
            (duration, outcome.traces["duration"]),
            (force, outcome.traces["force.peak_share"]),
        ):
            axes.plot(values[own], np.full(own.sum(), place), "|", color=FORCE["color"])
            axes.plot([values[own].mean()], [place], "o", color=FORCE["color"])
    rate.set_yticks(places, [name.replace("_", " ") for name in skills])
    rate.set_ylim(len(skills) - 0.5, -0.5)
    rate.set_xlim(-3, 103)
    force.axvline(1.0, **LIMIT)
    for axes in (duration, force):
        axes.set_xlim(left=0.0)
    dress(rate, title="(a) Success, 95 % interval", x="runs with a free way / %", y="")
    dress(duration, title="(b) Duration, runs and mean", x="time / s", y="")
    dress(force, title="(c) Peak force, runs and mean", x="force / true mating force", y="")
    return figure
