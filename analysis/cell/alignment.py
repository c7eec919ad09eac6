"""Figs. 12 to 14: the cameras align peg and hole; and how well, many times."""

import time
from collections.abc import Mapping

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.campaign.campaign import Trials
from chamfer.analysis.campaign.trial_metrics import over_trials
from chamfer.analysis.cell.alignment_figures import (
    plot_alignment,
    plot_pictures,
    plot_repeatability,
)
from chamfer.analysis.cell.alignment_pictures import take_pictures
from chamfer.analysis.cell.alignment_runs import (
    ALIGNMENT,
    LATE,
    SETTLED,
    STOPPED,
    alignment_metrics,
    detected_metric,
    run_alignment,
    settling_metrics,
    stopped_metrics,
    warn_of_stops,
)
from chamfer.analysis.cell.alignment_trials import (
    RepeatabilityScenario,
    align_all,
    drawn,
    margins,
    statistics,
)
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.cell.alignment import resolve
from chamfer.diagrams.cell.alignment_scenario import AlignmentScenario
from chamfer.diagrams.cell.in_view import require_fine_enough

_SPEED = "simulated over wall-clock time, one core, the machine's own"


def run(scenario: AlignmentScenario, seed: int, progress: Progress) -> Outcome:
    """Align the parts once."""
    started = time.perf_counter()
    traces = run_alignment(scenario, seed, progress)
    wall = time.perf_counter() - started
    measured = alignment_metrics(traces, scenario)
    metrics = over_trials([measured], ALIGNMENT)
    metrics["detected"] = detected_metric(np.array([measured["detected"]], np.float64))
    warn_of_stops({name: column([measured[name] or 0.0]) for name in STOPPED})
    metrics |= settling_metrics(scenario)
    metrics["real_time_factor"] = Metric(
        value=round(scenario.duration / wall, 2), unit="", note=_SPEED
    )
    return Outcome(
        metrics=metrics,
        traces=traces,
        simulated_seconds=scenario.duration,
        tables={"pictures": take_pictures(scenario, traces, seed)},
    )


def run_repeatability(scenario: RepeatabilityScenario, seed: int, progress: Progress) -> Outcome:
    """Align the parts many times, each with other initial errors and other model errors."""
    finished = align_all(scenario, seed, progress)
    metrics = {
        **statistics(finished, "lateral_error", "m"),
        **statistics(finished, "rotational_error", "rad"),
        **margins(finished, scenario.parts, scenario.held()),
        **_over_trials(finished),
        **settling_metrics(scenario),
    }
    errors = {
        "trial": np.repeat(finished.tasks, [len(row["time"]) for row in finished.rows]),
        "time": np.concatenate([row["time"] for row in finished.rows]),
        "lateral_error": np.concatenate([row["lateral_errors"] for row in finished.rows]),
        "rotational_error": np.concatenate([row["rotational_errors"] for row in finished.rows]),
    }
    return Outcome(
        metrics=metrics,
        traces=_rows(scenario, seed, finished),
        simulated_seconds=len(finished) * scenario.duration,
        tables={"errors": errors},
    )


def _over_trials(finished: Trials[int]) -> dict[str, Metric]:
    count = f"of {len(finished)} trials"
    settling = finished.column("settling_time")
    settled = settling[np.isfinite(settling)]
    limits = f"below {1e3 * SETTLED[0]:g} mm and {1e3 * SETTLED[1]:g} mrad for good"
    still = f"mean change in the last {LATE:g} s, the largest of the axes; 0 where it is constant"
    speed = np.mean([row["time"][-1] / row["wall_seconds"] for row in finished.rows])
    return {
        "settling_time": Metric(
            value=float(settled.mean()) if len(settled) else None,
            unit="s",
            note=f"mean {count} that settle in time, {limits}",
        ),
        "settled": Metric(value=100 * len(settled) / len(settling), unit="%", note=limits),
        "uncompensated.lateral_error": _mean(finished, "uncompensated.lateral_error", "m"),
        "uncompensated.rotational_error": _mean(finished, "uncompensated.rotational_error", "rad"),
        "vision.lateral_error": _mean(finished, "vision.lateral_error", "m"),
        "vision.rotational_error": _mean(finished, "vision.rotational_error", "rad"),
        "compensation.late_lateral": Metric(
            value=float(finished.column("compensation.late_lateral").mean()),
            unit="m",
            note=still,
        ),
        "compensation.late_rotational": Metric(
            value=float(finished.column("compensation.late_rotational").mean()),
            unit="rad",
            note=still,
        ),
        "detected": detected_metric(finished.column("detected")),
        **stopped_metrics({name: finished.column(name) for name in STOPPED}),
        "real_time_factor": Metric(value=round(float(speed), 2), unit="", note=_SPEED),
    }


def _mean(finished: Trials[int], name: str, unit: str) -> Metric:
    known = finished.column(name)
    known = known[np.isfinite(known)]
    if not len(known):
        return Metric(value=None, unit=unit, note="nothing was measured at the end of any trial")
    return Metric(
        value=float(known.mean()),
        unit=unit,
        note=f"mean of {len(known)} trials, {known.min():.4g} to {known.max():.4g}",
    )


def _rows(
    scenario: RepeatabilityScenario, seed: int, finished: Trials[int]
) -> dict[str, np.ndarray]:
    rows = {"trial": column(finished.tasks)}
    scenarios = [drawn(scenario, scenario.spread, seed, trial) for trial in finished.tasks]
    for i, axis in ((1, "y"), (2, "z"), (4, "pitch"), (5, "yaw")):
        rows[f"initial_{axis}"] = column([one.initial_error[i] for one in scenarios])
    for arm in scenario.arms:
        settings = [getattr(one, arm) for one in scenarios]
        rows[f"{arm}_payload_error"] = column([one.payload_error for one in settings])
        rows[f"{arm}_mass_scale"] = column([one.mass_scale for one in settings])
        rows[f"{arm}_joint_friction"] = column([max(one.arm.dry_friction) for one in settings])
    return rows | {name: finished.column(name) for name in ALIGNMENT}


def figures(scenario: AlignmentScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {
        "pictures": plot_pictures(scenario, outcome),
        "compensation": plot_alignment(scenario, outcome),
    }


def repeatability_figures(
    scenario: RepeatabilityScenario, outcome: Outcome
) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"repeatability": plot_repeatability(scenario, outcome)}


def resolve_alignment(scenario: AlignmentScenario) -> AlignmentScenario:
    """Return the scenario with what it leaves open filled in, and checked."""
    resolved = resolve(scenario)
    require_fine_enough(resolved)
    return resolved
