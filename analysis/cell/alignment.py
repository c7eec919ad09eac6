"""Figs. 11 to 14: the cameras align peg and hole, also on the way up; and how well, many times."""

import time
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray
from pydrake.geometry import Box, Meshcat, Rgba
from pydrake.math import RigidTransform, RotationMatrix
from scipy.spatial.transform import Rotation

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import metrics_of, over_trials, prefixed
from chamfer.analysis.campaign.trial_rows import Row, table_of, with_table
from chamfer.analysis.cell.alignment_runs import (
    ALIGNMENT,
    ARM_LIMITS,
    COURSE,
    LATE,
    SETTLED,
    STOPPED,
    RepeatabilityScenario,
    ResolvedRepeatabilityScenario,
    align_all,
    alignment_metrics,
    arm_limits,
    courses,
    detected_metric,
    detected_share,
    drawn,
    margins,
    mean_over,
    row_before,
    run_alignment,
    settled_trials,
    settling_metrics,
    statistics,
    stopped_metrics,
    stopped_values,
    warn_of_stops,
)
from chamfer.analysis.drawing.figure_kit import (
    Curve,
    FilledBand,
    ReferenceLine,
    draw_lines,
    metric_value,
    trial_curves,
)
from chamfer.analysis.drawing.figure_style import (
    AXIS_LOOKS,
    BAND,
    DESIRED,
    FSM,
    LATERAL,
    PUBLISHED,
    REGION,
    ROTATIONAL,
    Style,
    dress,
    legend,
    legend_below,
    new_figure,
    wrapped,
)
from chamfer.analysis.published.fsm_work_cell import DROOP, MEAN_ERROR, WORST_ERROR
from chamfer.analysis.report.replay import record, set_stage
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, Table, column
from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import (
    KINDS,
    AlignmentScenario,
    Compensated,
    ResolvedAlignmentScenario,
    require_fine_enough,
)
from chamfer.diagrams.cell.cell_vision import VIEWS, looks_in, undistortion_of
from chamfer.diagrams.cell.work_cell import (
    CellArmSettings,
    make_work_cell_view,
)
from chamfer.models.cameras.camera import Camera
from chamfer.models.peg_theory.wedging import rotation_bounds
from chamfer.models.validation import ParameterError
from chamfer.systems.cameras.camera_image import Image, add_noise, shaded
from chamfer.systems.cameras.software_camera import between, render, render_moving
from chamfer.systems.pose import POSE_NAMES, pose_from_vector
from chamfer.systems.vision.cell_error import AXES
from chamfer.systems.vision.detections import Detection
from chamfer.systems.vision.part_detection import detect_parts

_CHANNELS: Final = ("red", "green", "blue")


def pictures_at(
    scenario: AlignmentScenario, traces: Table, rows: Mapping[str, int], seed: int
) -> dict[str, NDArray[np.uint8]]:
    """Return the pictures at some rows of the traces as a table, a row a pixel, row after row.

    Columns ``xz_before_red`` and so on, by the moments' names; drawn by the software camera at the
    true poses, with the scenario's noise.
    """
    generator = np.random.default_rng(seed)
    table = {}
    for view in VIEWS:
        camera, sensor = scenario.camera(view), scenario.cameras.view(view).sensor
        for moment, row in rows.items():
            peg, hole = _poses(traces, row)
            if sensor.exposure:
                earlier = _poses(traces, max(row - 1, 0))
                share = 1 - sensor.exposure / scenario.cameras.frames.period
                opening = between(earlier[0], peg, share), between(earlier[1], hole, share)
                picture = render_moving(scenario.parts, camera, opening, (peg, hole))
            else:
                picture = render(scenario.parts, camera, peg, hole)
            if sensor.shades:
                picture = shaded(picture, sensor.vignetting, sensor.white_balance)
            if noise := scenario.cameras.frames_of(view).noise:
                picture = add_noise(picture, noise, generator)
            for i, channel in enumerate(_CHANNELS):
                table[f"{view}_{moment}_{channel}"] = picture[:, :, i].ravel()
    return table


