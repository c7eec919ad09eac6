"""How often both connectors are inserted, each time in another world."""

import math
from collections.abc import Mapping
from dataclasses import replace

from matplotlib.figure import Figure

from analysis.run.experiment import Experiment, Outcome, Progress
from analysis.skills.connector_success_figures import plot_success
from analysis.skills.connector_trials import (
    BncConnectorSuccessScenario,
    DConnectorSuccessScenario,
    SuccessScenario,
    attempt_all,
    attempt_rows,
    success_metrics,
)


def run(scenario: SuccessScenario, seed: int, progress: Progress) -> Outcome:
    """Grasp and insert the connector many times."""
    attempts = attempt_all(scenario, seed, progress)
    metrics = success_metrics(attempts)
    speed = metrics["real_time_factor"]
    note = f"a core each, the machine's own; {speed.note}"
    return Outcome(
        metrics={**metrics, "real_time_factor": replace(speed, note=note)},
        traces=attempt_rows(attempts),
        simulated_seconds=math.fsum(attempts.column("duration")),
    )


def _plot(scenario: SuccessScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"success": plot_success(outcome, middle=scenario.initial_error)}


D_SUCCESS = Experiment[SuccessScenario](
    name="d-connector-success",
    paper="sensorimotor-primitives",
    figure="section 4",
    summary="a 25-pin D connector is grasped and inserted in many worlds that it doesn't know",
    scenario=DConnectorSuccessScenario,
    run=run,
    plot=_plot,
    reduced=("trials=1", "step=0.002"),
)

BNC_SUCCESS = Experiment[SuccessScenario](
    name="bnc-connector-success",
    paper="sensorimotor-primitives",
    figure="section 4",
    summary="a BNC connector is grasped and inserted in many worlds that it doesn't know",
    scenario=BncConnectorSuccessScenario,
    run=run,
    plot=_plot,
    reduced=("trials=1", "step=0.002"),
)
