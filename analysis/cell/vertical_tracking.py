"""Fig. 11: the tip goes to the hole's height, with and without compensation by sight."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_rows import Row, table_of, with_table
from chamfer.analysis.cell.alignment_runs import (
    LATE,
    STOPPED,
    detected_metric,
    detected_share,
    run_alignment,
    settling_metrics,
    stopped_values,
    warn_of_stops,
)
from chamfer.analysis.drawing.figure_kit import Curve, FilledBand, ReferenceLine, draw_lines
from chamfer.analysis.drawing.figure_style import (
    DESIRED,
    FSM,
    PUBLISHED,
    Style,
    legend,
    new_figure,
)
from chamfer.analysis.published.work_cell import DROOP
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.cell.alignment import resolve as resolve_alignment
from chamfer.diagrams.cell.alignment_scenario import (
    AlignmentScenario,
    Compensated,
    ResolvedAlignmentScenario,
)
from chamfer.models.validation import ParameterError

RUNS: Final = ("uncompensated", "compensated")


def resolve(scenario: AlignmentScenario) -> ResolvedAlignmentScenario:
    """Refuse what leaves nothing to compare, or to see."""
    if scenario.axis != "horizontal":
        allowed = "horizontal, for a peg that goes up to the height of the hole"
        raise ParameterError("axis", scenario.axis, allowed)
    if scenario.compensated == "none":
        raise ParameterError("compensated", "none", "peg, hole, both; one run goes without")
    return resolve_alignment(scenario)


def run(scenario: ResolvedAlignmentScenario, seed: int, progress: Progress) -> Outcome:
    """Run without and with compensation, and measure the heights that the tip reaches."""
    finished = run_each(partial(_run_one, scenario, seed), RUNS, progress)
    split = finished.split(RUNS, lambda name: name)
    runs = {name: table_of(one.rows[0]) for name, one in split.items()}
    goal = scenario.mouth[2]
    metrics: dict[str, Metric] = {}
    traces = {
        "time": runs["compensated"]["time"],
        "desired_height": runs["compensated"]["peg_desired_z"],
    }
    time = traces["time"]
    moving = time <= scenario.motion_time
    late = time >= time[-1] - LATE - 1e-9
    for name, found in runs.items():
        height = found["peg_true_z"]
        off = height - traces["desired_height"]
        metrics |= {
            f"{name}.height_error": Metric(
                value=float(np.mean(height[late]) - goal),
                unit="m",
                note=f"mean of the last {LATE:g} s",
            ),
            f"{name}.height_error_max": Metric(
                value=float(np.abs(height[late] - goal).max()), unit="m"
            ),
            f"{name}.tracking_rms": Metric(
                value=float(np.sqrt(np.mean(off[moving] ** 2))), unit="m", note="on the way"
            ),
        }
        traces |= {
            f"{name}_height": height,
            f"{name}_encoder_height": found["peg_tool_z"],
            f"{name}_hole_height": found["hole_true_z"],
            f"{name}_valid": found["valid"],
        }
    # Without compensation the compensator asks for one too, which nobody adds.
    traces["compensation"] = runs["compensated"]["compensation_z"]
    seen = detected_share(runs["compensated"], scenario)
    metrics["detected"] = detected_metric(np.array([seen]))
    stopped = stopped_values(runs["compensated"], scenario)
    warn_of_stops({name: column([stopped[name] or 0.0]) for name in STOPPED})
    metrics |= {name: Metric(value=value, unit="") for name, value in stopped.items()}
    metrics |= settling_metrics(scenario)
    return Outcome(
        metrics=metrics,
        traces=traces,
        simulated_seconds=len(RUNS) * scenario.duration,
    )


def _run_one(scenario: ResolvedAlignmentScenario, seed: int, name: str) -> Row:
    compensated: Compensated = scenario.compensated if name == "compensated" else "none"
    return with_table({}, run_alignment(replace(scenario, compensated=compensated), seed))


_WITHOUT: Final[Style] = {"color": "#1b4f9c", "linestyle": "--", "linewidth": 1.8}
_ADDED: Final[Style] = {"color": "#7a4100", "linestyle": "-.", "linewidth": 1.3}
_RUNS: Final = (
    ("uncompensated", "without compensation", _WITHOUT),
    ("compensated", "with compensation by sight", FSM),
)


def figures(scenario: ResolvedAlignmentScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw height, error and compensation over time."""
    traces, goal = outcome.traces, scenario.mouth[2]
    time, desired = traces["time"], traces["desired_height"]
    figure = new_figure(10.0, 7.5)
    height, error = figure.subplots(2, 1, sharex=True)
    curves = [Curve(1e3 * desired, "desired", DESIRED)]
    off = []
    for name, label, style in _RUNS:
        reached = traces[f"{name}_height"]
        curves.append(Curve(1e3 * reached, label, style))
        off.append(Curve(1e3 * (reached - desired), label, style))
    off.append(Curve(1e3 * traces["compensation"], "compensation added", _ADDED))
    title, y = "(a) Height of the peg's tip", "height / mm"
    draw_lines(height, time, curves, title=title, y=y, over="", key="lower right")
    zone = 1e3 * scenario.compensator.lateral.closed.dead_zone * scenario.cameras.pixel_size
    draw_lines(
        error,
        time,
        off,
        title=f"(b) Actual minus desired height, and compensation; goal {1e3 * goal:g} mm",
        y="error / mm",
        bands=[FilledBand(-zone, zone, "dead zone")],
        levels=[ReferenceLine(1e3 * DROOP, "published: 1.5 mm low", PUBLISHED)],
    )
    legend(error, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=5)
    error.set_xlim(0.0, float(time[-1]))
    return {"vertical-tracking": figure}
