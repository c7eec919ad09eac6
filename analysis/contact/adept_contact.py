"""Section 3.2: the Adept One presses and moves a roller and a nugget."""

from collections.abc import Mapping

from matplotlib.figure import Figure

from chamfer.analysis.contact.contact_figures import plot_contact
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.contact.adept_scenarios import (
    AdeptScenario,
)


def roller_hold_figures(scenario: AdeptScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"adept-roller-hold": plot_contact("adept-roller-hold", scenario, outcome)}


def roller_motion_figures(scenario: AdeptScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"adept-roller-motion": plot_contact("adept-roller-motion", scenario, outcome)}


def nugget_hold_figures(scenario: AdeptScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"adept-nugget-hold": plot_contact("adept-nugget-hold", scenario, outcome)}


def nugget_motion_figures(scenario: AdeptScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"adept-nugget-motion": plot_contact("adept-nugget-motion", scenario, outcome)}
