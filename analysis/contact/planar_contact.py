"""Chapter 2: hold and slide in the crucible."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from chamfer.analysis.contact.contact_figures import plot_contact
from chamfer.analysis.contact.contact_runs import contact_charts, run_trials
from chamfer.analysis.scenario.experiment import Experiment, Outcome
from chamfer.diagrams.contact.hybrid_loop import make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_resolve import resolve
from chamfer.diagrams.contact.planar_scenarios import (
    PlanarScenario,
    PlanarSlideLateScenario,
    PlanarSlideScenario,
)


def _plot_hold(scenario: PlanarScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"planar-hold": plot_contact("planar-hold", scenario, outcome)}


def _plot_slide(scenario: PlanarSlideScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"planar-slide": plot_contact("planar-slide", scenario, outcome)}


def _plot_late(scenario: PlanarSlideLateScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"planar-slide-late": plot_contact("planar-slide-late", scenario, outcome)}


PLANAR_HOLD = Experiment(
    name="planar-hold",
    paper="hybrid-force-position",
    figure="Fig. 2-5",
    summary="a two-link arm touches the crucible and pushes with 15 N",
    scenario=PlanarScenario,
    resolve=resolve,
    run=run_trials,
    plot=_plot_hold,
    diagram=make_hybrid_diagram,
    charts=contact_charts,
    reduced=("task.speed=1", "duration=2.5", "measure_after=2"),
)

PLANAR_SLIDE = Experiment(
    name="planar-slide",
    paper="hybrid-force-position",
    figure="Fig. 2-6",
    summary="it slides along the crucible and keeps the force",
    scenario=PlanarSlideScenario,
    resolve=resolve,
    run=run_trials,
    plot=_plot_slide,
    diagram=make_hybrid_diagram,
    charts=contact_charts,
    reduced=("task.speed=1", "duration=2.5", "measure_after=2"),
)

PLANAR_SLIDE_LATE = Experiment(
    name="planar-slide-late",
    paper="hybrid-force-position",
    figure="Fig. 2-6",
    summary="the same with a torque one sample late, which the thesis' gains would not bear",
    scenario=PlanarSlideLateScenario,
    resolve=resolve,
    run=run_trials,
    plot=_plot_late,
    diagram=make_hybrid_diagram,
    charts=contact_charts,
    reduced=("task.speed=1", "duration=2.5", "measure_after=2"),
)
