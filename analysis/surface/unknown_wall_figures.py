"""An arm along an unknown wall: the way, the force and the normal, with Fig. 5-8's numbers."""

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.contact.contact_figures import note_stability
from chamfer.analysis.drawing.figure_style import (
    BAND,
    CONTACT_LOST,
    DESIRED,
    FORCE,
    NOTE,
    POSITION,
    PUBLISHED,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.published.hybrid_force_position_observer import FIG_5_8_BAND, FIG_5_8_FORCE
from chamfer.analysis.scenario.experiment import Outcome, Table
from chamfer.analysis.surface.normal_metrics import BAND as DEVIATIONS
from chamfer.analysis.surface.normal_metrics import TOLERANCE
from chamfer.analysis.surface.surface_figures import ESTIMATE, TRUTH, UNCERTAIN
from chamfer.diagrams.surface.unknown_wall_scenario import UnknownWallScenario
from chamfer.systems.force.contact_detection import CONTACT, LOST

Array = NDArray[np.float64]

_BESIDE: Final = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}
_ARROWS: Final = 9  # estimates drawn along the way
_NEWTON: Final = 20  # iterations to the wall's outline
_MOST_ERROR: Final = 30.0  # deg, the axis' end


def plot_wall(scenario: UnknownWallScenario, outcome: Outcome) -> Figure:
    """Draw the first run: its way along the wall, the force and the estimated normal."""
    traces = outcome.traces
    figure = new_figure(11.0, 11.0)
    panels = dict(
        zip(
            ("way", "force", "normal", "gap"),
            figure.subplots(4, 1, height_ratios=(4, 3, 3, 2)),
            strict=True,
        )
    )
    for name in ("force", "normal"):
        panels[name].sharex(panels["gap"])
    _way(panels["way"], scenario, traces)
    _force(panels["force"], scenario, traces)
    _normal(panels["normal"], scenario, traces)
    _gap(panels["gap"], scenario, traces, outcome)
    panels["gap"].set_xlim(0, scenario.duration)
    note_stability(figure, outcome)
    return figure


def _way(axes: Axes, scenario: UnknownWallScenario, traces: Table) -> None:
    along, across = 1e3 * traces["along"], 1e3 * traces["across"]
    touched = np.flatnonzero(traces["mode"] == CONTACT)
    low, high = float(along.min()), float(along.max())
    margin = 0.1 * (high - low) + 1.0
    s = np.linspace(low - margin, high + margin, 200)
    axes.fill_between(s, _outline(scenario, traces, s), across.min() - margin, **BAND)
    axes.plot(s, _outline(scenario, traces, s), label="wall, unknown to the arm", **TRUTH)
    axes.axhline(0.0, label="wall as it is believed", **DESIRED)
    axes.plot(along, across, label="tip", **POSITION)
    if len(touched):
        rows = touched[np.linspace(0, len(touched) - 1, _ARROWS).astype(int)]
        normals = np.stack([traces[f"normal_{axis}"][rows] for axis in "xyz"], axis=1)
        axes.quiver(
            along[rows],
            across[rows],
            normals @ scenario.spatial_along,
            normals @ scenario.spatial_up,
            color=ESTIMATE["color"],
            width=0.006,
            label="estimated normal",
        )
    axes.set_aspect("equal")
    axes.set_xlim(low - margin, high + margin)
    dress(axes, title="(a) The way", x="along / mm", y="out of the wall / mm")
    legend(axes, **_BESIDE)


def _outline(scenario: UnknownWallScenario, traces: Table, s: Array) -> Array:
    """Return how far out the wall is at places along it, mm."""
    wall, up = scenario.make_surface(), scenario.spatial_up
    point = np.array([traces[f"point_{axis}"][0] for axis in "xyz"])
    origin = point - traces["along"][0] * scenario.spatial_along - traces["across"][0] * up
    heights = []
    for place in 1e-3 * s:
        p = origin + place * scenario.spatial_along
        for _ in range(_NEWTON):
            p = p - wall.level(p) / float(wall.gradient(p) @ up) * up
        heights.append(1e3 * float((p - origin) @ up))
    return np.array(heights)


def _force(axes: Axes, scenario: UnknownWallScenario, traces: Table) -> None:
    time, desired = traces["time"], scenario.task.force
    off = TOLERANCE * desired
    axes.fill_between(
        time, desired - off, desired + off, label=f"within {100 * TOLERANCE:g} %", **BAND
    )
    axes.plot(time, traces["force"], label="true normal force", **FORCE)
    axes.axhline(desired, label=f"desired, {desired:g} N", **DESIRED)
    if desired == FIG_5_8_FORCE.desired:
        for value in (FIG_5_8_FORCE.low, FIG_5_8_FORCE.high):
            axes.axhline(value, label=f"Fig. 5-8, {value:g} N", **PUBLISHED)
    _shade(axes, traces)
    axes.set_ylim(-0.1 * desired, 2.2 * desired)
    peak = float(traces["peak_force"].max())
    if peak > 2.2 * desired:
        axes.annotate(f"peak {peak:.3g} N", (0.01, 0.92), xycoords="axes fraction", **NOTE)
    dress(axes, title="(b) Contact force (first seed)", x="", y="force / N")
    legend(axes, **_BESIDE)


def _normal(axes: Axes, scenario: UnknownWallScenario, traces: Table) -> None:
    time, band = traces["time"], traces["band"]
    axes.fill_between(
        time, 0 * band, band, label=f"{DEVIATIONS:g} standard deviations", **UNCERTAIN
    )
    axes.plot(time, traces["error"], label=f"error, {scenario.observer.kind}", **ESTIMATE)
    axes.axhline(FIG_5_8_BAND, label=f"band of Fig. 5-8, {FIG_5_8_BAND:g}°", **PUBLISHED)
    _shade(axes, traces)
    axes.set_ylim(0, _MOST_ERROR)
    dress(axes, title="(c) Angle between estimated and true normal", x="", y="angle / °")
    legend(axes, **_BESIDE)


def _gap(axes: Axes, scenario: UnknownWallScenario, traces: Table, outcome: Outcome) -> None:
    axes.plot(traces["time"], 1e3 * traces["gap"], label="distance", **POSITION)
    axes.axhline(0.0, **DESIRED)
    _shade(axes, traces)
    axes.set_yscale("symlog", linthresh=1.0)
    axes.yaxis.set_major_formatter("{x:g}")
    impact = outcome.metrics["impact.speed"].value
    if impact is not None:
        axes.annotate(
            f"impact {impact:.3g} m/s", (0.99, 0.9), xycoords="axes fraction", ha="right", **NOTE
        )
    dress(axes, title="(d) Distance of the tip from the wall", x="time / s", y="distance / mm")


def _shade(axes: Axes, traces: Table) -> None:
    lost = traces["mode"] == LOST
    if np.any(lost):
        axes.fill_between(
            traces["time"],
            0,
            1,
            where=lost.tolist(),
            transform=axes.get_xaxis_transform(),
            label="contact lost",
            **CONTACT_LOST,
        )
