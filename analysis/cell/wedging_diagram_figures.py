"""The wedging diagram, its neighbourhood of the published errors, and the insertion force."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from chamfer.analysis.drawing.figure_style import (
    LIMIT,
    PUBLISHED,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Outcome, Table
from chamfer.models.peg.peg_and_hole import PegHoleGeometry
from chamfer.models.peg_theory.planar_statics import Contact

Array = NDArray[np.float64]
Points = tuple[Array, Array]  # lateral error, m, and rotation, rad

STARTS: Final[dict[str, tuple[str, Style]]] = {
    "published_mean": ("mean of the ten runs", {"color": "#1b7f5c", "marker": "o"}),
    "published_worst": ("largest of the ten runs", {"color": "#b00020", "marker": "s"}),
    "wedging_prone": ("wedging-prone start, assumed", {"color": "#444444", "marker": "X"}),
}
_EXACT: Final[Style] = {"color": "#1b4f9c", "linestyle": "-", "linewidth": 1.8}
_SIMPLE: Final[Style] = {"color": "#1b4f9c", "linestyle": (0, (4, 2)), "linewidth": 1.2}
_REGION: Final[Style] = {"color": "#dfe7f2", "linewidth": 0}
_GUIDED: Final[Style] = {"color": "#bccde8", "linewidth": 0}
_WEDGE: Final[Style] = {"color": "#b00020", "alpha": 0.10, "linewidth": 0}
_OTHERS: Final = ("#e07b00", "#8f5bb5", "#7a7a7a", "#2a9d9d")
_ENDS: Final[Style] = {"color": "black", "marker": ".", "linestyle": "none", "markersize": 5}
_ARMS: Final[Style] = {"color": "black", "linewidth": 1.2, "linestyle": (0, (1, 1))}
_BELOW: Final[Style] = {"loc": "upper center", "bbox_to_anchor": (0.5, -0.2)}
_MM: Final = 1e3
_MRAD: Final = 1e3


def plot_wedging(
    parts: PegHoleGeometry,
    starts: Mapping[str, tuple[float, float]],
    outcome: Outcome,
    ends: Points | None = None,
) -> Figure:
    """Draw the diagram, its part with the published errors, and force over depth.

    Args:
        parts: Peg, hole and support.
        starts: Lateral error, m, and rotation, rad, of each of ``STARTS``.
        outcome: With the table of boundaries and a trace of every start.
        ends: Where simulated alignments ended, drawn too if given.
    """
    figure = new_figure(12.0, 6.6)
    grid = figure.add_gridspec(2, 2, width_ratios=(1.25, 1.0))
    whole = figure.add_subplot(grid[:, 0])
    near = figure.add_subplot(grid[0, 1])
    force = figure.add_subplot(grid[1, 1])
    table = outcome.tables["boundaries"]
    for axes in (whole, near):
        _region(axes, parts, table)
        _starts(axes, starts)
        if ends is not None:
            _arms(axes, parts, outcome.tables["arms"])
            _points(axes, ends)
    _margins(near, starts, outcome)
    limits = parts.lateral_limit, parts.rotation_limit
    box = Rectangle(
        (-limits[0] * _MM, -limits[1] * _MRAD),
        2 * limits[0] * _MM,
        2 * limits[1] * _MRAD,
        fill=False,
        label="published limits: the no-wedge box",
        **PUBLISHED,
    )
    whole.add_patch(box)
    near.axhline(parts.rotation_limit * _MRAD, **PUBLISHED)
    x, y = "initial lateral error / mm", "initial rotation / mrad"
    dress(whole, title="(a) Free of wedging: shaded", x=x, y=y)
    dress(near, title="(b) Near the published errors, with the margins left", x=x, y=y)
    edge = 1.1 * max(parts.lateral_limit, parts.chamfer_limit) * _MM
    whole.set_xlim(-edge, edge)
    tallest = np.max(np.abs(table["exact_upper"]), where=_own(table), initial=0.0)
    whole.set_ylim(*(np.array([-1.0, 1.0]) * 1.05 * tallest * _MRAD))
    _focus(near, parts, starts, ends)
    legend(whole, ncols=2, **_BELOW | {"bbox_to_anchor": (0.5, -0.09)})
    _force(force, parts, outcome)
    return figure


def _own(table: Table) -> NDArray[np.bool_]:
    """Say which rows belong to the parts' own compliance centre, the first."""
    own: NDArray[np.bool_] = table["centre_distance"] == table["centre_distance"][0]
    return own


