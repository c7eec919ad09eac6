"""Section 5.3: hybrid control along a parabola that only the observer knows."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from chamfer.analysis.scenario.experiment import Experiment, Outcome
from chamfer.analysis.surface.surface_figures import plot_tracking
from chamfer.analysis.surface.surface_runs import run_tracking_trials
from chamfer.diagrams.surface.surface_tracking import make_tracking_diagram, resolve_tracking
from chamfer.diagrams.surface.tracking_scenario import (
    AdaptiveTrackingScenario,
    NoiseFreeTrackingScenario,
    TrackingScenario,
)


def _plot(scenario: TrackingScenario, outcome: Outcome) -> Mapping[str, Figure]:
    name = "unknown-surface-control"
    return {name: plot_tracking(name, scenario, outcome)}


def _plot_noise_free(scenario: TrackingScenario, outcome: Outcome) -> Mapping[str, Figure]:
    name = "unknown-surface-control-noise-free"
    return {name: plot_tracking(name, scenario, outcome)}


def _plot_adaptive(scenario: TrackingScenario, outcome: Outcome) -> Mapping[str, Figure]:
    name = "unknown-surface-control-adaptive"
    return {name: plot_tracking(name, scenario, outcome)}


UNKNOWN_SURFACE_CONTROL = Experiment(
    name="unknown-surface-control",
    paper="hybrid-force-position",
    figure="Fig. 5-8",
    summary="force and motion are controlled along an estimated surface",
    scenario=TrackingScenario,
    resolve=resolve_tracking,
    run=run_tracking_trials,
    plot=_plot,
    diagram=make_tracking_diagram,
    reduced=("trials=2", "duration=2"),
)

UNKNOWN_SURFACE_CONTROL_NOISE_FREE = Experiment(
    name="unknown-surface-control-noise-free",
    paper="hybrid-force-position",
    figure="Fig. 5-9",
    summary="the same without noise: the force settles at the desired one",
    scenario=NoiseFreeTrackingScenario,
    resolve=resolve_tracking,
    run=run_tracking_trials,
    plot=_plot_noise_free,
    diagram=make_tracking_diagram,
    reduced=("duration=2",),
)

UNKNOWN_SURFACE_CONTROL_ADAPTIVE = Experiment(
    name="unknown-surface-control-adaptive",
    paper="hybrid-force-position",
    figure="section 5.3.4",
    summary="the same by the adaptive observer, which is given means of the force",
    scenario=AdaptiveTrackingScenario,
    resolve=resolve_tracking,
    run=run_tracking_trials,
    plot=_plot_adaptive,
    diagram=make_tracking_diagram,
    reduced=("trials=2", "duration=2"),
)
