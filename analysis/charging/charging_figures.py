"""The figures of a charging cycle: each mode with its limits, and the final places."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle, Rectangle
from numpy.typing import NDArray

from chamfer.analysis.charging.charging_runs import SLIDING, in_space, items_of
from chamfer.analysis.drawing.chart_path import plot_chart_path
from chamfer.analysis.drawing.figure_kit import (
    Curve,
    ReferenceLine,
    draw_lines,
    metric_value,
    shade,
)
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
from chamfer.systems.charging.charging_law import ChargingChart
from chamfer.systems.force.contact_detection_law import LOST

Array = NDArray[np.float64]

MM: Final = 1e3
CM: Final = 1e2
GLASS: Final[Style] = {"facecolor": "#bfd4ea", "edgecolor": "#5a7fa8", "linewidth": 0.8}

_NORMAL_95: Final = 1.96  # standard deviations
_NAMED: Final = 8  # parts that a legend has room for; more have no label
_COLOURS: Final = ("#1b4f9c", "#e07b00", "#2e7d32", "#7a4100", "#6fa0e8", "#b00020")


class ChargingRun(NamedTuple):
    """A run, and the names of the chart's states by the index in its traces."""

    scenario: ResolvedCrucibleChargingScenario
    outcome: Outcome
    states: Sequence[str]

    def said(self, metric: str, scale: float = 1.0) -> str:
        """Return a metric's value for a title."""
        found = self.outcome.metrics.get(metric)
        if found is None or found.value is None:
            return "-"
        return f"{scale * found.value + 0.0:.3g}"  # no -0

    def parts(self, *modes: str, first: str = "", kind: str = "") -> list["ModeRows"]:
        """Return the rows in which items, of a kind, were in one of some modes.

        Rows count from the state ``first`` on; "" stands for any state or kind.
        """
        traces = self.outcome.traces
        mode = np.array([name.partition(".")[0] for name in self.states])
        current = mode[traces["state"].astype(int)]
        found: list[ModeRows] = []
        for i, one in enumerate(self.scenario.plan):
            rows = np.flatnonzero(np.isin(current, modes) & (traces["item"] == i))
            if first:
                begun = traces["state"][rows] == self.states.index(first)
                rows = rows[np.logical_or.accumulate(begun)]
            if len(rows) and kind in ("", one.kind):
                style: Style = {"color": _colour_of(i), "linewidth": 1.2}
                label = f"{i + 1}: {one.kind}, {1e3 * one.mass:.0f} g"
                time = traces["time"][rows] - traces["time"][rows[0]]
                label = label if len(found) < _NAMED else ""
                found.append(ModeRows(i, label, style, rows, time))
        return found


class ModeRows(NamedTuple):
    """Rows of an item in a mode."""

    item: int
    label: str
    style: Style
    rows: NDArray[np.intp]  # of the traces
    time: Array  # s, since the mode began


def _colour_of(item: int) -> str:
    return _COLOURS[item % len(_COLOURS)]


def _off_command(traces: Table) -> Array:
    """Return the distance of the nugget from the command, m."""
    away: Array = np.linalg.norm(in_space(traces, "nugget") - in_space(traces, "desired"), axis=1)
    return away


def _courses(shown: Sequence[ModeRows], values: Array, named: bool = False) -> list[Curve]:
    """Return a curve of a column for each item, over the time since its mode began."""
    return [
        Curve(values[part.rows], part.label if named else None, part.style, part.time)
        for part in shown
    ]


def _panel(
    axes: Axes,
    curves: Sequence[Curve],
    levels: Sequence[ReferenceLine],
    title: str,
    y: str,
    x: str = "",
) -> None:
    draw_lines(axes, (), curves, title=title, y=y, over=x, levels=levels)
    legend(axes, ncols=5)


def _limit(at: float, unit: str, ours: str = "") -> ReferenceLine:
    return ReferenceLine(at, f"limit, {at:g} {unit}{ours}", LIMIT)


_OUTLINES: Final = 9  # of a nugget along a slew


