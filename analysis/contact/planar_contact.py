"""Chapter 2: hold and slide in the crucible."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from chamfer.analysis.contact.contact_figures import plot_contact
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.contact.planar_scenarios import (
    PlanarScenario,
    PlanarSlideLateScenario,
    PlanarSlideScenario,
)


def hold_figures(scenario: PlanarScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"planar-hold": plot_contact("planar-hold", scenario, outcome)}


def slide_figures(scenario: PlanarSlideScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"planar-slide": plot_contact("planar-slide", scenario, outcome)}


def late_figures(scenario: PlanarSlideLateScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"planar-slide-late": plot_contact("planar-slide-late", scenario, outcome)}
