"""How often connectors are inserted, each time in another world."""

import math
from collections.abc import Mapping
from dataclasses import replace

from matplotlib.figure import Figure

from chamfer.analysis.scenario.experiment import Experiment, Metric, Outcome, Progress
from chamfer.analysis.skills.connector_success_figures import plot_success
from chamfer.analysis.skills.connector_trials import (
    BncConnectorSuccessScenario,
    DConnectorSuccessScenario,
    Rj45ConnectorSuccessScenario,
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
    reduced=("trials=1", "duration=3.0"),
)

BNC_SUCCESS = Experiment[SuccessScenario](
    name="bnc-connector-success",
    paper="sensorimotor-primitives",
    figure="section 4",
    summary="a BNC connector is grasped and inserted in many worlds that it doesn't know",
    scenario=BncConnectorSuccessScenario,
    run=run,
    plot=_plot,
    reduced=("trials=1", "duration=3.0"),
)

RJ45_SUCCESS = Experiment[SuccessScenario](
    name="rj45-connector-success",
    paper="sensorimotor-primitives",
    figure="section 4",
    summary="an RJ45 plug is grasped and inserted in many worlds that it doesn't know",
    scenario=Rj45ConnectorSuccessScenario,
    run=run,
    plot=_plot,
    reduced=("trials=1", "step=0.002"),
)
