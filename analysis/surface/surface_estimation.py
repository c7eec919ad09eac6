"""Section 5.2: the observer watches a gripper that is led along a parabola."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from chamfer.analysis.scenario.experiment import Outcome
from chamfer.analysis.surface.surface_figures import plot_estimation
from chamfer.diagrams.surface.surface_estimation import (
    EstimationScenario,
)


def figures(scenario: EstimationScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"surface-estimation": plot_estimation("surface-estimation", scenario, outcome)}


def smooth_figures(scenario: EstimationScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    name = "surface-estimation-smooth"
    return {name: plot_estimation(name, scenario, outcome)}


def noise_free_figures(scenario: EstimationScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    name = "surface-estimation-noise-free"
    return {name: plot_estimation(name, scenario, outcome)}


def large_noise_figures(scenario: EstimationScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    name = "surface-estimation-large-noise"
    return {name: plot_estimation(name, scenario, outcome)}
