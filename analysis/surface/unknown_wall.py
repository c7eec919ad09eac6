"""Section 6.3: arms find a wall that they do not know, and slide along it."""

from collections.abc import Mapping
from typing import Any

from matplotlib.figure import Figure

from chamfer.analysis.scenario.experiment import Outcome
from chamfer.analysis.surface.unknown_wall_figures import plot_wall
from chamfer.diagrams.surface.unknown_wall_scenario import UnknownWallScenario
from chamfer.systems.force.contact_detection import make_contact_chart
from chamfer.systems.statechart.chart import Chart


def adept_figures(scenario: UnknownWallScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"adept-unknown-wall": plot_wall(scenario, outcome)}


def puma_figures(scenario: UnknownWallScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"puma-unknown-wall": plot_wall(scenario, outcome)}


def planar_figures(scenario: UnknownWallScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"planar-unknown-wall": plot_wall(scenario, outcome)}


def make_charts(scenario: UnknownWallScenario) -> tuple[Chart[Any, Any], ...]:
    """Return the state charts."""
    return (make_contact_chart(scenario.detection, scenario.direction),)
