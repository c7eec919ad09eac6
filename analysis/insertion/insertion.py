"""From pixels to a seated peg: the cameras align, a chart decides and inserts (section 5)."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.trial_metrics import over_trials
from chamfer.analysis.cell.alignment import pictures_at, plot_moments
from chamfer.analysis.cell.alignment_runs import row_before, settling_metrics
from chamfer.analysis.cell.wedging_diagram import draw_reach, draw_sides
from chamfer.analysis.drawing.chart_path import plot_chart_path
from chamfer.analysis.drawing.figure_kit import (
    Curve,
    ReferenceLine,
    colour_bar,
    colour_legend,
    draw_lines,
    draw_strip,
    metric_value,
    shade,
    state_visits,
)
from chamfer.analysis.drawing.figure_style import (
    ABOVE,
    AXIS_LOOKS,
    FORCE,
    LIMIT,
    POSITION,
    REGION,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.insertion.admittance_stability import loop_metrics
from chamfer.analysis.insertion.cell_runs import (
    INSERTION,
    CellInsertion,
    ending,
    errors_in_planes,
    force_medians,
    insertion_charts,
    insertion_metrics,
    loads_in_planes,
    path_table,
    predict,
    run_cell_insertion,
    touch_row,
)
from chamfer.analysis.insertion.jamming_diagram import (
    DEPTH_COLOURS,
    DEPTH_SCALE,
    draw_parallelogram,
)
from chamfer.analysis.insertion.peg_insertion import STATES
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress
from chamfer.diagrams.cell.alignment_scenario import require_fine_enough
from chamfer.diagrams.insertion.contact_loop import contact_loop
from chamfer.diagrams.insertion.insertion import (
    InsertionScenario,
    ResolvedInsertionScenario,
    resolve,
    task_params,
)
from chamfer.models.peg.peg_and_hole import SEATED
from chamfer.models.peg_theory.wedging import rotation_bounds
from chamfer.systems.contact.peg_hole_contact_monitor import ContactState

_NOTES = {
    "seated": f"1: {100 * SEATED:g} % of the commanded depth, or on the bottom, at the end",
    "seated.first": "1: with the first attempt",
    "depth": "of the tip below the mouth, deepest of the last attempt",
    "force.axial": "against the insertion, largest median of 10 ms",
    "force.lateral": "across, largest median of 10 ms",
    "force.contact": "of both together, largest median of 10 ms",
    "force.raw_peak": "against the insertion, of one step",
    "force.peak": "in any direction, of one step",
    "compliance.deflection": "largest deflection of the remote centre compliance, of its limit",
    "force.share": "of insert.force_limit",
    "saturated": "of the time, with a joint at its torque limit",
    "joints.margin": "to the nearest end of a joint's travel",
    "force.sensed_error": "largest error of the arm's sensed force while the peg is fed",
    "cycle_time": "from the start until the task reports seated",
    "time_to_seated": "from the begin of the compensation to 90 % of the depth",
    "search.time": "of the searches by contact, all attempts",
    "search.found": "1: the last search led into the hole",
    "decision.time": "from the begin of the compensation to the last decision",
    "touch.lateral_error": "at the first touch, or with the tip at the mouth",
    "touch.rotational_error": "at the first touch, or with the tip at the mouth",
    "two_point.onset": "l",
    "pull_out.force": "that pulls out a peg stopped in the hole",
}


def run(scenario: ResolvedInsertionScenario, seed: int, progress: Progress) -> Outcome:
    """Insert the peg once."""

    def told(fraction: float, doing: str = "") -> None:
        # The task ends long before its time is up: the time is what tells.
        progress(fraction, doing or f"{fraction * scenario.duration:.0f} s of the task")

    return outcome_of(scenario, run_cell_insertion(scenario, seed, told), seed)


def outcome_of(scenario: ResolvedInsertionScenario, done: CellInsertion, seed: int) -> Outcome:
    """Return the results of a run; the seed is that of its pictures."""
    time, touch = done.traces["time"], touch_row(done)
    last, before = len(time) - 1, row_before(time, scenario.begin)
    moments = {"before": before, "touch": last if touch is None else touch, "end": last}
    tables = {"path": path_table(done.path)}
    if scenario.cameras.kind == "pair":
        tables["pictures"] = pictures_at(scenario.there, done.traces, moments, seed)
    return Outcome(
        metrics=_metrics(scenario, done),
        traces=done.traces,
        simulated_seconds=float(time[-1]),
        tables=tables,
    )


def _metrics(scenario: ResolvedInsertionScenario, done: CellInsertion) -> dict[str, Metric]:
    metrics = over_trials([insertion_metrics(done, scenario)], INSERTION)
    insert = scenario.insert
    cap = f"at a cap of {insert.push:g} N"
    notes = _NOTES | {
        "wedged": f"1: stopped {cap}, held without it by more than {insert.held_force:g} N",
        "jammed": f"1: stopped {cap}, held by no more without it",
    }
    notes["said_seated"] = ending(done, scenario)
    for name, note in notes.items():
        if metrics[name].value is not None:
            metrics[name] = replace(metrics[name], note=note)
    if metrics["compliance.deflection"].value is None:
        del metrics["compliance.deflection"]  # there is none
    metrics["real_time_factor"] = Metric(
        value=round(float(done.traces["time"][-1]) / done.cpu_seconds, 2),
        unit="",
        note="simulated over processor time, one core, the machine's own",
    )
    if scenario.cameras.kind != "none":
        metrics |= settling_metrics(scenario)
    if scenario.servo is not None and scenario.admittance.kind == "wrist":
        metrics |= loop_metrics(contact_loop(scenario))
    return metrics | predict(scenario, done)


def figures(scenario: ResolvedInsertionScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    (chart,) = insertion_charts(scenario)
    result = outcome.metrics["said_seated"].note
    time = outcome.traces["time"]
    loads = new_figure(
        height=5.6,
        caption="Path of the peg's tip and tilt into the wedge-free region (a), and the loads on "
        "the peg in the bore (b): at a depth ratio \u03bb it slides inside that colour's line.",
    )
    wedging, jamming = loads.subplots(1, 2)
    _wedging(wedging, scenario, outcome)
    _jamming(jamming, scenario, outcome)
    drawn = {
        "insertion": plot_course(scenario, outcome, chart.state_names),
        "path": plot_chart_path(chart, outcome.tables["path"], result=result),
        "loads": loads,
    }
    if "pictures" in outcome.tables:
        moments = {"before": "before", "touch": "at the touch", "end": f"after {time[-1]:.1f} s"}
        drawn["pictures"] = plot_moments(scenario, outcome.tables["pictures"], moments)
    return drawn


def resolve_insertion(scenario: InsertionScenario) -> ResolvedInsertionScenario:
    """Return the scenario with its open fields filled in, and checked."""
    resolved = resolve(scenario)
    if scenario.cameras.kind == "pair":
        require_fine_enough(resolved)
    return resolved


Array = NDArray[np.float64]

_MEASURED: Final[Style] = {"color": "#1b4f9c", "linestyle": "--", "linewidth": 1.2}
_SURE: Final[Style] = {"color": "#1b4f9c", "alpha": 0.18, "linewidth": 0}
_COMMAND: Final[Style] = {"color": "#555555", "linestyle": "-", "linewidth": 1.0}
_SIDE: Final[Style] = {"color": "#1b4f9c", "linestyle": "-", "linewidth": 1.2}
_PLANES: Final[dict[str, tuple[str, Style]]] = {
    "xy": ("plane XY", AXIS_LOOKS["y"]),
    "xz": ("plane XZ", AXIS_LOOKS["z"]),
}
_MARKERS: Final = {"xy": "o", "xz": "^"}
_RATIOS: Final = (0.5, 1.0, 2.0, 4.0)
_MM: Final = 1e3
_MRAD: Final = 1e3
_FEW: Final = 150  # loads of a plane that are drawn


def plot_course(
    scenario: ResolvedInsertionScenario, outcome: Outcome, states: Sequence[str]
) -> Figure:
    """Draw errors, depth and forces over time, with the task's and the contact's states."""
    metrics, traces = outcome.metrics, outcome.traces
    figure = new_figure(
        height=11.5,
        caption=f"Result: {metrics['said_seated'].note}. Errors, depth and forces over time, with "
        "the states of the skill on top and the contact state as background.",
    )
    heights = (0.9, 1, 1, 1, 0.8, 1, 0.8)
    strip, *panels = figure.subplots(7, 1, sharex=True, height_ratios=heights)
    time, params = traces["time"], task_params(scenario)
    looks = np.isin(traces["task_state"], [states.index(name) for name in ("align", "decide")])
    names = [name.replace("_", " ") for name in states]
    draw_strip(strip, state_visits(time, traces["task_state"], names), float(time[-1]))
    for axes, name, scale, unit, limit in (
        (panels[0], "lateral", _MM, "mm", params.region.lateral_limit),
        (panels[1], "rotational", _MRAD, "mrad", params.region.rotation_limit),
    ):
        error = scale * np.maximum(traces[f"{name}_error"], 1e-6)
        axes.semilogy(time, error, label="true", **POSITION)
        if scenario.cameras.kind != "none":
            known = looks & (traces["measured_lateral"] > 0)
            measured = np.where(known, traces[f"measured_{name}"], np.nan)
            unsure = traces[f"measured_{name}_uncertainty"]
            axes.semilogy(time, scale * measured, label="measured", **_MEASURED)
            low = np.maximum(measured - unsure, 1e-6)
            axes.fill_between(time, scale * low, scale * (measured + unsure), **_SURE)
        axes.axhline(scale * limit, label="limit", **LIMIT)
        axes.set_ylim(scale * limit / 300, 2 * max(float(error.max()), scale * limit))
        at = metric_value(metrics, f"touch.{name}_error", scale)
        title = f"{name.capitalize()} error" + (f", {at:.2g} {unit} at touch" if at >= 0 else "")
        letter = {"lateral": "a", "rotational": "b"}[name]
        dress(axes, title=f"({letter}) {title}", x="", y=f"error / {unit}")
    depth, off, force, across = panels[2:]
    lines = [Curve(_MM * traces["depth"], "true", POSITION)]
    target = ReferenceLine(_MM * params.target, "target", LIMIT)
    title = f"(c) Depth in the hole, {_MM * traces['depth'][-1]:.3g} mm at the end"
    draw_lines(depth, time, lines, title=title, y="depth / mm", over="", levels=[target])
    sensed = np.r_[np.nan, traces["sensed_depth"][1:]]  # it has not been sampled before
    lines = [
        Curve(_MM * (sensed - traces["depth"]), "encoders", _MEASURED),
        Curve(_MM * (traces["feed"] - scenario.gap - traces["depth"]), "command", _COMMAND),
    ]
    draw_lines(off, time, lines, title="(d) Depth minus the true one", y="depth / mm", over="")
    axial, lateral = (
        Curve(values, "contact, median of 10 ms", FORCE)
        for values in force_medians(traces, scenario.step)
    )
    sensor = "arm stiffness" if scenario.servo is None else "wrist sensor"
    lines = [axial, Curve(traces["sensed_x"], sensor, _MEASURED)]
    for axes, of, letter in ((force, lines, "e"), (across, [lateral], "f")):
        kind = "axial" if letter == "e" else "lateral"
        most = metric_value(metrics, f"force.{kind}")
        title = f"({letter}) {kind.capitalize()} force, contact up to {most:.2g} N"
        draw_lines(axes, time, of, title=title, y="force / N", over="")
    across.set_xlabel("time / s", fontsize=9)
    seen = {state: found for state, found in STATES.items() if state in traces["contact_state"]}
    for axes in panels:
        for state, (_, colour) in seen.items():
            look: Style = {"color": colour, "alpha": 0.6, "linewidth": 0, "zorder": 0}
            shade(axes, time, traces["contact_state"] == state, "", look)
        legend(axes, ncols=4, **ABOVE)
    across.set_xlim(0.0, float(time[-1]))
    if seen:
        colour_legend(figure, {f"contact: {name}": colour for name, colour in seen.values()})
    return figure


def _wedging(axes: Axes, scenario: ResolvedInsertionScenario, outcome: Outcome) -> None:
    parts, traces = scenario.parts, outcome.traces
    limit = parts.chamfer_limit
    x = np.linspace(-limit, limit, 201)
    sides = lower, upper = rotation_bounds(parts, scenario.wedging_support, x)
    axes.fill_between(
        _MM * x,
        _MRAD * lower,
        _MRAD * upper,
        label="free of wedging",
        **REGION,
    )
    draw_sides(axes, x, sides, "exact sides", _SIDE)
    draw_reach(axes, parts, "reach of the chamfers")
    touched = np.flatnonzero(
        (traces["contact_state"] != ContactState.NONE) | (traces["depth"] >= 0)
    )
    for plane, (lateral, tilt) in errors_in_planes(traces).items():
        name, style = _PLANES[plane]
        axes.plot(_MM * lateral, _MRAD * tilt, label=f"path, {name}", **style)
        for row in touched[:1]:
            look: Style = {"marker": _MARKERS[plane], "markersize": 7, "linestyle": "none"}
            look |= {"markerfacecolor": style["color"], "markeredgecolor": "black"}
            there = _MM * lateral[row], _MRAD * tilt[row]
            axes.plot(*there, label=f"first touch, {name}", **look)
    margin = metric_value(outcome.metrics, "touch.margin")
    title = f"(a) First touch: {margin:.0f} % margin to wedging"
    title = title if np.isfinite(margin) else "(a) Path in the wedging diagram"
    off = "lateral error of the tip / mm"
    dress(axes, title=title, x=off, y="tilt (equal signs add) / mrad")
    legend(axes, ncols=2)
    tallest = 1.1 * max(float(upper.max()), float(traces["rotational_error"].max()))
    axes.set_ylim(-_MRAD * tallest, _MRAD * tallest)


def _jamming(axes: Axes, scenario: ResolvedInsertionScenario, outcome: Outcome) -> None:
    parts = scenario.parts
    for ratio in _RATIOS:
        draw_parallelogram(axes, parts, ratio)
    for plane, loads in loads_in_planes(outcome.traces, parts, scenario.step).items():
        count = len(loads.depth)
        if not count:
            continue
        few = slice(None, None, max(1, count // _FEW))
        axes.scatter(
            loads.force_ratio[few],
            loads.moment_ratio[few],
            c=loads.depth[few] / parts.wedging_depth,
            marker=_MARKERS[plane],
            s=14,
            label=f"loads, {_PLANES[plane][0]}",
            norm=DEPTH_SCALE,
            cmap=DEPTH_COLOURS.cmap,
        )
    colour_bar(axes, DEPTH_COLOURS, r"$\lambda = l / (2 r \mu)$", ticks=_RATIOS, format="%g")
    reach = 2 * max(_RATIOS) + 2
    axes.set_xlim(-1.6 / parts.friction, 1.6 / parts.friction)
    axes.set_ylim(-reach, reach)
    title = "(b) Loads in the jamming diagram"
    dress(axes, title=title, x="$F_x / F_z$", y="$M / (r F_z)$")
    legend(axes, ncols=2)
