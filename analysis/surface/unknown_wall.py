"""Section 6.3: arms find an unknown wall, and slide along it."""

import math
from collections.abc import Mapping
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import Quantity, over_trials, trial_seed
from chamfer.analysis.campaign.trial_rows import Row, table_of, with_table
from chamfer.analysis.contact.contact_figures import note_stability, shade_losses
from chamfer.analysis.contact.contact_metrics import (
    KEPT,
    contact_kept,
    longest,
    settling_time,
    stability_metrics,
)
from chamfer.analysis.drawing.figure_kit import (
    Curve,
    FilledBand,
    ReferenceLine,
    draw_lines,
    metric_value,
)
from chamfer.analysis.drawing.figure_style import (
    BAND,
    DESIRED,
    NOTE,
    POSITION,
    PUBLISHED,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.published.hybrid_force_position_observer import FIG_5_8_BAND, FIG_5_8_FORCE
from chamfer.analysis.scenario.experiment import Outcome, Progress, Table
from chamfer.analysis.surface.normal_metrics import (
    DEVIATIONS,
    TELLS,
    TOLERANCE,
    angle_between,
    held,
)
from chamfer.analysis.surface.unknown_surface import ESTIMATE, TRUTH, UNCERTAIN, draw_force
from chamfer.diagrams.contact.hybrid_loop_stability import stability
from chamfer.diagrams.surface.unknown_wall_loop import (
    ResolvedUnknownWallScenario,
    make_unknown_wall_diagram,
)
from chamfer.models.surfaces.damage import SAFE_SPEED, SCRATCH_FORCE, impact_speed_limit
from chamfer.models.surfaces.surface import curvature, normal
from chamfer.systems.contact.arm_motion import CONTACT_SIGNALS
from chamfer.systems.force.contact_detection_law import CONTACT, LOST, make_contact_chart
from chamfer.systems.statechart.chart import Chart

Array = NDArray[np.float64]
Rows = NDArray[np.bool_]
Traces = dict[str, Array]

_ARROWS: Final = 9  # estimates drawn along the way
_NEWTON: Final = 20  # iterations to the wall's outline
_MOST_ERROR: Final = 30.0  # deg, the axis' end
RECOVERY: Final = 1.0  # s, after contact is made again; within it Fig. 5-8 has settled
QUANTITIES: Final = {
    "contact_time": Quantity("s"),
    "impact.speed": Quantity("m/s"),
    "force.peak": Quantity("N"),
    "force.settling_time_10": Quantity("s", "most"),
    "force.min": Quantity("N", "least"),
    "force.max": Quantity("N", "most"),
    "force.within_10": Quantity("%"),
    "force.final": Quantity("N"),
    "error.start": Quantity("deg"),
    "error.rms": Quantity("deg", "rms"),
    "error.max": Quantity("deg"),
    "band.mean": Quantity("deg"),
    "coverage": Quantity("%"),
    **KEPT,
    "loss.duration": Quantity("s"),
    "recontact.speed": Quantity("m/s"),
    "recontact.settling_time_10": Quantity("s"),
    "wall.smallest_radius": Quantity("m"),
    "position.travel": Quantity("m"),
    "damage.scratch_time": Quantity("s"),
    "damage.impact_share": Quantity("%"),
    "damage.safe_speed_share": Quantity("%"),
}


def wall_metrics(
    traces: Table, *, force: float, after: float, kick: float | None, impact_limit: float
) -> dict[str, float | None]:
    """Measure a run; a value is None where it is undefined.

    Forces and errors count from ``after`` on, except the time from a blow until
    :data:`RECOVERY` after the return; a contact that is lost without a blow counts.

    Args:
        traces: ``time`` s, ``mode``, ``force`` N (the true normal one), ``error`` and ``band``
            deg, ``curvature`` 1/m, ``travel`` m, ``peak_force`` N, ``impact_speed`` m/s; shape
            (n,) each.
        force: N, desired.
        after: s.
        kick: s, of a blow that takes the tip off the wall.
        impact_limit: m/s, from which on an impact damages.
    """
    time, mode, push = traces["time"], traces["mode"], traces["force"]
    values: dict[str, float | None] = dict.fromkeys(QUANTITIES)
    values["force.peak"] = float(traces["peak_force"].max())
    values |= contact_kept(traces, after, kick)
    values["damage.scratch_time"] = longest(time, push > SCRATCH_FORCE)
    values["error.start"] = float(traces["error"][0])
    values["position.travel"] = float(traces["travel"][-1])
    impacts = traces["impact_speed"][traces["impact_speed"] > 0]
    if len(impacts):
        values["impact.speed"] = float(impacts[0])
        values["damage.impact_share"] = 100 * float(impacts.max()) / impact_limit
        values["damage.safe_speed_share"] = 100 * float(impacts.max()) / SAFE_SPEED
    touching = np.flatnonzero(mode == CONTACT)
    if not len(touching):
        return values
    contact = float(time[touching[0]])
    values["contact_time"] = contact
    back = _return(traces, kick)
    first = (time >= contact) & (time < (math.inf if kick is None else kick))
    values["force.settling_time_10"] = _settled(time, push, first, force)
    counted = time >= after
    if kick is not None:
        late = (kick if back is None else back) + RECOVERY
        counted &= (time < kick) | (time >= late)
    if kick is not None and back is not None:
        blown = (time >= kick) & (traces["impact_speed"] > 0)
        values["loss.duration"] = back - kick
        speeds = traces["impact_speed"][blown]
        values["recontact.speed"] = float(speeds.max()) if len(speeds) else None
        values["recontact.settling_time_10"] = _settled(time, push, time >= back, force)
    if np.any(counted):
        values |= held(push[counted], force)
        values["force.final"] = float(push[time > time[-1] - 1.0].mean())
    known = counted & (push > 0)
    if np.any(known):
        sharpest = float(traces["curvature"][known].max())
        values["wall.smallest_radius"] = 1 / sharpest if sharpest > 0 else None
        error, band = traces["error"][known], traces["band"][known]
        values["error.rms"] = math.sqrt(float(np.mean(error**2)))
        values["error.max"] = float(error.max())
        values["band.mean"] = float(band.mean())
        values["coverage"] = 100 * float(np.mean((error <= band) & (band < TELLS)))
    return values


def _return(traces: Table, kick: float | None) -> float | None:
    """Return when contact is made again after a blow, s; None without a blow or a return."""
    if kick is None:
        return None
    time, mode = traces["time"], traces["mode"]
    lost = np.flatnonzero((time >= kick) & (mode == LOST))
    if not len(lost):
        return None
    again = np.flatnonzero((time > time[lost[0]]) & (mode == CONTACT))
    return float(time[again[0]]) if len(again) else None


def _settled(time: Array, push: Array, rows: Rows, force: float) -> float | None:
    """Return the time from the first of some rows until the force stays within 10 %."""
    if np.count_nonzero(rows) < 2:
        return None
    return settling_time(time[rows] - time[rows][0], push[rows], force, TOLERANCE * force)


def run_wall(scenario: ResolvedUnknownWallScenario, seed: int) -> Traces:
    """Simulate a resolved scenario and return its traces, a row for each period.

    Columns: ``time`` s; ``force`` N, the normal component of the true force; ``error`` deg, of the
    estimated normal at the tip; ``band`` deg, three standard deviations; ``mode`` of contact
    detection; ``status`` of the observer; ``travel`` m, of the tip since the first contact;
    ``curvature`` 1/m, of the wall at the tip, the largest of any direction;
    ``across`` m, out of the believed wall; ``along`` m; ``point_x`` m and so on, the tip;
    ``normal_x`` and ``true_normal_x`` and so on; ``measured_force_x`` N and so on, of the arm on
    the wall; :data:`CONTACT_SIGNALS`; joint positions, velocities and torques.
    """
    arm, d, n = scenario.ARM, scenario.dimension, scenario.ARM.num_joints
    diagram = make_unknown_wall_diagram(scenario)
    period = scenario.controller.period
    run = simulate(diagram, duration=scenario.duration, step=period, seed=seed)
    outputs, wall = run.outputs, scenario.make_surface()
    point = outputs["tip"][:, :3]
    truth = np.array([normal(wall, p) for p in point])
    estimate = np.zeros_like(truth)
    estimate[:, :d] = outputs["normal"]
    touched = outputs["mode"] > 0
    moved = np.linalg.norm(np.diff(point, axis=0, prepend=point[:1]), axis=1)
    origin = point[int(np.argmax(touched))]
    traces: Traces = {
        "time": run.time,
        "force": np.sum(outputs["contact_force"] * truth, axis=1),
        "error": np.abs(angle_between(estimate, truth)),
        "band": DEVIATIONS * np.degrees(outputs["deviation"]),
        "mode": outputs["mode"],
        "status": outputs["status"],
        "travel": np.cumsum(np.where(touched, moved, 0.0)),
        "along": (point - origin) @ scenario.spatial_along,
        "curvature": np.array([curvature(wall, p) for p in point]),
        "across": (point - origin) @ scenario.spatial_up,
    }
    for i, axis in enumerate("xyz"):
        traces[f"point_{axis}"] = point[:, i]
        traces[f"normal_{axis}"] = estimate[:, i]
        traces[f"true_normal_{axis}"] = truth[:, i]
    for i, axis in enumerate("xyz"[:d]):
        traces[f"measured_force_{axis}"] = outputs["measured_force"][:, i]
    for i, name in enumerate(CONTACT_SIGNALS):
        traces[name] = outputs["contact"][:, i]
    for i, name in enumerate(arm.joint_names):
        traces[f"{name}.position"] = outputs["encoders"][:, i]
        traces[f"{name}.velocity"] = outputs["encoders"][:, n + i]
        traces[f"{name}.torque"] = outputs["torque"][:, i]
    return traces


def run_wall_trials(
    scenario: ResolvedUnknownWallScenario, seed: int, progress: Progress
) -> Outcome:
    """Run with each of the scenario's seeds; the traces are of the first."""
    finished = run_each(partial(_run_trial, scenario, seed), range(scenario.trials), progress)
    first = finished.tasks[0]
    metrics = over_trials(finished.rows, QUANTITIES) | stability_metrics(stability(scenario))
    return Outcome(
        metrics=metrics,
        traces=table_of(finished.rows[0]) or run_wall(scenario, trial_seed(seed, first)),
        simulated_seconds=len(finished) * scenario.duration,
    )


def _run_trial(scenario: ResolvedUnknownWallScenario, seed: int, trial: int) -> Row:
    traces = run_wall(scenario, trial_seed(seed, trial))
    task = scenario.task
    measured = wall_metrics(
        traces,
        force=task.force,
        after=scenario.measure_after,
        kick=task.kick_time,
        impact_limit=impact_speed_limit(task.nugget_mass),
    )
    return measured if trial else with_table(measured, traces)


def make_charts(scenario: ResolvedUnknownWallScenario) -> tuple[Chart[Any, Any], ...]:
    """Return the state charts."""
    return (make_contact_chart(scenario.detection, scenario.direction),)


def _figures(
    experiment: str, scenario: ResolvedUnknownWallScenario, outcome: Outcome
) -> Mapping[str, Figure]:
    """Draw the first run: its path along the wall, the force and the estimated normal."""
    traces, metrics = outcome.traces, outcome.metrics
    within, rms = (metric_value(metrics, name) for name in ("force.within_10", "error.rms"))
    holds = f"Force stays within 10 % in {within:.3g} % of the runs"
    holds = holds if np.isfinite(within) else "Contact force"
    errs = f"Error of the normal: {rms:.2g} deg rms" if np.isfinite(rms) else "Error of the normal"
    figure = new_figure(
        height=12.0,
        caption=f"{holds} (b). {errs} (c). The arm believes that the wall is flat and follows its "
        "real shape (a). Curves are of the first seed, numbers of all.",
    )
    way, force, normal, gap = figure.subplots(4, 1, height_ratios=(4, 3, 3, 2))
    _way(way, scenario, traces)
    _force(force, scenario, traces, f"(b) {holds}")
    _normal(normal, scenario, traces, f"(c) {errs}")
    _gap(gap, scenario, traces, outcome)
    for axes in (force, normal, gap):
        shade_losses(axes, traces)
        axes.set_xlim(0, scenario.duration)
    for axes in (way, force, normal):
        legend(axes, ncols=2 if axes is way else 3)
    note_stability(figure, outcome)
    return {experiment: figure}


adept_figures = partial(_figures, "adept-unknown-wall")
puma_figures = partial(_figures, "puma-unknown-wall")
planar_figures = partial(_figures, "planar-unknown-wall")


def _way(axes: Axes, scenario: ResolvedUnknownWallScenario, traces: Table) -> None:
    along, across = 1e3 * traces["along"], 1e3 * traces["across"]
    touched = np.flatnonzero(traces["mode"] == CONTACT)
    low, high = float(along.min()), float(along.max())
    margin = 0.1 * (high - low) + 1.0
    s = np.linspace(low - margin, high + margin, 200)
    axes.fill_between(s, _outline(scenario, traces, s), across.min() - margin, **BAND)
    axes.plot(s, _outline(scenario, traces, s), label="wall, unknown to the arm", **TRUTH)
    axes.axhline(0.0, label="wall as believed", **DESIRED)
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
    dress(
        axes, title="(a) Path of the tip along the wall", x="along / mm", y="out of the wall / mm"
    )


def _outline(scenario: ResolvedUnknownWallScenario, traces: Table, s: Array) -> Array:
    """Return the height of the wall at places along it, mm."""
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


def _force(axes: Axes, scenario: ResolvedUnknownWallScenario, traces: Table, title: str) -> None:
    desired, published = scenario.task.force, []
    if desired == FIG_5_8_FORCE.desired:
        published = [("Fig. 5-8", one) for one in (FIG_5_8_FORCE.low, FIG_5_8_FORCE.high)]
    draw_force(axes, traces, desired, published, title)
    axes.set_ylim(-0.1 * desired, 2.2 * desired)
    peak = float(traces["peak_force"].max())
    if peak > 2.2 * desired:
        axes.annotate(f"peak {peak:.3g} N", (0.01, 0.92), xycoords="axes fraction", **NOTE)


def _normal(axes: Axes, scenario: ResolvedUnknownWallScenario, traces: Table, title: str) -> None:
    uncertain = FilledBand(
        np.zeros(len(traces["time"])),
        traces["band"],
        f"{DEVIATIONS:g} standard deviations",
        UNCERTAIN,
    )
    draw_lines(
        axes,
        traces["time"],
        [Curve(traces["error"], f"error, {scenario.observer.kind}", ESTIMATE)],
        title=title,
        y="angle / °",
        over="",
        bands=[uncertain],
        levels=[ReferenceLine(FIG_5_8_BAND, f"band of Fig. 5-8, {FIG_5_8_BAND:g}°", PUBLISHED)],
    )
    axes.set_ylim(0, _MOST_ERROR)


def _gap(
    axes: Axes, scenario: ResolvedUnknownWallScenario, traces: Table, outcome: Outcome
) -> None:
    axes.plot(traces["time"], 1e3 * traces["gap"], label="distance", **POSITION)
    axes.axhline(0.0, **DESIRED)
    axes.set_yscale("symlog", linthresh=1.0)
    axes.yaxis.set_major_formatter("{x:g}")
    impact = outcome.metrics["impact.speed"].value
    if impact is not None:
        axes.annotate(
            f"impact {impact:.3g} m/s", (0.99, 0.9), xycoords="axes fraction", ha="right", **NOTE
        )
    dress(axes, title="(d) Distance from the wall", x="time / s", y="distance / mm")
