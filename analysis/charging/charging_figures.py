"""One figure for each mode of a charging cycle: what was measured beside its limits."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from numpy.typing import NDArray

from analysis.charging.charging_metrics import items_of
from analysis.drawing.figure_style import (
    BAND,
    CONTACT_LOST,
    DESIRED,
    LIMIT,
    Style,
    dress,
    legend,
    new_figure,
)
from analysis.run.experiment import Outcome, Table
from diagrams.charging.charging_scenario import CrucibleChargingScenario
from models.damage import SCRATCH_FORCE
from systems.force.contact_detection import LOST

Array = NDArray[np.float64]

_COLOURS: Final = ("#1b4f9c", "#e07b00", "#2e7d32", "#7a4100", "#6fa0e8", "#b00020")
_MM: Final = 1e3
_CM: Final = 1e2
_GLASS: Final[Style] = {"facecolor": "#bfd4ea", "edgecolor": "#5a7fa8", "linewidth": 0.8}
_OUTLINES: Final = 9  # of a nugget along a slew
_BESIDE: Final = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}


class Part(NamedTuple):
    """What an item did in a mode."""

    item: int
    label: str
    style: Style
    rows: NDArray[np.intp]  # of the traces
    time: Array  # s, since the mode began


def plot_charging(
    scenario: CrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> dict[str, Figure]:
    """Draw each mode that the run came to.

    Args:
        scenario: Of the run, resolved.
        outcome: Its metrics and traces.
        states: Names of the chart's states, by the index in the traces. A name begins with its
            mode and a point.
    """
    figures = {
        "acquire": _acquire(scenario, outcome, states),
        "scan": _scan(scenario, outcome, states),
        "slew": _slew(scenario, outcome, states),
        "wall": _wall(scenario, outcome, states),
        "crown": _crown(scenario, outcome, states),
        "bulk": _bulk(scenario, outcome, states),
    }
    return {name: figure for name, figure in figures.items() if figure is not None}


def parts(
    scenario: CrucibleChargingScenario,
    traces: Table,
    states: Sequence[str],
    *modes: str,
    first: str = "",
) -> list[Part]:
    """Return the rows in which items were in one of some modes.

    Args:
        scenario: Of the run.
        traces: Of the run.
        states: Names of the chart's states, by the index in ``traces``.
        *modes: With which the states' names begin.
        first: The state from which on rows count; "" for any.
    """
    begun = states.index(first) if first else -1
    mode = np.array([name.partition(".")[0] for name in states])[traces["state"].astype(int)]
    found = []
    for i, one in enumerate(scenario.plan):
        rows = np.flatnonzero(np.isin(mode, modes) & (traces["item"] == i))
        if begun >= 0:
            rows = rows[np.logical_or.accumulate(traces["state"][rows] == begun)]
        if len(rows):
            style: Style = {"color": _COLOURS[i % len(_COLOURS)], "linewidth": 1.2}
            label = f"{i + 1}: {one.kind}, {1e3 * one.mass:.0f} g"
            time = traces["time"][rows] - traces["time"][rows[0]]
            found.append(Part(i, label, style, rows, time))
    return found


def _acquire(
    scenario: CrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> Figure | None:
    traces = outcome.traces
    shown = parts(scenario, traces, states, "acquire", first="acquire.descend")
    if not shown:
        return None
    figure = new_figure(10.0, 6.0)
    speed, force = figure.subplots(2, 1, sharex=True)
    rate = np.gradient(traces["z"], traces["time"])
    for part in shown:
        speed.plot(part.time, _CM * rate[part.rows], label=part.label, **part.style)
        force.plot(part.time, traces["feeder_peak_force"][part.rows], **part.style)
    for sign in (-1, 1):
        speed.axhline(sign * 15.0, label="15 cm/s" if sign > 0 else None, **LIMIT)
    force.axhline(20.0, label="limit, 20 N", **LIMIT)
    down, up = (_said(outcome, f"acquire.{name}_speed", _CM) for name in ("descent", "lift"))
    dress(
        speed,
        title=f"(a) Down at {down} cm/s, up at {up} cm/s; 15 cm/s are wanted",
        x="",
        y="speed upwards / cm/s",
    )
    dress(
        force,
        title=f"(b) Gripped with at most {_said(outcome, 'acquire.grip_force')} N; "
        "less than 20 N are wanted",
        x="time since the descent began / s",
        y="force on the feeder / N",
    )
    legend(speed, **_BESIDE)
    legend(force, **_BESIDE)
    return figure


def _scan(
    scenario: CrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> Figure | None:
    traces = outcome.traces
    shown = parts(scenario, traces, states, "scan")
    if not shown:
        return None
    figure = new_figure(10.0, 6.0)
    speed, error = figure.subplots(2, 1, sharex=True)
    station = scenario.station.true
    nugget = _space(traces, "nugget")
    rate = np.linalg.norm(np.gradient(nugget, traces["time"], axis=0), axis=1)
    along = nugget[:, 1] - station.scanner[1]
    passing = np.char.endswith(np.array(states)[traces["state"].astype(int)], ".pass")
    for part in shown:
        rows = part.rows[passing[part.rows]]
        speed.plot(_MM * along[rows], _CM * rate[rows], label=part.label, **part.style)
        error.plot(_MM * along[rows], _MM * _off(traces)[rows], **part.style)
    half = _MM * station.scan_length / 2
    for axes in (speed, error):
        axes.axvspan(-half, half, label="over the scanner", **BAND)
    speed.axhline(3.0, label="3 cm/s", **LIMIT)
    error.axhline(0.5, label="limit, 0.5 mm", **LIMIT)
    off = _said(outcome, "scan.speed_error", _MM)
    dress(
        speed,
        title=f"(a) Over the scanner the speed is off by {off} mm/s at most; "
        "constant 3 cm/s are wanted",
        x="",
        y="speed / cm/s",
    )
    dress(
        error,
        title=f"(b) It is {_said(outcome, 'scan.position_error', _MM)} mm off its way at most; "
        "0.5 mm are wanted",
        x="way along the scanner / mm",
        y="off the command / mm",
    )
    legend(speed, **_BESIDE)
    legend(error, **_BESIDE)
    return figure


def _slew(
    scenario: CrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> Figure | None:
    traces = outcome.traces
    shown = parts(scenario, traces, states, "slew")
    if not shown:
        return None
    figure = new_figure(10.0, 6.0)
    error, side = figure.subplots(2, 1, height_ratios=(1.3, 1.0))
    station = scenario.station.true
    nugget = _space(traces, "nugget")
    radius = np.hypot(*(nugget[:, :2] - station.crucible_centre).T)
    for part in shown:
        error.plot(part.time, _MM * _off(traces)[part.rows], label=part.label, **part.style)
        size = scenario.nuggets[part.item]
        height = nugget[part.rows, 2] - size.height / 2
        side.plot(_MM * radius[part.rows], _MM * height, **part.style)
        steps = np.linspace(0, len(part.rows) - 1, _OUTLINES).astype(int)
        angle = np.linspace(0.0, 2 * np.pi, 60)
        for k in steps:
            side.plot(
                _MM * (radius[part.rows[k]] + size.reach * np.cos(angle)),
                _MM * (height[k] + size.height / 2 * np.sin(angle)),
                color=part.style["color"],
                linewidth=0.5,
                alpha=0.6,
            )
    error.axhline(10.0, label="limit, 10 mm", **LIMIT)
    inner, wide = station.crucible_radius, station.crucible_thickness
    high = station.rim_height - station.bed_height
    corner = (_MM * inner, _MM * station.bed_height)
    side.add_patch(Rectangle(corner, _MM * wide, _MM * high, **_GLASS))
    side.plot([0.0, _MM * inner], [_MM * station.bed_height] * 2, **DESIRED)
    side.set_aspect("equal")
    dress(
        error,
        title=f"(a) In {_said(outcome, 'slew.time')} s, "
        f"{_said(outcome, 'slew.position_error', _MM)} mm off at most; "
        "about 2.5 s and 10 mm are wanted",
        x="time in the slew / s",
        y="off the command / mm",
    )
    dress(
        side,
        title=f"(b) It clears the crucible by {_said(outcome, 'slew.clearance', _MM)} mm",
        x="distance from the crucible's axis / mm",
        y="height / mm",
    )
    legend(error, **_BESIDE)
    return figure


def _wall(
    scenario: CrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> Figure | None:
    traces = outcome.traces
    shown = parts(scenario, traces, states, "wall", "release")
    shown = [part for part in shown if scenario.plan[part.item].kind == "wall"]
    if not shown:
        return None
    figure = new_figure(11.0, 9.0)
    speed, force, layer, shift = figure.subplots(
        4, 1, sharex=True, height_ratios=(1.0, 1.6, 1.0, 1.0)
    )
    velocity = np.gradient(_space(traces, "nugget"), traces["time"], axis=0)
    for part in shown:
        azimuth = items_of(scenario)[part.item].azimuth
        outwards = velocity[:, 0] * np.cos(azimuth) + velocity[:, 1] * np.sin(azimuth)
        carried = np.where(traces["held"] > 0, outwards, np.nan)  # nothing else meets the wall
        speed.plot(part.time, _CM * carried[part.rows], label=part.label, **part.style)
        force.plot(part.time, traces["wall_peak_force"][part.rows], **part.style)
        lost = traces["mode"][part.rows] == LOST
        if lost.any():
            across = force.get_xaxis_transform()
            force.fill_between(
                part.time, 0, 1, where=lost.tolist(), transform=across, **CONTACT_LOST
            )
    speed.axhline(10.0, label="limit, 10 cm/s", **LIMIT)
    force.axhline(2.0, label="limit, 2 N", **LIMIT)
    force.axhline(scenario.charging.wall_force, label="desired", **DESIRED)
    force.set_ylim(0.0, None)
    approach = _said(outcome, "wall.approach_speed", _CM)
    dress(
        speed,
        title=f"(a) Towards the wall with {approach} cm/s; at most 10 cm/s are wanted",
        x="",
        y="speed outwards / cm/s",
    )
    low, high = (_said(outcome, f"wall.slide_force{end}") for end in ("_min", ""))
    dress(
        force,
        title=f"(b) Sliding down with {low} to {high} N, {_said(outcome, 'wall.losses')} losses "
        "of contact; less than 2 N and none are wanted",
        x="",
        y="force on the wall / N",
    )
    _laid(layer, shift, shown, outcome, "wall")
    for axes in (speed, force, layer, shift):
        legend(axes, **_BESIDE)
    return figure


def _crown(
    scenario: CrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> Figure | None:
    shown = parts(scenario, outcome.traces, states, "crown", "release")
    shown = [part for part in shown if scenario.plan[part.item].kind == "crown"]
    if not shown:
        return None
    figure = new_figure(11.0, 7.0)
    error, layer, shift = figure.subplots(3, 1, sharex=True)
    for part in shown:
        off = _MM * _off(outcome.traces)[part.rows]
        error.plot(part.time, off, label=part.label, **part.style)
    error.axhline(10.0, label="limit, 10 mm (ours)", **LIMIT)
    place = _said(outcome, "crown.position_error", _MM)
    dress(
        error,
        title=f"(a) Set down {place} mm from its place; within 10 mm is wanted",
        x="",
        y="off the command / mm",
    )
    _laid(layer, shift, shown, outcome, "crown")
    for axes in (error, layer, shift):
        legend(axes, **_BESIDE)
    return figure


def _laid(layer: Axes, shift: Axes, shown: Sequence[Part], outcome: Outcome, mode: str) -> None:
    """Draw how an item meets the layer, and how far it pushes it."""
    traces = outcome.traces
    for part in shown:
        layer.plot(part.time, traces["layer_peak_force"][part.rows], **part.style)
        shift.plot(part.time, _MM * traces["layer_shift"][part.rows], **part.style)
    layer.axhline(SCRATCH_FORCE, label=f"scratches if sustained, {SCRATCH_FORCE:g} N", **LIMIT)
    shift.axhline(0.5, label="limit, 0.5 mm", **LIMIT)
    letters = "cd" if mode == "wall" else "bc"
    dress(
        layer,
        title=f"({letters[0]}) It meets the layer with "
        f"{_said(outcome, f'{mode}.impact_speed', _CM)} cm/s at most; 20 cm/s are safe",
        x="",
        y="force on the layer / N",
    )
    dress(
        shift,
        title=f"({letters[1]}) The layer is moved by "
        f"{_said(outcome, f'{mode}.layer_shift', _MM)} mm; at most 0.5 mm are wanted",
        x="time in the mode / s",
        y="shift / mm",
    )


def _bulk(
    scenario: CrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> Figure | None:
    traces = outcome.traces
    shown = parts(scenario, traces, states, "bulk")
    if not shown:
        return None
    figure = new_figure(11.0, 5.0)
    error, top = figure.subplots(1, 2)
    for part in shown:
        off = _MM * _off(traces)[part.rows]
        error.plot(part.time, off, label=part.label, **part.style)
    error.axhline(10.0, label="limit, 10 mm", **LIMIT)
    dress(
        error,
        title=f"(a) Poured {_said(outcome, 'bulk.position_error', _MM)} mm from its place; "
        "within 10 mm is wanted",
        x="time in the mode / s",
        y="off the command / mm",
    )
    _seen_from_above(top, scenario, traces)
    legend(error)
    return figure


def _seen_from_above(axes: Axes, scenario: CrucibleChargingScenario, traces: Table) -> None:
    """Draw where each item was left, and where it was to go."""
    station = scenario.station.true
    x, y = (_MM * one for one in station.crucible_centre)
    axes.add_patch(Circle((x, y), _MM * station.crucible_radius, **{**_GLASS, "alpha": 0.4}))
    for i, item in enumerate(items_of(scenario)):
        rows = np.flatnonzero((traces["item"] == i) & (traces["held"] > 0))
        if not len(rows):
            continue
        colour = _COLOURS[i % len(_COLOURS)]
        place = [_MM * traces[f"nugget_{axis}"][rows[-1]] for axis in "xy"]
        axes.add_patch(
            Circle((place[0], place[1]), _MM * item.nugget.reach, fill=False, color=colour)
        )
        axes.plot(*place, color=colour, marker=".", linestyle="none")
        axes.plot(*(_MM * one for one in item.goal[:2]), color=colour, marker="+", markersize=10)
        axes.annotate(str(i + 1), (place[0], place[1]), fontsize=8, ha="left", va="bottom")
    axes.set_aspect("equal")
    axes.autoscale_view()
    dress(
        axes,
        title="(b) Where each item was left (.), and where it was to go (+)",
        x="x / mm",
        y="y / mm",
    )


def _space(traces: Table, name: str) -> Array:
    return np.stack([traces[f"{name}_{axis}"] for axis in "xyz"], axis=1)


def _off(traces: Table) -> Array:
    """Return how far the nugget is from the command, m."""
    away: Array = np.linalg.norm(_space(traces, "nugget") - _space(traces, "desired"), axis=1)
    return away


def _said(outcome: Outcome, metric: str, scale: float = 1.0) -> str:
    """Return a metric's value for a title."""
    found = outcome.metrics.get(metric)
    if found is None or found.value is None:
        return "-"
    return f"{scale * found.value + 0.0:.3g}"  # no -0