def plot_acquire(run: ChargingRun, shown: Sequence[ModeRows]) -> Figure:
    """Draw the pick-up of the items."""
    traces = run.outcome.traces
    down, up = (run.said(f"acquire.{name}_speed", CM) for name in ("descent", "lift"))
    grip = run.said("acquire.grip_force")
    figure = new_figure(
        height=5.6,
        caption=f"The gripper goes down at {down} cm/s and up at {up} cm/s, and presses on the "
        f"feeder with up to {grip} N. Each curve is one item.",
    )
    speed, force = figure.subplots(2, 1, sharex=True)
    rate = np.gradient(traces["z"], traces["time"])
    _panel(
        speed,
        _courses(shown, CM * rate, named=True),
        [ReferenceLine(-15.0, None, LIMIT), ReferenceLine(15.0, "15 cm/s", LIMIT)],
        f"(a) Down at {down} cm/s, up at {up} cm/s (desired: 15 cm/s)",
        "speed upwards / cm/s",
    )
    _panel(
        force,
        _courses(shown, traces["feeder_peak_force"]),
        [_limit(20.0, "N")],
        f"(b) Gripped with up to {grip} N (limit: 20 N)",
        "force on the feeder / N",
        "time since the descent began / s",
    )
    return figure


def plot_scan(run: ChargingRun, shown: Sequence[ModeRows]) -> Figure:
    """Draw the items' passes over the scanner."""
    traces = run.outcome.traces
    off_speed, off_path = (run.said(f"scan.{name}_error", MM) for name in ("speed", "position"))
    figure = new_figure(
        height=5.6,
        caption=f"Over the scanner the speed is off by up to {off_speed} mm/s and the position by "
        f"up to {off_path} mm. Each curve is one item.",
    )
    speed, error = figure.subplots(2, 1, sharex=True)
    station = run.scenario.station.true
    nugget = in_space(traces, "nugget")
    rate = np.linalg.norm(np.gradient(nugget, traces["time"], axis=0), axis=1)
    along = nugget[:, 1] - station.scanner[1]
    passing = np.char.endswith(np.array(run.states)[traces["state"].astype(int)], ".pass")
    rates, errors = [], []
    for part in shown:
        rows = part.rows[passing[part.rows]]
        way, off = MM * along[rows], MM * _off_command(traces)[rows]
        rates.append(Curve(CM * rate[rows], part.label, part.style, way))
        errors.append(Curve(off, None, part.style, way))
    half = MM * station.scan_length / 2
    for axes in (speed, error):
        axes.axvspan(-half, half, label="over the scanner", **BAND)
    _panel(
        speed,
        rates,
        [ReferenceLine(3.0, "3 cm/s", LIMIT)],
        f"(a) Speed error over the scanner up to {off_speed} mm/s (desired: constant 3 cm/s)",
        "speed / cm/s",
    )
    _panel(
        error,
        errors,
        [_limit(0.5, "mm")],
        f"(b) Position error over the scanner up to {off_path} mm (limit: 0.5 mm)",
        "position error / mm",
        "position along the scanner / mm",
    )
    return figure


def plot_slew(run: ChargingRun, shown: Sequence[ModeRows]) -> Figure:
    """Draw the items' slews into the crucible."""
    traces = run.outcome.traces
    took, off, clear = (
        run.said(f"slew.{name}", scale)
        for name, scale in (("time", 1.0), ("position_error", MM), ("clearance", MM))
    )
    figure = new_figure(
        height=6.2,
        caption=f"Items move into the crucible in {took} s, up to {off} mm off the command, and "
        f"clear its wall by {clear} mm.",
    )
    error, side = figure.subplots(2, 1, height_ratios=(1.3, 1.0))
    station = run.scenario.station.true
    nugget = in_space(traces, "nugget")
    radius = np.hypot(*(nugget[:, :2] - station.crucible_centre).T)
    for part in shown:
        size = run.scenario.nuggets[part.item]
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
    inner, wide = station.crucible_radius, station.crucible_thickness
    high = station.rim_height - station.bed_height
    corner = (MM * inner, MM * station.bed_height)
    side.add_patch(Rectangle(corner, MM * wide, MM * high, **GLASS))
    side.plot([0.0, MM * inner], [MM * station.bed_height] * 2, **DESIRED)
    side.set_aspect("equal")
    _panel(
        error,
        _courses(shown, MM * _off_command(traces), named=True),
        [_limit(10.0, "mm")],
        f"(a) Slew in {took} s, up to {off} mm off (desired: 2.5 s, limit: 10 mm)",
        "position error / mm",
        "time in the slew / s",
    )
    dress(
        side,
        title=f"(b) Clearance to the crucible: {clear} mm",
        x="distance from the crucible's axis / mm",
        y="height / mm",
    )
    return figure


