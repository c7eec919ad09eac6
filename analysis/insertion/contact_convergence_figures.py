"""Force and depth of an insertion over what the solver is told."""

from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_style import PUBLISHED, Style, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome

_TITLES: Final = {
    "steps": "step / s",
    "stiffnesses": "stiffness / (N/m)",
    "facets": "facets",
    "stictions": "stiction / (m/s)",
    "approximations": "approximation",
    "accuracies": "CENIC's accuracy",
}
_STARTS: Final[tuple[tuple[str, Style], ...]] = (
    ("sliding", {"color": "#1b4f9c", "marker": "o", "linestyle": "-"}),
    ("stuck", {"color": "#e07b00", "marker": "s", "linestyle": "--"}),
)
_RAW: Final[Style] = {"marker": "x", "linestyle": "none"}
_MM: Final = 1e3


def plot_convergence(values: Mapping[str, Sequence[str]], outcome: Outcome) -> Figure:
    """Draw forces above depths, one column a parameter.

    Args:
        values: Of each parameter, as they are to be written.
        outcome: With a row a run.
    """
    figure = new_figure(14.0, 6.0)
    panels = figure.subplots(2, len(values), squeeze=False, sharey="row")
    traces = outcome.traces
    statics = outcome.metrics["sliding.predicted.force.axial"].value
    for k, (parameter, names) in enumerate(values.items()):
        for i, (start, style) in enumerate(_STARTS):
            of = (traces["parameter"] == k) & (traces["start"] == i)
            x = np.arange(np.count_nonzero(of))
            label = f"{start} start"
            panels[0, k].plot(x, traces["force"][of], label=label, **style)
            raw = {**_RAW, "color": style["color"]}
            panels[0, k].plot(x, traces["raw_peak"][of], label=f"{label}, raw peak", **raw)
            panels[1, k].plot(x, traces["depth"][of] * _MM, label=label, **style)
        if statics is not None:
            panels[0, k].axhline(statics, label="exact statics, sliding start", **PUBLISHED)
        for axes, y in zip(panels[:, k], ("axial force / N", "depth / mm"), strict=True):
            dress(axes, title="", x=_TITLES[parameter], y="" if k else y)
            axes.set_xticks(range(len(names)), names, fontsize=7)
        panels[0, k].set_yscale("log")
    legend(panels[0, 0])
    return figure