def _region(axes: Axes, parts: PegHoleGeometry, table: Table) -> None:
    """Shade what is free of wedging, darker what the chamfer reaches, and draw its sides."""
    chamfer = parts.chamfer_limit * _MM
    axes.axvline(-chamfer, **LIMIT)
    axes.axvline(
        chamfer, label=f"reach of chamfers of {parts.chamfer_width * _MM:g} mm, assumed", **LIMIT
    )
    reached = np.abs(table["lateral"]) <= max(parts.lateral_limit, parts.chamfer_limit)
    own = _own(table)
    x, lower, upper = (
        table[name][own & reached] * scale
        for name, scale in (("lateral", _MM), ("exact_lower", _MRAD), ("exact_upper", _MRAD))
    )
    axes.fill_between(x, lower, upper, **_REGION)
    axes.fill_between(x, lower, upper, where=np.abs(x) <= chamfer, **_GUIDED)
    _sides(axes, table, own & reached, "exact", _EXACT)
    _sides(axes, table, own & reached, "simple", _SIMPLE)
    for i, distance in enumerate(dict.fromkeys(table["centre_distance"][~own].tolist())):
        style: Style = {"color": _OTHERS[i % len(_OTHERS)], "linewidth": 1.0}
        other = (table["centre_distance"] == distance) & reached
        _sides(axes, table, other, "simple", style)


def _sides(axes: Axes, table: Table, rows: NDArray[np.bool_], form: str, style: Style) -> None:
    distance = table["centre_distance"][rows][0] * _MM
    x = table["lateral"][rows] * _MM
    label = f"{form} sides, $L_g$ {distance:.4g} mm"
    axes.plot(x, table[f"{form}_upper"][rows] * _MRAD, label=label, **style)
    axes.plot(x, table[f"{form}_lower"][rows] * _MRAD, **style)


def _starts(axes: Axes, starts: Mapping[str, tuple[float, float]]) -> None:
    for name, (lateral, rotation) in starts.items():
        label, style = STARTS[name]
        axes.plot(
            lateral * _MM, rotation * _MRAD, linestyle="none", ms=6, label=label, zorder=4, **style
        )


def _margins(axes: Axes, starts: Mapping[str, tuple[float, float]], outcome: Outcome) -> None:
    """Write the margins, away from the region's side that they are measured to."""
    for name, (lateral, rotation) in starts.items():
        margin = outcome.metrics[f"{name}.margin"].value
        if margin is not None:
            axes.annotate(
                f"{margin:.0f} %",
                (lateral * _MM, rotation * _MRAD),
                (5, -11 if margin * rotation >= 0 else 5),
                textcoords="offset points",
                fontsize=8,
                color=STARTS[name][1]["color"],
            )


def _arms(axes: Axes, parts: PegHoleGeometry, table: Table) -> None:
    """Draw the sides for the support that the arms are where the simulated ends belong."""
    reached = np.abs(table["lateral"]) <= max(parts.lateral_limit, parts.chamfer_limit)
    x, lower, upper = (
        table[name][reached] * scale
        for name, scale in (("lateral", _MM), ("exact_lower", _MRAD), ("exact_upper", _MRAD))
    )
    axes.plot(x, upper, label="exact sides, the arms of the simulation", **_ARMS)
    axes.plot(x, lower, **_ARMS)


def _points(axes: Axes, ends: Points) -> None:
    lateral, rotation = ends
    axes.plot(lateral * _MM, rotation * _MRAD, label="simulated alignments", zorder=3, **_ENDS)


def _focus(
    axes: Axes,
    parts: PegHoleGeometry,
    starts: Mapping[str, tuple[float, float]],
    ends: Points | None,
) -> None:
    """Show the quadrant of the starts, and every simulated end."""
    lateral, rotation = (np.array(values) for values in zip(*starts.values(), strict=True))
    if ends is not None:
        lateral, rotation = np.append(lateral, ends[0]), np.append(rotation, ends[1])
    right = max(1.5 * float(lateral.max()), 0.0)
    top = max(1.2 * float(rotation.max()), 1.2 * parts.rotation_limit)
    axes.set_xlim(min(0.0, 1.1 * float(lateral.min())) * _MM, right * _MM)
    axes.set_ylim(min(0.0, 1.1 * float(rotation.min())) * _MRAD, top * _MRAD)


def _force(axes: Axes, parts: PegHoleGeometry, outcome: Outcome) -> None:
    traces = outcome.traces
    axes.axvspan(
        0.0, parts.wedging_depth * _MM, label=r"two points may wedge, $\lambda \leq 1$", **_WEDGE
    )
    for i, (label, style) in enumerate(STARTS.values()):
        of = traces["start"] == i
        depth, force = traces["depth"][of] * _MM, traces["force"][of]
        axes.plot(depth, force, color=style["color"], linewidth=1.6, label=label)
        two = np.flatnonzero(traces["contact"][of] == Contact.TWO_POINT)
        if two.size:
            at = two[0]
            axes.plot(depth[at], force[at], linestyle="none", ms=6, **style)
    dress(
        axes,
        title="(c) Force down, if it slides on; marks: two points touch",
        x="depth of the tip in the bore / mm (negative: on the chamfer)",
        y="insertion force / N",
    )
    axes.set_ylim(0.0, 1.08 * float(np.nanmax(traces["force"])))
    legend(axes, ncols=2, **_BELOW)