def plot_wall(run: ChargingRun, shown: Sequence[ModeRows]) -> Figure:
    """Draw the laying of items at the wall."""
    traces = run.outcome.traces
    figure = new_figure(
        height=9.5,
        caption=f"Nuggets slide down the wall with up to {run.said('wall.slide_force')} N and "
        f"{run.said('wall.losses')} losses of contact. Each curve is one item.",
    )
    speed, force, layer, shift = figure.subplots(
        4, 1, sharex=True, height_ratios=(1.0, 1.6, 1.0, 1.0)
    )
    velocity = np.gradient(in_space(traces, "nugget"), traces["time"], axis=0)
    sliding = np.isin(np.array(run.states)[traces["state"].astype(int)], SLIDING)
    carried = _carried(traces)  # nothing else meets the wall
    speeds, forces, pushed = [], [], traces["wall_peak_force"]
    for part in shown:
        azimuth = items_of(run.scenario)[part.item].azimuth
        outwards = velocity[:, 0] * np.cos(azimuth) + velocity[:, 1] * np.sin(azimuth)
        speeds += _courses([part], np.where(carried, CM * outwards, np.nan), named=True)
        slides = np.where(sliding & (traces["item"] == part.item), pushed, np.nan)
        for values, width in ((pushed, 0.6), (slides, 2.4)):
            look = part.style | {"linewidth": width}
            forces.append(Curve(values[part.rows], None, look, part.time))
        lost = traces["mode"][part.rows] == LOST
        shade(force, part.time, lost, f"{part.item + 1}: lost", CONTACT_LOST)
    approach = run.said("wall.approach_speed", CM)
    _panel(
        speed,
        speeds,
        [_limit(10.0, "cm/s")],
        f"(a) Towards the wall at {approach} cm/s (limit: 10 cm/s)",
        "speed outwards / cm/s",
    )
    low, high = (run.said(f"wall.slide_force{end}") for end in ("_min", ""))
    desired = ReferenceLine(run.scenario.charging.wall_force, "desired, sliding", DESIRED)
    _panel(
        force,
        forces,
        [_limit(2.0, "N"), desired],
        f"(b) Sliding down (thick) with {low} to {high} N, "
        f"{run.said('wall.losses')} losses of contact (limit: 2 N)",
        "force on the wall / N",
    )
    force.set_ylim(0.0, None)
    _laid(layer, shift, run, shown, "wall")
    return figure


def plot_crown(run: ChargingRun, shown: Sequence[ModeRows]) -> Figure:
    """Draw the laying of items on the crown."""
    traces = run.outcome.traces
    place = run.said("crown.position_error", MM)
    figure = new_figure(
        height=7.5,
        caption=f"Items are set down on the crown {place} mm from their goal, with up to "
        f"{run.said('crown.peak_force')} N. Each curve is one item.",
    )
    error, layer, shift = figure.subplots(3, 1, sharex=True)
    nugget, carried = in_space(traces, "nugget"), _carried(traces)
    away = []
    for part in shown:
        off = np.linalg.norm(nugget - items_of(run.scenario)[part.item].goal, axis=1)
        away += _courses([part], np.where(carried, MM * off, np.nan), named=True)
    _panel(
        error,
        away,
        [_limit(10.0, "mm", " (ours)")],
        f"(a) Set down {place} mm from its goal (limit: 10 mm)",
        "distance to goal / mm",
    )
    error.set_yscale("log")
    _laid(layer, shift, run, shown, "crown")
    return figure


