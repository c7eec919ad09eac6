"""Section 6.3: arms find a wall that they do not know, and slide along it."""

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from chamfer.analysis.scenario.experiment import Experiment, Outcome
from chamfer.analysis.surface.unknown_wall_figures import plot_wall
from chamfer.analysis.surface.unknown_wall_runs import run_wall_trials
from chamfer.diagrams.surface.unknown_wall_loop import make_unknown_wall_diagram
from chamfer.diagrams.surface.unknown_wall_scenario import UnknownWallScenario, resolve_wall
from chamfer.diagrams.surface.unknown_walls import (
    AdeptUnknownWallScenario,
    PlanarUnknownWallScenario,
    PumaUnknownWallScenario,
)
from chamfer.systems.force.contact_detection import make_contact_chart
from chamfer.systems.statechart.chart import Chart


def _plot_adept(scenario: UnknownWallScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"adept-unknown-wall": plot_wall(scenario, outcome)}


def _plot_puma(scenario: UnknownWallScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"puma-unknown-wall": plot_wall(scenario, outcome)}


def _plot_planar(scenario: UnknownWallScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"planar-unknown-wall": plot_wall(scenario, outcome)}


def _charts(scenario: UnknownWallScenario) -> tuple[Chart[Any, Any], ...]:
    return (make_contact_chart(scenario.detection, scenario.direction),)


ADEPT_UNKNOWN_WALL = Experiment(
    name="adept-unknown-wall",
    paper="hybrid-force-position",
    figure="section 6.3",
    summary="the Adept One finds an unknown wall and slides along it",
    scenario=AdeptUnknownWallScenario,
    resolve=resolve_wall,
    run=run_wall_trials,
    plot=_plot_adept,
    diagram=make_unknown_wall_diagram,
    charts=_charts,
    reduced=("trials=1", "duration=2.5", "measure_after=2", "task.kick_time=1.8"),
)

PUMA_UNKNOWN_WALL = Experiment(
    name="puma-unknown-wall",
    paper="hybrid-force-position",
    figure="section 6.3",
    summary="the Puma 250 finds an unknown wall and slides along it",
    scenario=PumaUnknownWallScenario,
    resolve=resolve_wall,
    run=run_wall_trials,
    plot=_plot_puma,
    diagram=make_unknown_wall_diagram,
    charts=_charts,
    reduced=("trials=1", "duration=2.5", "measure_after=2", "task.kick_time=1.8"),
)

PLANAR_UNKNOWN_WALL = Experiment(
    name="planar-unknown-wall",
    paper="hybrid-force-position",
    figure="section 6.3",
    summary="the two-link arm finds an unknown wall and slides along it",
    scenario=PlanarUnknownWallScenario,
    resolve=resolve_wall,
    run=run_wall_trials,
    plot=_plot_planar,
    diagram=make_unknown_wall_diagram,
    charts=_charts,
    reduced=("trials=1", "duration=3.5", "measure_after=3", "task.kick_time=2.8"),
)
