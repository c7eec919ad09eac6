"""A gripper on an unknown surface: on a given path (section 5.2), or controlled (section 5.3)."""

import math
from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import over_trials, trial_seed
from chamfer.analysis.campaign.trial_rows import Row, table_of, with_table
from chamfer.analysis.contact.contact_figures import note_stability
from chamfer.analysis.contact.contact_metrics import stability_metrics
from chamfer.analysis.drawing.figure_kit import (
    Curve,
    FilledBand,
    ReferenceLine,
    draw_lines,
    metric_value,
)
from chamfer.analysis.drawing.figure_style import (
    AXIS_LOOKS,
    DESIRED,
    FORCE,
    NOTE,
    PUBLISHED,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.published.hybrid_force_position_observer import OBSERVER
from chamfer.analysis.report.checks import Published
from chamfer.analysis.scenario.experiment import Outcome, Progress, Table
from chamfer.analysis.surface.force_prediction import warn_of_force
from chamfer.analysis.surface.normal_metrics import (
    DEVIATIONS,
    ESTIMATION,
    TOLERANCE,
    TRACKING,
    angle_between,
    estimation_metrics,
    normalised_square,
    tracking_metrics,
)
from chamfer.diagrams.surface.compiled_surface_loop import run_compiled
from chamfer.diagrams.surface.surface_estimation import (
    LARGE_NOISE,
    NOISE_FREE,
    SMOOTH,
    SURFACE_ESTIMATION,
    EstimationScenario,
    ResolvedEstimationScenario,
    make_estimation_diagram,
    resolve_estimation,
)
from chamfer.diagrams.surface.surface_scenario import ResolvedSurfaceScenario
from chamfer.diagrams.surface.surface_tracking import (
    SURFACE_CONTROL,
    SURFACE_CONTROL_ADAPTIVE,
    SURFACE_CONTROL_NOISE_FREE,
    ResolvedTrackingScenario,
    TrackingScenario,
    make_tracking_diagram,
    resolve_tracking,
    tracking_stability,
)
from chamfer.systems.compiled import compiled
from chamfer.systems.estimation.normal_filter import instantaneous_normal

Array = NDArray[np.float64]
Traces = dict[str, Array]
Resolved = ResolvedEstimationScenario | ResolvedTrackingScenario

TRUTH: Final[Style] = {"color": "#111111", "linestyle": (0, (5, 2)), "linewidth": 1.3}
ESTIMATE: Final[Style] = {"color": "#1b4f9c", "linestyle": "-", "linewidth": 1.3}
UNCERTAIN: Final[Style] = {"color": "#6fa0e8", "alpha": 0.35, "linewidth": 0}
SAMPLE: Final[Style] = {"color": "#b5b5b5", "linestyle": "", "marker": ".", "markersize": 2.5}
_MARGIN: Final = 6.0  # deg, around estimate and band; single samples may be anywhere
_OFFSET: Final = {"textcoords": "offset points"}


def run_surface(scenario: Resolved, seed: int) -> Traces:
    """Move the gripper along a given path, or under control; return the traces.

    A row is a sample of the observer, with the estimate that is made with it, or a period of the
    controller. ``time`` s; ``force`` N, the normal component of the true force; ``error`` deg, the
    estimated normal's; ``band`` deg, three standard deviations; ``nees``, the normalised error
    squared; ``change`` deg, of the estimate since the start; ``angle``, ``true_angle`` and
    ``instantaneous`` (a single sample's) deg, of the normals above the x axis (in the plane);
    ``status``; ``speed`` m/s and ``point_x`` m and so on, of the contact point; ``nominal_x`` m
    and so on; ``normal_x`` and ``true_normal_x`` and so on; ``measured_force_x`` N and so on, of
    the gripper on the surface; ``travel`` m, of the contact point along x; where it is controlled,
    ``effort_x`` N and so on.
    """
    # The last sample's estimate shows a row later; rounding must not decide about the last row.
    period, d = scenario.sensor_period, scenario.dimension
    samples = math.floor(scenario.duration / period + 1e-9) + 1
    outputs = None
    if isinstance(scenario, ResolvedTrackingScenario):
        outputs = run_compiled(scenario, samples, seed)
        make = partial(make_tracking_diagram, scenario)
    else:
        make = partial(make_estimation_diagram, scenario)
    if outputs is None:
        time = (samples + 0.5) * period
        outputs = simulate(make(), duration=time, step=period, seed=seed).outputs
    # What the observer makes of a sample shows up in the next row.
    normal, deviation = outputs["normal"][1:], outputs["deviation"][1:]
    covariance = outputs["covariance"][1:].reshape(-1, d, d)
    contact, force = outputs["contact"][:-1], outputs["contact_force"][:-1]
    point, velocity, truth = contact[:, :d], contact[:, d : 2 * d], contact[:, 2 * d : 3 * d]
    first = np.broadcast_to(scenario.up, normal.shape)
    traces = {
        "time": period * np.arange(samples, dtype=np.float64),
        "force": np.sum(force * truth, axis=1),
        "error": angle_between(normal, truth),
        "band": DEVIATIONS * np.degrees(deviation),
        "nees": normalised_square(normal, truth, covariance),
        "change": angle_between(normal, first),
        "status": outputs["status"][1:],
        "speed": np.linalg.norm(velocity, axis=1),
        "travel": point[:, 0],
    }
    if d == 2:
        traces["angle"] = np.degrees(np.arctan2(normal[:, 1], normal[:, 0]))
        traces["true_angle"] = traces["angle"] - traces["error"]
        traces["instantaneous"] = _instantaneous(scenario, outputs)[:-1]
    for i, axis in enumerate("xyz"[:d]):
        traces[f"point_{axis}"] = point[:, i]
        traces[f"nominal_{axis}"] = outputs["nominal_motion"][:-1, i]
        traces[f"normal_{axis}"] = normal[:, i]
        traces[f"true_normal_{axis}"] = truth[:, i]
        traces[f"measured_force_{axis}"] = outputs["measured_force"][:-1, i]
        if "effort" in outputs:
            traces[f"effort_{axis}"] = outputs["effort"][1:, i]
    return traces


def _instantaneous(scenario: ResolvedSurfaceScenario, outputs: dict[str, Array]) -> Array:
    """Return the angle from each sample alone, deg; NaN where it gives none."""
    names = ("measured_force", "measured_force_rate", "nominal_motion")
    force, rate, motion = (np.ascontiguousarray(outputs[name]) for name in names)
    velocity = motion[:, scenario.dimension :] - rate @ scenario.observer.compliance.T
    return _angles(-force, velocity, scenario.observer.velocity_noise)


@compiled
def _angles(force: Array, velocity: Array, noise: float) -> Array:
    angles = np.full(len(force), math.nan)
    for i in range(len(force)):
        found, u = instantaneous_normal(force[i], velocity[i], 1.0, noise, np.zeros(2))
        if u < math.inf:
            angles[i] = math.degrees(math.atan2(found[1], found[0]))
    return angles


def run_trials(scenario: Resolved, seed: int, progress: Progress) -> Outcome:
    """Run the scenario with each of its seeds; traces are of the first."""
    if isinstance(scenario, ResolvedTrackingScenario):
        warn_of_force(scenario)
    finished = run_each(partial(_run_trial, scenario, seed), range(scenario.trials), progress)
    if isinstance(scenario, ResolvedTrackingScenario):
        metrics = over_trials(finished.rows, TRACKING)
        metrics |= stability_metrics(tracking_stability(scenario))
    else:
        metrics = over_trials(finished.rows, ESTIMATION)
    first = trial_seed(seed, finished.tasks[0])
    return Outcome(
        metrics=metrics,
        traces=table_of(finished.rows[0]) or run_surface(scenario, first),
        simulated_seconds=len(finished) * scenario.duration,
    )


def _run_trial(scenario: Resolved, seed: int, trial: int) -> Row:
    traces = run_surface(scenario, trial_seed(seed, trial))
    if isinstance(scenario, ResolvedTrackingScenario):
        every = round(scenario.observer.period / scenario.controller.period)
        measured = tracking_metrics(traces, force=scenario.task.force, every=every)
    else:
        lead = scenario.lead  # the metrics' windows are of its motion along x
        moving = traces | {"time": traces["time"] - lead.begins}
        measured = estimation_metrics(moving, halt=lead.halt)
    return measured if trial else with_table(measured, traces)


def _figures(
    experiment: str,
    default: EstimationScenario | TrackingScenario,
    scenario: Resolved,
    outcome: Outcome,
) -> Mapping[str, Figure]:
    """Draw the force where it is controlled, position of the contact point, and the normal."""
    published: dict[str, Published] = {}  # by metric; they are those of the default scenario only
    resolve = resolve_tracking if isinstance(default, TrackingScenario) else resolve_estimation
    if scenario == resolve(default):  # type: ignore[arg-type]
        published = {one.metric: one for one in OBSERVER if one.experiment == experiment}
    traces, metrics, halt = outcome.traces, outcome.metrics, math.inf
    rms, covered = (metric_value(metrics, name) for name in ("error.rms", "coverage"))
    known = math.isfinite(rms) and math.isfinite(covered)
    said = f"Normal: {rms:.2g} deg rms error, {covered:.3g} % within the band"
    said = said if known else "Estimated and true normal"
    if isinstance(scenario, ResolvedTrackingScenario):
        low, high = (metric_value(metrics, f"force.{end}") for end in ("min", "max"))
        holds = f"Force between {low:.2g} and {high:.2g} N, {scenario.task.force:g} N desired"
        holds = holds if low <= high else "Contact force"
        figure = new_figure(
            height=10.0,
            caption=f"{holds} (a). {said} (c), with {scenario.observer.kind} observer. "
            "Curves are of the first seed, numbers of all.",
        )
        force, position, normal = figure.subplots(3, 1, sharex=True, height_ratios=(4, 2, 4))
        levels = [
            (f"published {name}", value)
            for metric, name in (("force.min", "least"), ("force.max", "largest"))
            if metric in published and (value := published[metric].value) is not None
        ]
        draw_force(force, traces, scenario.task.force, levels, f"(a) {holds}")
        legend(force, ncols=3)
        note_stability(figure, outcome)
    else:
        figure = new_figure(
            height=7.0,
            caption=f"{said}, with {scenario.observer.kind} observer. The gripper is led along an "
            "unknown surface. Curves are of the first seed, numbers of all.",
        )
        position, normal = figure.subplots(2, 1, sharex=True, height_ratios=(2, 4))
        halt = scenario.lead.halt
    letters = "bc" if isinstance(scenario, ResolvedTrackingScenario) else "ab"
    _position(position, scenario, traces, f"({letters[0]}) Contact point")
    _normal(normal, scenario, traces, published, f"({letters[1]}) {said}")
    if halt < scenario.duration:
        for axes in (position, normal):
            axes.axvline(halt, color="#555555", linewidth=0.8, linestyle=":")
        normal.annotate("halt", (halt, normal.get_ylim()[0]), xytext=(3, 4), **_OFFSET, **NOTE)
    normal.set_xlim(0, scenario.duration)
    return {experiment: figure}


# The figures of each experiment, by file name.
estimation_figures = partial(_figures, "surface-estimation", SURFACE_ESTIMATION)
smooth_figures = partial(_figures, "surface-estimation-smooth", SMOOTH)
noise_free_figures = partial(_figures, "surface-estimation-noise-free", NOISE_FREE)
large_noise_figures = partial(_figures, "surface-estimation-large-noise", LARGE_NOISE)
control_figures = partial(_figures, "unknown-surface-control", SURFACE_CONTROL)
control_noise_free_figures = partial(
    _figures, "unknown-surface-control-noise-free", SURFACE_CONTROL_NOISE_FREE
)
control_adaptive_figures = partial(
    _figures, "unknown-surface-control-adaptive", SURFACE_CONTROL_ADAPTIVE
)


def draw_force(
    axes: Axes,
    traces: Table,
    desired: float,
    published: Sequence[tuple[str, float]],
    title: str,
    **options: Any,
) -> None:
    """Draw the true normal force with the desired one and the published limits, N."""
    off = TOLERANCE * desired
    levels = [ReferenceLine(desired, f"desired, {desired:g} N", DESIRED)]
    for name, value in published:
        levels.append(ReferenceLine(value, f"{name}, {value:g} N", PUBLISHED))
    draw_lines(
        axes,
        traces["time"],
        [Curve(traces["force"], "true normal force", FORCE)],
        title=title,
        y="force / N",
        over="",
        bands=[FilledBand(desired - off, desired + off, f"within {100 * TOLERANCE:g} %")],
        levels=levels,
        **options,
    )


def _position(axes: Axes, scenario: ResolvedSurfaceScenario, traces: Table, title: str) -> None:
    lines = []
    for axis in "xyz"[: scenario.dimension]:
        style = AXIS_LOOKS[axis]
        nominal: Style = {"color": style["color"], "linewidth": 0.9, "linestyle": ":"}
        lines.append(Curve(traces[f"nominal_{axis}"], f"{axis}, nominal", nominal))
        lines.append(Curve(traces[f"point_{axis}"], axis, style))
    draw_lines(axes, traces["time"], lines, title=title, y="position / m", over="")
    legend(axes, ncols=6)


def _normal(
    axes: Axes,
    scenario: ResolvedSurfaceScenario,
    traces: Table,
    published: dict[str, Published],
    title: str,
) -> None:
    every = max(1, round(scenario.observer.period / (traces["time"][1] - traces["time"][0])))
    time, band = traces["time"], traces["band"]
    if "angle" in traces:
        estimate, truth = traces["angle"], traces["true_angle"]
        axes.plot(time[::every], traces["instantaneous"][::every], label="single sample", **SAMPLE)
        axes.plot(time, truth, label="true normal", **TRUTH)
        unit = "angle above x / °"
        low, high = estimate - band, estimate + band
    else:
        estimate, truth = traces["error"], np.zeros(len(time))
        unit = "error of the normal / °"
        low, high = np.zeros(len(time)), band
    axes.fill_between(time, low, high, label=f"{DEVIATIONS:g} standard deviations", **UNCERTAIN)
    axes.plot(time, estimate, label=f"estimate, {scenario.observer.kind}", **ESTIMATE)
    for metric, window in (("band.equilibrium", (8.0, 14.9)), ("band.mean", (1.0, 15.0))):
        _published_band(axes, published.get(metric), window, time, truth)
    if "band.final" in published:
        _published_band(axes, published["band.final"], (time[-1] - 0.1, time[-1]), time, truth)
    axes.set_ylim(float(np.min(low)) - _MARGIN, float(np.max(high)) + _MARGIN)
    dress(axes, title=title, x="time / s", y=unit)
    legend(axes, ncols=3)


def _published_band(
    axes: Axes,
    published: Published | None,
    window: tuple[float, float],
    time: np.ndarray,
    truth: np.ndarray,
) -> None:
    if published is None or not published.value or published.relation != "near":
        return  # a band of 0 is the line of the truth
    rows = (time >= window[0]) & (time <= window[1])
    value = published.value
    for sign, label in ((1, f"published band, ±{value:g}°"), (-1, None)):
        axes.plot(time[rows], truth[rows] + sign * value, label=label, **PUBLISHED)
