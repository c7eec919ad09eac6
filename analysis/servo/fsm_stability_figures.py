"""The map of what settles, and the limit cycles beyond it."""

from typing import Final

import numpy as np
from matplotlib.colors import BoundaryNorm, ListedColormap
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from chamfer.analysis.drawing.figure_kit import Curve, ReferenceLine, draw_lines
from chamfer.analysis.drawing.figure_style import FSM, PUBLISHED, Style, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.servo.servo_scenario import StepScenario, fsm_axis

_VERDICTS = (
    ("settles", "#f5e6c8"),
    ("reverses, then settles", "#e8a13a"),
    ("cycles", "#5a2d00"),
    ("not finished", "#ffffff"),
)
_PREDICTED: Final[Style] = {
    "color": "#333333",
    "linestyle": "--",
    "marker": "s",
    "ms": 5,
    "mfc": "white",
}
_SIMULATED: Final[Style] = FSM | {"marker": "o", "ms": 4}


def plot_map(scenario: StepScenario, outcome: Outcome) -> Figure:
    """Draw what each cell does and, over it, what the theorem guarantees."""
    cells = outcome.traces
    x, y = np.unique(cells["dead_zone"]), np.unique(cells["increment"])
    shape = (len(x), len(y))
    figure = new_figure(9.0, 6.0)
    axes = figure.subplots()
    axes.pcolormesh(
        1e3 * x,
        1e3 * y,
        cells["verdict"].reshape(shape).T,
        cmap=ListedColormap([color for _, color in _VERDICTS]),
        norm=BoundaryNorm([-0.5, 0.5, 1.5, 2.5, 3.5], 4),
        shading="nearest",
        rasterized=True,
    )
    axes.set_yscale("log")
    share = cells["share"].reshape(shape).T
    axes.contour(1e3 * x, 1e3 * y, share, levels=[1.0], colors="black", linewidths=1.8)
    guaranteed = cells["guaranteed"].reshape(shape).T
    axes.contourf(1e3 * x, 1e3 * y, guaranteed, levels=[0.5, 1.5], colors="none", hatches=["////"])
    handles: list[Patch | Line2D] = [
        Patch(facecolor=color, edgecolor="#777777", label=label) for label, color in _VERDICTS
    ]
    handles += [
        Patch(facecolor="none", edgecolor="black", hatch="////", label="settling theorem holds"),
        Line2D([], [], color="black", linewidth=1.8, label="its bound on the small increment"),
    ]
    axis = fsm_axis(scenario, "position")
    axes.plot(
        1e3 * axis.dead_zone, 1e3 * axis.increment, "o", ms=9, mfc="white", mec="black", mew=2
    )
    handles.append(
        Line2D([], [], ls="", marker="o", ms=9, mfc="white", mec="black", label="scenario")
    )
    resolution = 1e3 * scenario.camera.resolution
    title = (
        "Simulation against the settling theorem, worst trial of each cell\n"
        f"(the steps are the camera's resolution, {resolution:g} mm)"
    )
    dress(axes, title=title, x="dead zone / mm", y="large increment n / mm per tick")
    ticks = [2, 5, 10, 20, 50]
    axes.set_yticks(ticks, [str(tick) for tick in ticks])
    axes.set_yticks([], minor=True)
    figure.legend(handles=handles, loc="outside lower center", ncols=3, fontsize=8, frameon=False)
    return figure


def plot_limit_cycles(outcome: Outcome) -> Figure:
    """Draw frequency and amplitude of the limit cycles, predicted and simulated."""
    cycles = outcome.tables["limit_cycles"]
    figure = new_figure(10.0, 4.2)
    left, right = figure.subplots(1, 2)
    for axes, name, scale, title, unit in (
        (left, "frequency", 1.0, "(a) Frequency of the limit cycle", "frequency / (rad/s)"),
        (right, "amplitude", 1e3, "(b) Amplitude of the limit cycle", "amplitude / mm"),
    ):
        draw_lines(
            axes,
            cycles["share"],
            [
                Curve(scale * cycles[f"predicted_{name}"], "describing function", _PREDICTED),
                Curve(scale * cycles[f"measured_{name}"], "simulation", _SIMULATED),
            ],
            title=title,
            y=unit,
            over="increment / that of the bound",
            levels=[ReferenceLine(1.0, "bound of the settling theorem", PUBLISHED, upright=True)],
        )
        axes.set_xscale("log")
        axes.margins(y=0.15)
        axes.set_ylim(bottom=0)
        axes.set_xticks([1, 2, 5, 10], ["1", "2", "5", "10"])
    legend(left, loc="lower left")
    return figure
