"""How often connectors are inserted, each time in another world."""

import math
from collections.abc import Mapping
from dataclasses import replace

from matplotlib.figure import Figure

from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress
from chamfer.analysis.skills.connector_success_figures import plot_success
from chamfer.analysis.skills.connector_trials import (
    SuccessScenario,
    attempt_all,
    attempt_rows,
    success_metrics,
)


def run(scenario: SuccessScenario, seed: int, progress: Progress) -> Outcome:
    """Grasp and insert the connector many times."""
    attempts = attempt_all(scenario, seed, progress)
    return Outcome(
        metrics=told(success_metrics(attempts)),
        traces=attempt_rows(attempts),
        simulated_seconds=math.fsum(attempts.column("duration")),
    )


def told(metrics: Mapping[str, Metric]) -> dict[str, Metric]:
    """Return metrics with what the speed was measured on."""
    speed = metrics["real_time_factor"]
    note = f"a core each, the machine's own; {speed.note}"
    return {**metrics, "real_time_factor": replace(speed, note=note)}


def figures(scenario: SuccessScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"success": plot_success(outcome, middle=scenario.initial_error)}
