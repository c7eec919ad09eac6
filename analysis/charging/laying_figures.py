"""The figures of the modes in which a charging cycle lays an item."""

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Circle
from numpy.typing import NDArray

from chamfer.analysis.charging.charging_metrics import SLIDING, in_space, items_of
from chamfer.analysis.charging.charging_parts import (
    BESIDE,
    CM,
    GLASS,
    MM,
    Part,
    colour_of,
    off_command,
    parts,
    said,
)
from chamfer.analysis.drawing.figure_style import (
    CONTACT_LOST,
    DESIRED,
    LIMIT,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Outcome, Table
from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario
from chamfer.models.surfaces.damage import SCRATCH_FORCE
from chamfer.systems.force.contact_detection import LOST


def plot_wall(
    scenario: CrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
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
    scenario: CrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
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
    scenario: CrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
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


def _laid(layer: Axes, shift: Axes, shown: Sequence[Part], outcome: Outcome, mode: str) -> None:
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


def plot_places(scenario: CrucibleChargingScenario, outcome: Outcome) -> Figure | None:
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
