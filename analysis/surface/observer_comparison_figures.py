"""How far off each observer is, and whether its band says so."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_style import PUBLISHED, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome

_TARGET: Final = 99.0  # %
_LOOK: Final = {
    "thesis": ("thesis", "#555555", "s"),
    "gated": ("gated", "#9a9a9a", "v"),
    "prior_weights": ("weights from the prior", "#b58900", "<"),
    "vision": ("the same, with a camera's prediction", "#7a0060", "P"),
    "curvature": ("curvature state", "#6fa0e8", ">"),
    "friction": ("friction-angle state", "#b00020", "X"),
    "adaptive": ("adaptive", "#e07b00", "o"),
    "adaptive_vision": ("adaptive, with the prediction", "#7a4100", "D"),
}


def plot_comparison(
    outcome: Outcome, *, cases: Mapping[str, bool], observers: Sequence[str]
) -> Figure:
    """Draw rms and coverage of each observer in each case, with the spread over the seeds.

    Args:
        outcome: With the metrics and a row of traces for each case, observer and seed.
        cases: Whether a case was kept apart when parameters were chosen.
        observers: In the traces' order.
    """
    figure = new_figure(12.0, 7.5)
    errors, coverage = figure.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    rows = np.arange(len(cases))
    offsets = np.linspace(-0.33, 0.33, len(observers))
    for j, observer in enumerate(observers):
        label, color, marker = _LOOK[observer]
        rms, low, high, covered = [], [], [], []
        for i, case in enumerate(cases):
            of = (outcome.traces["case"] == i) & (outcome.traces["observer"] == j)
            values = outcome.traces["rms"][of]
            rms.append(outcome.metrics[f"{case}.{observer}.rms"].value)
            low.append(float(np.percentile(values, 5)))
            high.append(float(np.percentile(values, 95)))
            covered.append(outcome.metrics[f"{case}.{observer}.coverage"].value)
        errors.hlines(rows + offsets[j], low, high, color=color, linewidth=2.2, alpha=0.45)
        for axes, values in ((errors, rms), (coverage, covered)):
            axes.plot(
                values, rows + offsets[j], marker, color=color, ms=5, label=label, clip_on=False
            )
    for axes in (errors, coverage):
        for row in rows[1:]:
            axes.axhline(row - 0.5, color="#dddddd", linewidth=0.8)
    coverage.axvline(_TARGET, label=f"asked for, {_TARGET:g} %", **PUBLISHED)
    dress(
        errors,
        title="Error of the normal: rms over all seeds, and 5 to 95 % of them",
        x="rms error / °",
        y="",
    )
    dress(coverage, title="Share of errors within 3 standard deviations", x="coverage / %", y="")
    for axes in (errors, coverage):
        axes.grid(False, axis="y")
    errors.set_xlim(left=0)
    coverage.set_xlim(0, 101)
    names = [
        f"{case.replace('_', ' ')}\n({'reported' if apart else 'tuned on'})"
        for case, apart in cases.items()
    ]
    errors.set_yticks(rows, names)
    errors.invert_yaxis()  # both share it
    legend(coverage, loc="upper left", bbox_to_anchor=(1.0, 1.0))
    return figure
