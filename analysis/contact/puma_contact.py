"""Section 3.1: the Puma 250 presses and moves a roller and a nugget."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from chamfer.analysis.contact.contact_figures import plot_contact
from chamfer.analysis.contact.contact_runs import contact_charts, run_trials
from chamfer.analysis.scenario.experiment import Experiment, Outcome
from chamfer.diagrams.contact.hybrid_loop import make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_resolve import resolve
from chamfer.diagrams.contact.puma_scenarios import (
    PumaNuggetHoldScenario,
    PumaNuggetMotionScenario,
    PumaRollerHoldScenario,
    PumaRollerMotionScenario,
    PumaScenario,
)


def _plot_roller_hold(scenario: PumaScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"puma-roller-hold": plot_contact("puma-roller-hold", scenario, outcome)}


def _plot_roller_motion(scenario: PumaScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"puma-roller-motion": plot_contact("puma-roller-motion", scenario, outcome)}


def _plot_nugget_hold(scenario: PumaScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"puma-nugget-hold": plot_contact("puma-nugget-hold", scenario, outcome)}


def _plot_nugget_motion(scenario: PumaScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"puma-nugget-motion": plot_contact("puma-nugget-motion", scenario, outcome)}


PUMA_ROLLER_HOLD = Experiment(
    name="puma-roller-hold",
    paper="hybrid-force-position",
    figure="Fig. 3-5",
    summary="the Puma 250 presses a roller on a table",
    scenario=PumaRollerHoldScenario,
    resolve=resolve,
    run=run_trials,
    plot=_plot_roller_hold,
    diagram=make_hybrid_diagram,
    charts=contact_charts,
    reduced=("trials=1", "duration=3", "measure_after=2"),
)

PUMA_ROLLER_MOTION = Experiment(
    name="puma-roller-motion",
    paper="hybrid-force-position",
    figure="Fig. 3-6",
    summary="the Puma 250 rolls along a table",
    scenario=PumaRollerMotionScenario,
    resolve=resolve,
    run=run_trials,
    plot=_plot_roller_motion,
    diagram=make_hybrid_diagram,
    charts=contact_charts,
    reduced=("trials=1", "duration=3", "measure_after=2"),
)

PUMA_NUGGET_HOLD = Experiment(
    name="puma-nugget-hold",
    paper="hybrid-force-position",
    figure="Fig. 3-7",
    summary="the Puma 250 presses a nugget on a glass wall",
    scenario=PumaNuggetHoldScenario,
    resolve=resolve,
    run=run_trials,
    plot=_plot_nugget_hold,
    diagram=make_hybrid_diagram,
    charts=contact_charts,
    reduced=("trials=1", "duration=3", "measure_after=2"),
)

PUMA_NUGGET_MOTION = Experiment(
    name="puma-nugget-motion",
    paper="hybrid-force-position",
    figure="Fig. 3-8",
    summary="the Puma 250 slides a nugget along a glass wall",
    scenario=PumaNuggetMotionScenario,
    resolve=resolve,
    run=run_trials,
    plot=_plot_nugget_motion,
    diagram=make_hybrid_diagram,
    charts=contact_charts,
    reduced=("trials=1", "duration=3", "measure_after=2"),
)
