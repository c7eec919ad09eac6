"""Figs. 5 and 6: the D and the BNC connector are inserted, from sight to lock; other parts too."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from matplotlib.figure import Figure

from chamfer.analysis.campaign.trial_metrics import over_trials
from chamfer.analysis.drawing.chart_path import plot_chart_path
from chamfer.analysis.scenario.experiment import Outcome, Progress
from chamfer.analysis.skills.connector_insertion_figures import plot_insertion
from chamfer.analysis.skills.connector_runs import (
    INSERTION,
    failure,
    insertion_metrics,
    run_insertion,
    skill_charts,
)
from chamfer.analysis.skills.skill_run import path_table
from chamfer.diagrams.skills.connector_insertion import (
    AnyConnectorScenario,
)

SPEED: Final = "simulated over wall-clock time, one core, the machine's own"


def run(scenario: AnyConnectorScenario, seed: int, progress: Progress) -> Outcome:
    """Insert the connector once."""

    def told(fraction: float, doing: str = "") -> None:
        # The skill ends long before its time is up: the time is what tells.
        progress(fraction, doing or f"{fraction * scenario.duration:.0f} s of the skill")

    done = run_insertion(scenario, seed, told)
    metrics = over_trials([insertion_metrics(done, scenario)], INSERTION)
    metrics["success"] = replace(metrics["success"], note=failure(done, scenario))
    metrics["real_time_factor"] = replace(metrics["real_time_factor"], note=SPEED)
    return Outcome(
        metrics=metrics,
        traces=done.traces,
        simulated_seconds=float(done.traces["time"][-1]),
        tables={"path": path_table(done.path)},
    )


def figures(scenario: AnyConnectorScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    (chart,) = skill_charts(scenario)
    success = outcome.metrics["success"]
    ended = "inserted" if success.value else f"failed: {success.note}"
    result = f"{ended}, after {outcome.metrics['duration'].value:.2f} s"
    path = outcome.tables["path"]
    return {
        "path": plot_chart_path(chart, path, result=result),
        "signals": plot_insertion(
            outcome.traces,
            path,
            states=[state.name for state in chart.states],
            mated=scenario.connector.mated_depth,
            mating_force=scenario.connector.mating_force,
        ),
    }
