"""Section 3.2: the Adept One presses and moves a roller and a nugget."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from chamfer.analysis.contact.contact_figures import plot_contact
from chamfer.analysis.contact.contact_runs import contact_charts, run_trials
from chamfer.analysis.scenario.experiment import Experiment, Outcome
from chamfer.diagrams.contact.adept_scenarios import (
    AdeptNuggetHoldScenario,
    AdeptNuggetMotionScenario,
    AdeptRollerHoldScenario,
    AdeptRollerMotionScenario,
    AdeptScenario,
)
from chamfer.diagrams.contact.hybrid_loop import make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_resolve import resolve


def _plot_roller_hold(scenario: AdeptScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"adept-roller-hold": plot_contact("adept-roller-hold", scenario, outcome)}


def _plot_roller_motion(scenario: AdeptScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"adept-roller-motion": plot_contact("adept-roller-motion", scenario, outcome)}


def _plot_nugget_hold(scenario: AdeptScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"adept-nugget-hold": plot_contact("adept-nugget-hold", scenario, outcome)}


def _plot_nugget_motion(scenario: AdeptScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"adept-nugget-motion": plot_contact("adept-nugget-motion", scenario, outcome)}


ADEPT_ROLLER_HOLD = Experiment(
    name="adept-roller-hold",
    paper="hybrid-force-position",
    figure="Fig. 3-11",
    summary="the Adept One presses a roller on a plate",
    scenario=AdeptRollerHoldScenario,
    resolve=resolve,
    run=run_trials,
    plot=_plot_roller_hold,
    diagram=make_hybrid_diagram,
    charts=contact_charts,
    reduced=("trials=1", "task.speed=0.05", "duration=3", "measure_after=2"),
)

ADEPT_ROLLER_MOTION = Experiment(
    name="adept-roller-motion",
    paper="hybrid-force-position",
    figure="Fig. 3-12",
    summary="the Adept One rolls along a plate",
    scenario=AdeptRollerMotionScenario,
    resolve=resolve,
    run=run_trials,
    plot=_plot_roller_motion,
    diagram=make_hybrid_diagram,
    charts=contact_charts,
    reduced=("trials=1", "task.speed=0.05", "duration=3", "measure_after=2"),
)

ADEPT_NUGGET_HOLD = Experiment(
    name="adept-nugget-hold",
    paper="hybrid-force-position",
    figure="Fig. 3-13",
    summary="the Adept One presses a nugget on a metal wall",
    scenario=AdeptNuggetHoldScenario,
    resolve=resolve,
    run=run_trials,
    plot=_plot_nugget_hold,
    diagram=make_hybrid_diagram,
    charts=contact_charts,
    reduced=("trials=1", "duration=3", "measure_after=2"),
)

ADEPT_NUGGET_MOTION = Experiment(
    name="adept-nugget-motion",
    paper="hybrid-force-position",
    figure="Fig. 3-14",
    summary="the Adept One slides a nugget along a metal wall",
    scenario=AdeptNuggetMotionScenario,
    resolve=resolve,
    run=run_trials,
    plot=_plot_nugget_motion,
    diagram=make_hybrid_diagram,
    charts=contact_charts,
    reduced=("trials=1", "duration=3", "measure_after=2"),
)
