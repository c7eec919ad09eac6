"""The figures of a charging cycle: each mode beside its limits, and where all was left."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from numpy.typing import NDArray

from chamfer.analysis.charging.charging_runs import SLIDING, in_space, items_of
from chamfer.analysis.drawing.chart_path import plot_chart_path
from chamfer.analysis.drawing.figure_style import (
    BAND,
    CONTACT_LOST,
    DESIRED,
    LIMIT,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Outcome, Table
from chamfer.diagrams.charging.charging_scenario import ResolvedCrucibleChargingScenario
from chamfer.models.surfaces.damage import SCRATCH_FORCE
from chamfer.systems.charging.charging_chart import DONE, HALTED, STOPPED, ChargingChart
from chamfer.systems.force.contact_detection import LOST
from chamfer.systems.statechart.chart import ANY


def plot_charging(
    scenario: ResolvedCrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> dict[str, Figure]:
    """Draw each mode that the run came to, and where all items were left.

    Args:
        scenario: Of the run.
        outcome: Its metrics and traces.
        states: Names of the chart's states, by the index in the traces. A name begins with its
            mode and a point.
    """
    figures = {
        "acquire": plot_acquire(scenario, outcome, states),
        "scan": plot_scan(scenario, outcome, states),
        "slew": plot_slew(scenario, outcome, states),
        "wall": plot_wall(scenario, outcome, states),
        "crown": plot_crown(scenario, outcome, states),
        "bulk": plot_bulk(scenario, outcome, states),
        "places": plot_places(scenario, outcome),
    }
    return {name: figure for name, figure in figures.items() if figure is not None}


Array = NDArray[np.float64]

MM: Final = 1e3
CM: Final = 1e2
GLASS: Final[Style] = {"facecolor": "#bfd4ea", "edgecolor": "#5a7fa8", "linewidth": 0.8}
BESIDE: Final = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}  # of the axes, a legend

_NAMED: Final = 8  # parts that a legend has room for; more have no label
_COLOURS: Final = ("#1b4f9c", "#e07b00", "#2e7d32", "#7a4100", "#6fa0e8", "#b00020")


class ModeRows(NamedTuple):
    """What an item did in a mode."""

    item: int
    label: str
    style: Style
    rows: NDArray[np.intp]  # of the traces
    time: Array  # s, since the mode began


def parts(
    scenario: ResolvedCrucibleChargingScenario,
    traces: Table,
    states: Sequence[str],
    *modes: str,
    first: str = "",
) -> list[ModeRows]:
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
    found: list[ModeRows] = []
    for i, one in enumerate(scenario.plan):
        rows = np.flatnonzero(np.isin(mode, modes) & (traces["item"] == i))
        if begun >= 0:
            rows = rows[np.logical_or.accumulate(traces["state"][rows] == begun)]
        if len(rows):
            style: Style = {"color": colour_of(i), "linewidth": 1.2}
            label = f"{i + 1}: {one.kind}, {1e3 * one.mass:.0f} g" if len(found) < _NAMED else ""
            time = traces["time"][rows] - traces["time"][rows[0]]
            found.append(ModeRows(i, label, style, rows, time))
    return found


def colour_of(item: int) -> str:
    """Return the colour of an item, by its index in the plan."""
    return _COLOURS[item % len(_COLOURS)]


def off_command(traces: Table) -> Array:
    """Return how far the nugget is from the command, m."""
    away: Array = np.linalg.norm(in_space(traces, "nugget") - in_space(traces, "desired"), axis=1)
    return away


def said(outcome: Outcome, metric: str, scale: float = 1.0) -> str:
    """Return a metric's value for a title."""
    found = outcome.metrics.get(metric)
    if found is None or found.value is None:
        return "-"
    return f"{scale * found.value + 0.0:.3g}"  # no -0


_OUTLINES: Final = 9  # of a nugget along a slew