def plot_bulk(run: ChargingRun, shown: Sequence[ModeRows]) -> Figure:
    """Draw the places of the bulk loads and all other items."""
    traces = run.outcome.traces
    off = run.said("bulk.position_error", MM)
    figure = new_figure(
        height=3.6,
        caption=f"Bulk loads are poured {off} mm from their goal. Each curve is one load.",
    )
    _panel(
        figure.subplots(),
        _courses(shown, MM * _off_command(traces), named=True),
        [_limit(10.0, "mm")],
        f"Poured {off} mm from its goal (limit: 10 mm)",
        "position error / mm",
        "time in the mode / s",
    )
    return figure


def _laid(
    layer: Axes, shift: Axes, run: ChargingRun, shown: Sequence[ModeRows], mode: str
) -> None:
    """Draw an item's force on the layer, and the layer's shift."""
    traces = run.outcome.traces
    letters = "cd" if mode == "wall" else "bc"
    _panel(
        layer,
        _courses(shown, traces["layer_peak_force"]),
        [_limit(2.0, "N")],
        f"({letters[0]}) Set down with up to {run.said(f'{mode}.peak_force')} N at "
        f"{run.said(f'{mode}.impact_speed', CM)} cm/s (limits: 2 N, 20 cm/s)",
        "force on the layer / N",
    )
    _panel(
        shift,
        _courses(shown, MM * traces["layer_shift"]),
        [_limit(0.5, "mm")],
        f"({letters[1]}) Layer shifted by {run.said(f'{mode}.layer_shift', MM)} mm "
        "(limit: 0.5 mm)",
        "shift / mm",
        "time in the mode / s",
    )


def plot_landscape(run: ChargingRun) -> Figure | None:
    """Draw the nuggets that followed the one below; None if none did."""
    shown = [
        part
        for kind in ("wall", "crown")
        for part in run.parts(kind, first=f"{kind}.follow", kind=kind)
    ]
    if not shown:
        return None
    traces = run.outcome.traces
    taken, true = (in_space(traces, name) for name in ("normal", "true_normal"))
    tilts = [np.degrees(np.arccos(np.clip(one[:, 2], -1.0, 1.0))) for one in (taken, true)]
    figure = new_figure(
        height=9.0,
        caption="Nuggets that follow what lies below them: force, estimated slope with its 95 % "
        "band, and direction of the force control beside the true normal (dotted).",
    )
    force, normal, *selected = figure.subplots(4, 1, sharex=True)
    _panel(
        force,
        _courses(shown, traces["layer_peak_force"], named=True),
        [_limit(2.0, "N")],
        "(a) Force on the nugget below (limit: 2 N)",
        "force / N",
    )
    if "normal_deviation" in traces:
        half = np.degrees(_NORMAL_95 * traces["normal_deviation"])
        for part in shown:
            low, high = (tilts[0][part.rows] + sign * half[part.rows] for sign in (-1, 1))
            look = BAND | {"color": _colour_of(part.item), "alpha": 0.15}
            normal.fill_between(part.time, np.maximum(low, 0.0), high, **look)
    dotted = [part._replace(style=part.style | {"linestyle": ":"}) for part in shown]
    draw_lines(
        normal,
        (),
        [*_courses(shown, tilts[0]), *_courses(dotted, tilts[1])],
        title="(b) Estimated slope with 95 % band, and true slope (dotted)",
        y="slope / deg",
        over="",
    )
    for axes, i, letter in zip(selected, (0, 1), "cd", strict=True):
        axis = "xy"[i]
        draw_lines(
            axes,
            (),
            [*_courses(shown, taken[:, i]), *_courses(dotted, true[:, i])],
            title=f"({letter}) Force direction along {axis}, and true normal (dotted)",
            y=f"part along {axis}",
            over="time since the touch / s" if i else "",
        )
    return figure


