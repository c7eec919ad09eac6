"""Section 3.1: the Puma 250 presses and moves a roller and a nugget."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from chamfer.analysis.contact.contact_figures import plot_contact
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.contact.puma_scenarios import (
    PumaScenario,
)


def roller_hold_figures(scenario: PumaScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"puma-roller-hold": plot_contact("puma-roller-hold", scenario, outcome)}


def roller_motion_figures(scenario: PumaScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"puma-roller-motion": plot_contact("puma-roller-motion", scenario, outcome)}


def nugget_hold_figures(scenario: PumaScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"puma-nugget-hold": plot_contact("puma-nugget-hold", scenario, outcome)}


def nugget_motion_figures(scenario: PumaScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"puma-nugget-motion": plot_contact("puma-nugget-motion", scenario, outcome)}
