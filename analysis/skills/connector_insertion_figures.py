"""Commands, motion, forces and depth of an insertion, state by state."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_style import (
    DESIRED,
    FORCE,
    LIMIT,
    POSITION,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Table

_COMMAND: Final[Style] = {"color": "#111111", "linestyle": "-", "linewidth": 0.9, "zorder": 3}
_MOTION: Final[Style] = {"color": "#e07b00", "linestyle": "-", "linewidth": 1.4}
_BAND: Final = ("#ffffff", "#eceff4")
_BAD: Final = ("jammed", "timed out", "failed")
_TORQUES: Final = {"rx": "#1b4f9c", "ry": "#e07b00", "rz": "#4a8c3a"}
_BESIDE: Final = 0.01  # m, from which on a plug is not above its socket
_NAMES: Final = 7.5  # pt
_APART: Final = 0.0125  # of the width, of two names


def plot_insertion(
    traces: Table,
    path: Table,
    *,
    states: Sequence[str],
    mated: float,
    mating_force: float,
) -> Figure:
    """Draw V_cmd and V_ref axis by axis as the paper does, forces, torques and the depth."""
    figure = new_figure(12.0, 14.0)
    heights = [1.15, *(0.8,) * 6, 1.15, 0.9, 1.15]
    panels: list[Axes] = list(figure.subplots(len(heights), 1, sharex=True, height_ratios=heights))
    time = traces["time"]
    visits = state_visits(traces, path, states)
    _draw_states(panels[0], visits, float(time[-1]))
    for axes in panels[1:]:
        for i, (begin, end, _) in enumerate(visits):
            axes.axvspan(begin, end, color=_BAND[i % 2], linewidth=0, zorder=0)
    linear, angular = (1e3, "mm/s"), (1.0, "rad/s")
    rows = [*((axis, linear) for axis in "xyz"), *((f"r{axis}", angular) for axis in "xyz")]
    for axes, (axis, (scale, unit)) in zip(panels[1:7], rows, strict=True):
        axes.plot(time, scale * traces[f"V_ref_{axis}"], label=r"$V_{ref}$", **_MOTION)
        axes.plot(time, scale * traces[f"V_cmd_{axis}"], label=r"$V_{cmd}$", **_COMMAND)
        what = f"about {axis[1]}" if len(axis) > 1 else f"along {axis}"
        _dress(axes, f"{what}\n{unit}")
    _legend(panels[1])
    force, torque, depth = panels[7:]
    force.plot(time, traces["wrench_z"], **FORCE)
    force.axhline(mating_force, label=f"mating force, {mating_force:.3g} N", **LIMIT)
    _dress(force, "push\nN")
    _legend(force)
    for axis, colour in _TORQUES.items():
        label = f"about {axis[1]}"
        torque.plot(time, traces[f"wrench_{axis}"], color=colour, linewidth=1.0, label=label)
    _dress(torque, "torque\nN m")
    _legend(torque)
    beside = np.hypot(traces["lateral_x"], traces["lateral_y"]) > _BESIDE
    deep = np.where(beside, np.nan, 1e3 * traces["depth"])
    depth.plot(time, deep, label="depth, of a plug above its socket", **POSITION)
    depth.axhline(1e3 * mated, label=f"mated, {1e3 * mated:.3g} mm", **LIMIT)
    depth.axhline(0.0, **DESIRED | {"linewidth": 0.7})
    depth.set_ylim(-8.0, 1e3 * max(mated, float(traces["depth"].max())) + 2.0)
    _dress(depth, "depth\nmm")
    _legend(depth)
    depth.set_xlabel("time / s", fontsize=9)
    depth.set_xlim(0.0, float(time[-1]))
    return figure


def state_visits(
    traces: Table, path: Table, states: Sequence[str]
) -> list[tuple[float, float, str]]:
    """Return begin and end, s, of every visit to a state, and its name with its outcome."""
    visits = [
        (float(entered), float(left), f"{source}: {outcome}")
        for entered, left, source, outcome in zip(
            path["entered"], path["time"], path["source"], path["outcome"], strict=True
        )
    ]
    end = float(traces["time"][-1])
    begin = visits[-1][1] if visits else 0.0
    return [*visits, (begin, end, states[round(float(traces["state"][-1]))])]


def _dress(axes: Axes, label: str) -> None:
    dress(axes, title="", x="", y=label)
    axes.set_ylabel(label, fontsize=8.5)


def _legend(axes: Axes) -> None:
    """Draw a legend above the right end of a panel, where it hides nothing."""
    legend(axes, loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=3, borderaxespad=0.0)


def _draw_states(axes: Axes, visits: Sequence[tuple[float, float, str]], duration: float) -> None:
    """Draw the bands of the states; names stand above theirs, or beside if it is too narrow."""
    axes.set_ylim(0.0, 1.0)
    for i, (begin, end, name) in enumerate(visits):
        bad = name.endswith(_BAD)
        colour = "#f3b6b6" if bad else ("#cfe0f5", "#f9dcb8")[i % 2]
        axes.axvspan(begin, end, ymax=0.12, color=colour, linewidth=0)
    middles = np.array([(begin + end) / 2 for begin, end, _ in visits]) / duration
    for (_, _, name), middle, place in zip(visits, middles, spaced(middles), strict=True):
        x = place * duration
        axes.plot(
            [middle * duration, x], [0.13, 0.24], color="#888888", linewidth=0.6, clip_on=False
        )
        bold = "bold" if name.endswith(_BAD) else "normal"
        axes.text(
            x, 0.27, name, rotation=90, ha="center", va="bottom", fontsize=_NAMES, weight=bold
        )
    axes.set_axis_off()


def spaced(places: np.ndarray) -> np.ndarray:
    """Return ascending places, as shares of a width, far enough from each other to be named."""
    moved = places.copy()
    for i in range(1, len(moved)):
        moved[i] = max(moved[i], moved[i - 1] + _APART)
    excess = moved[-1] - 1.0
    if excess > 0:
        moved[-1] = 1.0
        for i in range(len(moved) - 2, -1, -1):
            moved[i] = min(moved[i], moved[i + 1] - _APART)
    return moved