def plot_acquire(
    scenario: ResolvedCrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> Figure | None:
    """Draw how the items were picked up; None if the run came to none."""
    traces = outcome.traces
    shown = parts(scenario, traces, states, "acquire", first="acquire.descend")
    if not shown:
        return None
    figure = new_figure(10.0, 6.0)
    speed, force = figure.subplots(2, 1, sharex=True)
    rate = np.gradient(traces["z"], traces["time"])
    for part in shown:
        speed.plot(part.time, CM * rate[part.rows], label=part.label, **part.style)
        force.plot(part.time, traces["feeder_peak_force"][part.rows], **part.style)
    for sign in (-1, 1):
        speed.axhline(sign * 15.0, label="15 cm/s" if sign > 0 else None, **LIMIT)
    force.axhline(20.0, label="limit, 20 N", **LIMIT)
    down, up = (said(outcome, f"acquire.{name}_speed", CM) for name in ("descent", "lift"))
    dress(
        speed,
        title=f"(a) Down at {down} cm/s, up at {up} cm/s; 15 cm/s are wanted",
        x="",
        y="speed upwards / cm/s",
    )
    dress(
        force,
        title=f"(b) Gripped with at most {said(outcome, 'acquire.grip_force')} N; "
        "less than 20 N are wanted",
        x="time since the descent began / s",
        y="force on the feeder / N",
    )
    legend(speed, **BESIDE)
    legend(force, **BESIDE)
    return figure


def plot_scan(
    scenario: ResolvedCrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> Figure | None:
    """Draw how the items passed the scanner; None if the run came to none."""
    traces = outcome.traces
    shown = parts(scenario, traces, states, "scan")
    if not shown:
        return None
    figure = new_figure(10.0, 6.0)
    speed, error = figure.subplots(2, 1, sharex=True)
    station = scenario.station.true
    nugget = in_space(traces, "nugget")
    rate = np.linalg.norm(np.gradient(nugget, traces["time"], axis=0), axis=1)
    along = nugget[:, 1] - station.scanner[1]
    passing = np.char.endswith(np.array(states)[traces["state"].astype(int)], ".pass")
    for part in shown:
        rows = part.rows[passing[part.rows]]
        speed.plot(MM * along[rows], CM * rate[rows], label=part.label, **part.style)
        error.plot(MM * along[rows], MM * off_command(traces)[rows], **part.style)
    half = MM * station.scan_length / 2
    for axes in (speed, error):
        axes.axvspan(-half, half, label="over the scanner", **BAND)
    speed.axhline(3.0, label="3 cm/s", **LIMIT)
    error.axhline(0.5, label="limit, 0.5 mm", **LIMIT)
    off = said(outcome, "scan.speed_error", MM)
    dress(
        speed,
        title=f"(a) Over the scanner the speed is off by {off} mm/s at most; "
        "constant 3 cm/s are wanted",
        x="",
        y="speed / cm/s",
    )
    dress(
        error,
        title=f"(b) It is {said(outcome, 'scan.position_error', MM)} mm off its way at most; "
        "0.5 mm are wanted",
        x="way along the scanner / mm",
        y="off the command / mm",
    )
    legend(speed, **BESIDE)
    legend(error, **BESIDE)
    return figure


def plot_slew(
    scenario: ResolvedCrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> Figure | None:
    """Draw how the items were slewed into the crucible; None if the run came to none."""
    traces = outcome.traces
    shown = parts(scenario, traces, states, "slew")
    if not shown:
        return None
    figure = new_figure(10.0, 6.0)
    error, side = figure.subplots(2, 1, height_ratios=(1.3, 1.0))
    station = scenario.station.true
    nugget = in_space(traces, "nugget")
    radius = np.hypot(*(nugget[:, :2] - station.crucible_centre).T)
    for part in shown:
        error.plot(part.time, MM * off_command(traces)[part.rows], label=part.label, **part.style)
        size = scenario.nuggets[part.item]
        height = nugget[part.rows, 2] - size.height / 2
        side.plot(MM * radius[part.rows], MM * height, **part.style)
        steps = np.linspace(0, len(part.rows) - 1, _OUTLINES).astype(int)
        angle = np.linspace(0.0, 2 * np.pi, 60)
        for k in steps:
            side.plot(
                MM * (radius[part.rows[k]] + size.reach * np.cos(angle)),
                MM * (height[k] + size.height / 2 * np.sin(angle)),
                color=part.style["color"],
                linewidth=0.5,
                alpha=0.6,
            )
    error.axhline(10.0, label="limit, 10 mm", **LIMIT)
    inner, wide = station.crucible_radius, station.crucible_thickness
    high = station.rim_height - station.bed_height
    corner = (MM * inner, MM * station.bed_height)
    side.add_patch(Rectangle(corner, MM * wide, MM * high, **GLASS))
    side.plot([0.0, MM * inner], [MM * station.bed_height] * 2, **DESIRED)
    side.set_aspect("equal")
    dress(
        error,
        title=f"(a) In {said(outcome, 'slew.time')} s, "
        f"{said(outcome, 'slew.position_error', MM)} mm off at most; "
        "about 2.5 s and 10 mm are wanted",
        x="time in the slew / s",
        y="off the command / mm",
    )
    dress(
        side,
        title=f"(b) It clears the crucible by {said(outcome, 'slew.clearance', MM)} mm; "
        "not to touch it is wanted",
        x="distance from the crucible's axis / mm",
        y="height / mm",
    )
    legend(error, **BESIDE)
    return figure


def plot_wall(
    scenario: ResolvedCrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> Figure | None:
    """Draw how items were laid at the wall; None if the run came to none."""
    traces = outcome.traces
    shown = parts(scenario, traces, states, "wall", "release")
    shown = [part for part in shown if scenario.plan[part.item].kind == "wall"]
    if not shown:
        return None
    figure = new_figure(11.0, 9.0)
    speed, force, layer, shift = figure.subplots(
        4, 1, sharex=True, height_ratios=(1.0, 1.6, 1.0, 1.0)
    )
    velocity = np.gradient(in_space(traces, "nugget"), traces["time"], axis=0)
    sliding = np.isin(np.array(states)[traces["state"].astype(int)], SLIDING)
    for part in shown:
        azimuth = items_of(scenario)[part.item].azimuth
        outwards = velocity[:, 0] * np.cos(azimuth) + velocity[:, 1] * np.sin(azimuth)
        carried = np.where(_carried(traces), outwards, np.nan)  # nothing else meets the wall
        speed.plot(part.time, CM * carried[part.rows], label=part.label, **part.style)
        pushed = traces["wall_peak_force"]
        force.plot(part.time, pushed[part.rows], **part.style | {"linewidth": 0.6})
        slides = np.where(sliding & (traces["item"] == part.item), pushed, np.nan)
        force.plot(part.time, slides[part.rows], **part.style | {"linewidth": 2.4})
        lost = traces["mode"][part.rows] == LOST
        if lost.any():
            across = force.get_xaxis_transform()
            force.fill_between(
                part.time,
                0,
                1,
                where=lost.tolist(),
                transform=across,
                label=f"{part.item + 1}: lost",
                **CONTACT_LOST,
            )
    speed.axhline(10.0, label="limit, 10 cm/s", **LIMIT)
    force.axhline(2.0, label="limit, 2 N", **LIMIT)
    force.axhline(scenario.charging.wall_force, label="desired", **DESIRED)
    force.set_ylim(0.0, None)
    approach = said(outcome, "wall.approach_speed", CM)
    dress(
        speed,
        title=f"(a) Towards the wall with {approach} cm/s; at most 10 cm/s are wanted",
        x="",
        y="speed outwards / cm/s",
    )
    low, high = (said(outcome, f"wall.slide_force{end}") for end in ("_min", ""))
    dress(
        force,
        title=f"(b) Sliding down (thick) with {low} to {high} N, "
        f"{said(outcome, 'wall.losses')} losses of contact; less than 2 N and none are wanted",
        x="",
        y="force on the wall / N",
    )
    _laid(layer, shift, shown, outcome, "wall")
    for axes in (speed, force, layer, shift):
        legend(axes, **BESIDE)
    return figure


def plot_crown(
    scenario: ResolvedCrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> Figure | None:
    """Draw how items were laid on the crown; None if the run came to none."""
    shown = parts(scenario, outcome.traces, states, "crown", "release")
    shown = [part for part in shown if scenario.plan[part.item].kind == "crown"]
    if not shown:
        return None
    figure = new_figure(11.0, 7.0)
    error, layer, shift = figure.subplots(3, 1, sharex=True)
    nugget, carried = in_space(outcome.traces, "nugget"), _carried(outcome.traces)
    for part in shown:
        away = np.linalg.norm(nugget - items_of(scenario)[part.item].goal, axis=1)
        away = np.where(carried, MM * away, np.nan)
        error.plot(part.time, away[part.rows], label=part.label, **part.style)
    error.axhline(10.0, label="limit, 10 mm (ours)", **LIMIT)
    error.set_yscale("log")
    place = said(outcome, "crown.position_error", MM)
    dress(
        error,
        title=f"(a) Set down {place} mm from its place; within 10 mm is wanted",
        x="",
        y="from its place / mm",
    )
    _laid(layer, shift, shown, outcome, "crown")
    for axes in (error, layer, shift):
        legend(axes, **BESIDE)
    return figure


def plot_bulk(
    scenario: ResolvedCrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> Figure | None:
    """Draw where the bulk loads and all other items went; None if the run came to no bulk load."""
    traces = outcome.traces
    shown = parts(scenario, traces, states, "bulk")
    if not shown:
        return None
    figure = new_figure(10.0, 4.0)
    error = figure.subplots()
    for part in shown:
        off = MM * off_command(traces)[part.rows]
        error.plot(part.time, off, label=part.label, **part.style)
    error.axhline(10.0, label="limit, 10 mm", **LIMIT)
    dress(
        error,
        title=f"Poured {said(outcome, 'bulk.position_error', MM)} mm from its place; "
        "within 10 mm is wanted",
        x="time in the mode / s",
        y="off the command / mm",
    )
    legend(error, **BESIDE)
    return figure


def _laid(
    layer: Axes, shift: Axes, shown: Sequence[ModeRows], outcome: Outcome, mode: str
) -> None:
    """Draw how an item meets the layer, and how far it pushes it."""
    traces = outcome.traces
    for part in shown:
        layer.plot(part.time, traces["layer_peak_force"][part.rows], **part.style)
        shift.plot(part.time, MM * traces["layer_shift"][part.rows], **part.style)
    layer.axhline(SCRATCH_FORCE, label=f"scratches if sustained, {SCRATCH_FORCE:g} N", **LIMIT)
    shift.axhline(0.5, label="limit, 0.5 mm", **LIMIT)
    letters = "cd" if mode == "wall" else "bc"
    dress(
        layer,
        title=f"({letters[0]}) It meets the layer with "
        f"{said(outcome, f'{mode}.impact_speed', CM)} cm/s at most; 20 cm/s are safe",
        x="",
        y="force on the layer / N",
    )
    dress(
        shift,
        title=f"({letters[1]}) The layer is moved by "
        f"{said(outcome, f'{mode}.layer_shift', MM)} mm; at most 0.5 mm are wanted",
        x="time in the mode / s",
        y="shift / mm",
    )


def plot_places(scenario: ResolvedCrucibleChargingScenario, outcome: Outcome) -> Figure | None:
    """Draw the crucible from above with what was left where; None if nothing was taken up."""
    traces, station = outcome.traces, scenario.station.true
    nugget = MM * in_space(traces, "nugget")
    held = [
        np.flatnonzero((traces["item"] == i) & (traces["held"] > 0))
        for i in range(len(scenario.plan))
    ]
    if not any(map(len, held)):
        return None
    figure = new_figure(9.0, 6.0)
    axes = figure.subplots()
    x, y = (MM * one for one in station.crucible_centre)
    style = {**GLASS, "alpha": 0.4, "label": "crucible, inner wall"}
    axes.add_patch(Circle((x, y), MM * station.crucible_radius, **style))
    for i, (item, rows) in enumerate(zip(items_of(scenario), held, strict=True)):
        if not len(rows):
            continue
        colour = colour_of(i)
        place = (float(nugget[rows[-1], 0]), float(nugget[rows[-1], 1]))
        axes.add_patch(Circle(place, MM * item.nugget.reach, fill=False, color=colour))
        axes.annotate(str(i + 1), place, xytext=(4, 4), textcoords="offset points", fontsize=8)
        axes.plot(*place, color=colour, marker=".", linestyle="none")
        axes.plot(*(MM * one for one in item.goal[:2]), color=colour, marker="+", markersize=10)
    axes.set_aspect("equal")
    axes.autoscale_view()
    dress(
        axes,
        title="Where each item was left (.), and where it was to go (+)",
        x="x / mm",
        y="y / mm",
    )
    legend(axes, **BESIDE)
    return figure


def _carried(traces: Table) -> NDArray[np.bool_]:
    """Return the rows in which an item is in the gripper, and in the next one too.

    What is shown of an item jumps to the empty gripper when it is let go.
    """
    held = traces["held"] > 0
    still: NDArray[np.bool_] = held & np.append(held[1:], False)
    return still


_SELDOM: Final = (HALTED, "back_off")  # drawn only where the run came to it
# What stands in a row: states by the mode with which their names begin.
_ROWS: Final = (
    {"home"},
    {"acquire"},
    {"scan", "slew"},
    {"wall"},
    {"crown"},
    {"bulk"},
    {"release", "retreat", "return", DONE},
    {ANY, *_SELDOM, STOPPED},
)
_MOST: Final = 2  # numbers at a line; a transition is taken with each item


def plot_path(chart: ChargingChart, outcome: Outcome) -> Figure:
    """Draw the chart and what a run took of it.

    Args:
        chart: Which ran.
        outcome: Its table ``transitions`` has the columns ``time``, s, ``source``, ``target`` and
            ``label``; its metrics ``cycle.laid`` and ``cycle.time``.
    """
    names = [*chart.state_names, ANY]
    mode = {name: name.partition(".")[0] for name in names}
    path = outcome.tables["transitions"]
    laid, time = outcome.metrics["cycle.laid"], outcome.metrics["cycle.time"].value
    why = f", then stopped: {laid.note}" if laid.note else ""
    return plot_chart_path(
        chart,
        {**path, "outcome": path["label"]},
        result=f"{laid.value:g} items laid in {time:.1f} s{why}",
        rows=[[name for name in names if mode[name] in row] for row in _ROWS],
        seldom=[name for name in names if mode[name] in _SELDOM],
        most=_MOST,
    )
