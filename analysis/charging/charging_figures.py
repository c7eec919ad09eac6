"""The figures of a charging cycle: each mode beside its limits, and where all was left."""

from collections.abc import Sequence

from matplotlib.figure import Figure

from chamfer.analysis.charging.carrying_figures import plot_acquire, plot_scan, plot_slew
from chamfer.analysis.charging.laying_figures import plot_bulk, plot_crown, plot_places, plot_wall
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario


def plot_charging(
    scenario: CrucibleChargingScenario, outcome: Outcome, states: Sequence[str]
) -> dict[str, Figure]:
    """Draw each mode that the run came to, and where all items were left.

    Args:
        scenario: Of the run, resolved.
        outcome: Its metrics and traces.
        states: Names of the chart's states, by the index in the traces. A name begins with its
            mode and a point.
    """
    figures = {
        "acquire": plot_acquire(scenario, outcome, states),
        "scan": plot_scan(scenario, outcome, states),
        "slew": plot_slew(scenario, outcome, states),
        "wall": plot_wall(scenario, outcome, states),
        "crown": plot_crown(scenario, outcome, states),
        "bulk": plot_bulk(scenario, outcome, states),
        "places": plot_places(scenario, outcome),
    }
    return {name: figure for name, figure in figures.items() if figure is not None}
