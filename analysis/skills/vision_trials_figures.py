"""Section 3.1: how vision primitives settle with wrong cameras, and how wrong they may be."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_kit import Curve, ReferenceLine, draw_lines, trial_curves
from chamfer.analysis.drawing.figure_style import DESIRED, Style, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome

_COURSE: Final[Style] = {"color": "#1b4f9c", "linewidth": 0.7, "alpha": 0.6}
_SHADES: Final = ListedColormap(["#f3d3c8", "#f5ead0", "#d4e3f3"])  # none, some, all settle
_LEAST: Final = 1e-2  # mm or mrad, below which the panels show nothing


class _Panel(NamedTuple):
    name: str
    title: str
    column: str
    label: str


_PANELS: Final = (
    _Panel("translation", "Translation along x, y, z", "error_m", "tip to goal / mm"),
    _Panel("rotation", "Rotation: alignment of lines", "error_rad", "axis to axis / mrad"),
    _Panel("fixed_point", "Rotation about a fixed point", "error_rad", "turn left / mrad"),
    _Panel("grasp", "Visual grasp, eye in hand", "error_m", "centre to centre / mm"),
)


def plot_vision_primitives(outcome: Outcome, *, names: Sequence[str], wrong: str) -> Figure:
    """Draw the errors of all trials over time, the held point, and the map of calibration."""
    figure = new_figure(13.5, 7.6)
    figure.suptitle(f"True errors of all trials; {wrong}", fontsize=11)
    grid = figure.add_gridspec(2, 8)
    for i, panel in enumerate(_PANELS):
        axes = figure.add_subplot(grid[0, 2 * i : 2 * i + 2])
        courses = _courses(outcome, names.index(panel.name), panel.column)
        share = outcome.metrics[f"{panel.name}.converged"]
        title = f"({'abcd'[i]}) {panel.title}\n{share.note} settle"
        draw_lines(axes, (), courses, title=title, y=panel.label)
        axes.set_yscale("log")
        axes.set_ylim(bottom=_LEAST)
    axes = figure.add_subplot(grid[1, :3])
    alone = outcome.metrics["fixed_point.unheld.max"].value
    levels = []
    if alone is not None:
        label = "largest, if the point was not held"
        levels = [ReferenceLine(1e3 * alone, label, DESIRED)]
    draw_lines(
        axes,
        (),
        _courses(outcome, names.index("fixed_point"), "error_m"),
        title="(e) The fixed point, on the way",
        y="point from start / mm",
        levels=levels,
        key="center right" if levels else None,
    )
    axes.set_ylim(bottom=0.0)
    _draw_map(figure.add_subplot(grid[1, 3:]), outcome)
    return figure


def _courses(outcome: Outcome, primitive: int, column: str) -> list[Curve]:
    table = outcome.tables["courses"]
    of = table["primitive"] == primitive
    columns = table["time"][of], 1e3 * table[column][of], table["trial"][of]
    return trial_curves(*columns, _COURSE)


def _draw_map(axes: Axes, outcome: Outcome) -> None:
    cells = outcome.tables["map"]
    focal, angle = np.unique(cells["focal_factor"]), np.unique(cells["angle"])
    share = np.empty((len(angle), len(focal)))
    for i, one in enumerate(angle):
        for j, other in enumerate(focal):
            of = (cells["angle"] == one) & (cells["focal_factor"] == other)
            share[i, j] = np.mean(cells["converged"][of])
            roots = cells["theory_root"][of]
            # Beside each other, a mark for each trial.
            for k, root in enumerate(roots):
                x = j + 0.5 * ((k + 0.5) / len(roots) - 0.5)
                marker = "o" if root < 1 else "x"
                axes.plot(x, i, marker, color="#555555", mfc="none", ms=5)
    shades = np.where(share == 0, 0, np.where(share < 1, 1, 2))
    axes.pcolormesh(
        np.arange(len(focal) + 1) - 0.5,
        np.arange(len(angle) + 1) - 0.5,
        shades,
        cmap=_SHADES,
        vmin=0,
        vmax=2,
        edgecolors="white",
        linewidth=1.0,
    )
    axes.set_xticks(range(len(focal)), [f"{one:g}" for one in focal])
    axes.set_yticks(range(len(angle)), [f"{np.degrees(one):.0f}" for one in angle])
    for style, label in (("o", "theory: settles"), ("x", "theory: does not")):
        axes.plot([], [], style, color="#555555", mfc="none", ms=5, label=label)
    legend(axes, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2)
    title = "(f) Translation: blue, all settle; yellow, some; red, none"
    dress(
        axes,
        title=title,
        x="believed focal length / true one",
        y="orientation error / degrees",
    )