def plot_places(scenario: ResolvedCrucibleChargingScenario, outcome: Outcome) -> Figure | None:
    """Draw the crucible from above with the laid items; None if none was picked up."""
    traces, station = outcome.traces, scenario.station.true
    nugget = MM * in_space(traces, "nugget")
    held = [
        np.flatnonzero((traces["item"] == i) & (traces["held"] > 0))
        for i in range(len(scenario.plan))
    ]
    if not any(map(len, held)):
        return None
    placed, laid = (metric_value(outcome.metrics, f"cycle.{name}") for name in ("placed", "laid"))
    says = f"{placed:.0f} of {laid:.0f} items end at their goal"
    says = says if placed >= 0 else "Items and their goals"
    figure = new_figure(
        height=5.6,
        caption=f"{says}: the crucible from above, with the place of each item (dot, outline) "
        "and its goal (plus).",
    )
    axes = figure.subplots()
    x, y = (MM * one for one in station.crucible_centre)
    style = {**GLASS, "alpha": 0.4, "label": "crucible, inner wall"}
    axes.add_patch(Circle((x, y), MM * station.crucible_radius, **style))
    items = items_of(scenario)
    for one in items[0].laid:
        place = (MM * one.middle[0], MM * one.middle[1])
        axes.add_patch(Circle(place, MM * one.nugget.reach, color="0.85"))
    for i, (item, rows) in enumerate(zip(items, held, strict=True)):
        if not len(rows):
            continue
        colour = _colour_of(i)
        place = (float(nugget[rows[-1], 0]), float(nugget[rows[-1], 1]))
        axes.add_patch(Circle(place, MM * item.nugget.reach, fill=False, color=colour))
        axes.annotate(str(i + 1), place, xytext=(4, 4), textcoords="offset points", fontsize=8)
        axes.plot(*place, color=colour, marker=".", linestyle="none")
        axes.plot(*(MM * one for one in item.goal[:2]), color=colour, marker="+", markersize=10)
    axes.set_aspect("equal")
    axes.autoscale_view()
    dress(
        axes,
        title=f"{says} (dot: item, plus: goal)",
        x="x / mm",
        y="y / mm",
    )
    legend(axes)
    return figure


# Each mode's figure: the modes of the chart in it, the state from which on rows count, the kind.
_MODES: Final = {
    "acquire": (plot_acquire, ("acquire",), "acquire.descend", ""),
    "scan": (plot_scan, ("scan",), "", ""),
    "slew": (plot_slew, ("slew",), "", ""),
    "wall": (plot_wall, ("wall", "release"), "", "wall"),
    "crown": (plot_crown, ("crown", "release"), "", "crown"),
    "bulk": (plot_bulk, ("bulk",), "", ""),
}


def plot_charging(
    scenario: ResolvedCrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> dict[str, Figure]:
    """Draw each mode that the run reached, and the final places of the items.

    ``states`` are the chart's by their index in the traces; each name begins with its mode and a
    point.
    """
    run, figures = ChargingRun(scenario, outcome, states), {}
    for name, (draw, modes, first, kind) in _MODES.items():
        if shown := run.parts(*modes, first=first, kind=kind):
            figures[name] = draw(run, shown)
    others = {"landscape": plot_landscape(run), "places": plot_places(scenario, outcome)}
    return figures | {name: one for name, one in others.items() if one is not None}


def _carried(traces: Table) -> NDArray[np.bool_]:
    """Return the rows in which an item is in the gripper, and in the next one too.

    An item's signals jump to the empty gripper at its release.
    """
    held = traces["held"] > 0
    still: NDArray[np.bool_] = held & np.append(held[1:], False)
    return still


def plot_path(chart: ChargingChart, outcome: Outcome) -> Figure:
    """Draw the chart and a run's path through it, from its table ``transitions``."""
    path = outcome.tables["transitions"]
    laid, time = outcome.metrics["cycle.laid"], outcome.metrics["cycle.time"].value
    why = f", then stopped: {laid.note}" if laid.note else ""
    result = f"{laid.value:g} items laid in {time:.1f} s{why}"
    return plot_chart_path(chart, path, result=result)
