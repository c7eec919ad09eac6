"""Figs. 5 and 6: the D and the BNC connector are inserted, from sight to lock; other parts too."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.geometry import Meshcat

from chamfer.analysis.campaign.trial_metrics import over_trials
from chamfer.analysis.drawing.chart_path import plot_chart_path
from chamfer.analysis.report.replay import record, set_stage
from chamfer.analysis.scenario.experiment import Outcome, Progress, Table
from chamfer.analysis.skills.connector_insertion_figures import plot_insertion
from chamfer.analysis.skills.insertion_metrics import INSERTION, failure, insertion_metrics
from chamfer.analysis.skills.skill_run import AXES, SkillResult, path_table, run_skill
from chamfer.diagrams.skills.connector_scenario import (
    ResolvedConnectorScenario,
    ResolvedStrategyScenario,
)
from chamfer.diagrams.skills.connector_view import make_connector_view
from chamfer.models.connectors.connector import Connector
from chamfer.systems.primitives.skill import Skill
from chamfer.systems.primitives.skill_machine import make_skill_chart
from chamfer.systems.statechart.chart import Chart

Array = NDArray[np.float64]

SPEED: Final = "simulated over wall-clock time, one core, the machine's own"
_EYE: Final = np.array([0.07, -0.05, 0.04])  # m; assumed
_TARGET: Final = np.array([-0.01, 0.01, 0.012])  # m; assumed
_FLOOR: Final = np.array([0.0, 0.0, -0.05])  # m; assumed


def run(scenario: ResolvedStrategyScenario, seed: int, progress: Progress) -> Outcome:
    """Insert the connector once."""
    done = run_to_end(scenario.make_skill(), scenario, seed, progress)
    return insertion_outcome(done, scenario.connector)


def run_to_end(
    skill: Skill, scenario: ResolvedConnectorScenario, seed: int, progress: Progress
) -> SkillResult:
    """Run a skill, and report how far it is by the simulated time."""

    def annotated(fraction: float, doing: str = "") -> None:
        # The skill ends long before its time is up: the time is what tells.
        progress(fraction, doing or f"{fraction * scenario.duration:.0f} s of the skill")

    return run_skill(skill, scenario, seed=seed, progress=annotated)


def insertion_outcome(done: SkillResult, connector: Connector) -> Outcome:
    """Return what a run of a skill measured."""
    metrics = over_trials([insertion_metrics(done, connector)], INSERTION)
    metrics["success"] = replace(metrics["success"], note=failure(done, connector))
    metrics["real_time_factor"] = replace(metrics["real_time_factor"], note=SPEED)
    return Outcome(
        metrics=metrics,
        traces=done.traces,
        simulated_seconds=float(done.traces["time"][-1]),
        tables={"path": path_table(done.path)},
    )


def figures(scenario: ResolvedStrategyScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    success = outcome.metrics["success"]
    ended = "inserted" if success.value else f"failed: {success.note}"
    return insertion_figures(scenario.make_skill(), scenario.connector, outcome, ended)


def insertion_figures(
    skill: Skill, connector: Connector, outcome: Outcome, ended: str
) -> dict[str, Figure]:
    """Return the figures of a run of a skill; ``ended`` says how."""
    chart, path = make_skill_chart(skill), outcome.tables["path"]
    result = f"{ended}, after {outcome.metrics['duration'].value:.2f} s"
    return {
        "path": plot_chart_path(chart, path, result=result),
        "signals": plot_insertion(
            outcome.traces,
            path,
            states=[state.name for state in chart.states],
            mated=connector.mated_depth,
            mating_force=connector.mating_force,
        ),
    }


def skill_charts(scenario: ResolvedStrategyScenario) -> tuple[Chart[Any, Any], ...]:
    """Return the chart of the scenario's skill."""
    return (make_skill_chart(scenario.make_skill()),)


def replay_insertion(
    scenario: ResolvedConnectorScenario, outcome: Outcome, meshcat: Meshcat
) -> None:
    """Show a run as an animation, seen at first from near the socket.

    Raises:
        ValueError: If one of the traces' columns ``time``, ``plug_<axis>`` and ``carriage_<axis>``
            is missing, or what :func:`chamfer.analysis.report.replay.record` raises.
    """
    view = make_connector_view(scenario, meshcat)
    set_stage(meshcat, floor=_FLOOR, eye=_EYE, target=_TARGET)
    plug, carriage = (_displacement(outcome.traces, name) for name in ("plug", "carriage"))
    time = _column(outcome.traces, "time")
    record(meshcat, view.diagram, view.plant, time, view.positions(plug, carriage))


def _displacement(traces: Table, name: str) -> Array:
    return np.column_stack([_column(traces, f"{name}_{axis}") for axis in AXES])


def _column(traces: Table, name: str) -> Array:
    if name not in traces:
        raise ValueError(f"the traces lack the column {name!r}, which the replay needs")
    return np.asarray(traces[name], dtype=np.float64)
