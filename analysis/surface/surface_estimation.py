"""Section 5.2: the observer watches a gripper that is led along a parabola."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from chamfer.analysis.scenario.experiment import Experiment, Outcome
from chamfer.analysis.surface.surface_figures import plot_estimation
from chamfer.analysis.surface.surface_runs import run_estimation_trials
from chamfer.diagrams.surface.surface_estimation import (
    EstimationScenario,
    LargeNoiseEstimationScenario,
    NoiseFreeEstimationScenario,
    SmoothEstimationScenario,
    make_estimation_diagram,
    resolve_estimation,
)


def _plot(scenario: EstimationScenario, outcome: Outcome) -> Mapping[str, Figure]:
    return {"surface-estimation": plot_estimation("surface-estimation", scenario, outcome)}


def _plot_smooth(scenario: EstimationScenario, outcome: Outcome) -> Mapping[str, Figure]:
    name = "surface-estimation-smooth"
    return {name: plot_estimation(name, scenario, outcome)}


def _plot_noise_free(scenario: EstimationScenario, outcome: Outcome) -> Mapping[str, Figure]:
    name = "surface-estimation-noise-free"
    return {name: plot_estimation(name, scenario, outcome)}


def _plot_large_noise(scenario: EstimationScenario, outcome: Outcome) -> Mapping[str, Figure]:
    name = "surface-estimation-large-noise"
    return {name: plot_estimation(name, scenario, outcome)}


SURFACE_ESTIMATION = Experiment(
    name="surface-estimation",
    paper="hybrid-force-position",
    figure="Fig. 5-3",
    summary="a gripper slides along an unknown surface, and an observer estimates the normal",
    scenario=EstimationScenario,
    resolve=resolve_estimation,
    run=run_estimation_trials,
    plot=_plot,
    diagram=make_estimation_diagram,
    reduced=("trials=2", "lead.halt=1.5", "duration=2"),
)

SURFACE_ESTIMATION_SMOOTH = Experiment(
    name="surface-estimation-smooth",
    paper="hybrid-force-position",
    figure="Fig. 5-4",
    summary="the same with a surface that is known to be smooth",
    scenario=SmoothEstimationScenario,
    resolve=resolve_estimation,
    run=run_estimation_trials,
    plot=_plot_smooth,
    diagram=make_estimation_diagram,
    reduced=("trials=2", "lead.halt=1.5", "duration=2"),
)

SURFACE_ESTIMATION_NOISE_FREE = Experiment(
    name="surface-estimation-noise-free",
    paper="hybrid-force-position",
    figure="Fig. 5-5",
    summary="the same without noise: the normal is found exactly",
    scenario=NoiseFreeEstimationScenario,
    resolve=resolve_estimation,
    run=run_estimation_trials,
    plot=_plot_noise_free,
    diagram=make_estimation_diagram,
    reduced=("lead.halt=1.5", "duration=2"),
)

SURFACE_ESTIMATION_LARGE_NOISE = Experiment(
    name="surface-estimation-large-noise",
    paper="hybrid-force-position",
    figure="Fig. 5-6",
    summary="the same with a sensor that is taken to be useless: the first estimate stays",
    scenario=LargeNoiseEstimationScenario,
    resolve=resolve_estimation,
    run=run_estimation_trials,
    plot=_plot_large_noise,
    diagram=make_estimation_diagram,
    reduced=("trials=2", "lead.halt=1.5", "duration=2"),
)
