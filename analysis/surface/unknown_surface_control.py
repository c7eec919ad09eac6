"""Section 5.3: hybrid control along a parabola that only the observer knows."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from chamfer.analysis.scenario.experiment import Outcome
from chamfer.analysis.surface.surface_figures import plot_tracking
from chamfer.diagrams.surface.tracking_scenario import (
    TrackingScenario,
)


def figures(scenario: TrackingScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    name = "unknown-surface-control"
    return {name: plot_tracking(name, scenario, outcome)}


def noise_free_figures(scenario: TrackingScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    name = "unknown-surface-control-noise-free"
    return {name: plot_tracking(name, scenario, outcome)}


def adaptive_figures(scenario: TrackingScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    name = "unknown-surface-control-adaptive"
    return {name: plot_tracking(name, scenario, outcome)}