def _poses(traces: Table, row: int) -> tuple[RigidTransform, RigidTransform]:
    """Return X_WT and X_WM."""
    peg, hole = (
        pose_from_vector(np.array([traces[f"{arm}_true_{name}"][row] for name in POSE_NAMES]))
        for arm in ("peg", "hole")
    )
    return peg, hole


def picture(
    scenario: AlignmentScenario, table: Mapping[str, NDArray[Any]], view: str, moment: str
) -> Image:
    """Return a picture of the table, shape (height, width, 3)."""
    camera = scenario.camera("xz")
    channels = [table[f"{view}_{moment}_{channel}"] for channel in _CHANNELS]
    shape = (camera.height, camera.width, len(_CHANNELS))
    return np.column_stack(channels).reshape(shape).astype(np.uint8)


_SPEED = "simulated over wall-clock time, one core, the machine's own"


def run(scenario: ResolvedAlignmentScenario, seed: int, progress: Progress) -> Outcome:
    """Align the parts once."""
    started = time.perf_counter()
    traces = run_alignment(scenario, seed, progress)
    wall = time.perf_counter() - started
    measured = alignment_metrics(traces, scenario)
    metrics = over_trials([measured], ALIGNMENT)
    metrics["detected"] = detected_metric(np.array([measured["detected"]], np.float64))
    warn_of_stops({name: column([measured[name] or 0.0]) for name in STOPPED})
    metrics |= settling_metrics(scenario)
    metrics |= metrics_of({"real_time_factor": (round(scenario.duration / wall, 2), "", _SPEED)})
    moments = {"before": row_before(traces["time"], scenario.begin), "after": -1}
    return Outcome(
        metrics=metrics,
        traces=traces,
        simulated_seconds=scenario.duration,
        tables={"pictures": pictures_at(scenario, traces, moments, seed)},
    )


def run_repeatability(
    scenario: ResolvedRepeatabilityScenario, seed: int, progress: Progress
) -> Outcome:
    """Align the parts many times, each with other initial errors and other model errors."""
    finished = align_all(scenario, seed, progress)
    metrics = {
        **statistics(finished, "lateral_error", "m"),
        **statistics(finished, "rotational_error", "rad"),
        **margins(finished, scenario.parts, scenario.held()),
        **_over_trials(finished),
        **settling_metrics(scenario),
    }
    errors = courses(finished.rows, COURSE, trial=finished.tasks)
    return Outcome(
        metrics=metrics,
        traces=_rows(scenario, seed, finished),
        simulated_seconds=len(finished) * scenario.duration,
        tables={"errors": errors},
    )


def _over_trials(finished: Trials[int]) -> dict[str, Metric]:
    limits = f"below {1e3 * SETTLED[0]:g} mm and {1e3 * SETTLED[1]:g} mrad for good"
    still = f"mean change in the last {LATE:g} s, the largest of the axes; 0 where it is constant"
    speed = np.mean([row["time"][-1] / row["wall_seconds"] for row in finished.rows])
    found = settled_trials(
        finished, f"mean of {len(finished)} trials that settle in time, {limits}"
    )
    for name, unit in (("lateral", "m"), ("rotational", "rad")):
        for when in ("uncompensated", "vision"):
            of, never = f"{when}.{name}_error", "nothing was measured at the end of any trial"
            found[of] = mean_over(finished, of, unit, never)
        late = f"compensation.late_{name}"
        found |= metrics_of({late: (float(finished.column(late).mean()), unit, still)})
    return {
        **found,
        "settled": replace(found["settled"], note=limits),
        "detected": detected_metric(finished.column("detected")),
        **stopped_metrics({name: finished.column(name) for name in STOPPED}),
        **over_trials(finished.rows, ARM_LIMITS),
        **metrics_of({"real_time_factor": (round(float(speed), 2), "", _SPEED)}),
    }


