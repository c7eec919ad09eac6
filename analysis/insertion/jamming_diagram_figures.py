"""Parallelograms over depth with loads of insertions, and how far from the sides the loads are."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_style import LIMIT, Style, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.models.peg.peg_hole_geometry import PegHoleGeometry
from chamfer.models.peg_theory.wedging import jamming_vertices

_COLOURS: Final = ("#b00020", "#e07b00", "#1b7f5c", "#1b4f9c", "#8f5bb5")
_NEAR: Final = 0.04  # of a depth ratio, loads that are drawn into its parallelogram
_MOVING: Final[Style] = {"marker": "o", "linestyle": "none", "markersize": 3}
_STOPPED: Final[Style] = {"marker": "x", "linestyle": "none", "markersize": 5}
_FEW: Final = 60  # loads of a kind that are drawn


def plot_jamming(
    parts: PegHoleGeometry, depth_ratios: Sequence[float], outcome: Outcome
) -> Figure:
    """Draw the loads at several depths, and the level of all loads over the depth.

    Args:
        parts: Peg and hole.
        depth_ratios: lambda of the parallelograms.
        outcome: With a row a load.
    """
    figure = new_figure(12.0, 5.6)
    diagram, levels = figure.subplots(1, 2)
    traces = outcome.traces
    moving = traces["moving"] > 0
    for k, ratio in enumerate(depth_ratios):
        colour = _COLOURS[k % len(_COLOURS)]
        corners = jamming_vertices(parts, ratio * parts.wedging_depth)
        closed = np.vstack([corners, corners[:1]])
        diagram.plot(*closed.T, color=colour, label=rf"slides at $\lambda$ = {ratio:g}")
        near = np.abs(traces["depth_ratio"] / ratio - 1) < _NEAR
        for of, style in ((near & moving, _MOVING), (near & ~moving, _STOPPED)):
            rows = np.flatnonzero(of)
            rows = rows[:: max(1, len(rows) // _FEW)]
            diagram.plot(
                traces["force_ratio"][rows], traces["moment_ratio"][rows], color=colour, **style
            )
    dress(
        diagram,
        title="(a) Loads of simulated pegs: dots move, crosses are stopped",
        x="$F_x / F_z$",
        y="$M / (r F_z)$",
    )
    legend(diagram, loc="upper right")
    for of, style, label in (
        (moving, _MOVING, "moves"),
        (~moving, _STOPPED, "stopped by the cap"),
    ):
        colour = "#1b4f9c" if label == "moves" else "#b00020"
        levels.plot(
            traces["depth_ratio"][of], traces["level"][of], color=colour, label=label, **style
        )
    levels.axhline(1.0, label="sides of the parallelogram", **LIMIT)
    dress(
        levels,
        title="(b) Level of every load: below 1 it slides, above it jams",
        x=r"$\lambda = l / (2 r \mu)$",
        y="level",
    )
    levels.set_ylim(0.0, None)
    legend(levels)
    return figure
