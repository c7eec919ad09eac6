"""The figures of the modes in which a charging cycle takes an item to the crucible."""

from collections.abc import Sequence
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from chamfer.analysis.charging.charging_metrics import in_space
from chamfer.analysis.charging.charging_parts import (
    BESIDE,
    CM,
    GLASS,
    MM,
    off_command,
    parts,
    said,
)
from chamfer.analysis.drawing.figure_style import BAND, DESIRED, LIMIT, dress, legend, new_figure
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario

_OUTLINES: Final = 9  # of a nugget along a slew


def plot_acquire(
    scenario: CrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
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
    scenario: CrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
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
    scenario: CrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
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