def _rows(
    scenario: RepeatabilityScenario, seed: int, finished: Trials[int]
) -> dict[str, np.ndarray]:
    rows: dict[str, list[float]] = {"trial": [*finished.tasks]}
    for one in (drawn(scenario, scenario.spread, seed, trial) for trial in finished.tasks):
        row = {f"initial_{AXES[i]}": one.initial_error[i] for i in (1, 2, 4, 5)}
        for arm in scenario.arms:
            settings: CellArmSettings = getattr(one, arm)
            row[f"{arm}_payload_error"] = settings.payload_error
            row[f"{arm}_mass_scale"] = settings.mass_scale
            row[f"{arm}_joint_friction"] = max(settings.arm.dry_friction)
        for name, value in row.items():
            rows.setdefault(name, []).append(value)
    drawn_rows = {name: column(values) for name, values in rows.items()}
    return drawn_rows | {name: finished.column(name) for name in ALIGNMENT}


def figures(scenario: AlignmentScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw Fig. 12: both cameras' pictures before and after; and Figs. 13 and 14."""
    moments = {"before": "before", "after": f"after {scenario.compensation_time:g} s"}
    return {
        "pictures": plot_moments(scenario, outcome.tables["pictures"], moments),
        "compensation": plot_alignment(scenario, outcome),
    }


def resolve_alignment(scenario: AlignmentScenario) -> ResolvedAlignmentScenario:
    """Return the scenario with its open fields filled in, and checked."""
    resolved = resolve(scenario)
    require_fine_enough(resolved)
    return resolved


_TITLES: Final = {"xz": "X-Z plane, from the side", "xy": "X-Y plane, from above"}
_AXIS: Final[Style] = {"color": "#111111", "linestyle": "-", "linewidth": 1.0}
_QUATERNION: Final[tuple[tuple[str, str, Style], ...]] = (
    ("qw", "w - 1", {"color": "#777777", "linestyle": ":", "linewidth": 1.6}),
    *((f"q{name}", name, style) for name, style in AXIS_LOOKS.items()),
)
_SIDES: Final[Style] = {"color": "#1b4f9c", "linestyle": "-", "linewidth": 1.6}
_SIMPLE: Final[Style] = {"color": "#1b4f9c", "linestyle": (0, (4, 2)), "linewidth": 1.2}
_END: Final[Style] = {"color": "black", "marker": "o", "linestyle": "none", "markersize": 3.5}


def plot_moments(scenario: AlignmentScenario, table: Table, moments: Mapping[str, str]) -> Figure:
    """Draw both cameras' pictures at some moments, with titles and detections.

    Where they are not believed to be straight they are straightened, as they are before detection.
    """
    figure = new_figure(
        height=2 * (0.75 * (8.0 / len(moments) - 0.6) + 1.0),
        caption="Pictures of both cameras with the detected axes (black lines) and tips (white "
        f"crosses) of peg and hole: {', '.join(moments.values())}.",
    )
    panels = figure.subplots(len(VIEWS), len(moments), squeeze=False)
    for i, view in enumerate(VIEWS):
        looks = looks_in(scenario.cameras, scenario, view)
        straighten = undistortion_of(scenario.cameras, scenario, view)
        for k, (moment, said) in enumerate(moments.items()):
            axes = panels[i, k]
            image = picture(scenario, table, view, moment)
            image = image if straighten is None else straighten(image)
            axes.imshow(image, interpolation="nearest")
            for part in detect_parts(image, *looks):
                _detected(axes, part, image.shape[1])
            axes.set_xlim(-0.5, image.shape[1] - 0.5)
            axes.set_ylim(image.shape[0] - 0.5, -0.5)
            title = wrapped(axes, f"{_TITLES[view]}: {said}")
            axes.set_title(title, fontsize=9, loc="left", fontweight="bold")
            axes.set_xlabel("u / pixels", fontsize=8)
            axes.set_ylabel("v / pixels", fontsize=8)
            axes.tick_params(labelsize=8)
    return figure


def _detected(axes: Axes, part: Detection, width: int) -> None:
    """Draw the axis through the picture, and the tip."""
    if part.status.lost:
        return
    u = np.array([0.0, width - 1.0])
    axes.plot(u, part.point[1] + np.tan(part.angle) * (u - part.point[0]), **_AXIS)
    axes.plot(*part.tip, marker="+", color="white", markersize=9, markeredgewidth=1.6)


def plot_alignment(scenario: AlignmentScenario, outcome: Outcome) -> Figure:
    """Draw the errors and, as Figs. 13 and 14, the compensation of each arm over time."""
    traces = outcome.traces
    time = traces["time"]
    rows = 1 + len(scenario.arms)
    left = [metric_value(outcome.metrics, f"{kind}_error", 1e3) for kind in KINDS]
    figure = new_figure(
        height=0.6 + 2.7 * rows,
        caption=f"The compensation leaves {left[0]:.2g} mm and {left[1]:.2g} mrad between peg and "
        "hole (a, b); below is the motion that it adds to each arm.",
    )
    panels = figure.subplots(rows, 2)
    for k, (name, unit, style) in enumerate(
        (("lateral", "mm", LATERAL), ("rotational", "mrad", ROTATIONAL))
    ):
        axes, mean, settled = panels[0, k], 1e3 * MEAN_ERROR[k], 1e3 * SETTLED[k]
        error = 1e3 * np.maximum(traces[f"{name}_error"], 1e-6)
        axes.semilogy(time, error, **style)
        axes.axhline(mean, label="published mean of ten runs", **PUBLISHED)
        axes.axhspan(1e-9, settled, label="counted as settled", **BAND)
        axes.set_ylim(settled / 100, 2 * max(float(error.max()), mean))
        title = f"({'ab'[k]}) {name.capitalize()} error ends at {left[k]:.2g} {unit}"
        dress(axes, title=title, x="", y=f"error / {unit}")
        legend(axes, ncols=2)
    for (shift, turn), arm, (a, b) in zip(
        panels[1:], scenario.arms, (("c", "d"), ("e", "f")), strict=False
    ):
        place = {name: 1e3 * traces[f"{arm}_{name}"] for name in AXIS_LOOKS}
        shifts = [
            Curve(place[name] - place[name][0], name.upper(), style)
            for name, style in AXIS_LOOKS.items()
        ]
        title = f"({a}) Arm of the {arm}: lateral compensation"
        draw_lines(shift, time, shifts, title=title, y="added / mm", over="")
        turned = _relative(traces, arm)
        turns = [Curve(turned[name], label, style) for name, label, style in _QUATERNION]
        title = f"({b}) Arm of the {arm}: rotational compensation, quaternion"
        draw_lines(turn, time, turns, title=title, y="element", over="")
    for axes in figure.axes:
        axes.axvspan(0.0, scenario.begin, color="#f2f2f2", linewidth=0, zorder=0)
        axes.set_xlim(0.0, float(time[-1]))
    for axes in figure.axes[-2:]:
        axes.set_xlabel("time / s (shaded: impedance control only)", fontsize=9)
        legend(axes, ncols=4)
    return figure


def _relative(traces: Any, arm: str) -> dict[str, NDArray[np.float64]]:
    """Return the commanded quaternion relative to the first one, less 1, in the world's axes."""
    q = np.column_stack([traces[f"{arm}_{name}"] for name, _, _ in _QUATERNION])
    turned = Rotation.from_quat(q, scalar_first=True)
    relative = (turned * turned[0].inv()).as_quat(scalar_first=True, canonical=True)
    relative[:, 0] -= 1
    return {name: relative[:, i] for i, (name, _, _) in enumerate(_QUATERNION)}


def repeatability_figures(
    scenario: RepeatabilityScenario, outcome: Outcome
) -> Mapping[str, Figure]:
    """Draw every trial's errors over time, and where the trials end in the wedging diagram."""
    wedging = metric_value(outcome.metrics, "wedging")
    inside = f"{wedging:.3g} % of the trials end" if wedging else "No trial ends"
    figure = new_figure(
        height=8.5,
        caption=f"{inside} outside the wedge-free region (c), {scenario.compensation_time:g} s "
        f"after the compensation begins. Errors of {scenario.trials} trials over time (a, b).",
    )
    grid = figure.add_gridspec(2, 2, height_ratios=(1.0, 1.3))
    table = outcome.tables["errors"]
    for row, (name, unit, published, style) in enumerate(
        (
            ("lateral", "mm", MEAN_ERROR[0], LATERAL),
            ("rotational", "mrad", MEAN_ERROR[1], ROTATIONAL),
        )
    ):
        axes = figure.add_subplot(grid[0, row])
        ends_at = metric_value(outcome.metrics, f"{name}_error.mean", 1e3)
        errors = 1e3 * np.maximum(table[f"{name}_error"], 1e-6)
        thin: Style = {"color": style["color"], "linewidth": 0.7, "alpha": 0.6}
        draw_lines(
            axes,
            (),
            trial_curves(table["time"] - scenario.begin, errors, table["trial"], thin),
            title=f"({'ab'[row]}) {name.capitalize()} error ends at {ends_at:.2g} {unit} (mean)",
            y=f"error / {unit}",
            over="time since compensation begins / s",
            levels=[ReferenceLine(1e3 * published, "published mean after 2.5 s", PUBLISHED)],
            key="below",
        )
        axes.set_yscale("log")
        axes.set_xlim(-0.25, scenario.compensation_time)
        axes.set_ylim(1e3 * published / 200, None)
    ends = figure.add_subplot(grid[1, :])
    _ends(ends, scenario, outcome)
    legend_below(figure, ends)
    return {"repeatability": figure}


def _ends(axes: Axes, scenario: RepeatabilityScenario, outcome: Outcome) -> None:
    parts, trials = scenario.parts, outcome.traces
    lateral, rotational = trials["lateral_error"], trials["rotational_error"]
    right = 1.3 * max(float(lateral.max()), WORST_ERROR[0])
    top = 1.15 * max(float(rotational.max()), parts.rotation_limit)
    x = np.linspace(0.0, right, 400)
    exact, simple = (
        rotation_bounds(parts, scenario.held(), x, form)[1] for form in ("exact", "simple")
    )
    axes.fill_between(1e3 * x, 0.0, 1e3 * exact, label="free of wedging", **REGION)
    axes.plot(1e3 * x, 1e3 * exact, label="exact side", **_SIDES)
    axes.plot(1e3 * x, 1e3 * simple, label="simple side", **_SIMPLE)
    axes.axhline(1e3 * parts.rotation_limit, label="published limit: the box", **PUBLISHED)
    axes.plot(1e3 * lateral, 1e3 * rotational, label="ends of the trials", **_END)
    low, high = (
        np.array(
            [metric_value(outcome.metrics, f"{kind}_error.mean_{end}", 1e3) for kind in KINDS]
        )
        for end in ("low", "high")
    )
    if np.isfinite([low, high]).all():
        look: Style = {"facecolor": "none", "edgecolor": "#1b7f5c", "linewidth": 1.6}
        axes.add_patch(
            Rectangle((low[0], low[1]), *(high - low), label="95 % intervals of the means", **look)
        )
    published: Style = {"color": "#b00020", "linestyle": "none", "markersize": 7}
    for (eps, theta), label, marker in (
        (MEAN_ERROR, "published mean of ten runs", "o"),
        (WORST_ERROR, "published largest of ten runs", "s"),
    ):
        axes.plot(1e3 * eps, 1e3 * theta, label=label, marker=marker, **published)
    title = f"(c) Errors after {scenario.compensation_time:g} s, in the wedging diagram"
    dress(axes, title=title, x="lateral error / mm", y="rotational error / mrad")
    axes.set_xlim(0.0, 1e3 * right)
    axes.set_ylim(0.0, 1e3 * top)


RUNS: Final = ("uncompensated", "compensated")


def resolve_tracking(scenario: AlignmentScenario) -> ResolvedAlignmentScenario:
    """Refuse scenarios without a comparison, or without an effect."""
    if scenario.axis != "horizontal":
        allowed = "horizontal, for a peg that goes up to the height of the hole"
        raise ParameterError("axis", scenario.axis, allowed)
    if scenario.compensated == "none":
        raise ParameterError("compensated", "none", "peg, hole, both; one run goes without")
    return resolve(scenario)


def run_tracking(scenario: ResolvedAlignmentScenario, seed: int, progress: Progress) -> Outcome:
    """Run without and with compensation, and measure the heights that the tip reaches."""
    finished = run_each(partial(_run_one, scenario, seed), RUNS, progress)
    split = finished.split(RUNS, lambda name: name)
    runs = {name: table_of(one.rows[0]) for name, one in split.items()}
    goal = scenario.mouth[2]
    metrics: dict[str, Metric] = {}
    with_it = runs["compensated"]
    time, desired = with_it["time"], with_it["peg_desired_z"]
    traces = {"time": time, "desired_height": desired}
    moving = time <= scenario.motion_time
    late = time >= time[-1] - LATE - 1e-9
    of_late = f"mean of the last {LATE:g} s"
    for name, found in runs.items():
        height = found["peg_true_z"]
        rms = float(np.sqrt(np.mean((height - desired)[moving] ** 2)))
        off = height[late] - goal
        measured = {
            "height_error": (float(np.mean(height[late]) - goal), "m", of_late),
            "height_error_max": (float(np.abs(off).max()), "m", ""),
            "tracking_rms": (rms, "m", "on the way"),
        }
        metrics |= prefixed(name, metrics_of(measured))
        traces |= {
            f"{name}_height": height,
            f"{name}_encoder_height": found["peg_tool_z"],
            f"{name}_hole_height": found["hole_true_z"],
            f"{name}_valid": found["valid"],
        }
    # Without compensation the compensator asks for one too, which nobody adds.
    traces["compensation"] = with_it["compensation_z"]
    metrics["detected"] = detected_metric(np.array([detected_share(with_it, scenario)]))
    metrics |= over_trials([arm_limits(with_it, scenario)], ARM_LIMITS)
    stopped = stopped_values(with_it, scenario)
    warn_of_stops({name: column([stopped[name] or 0.0]) for name in STOPPED})
    metrics |= {name: Metric(value=value, unit="") for name, value in stopped.items()}
    metrics |= settling_metrics(scenario)
    return Outcome(metrics=metrics, traces=traces, simulated_seconds=len(RUNS) * scenario.duration)


def _run_one(scenario: ResolvedAlignmentScenario, seed: int, name: str) -> Row:
    compensated: Compensated = scenario.compensated if name == "compensated" else "none"
    return with_table({}, run_alignment(replace(scenario, compensated=compensated), seed))


_WITHOUT: Final[Style] = {"color": "#1b4f9c", "linestyle": "--", "linewidth": 1.8}
_ADDED: Final[Style] = {"color": "#7a4100", "linestyle": "-.", "linewidth": 1.3}
_RUNS: Final = (
    ("uncompensated", "without compensation", _WITHOUT),
    ("compensated", "with compensation by the cameras", FSM),
)


def tracking_figures(
    scenario: ResolvedAlignmentScenario, outcome: Outcome
) -> Mapping[str, Figure]:
    """Draw height, error and compensation over time."""
    traces, goal = outcome.traces, scenario.mouth[2]
    time, desired = traces["time"], traces["desired_height"]
    rest = [metric_value(outcome.metrics, f"{name}.height_error", 1e3) for name in RUNS]
    figure = new_figure(
        height=6.5,
        caption=f"The tip of the peg ends {-rest[0]:.2g} mm too low without and {-rest[1]:.2g} mm "
        "too low with compensation by the cameras.",
    )
    height, error = figure.subplots(2, 1, sharex=True)
    curves = [Curve(1e3 * desired, "desired", DESIRED)]
    off = []
    for name, label, style in _RUNS:
        reached = traces[f"{name}_height"]
        curves.append(Curve(1e3 * reached, label, style))
        off.append(Curve(1e3 * (reached - desired), label, style))
    off.append(Curve(1e3 * traces["compensation"], "compensation added", _ADDED))
    title = f"(a) Height error at the end: {rest[0]:.2g} mm, with compensation {rest[1]:.2g} mm"
    draw_lines(height, time, curves, title=title, y="height / mm", over="")
    zone = 1e3 * scenario.compensator.lateral.closed.dead_zone * scenario.cameras.pixel_size
    draw_lines(
        error,
        time,
        off,
        title=f"(b) Actual minus desired height, and compensation added; goal {1e3 * goal:g} mm",
        y="error / mm",
        bands=[FilledBand(-zone, zone, "dead zone")],
        levels=[ReferenceLine(1e3 * DROOP, "published: 1.5 mm low", PUBLISHED)],
    )
    legend(height, ncols=3)
    legend(error, ncols=3)
    error.set_xlim(0.0, float(time[-1]))
    return {"vertical-tracking": figure}


_EYE: Final = np.array([-0.04, -0.16, 0.10])  # m, from the middle of the gap; assumed
_BODY: Final = (0.04, 0.03, 0.05)  # m, of a camera, along its axes; assumed
_REACH: Final = 0.12  # m, that the lines of sight are drawn, along the optical axis
_CAMERA: Final = Rgba(0.15, 0.16, 0.18)
_SIGHT: Final = Rgba(0.85, 0.55, 0.1)


def replay_alignment(scenario: AlignmentScenario, outcome: Outcome, meshcat: Meshcat) -> None:
    """Show a run as an animation, with its cameras, seen at first from near the parts.

    The traces have ``time``, s, and of each arm the joint positions ``peg_q1``, ... rad.
    """
    diagram, plant = make_work_cell_view(scenario, meshcat)
    target = scenario.nominal_pose("peg") @ np.array([scenario.gap / 2, 0.0, 0.0])
    arms: list[CellArmSettings] = [getattr(scenario, arm) for arm in scenario.arms]
    bases = [(one.base.transform @ one.base_error.transform).translation() for one in arms]
    feet = [base[2] - one.arm.base_height for base, one in zip(bases, arms, strict=True)]
    floor = np.array([*target[:2], min(feet)])
    set_stage(meshcat, floor=floor, eye=target + scenario.hole_axes @ _EYE, target=target)
    for i, view in enumerate(VIEWS):
        _draw_camera(meshcat, f"camera_{i + 1}", scenario.camera(view))
    traces = outcome.traces
    joints = [
        traces[f"{arm}_q{i + 1}"]
        for arm, one in zip(scenario.arms, arms, strict=True)
        for i in range(one.arm.num_joints)
    ]
    record(meshcat, diagram, plant, traces["time"], np.column_stack(joints))


def _draw_camera(meshcat: Meshcat, path: str, camera: Camera) -> None:
    """Draw a box with its front at the camera's centre, and the edges of what it sees."""
    X_WC = RigidTransform(RotationMatrix(camera.R_WC), camera.p_WC)
    meshcat.SetObject(f"{path}/body", Box(*_BODY), _CAMERA)
    meshcat.SetTransform(f"{path}/body", X_WC @ RigidTransform([0.0, 0.0, -_BODY[2] / 2]))
    right, low = camera.width - 0.5, camera.height - 0.5
    corners = np.array([[-0.5, -0.5], [right, -0.5], [right, low], [-0.5, low]])
    rays = camera.ray(corners)
    # Corners in which a lens shows nothing are drawn as without it.
    rays = np.where(np.isfinite(rays), rays, camera.without_distortion().ray(corners))
    ends = camera.p_WC + rays * (_REACH / (rays @ camera.R_WC[:, 2:]))
    start = np.vstack([np.tile(camera.p_WC, (4, 1)), ends])
    end = np.vstack([ends, np.roll(ends, -1, axis=0)])
    meshcat.SetLineSegments(f"{path}/sight", start.T, end.T, 2.0, _SIGHT)
