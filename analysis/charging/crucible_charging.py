"""Section 1.1.2: nuggets from the feeder into the crucible, against the limits of each mode."""

from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.charging.charging_figures import plot_charging, plot_path
from chamfer.analysis.charging.charging_runs import (
    LIMITS,
    ChargingRun,
    item_limits,
    items_of,
    limits_in,
    run_charging,
)
from chamfer.analysis.contact.contact_metrics import stability_metrics
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.charging.charging_scenario import (
    ResolvedCrucibleChargingScenario,
    charging_stability,
    chart_of,
)
from chamfer.models.charging.packing import PlanItem
from chamfer.systems.statechart.chart import Chart

NEAR: Final = 0.01  # m, of the designated location; section 1.1.2 has it for bulk filling
_PLACES: Final = tuple(f"{kind}.position_error" for kind in ("wall", "crown", "bulk"))


def measure(
    scenario: ResolvedCrucibleChargingScenario, run: ChargingRun
) -> tuple[dict[str, float], ...]:
    """Return the measurements of each item of the plan."""
    names = chart_of(scenario).state_names
    return tuple(
        item_limits(run.traces, names, item, index, scenario.station.true)
        for index, item in enumerate(items_of(scenario))
    )


def worst(plan: Sequence[PlanItem], items: tuple[Mapping[str, float], ...]) -> dict[str, Metric]:
    """Return the worst of all items, with each item's value in the note."""
    metrics = {}
    for name, (unit, of) in limits_in(plan).items():
        values = [item.get(name) for item in items]
        known = [value for value in values if value is not None]
        shown = ", ".join("-" if value is None else f"{value:.3g}" for value in values)
        metrics[name] = Metric(
            value=of(known) if known else None,
            unit=unit,
            note=f"by item: {shown}" if known else "no item came to it",
        )
    return metrics


def placed(items: tuple[Mapping[str, float], ...]) -> int:
    """Return the number of items at their true places; the chart can't know that."""
    errors = [value for item in items for name, value in item.items() if name in _PLACES]
    return sum(value <= NEAR for value in errors)


def run_crucible_charging(
    scenario: ResolvedCrucibleChargingScenario, seed: int, progress: Progress
) -> Outcome:
    """Run the experiment."""
    run = run_charging(scenario, seed, progress)
    items = measure(scenario, run)
    laid = int(np.sum(run.transitions["target"] == "retreat.up"))
    cycle = {
        "cycle.laid": Metric(value=laid, unit="", note=run.reason),
        "cycle.placed": Metric(
            value=placed(items), unit="", note=f"where they should be, within {NEAR:g} m"
        ),
        "cycle.placed_share": Metric(
            value=100 * placed(items) / len(items), unit="%", note="likewise, of the plan"
        ),
        "cycle.time": Metric(value=float(run.traces["time"][-1]), unit="s"),
    }
    # One row an item; NaN where nothing was measured.
    nuggets: dict[str, Any] = {
        "item": column(range(len(items))),
        "kind": np.array([one.kind for one in scenario.plan]),
        "mass": column([one.mass for one in scenario.plan]),
        "azimuth": column([one.azimuth for one in scenario.plan]),
        **{name: column([item.get(name, np.nan) for item in items]) for name in LIMITS},
    }
    stability = charging_stability(scenario)
    margins = {} if stability is None else stability_metrics(stability)
    return Outcome(
        metrics=worst(scenario.plan, items) | cycle | margins,
        traces=run.traces,
        tables={"nuggets": nuggets, "transitions": run.transitions},
        simulated_seconds=float(run.traces["time"][-1]),
    )


def make_charts(scenario: ResolvedCrucibleChargingScenario) -> tuple[Chart[Any, Any], ...]:
    """Return the state charts."""
    return (chart_of(scenario),)


def figures(scenario: ResolvedCrucibleChargingScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    chart = chart_of(scenario)
    figures = plot_charging(scenario, outcome, chart.state_names)
    return figures | {"path": plot_path(chart, outcome)}
