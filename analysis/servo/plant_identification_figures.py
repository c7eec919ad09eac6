"""The family of plants behind Fig. 8."""

from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_style import PID, PUBLISHED, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome

_PAPERS_STIFFNESS = 700.0  # N/m, K_p of section 5


def plot_family(outcome: Outcome) -> Figure:
    """Draw mass, damping and damping ratio over the stiffness."""
    table = outcome.traces
    figure = new_figure(10.0, 3.6)
    panels = figure.subplots(1, 3)
    for axes, name, title, label in zip(
        panels,
        ("mass", "damping", "damping_ratio"),
        ("(a) Mass", "(b) Damping", "(c) Damping ratio"),
        ("mass / kg", "damping / (N s/m)", "damping ratio"),
        strict=True,
    ):
        axes.plot(table["stiffness"], table[name], marker="o", ms=4, label="identified", **PID)
        axes.axvline(_PAPERS_STIFFNESS, label="the paper's stiffness", **PUBLISHED)
        dress(axes, title=title, x="stiffness / (N/m)", y=label)
    legend(panels[0], loc="upper left")
    return figure
