"""Figs. 5 and 6: the D and the BNC connector are inserted, from sight to lock; other parts too."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from matplotlib.figure import Figure

from chamfer.analysis.campaign.trial_metrics import over_trials
from chamfer.analysis.drawing.chart_path import plot_chart_path
from chamfer.analysis.scenario.experiment import Experiment, Outcome, Progress
from chamfer.analysis.skills.connector_insertion_figures import plot_insertion
from chamfer.analysis.skills.connector_replay import replay_insertion
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
    BncConnectorScenario,
    DConnectorScenario,
    PegScenario,
    Rj45ConnectorScenario,
    make_connector_diagram,
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


def _plot(scenario: AnyConnectorScenario, outcome: Outcome) -> Mapping[str, Figure]:
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


D_CONNECTOR = Experiment[AnyConnectorScenario](
    name="d-connector",
    paper="sensorimotor-primitives",
    figure="Fig. 5",
    summary="a skill grasps a 25-pin D connector by sight and inserts it by force",
    scenario=DConnectorScenario,
    run=run,
    plot=_plot,
    diagram=make_connector_diagram,
    charts=skill_charts,
    replay=replay_insertion,
    reduced=("step=0.002",),
)

BNC_CONNECTOR = Experiment[AnyConnectorScenario](
    name="bnc-connector",
    paper="sensorimotor-primitives",
    figure="Fig. 6",
    summary="a skill grasps a BNC connector by sight, finds its slots by force and locks it",
    scenario=BncConnectorScenario,
    run=run,
    plot=_plot,
    diagram=make_connector_diagram,
    charts=skill_charts,
    replay=replay_insertion,
    reduced=("step=0.002",),
)

PEG = Experiment[AnyConnectorScenario](
    name="peg-skill",
    paper="sensorimotor-primitives",
    figure="section 2",
    summary="a skill grasps a round peg by sight, aligns it by touch and searches its hole",
    scenario=PegScenario,
    run=run,
    plot=_plot,
    diagram=make_connector_diagram,
    charts=skill_charts,
    replay=replay_insertion,
    reduced=("step=0.002",),
)

RJ45_CONNECTOR = Experiment[AnyConnectorScenario](
    name="rj45-connector",
    paper="sensorimotor-primitives",
    figure="section 4",
    summary="a skill grasps an RJ45 plug by sight, aligns it by touch and latches it",
    scenario=Rj45ConnectorScenario,
    run=run,
    plot=_plot,
    diagram=make_connector_diagram,
    charts=skill_charts,
    replay=replay_insertion,
    reduced=("step=0.002",),
)
