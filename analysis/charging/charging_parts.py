"""What the figures of a charging cycle share: the rows of an item in a mode, and their style."""

from collections.abc import Sequence
from typing import Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.charging.charging_metrics import in_space
from chamfer.analysis.drawing.figure_style import Style
from chamfer.analysis.scenario.experiment import Outcome, Table
from chamfer.diagrams.charging.charging_scenario import CrucibleChargingScenario

Array = NDArray[np.float64]

MM: Final = 1e3
CM: Final = 1e2
GLASS: Final[Style] = {"facecolor": "#bfd4ea", "edgecolor": "#5a7fa8", "linewidth": 0.8}
BESIDE: Final = {"loc": "upper left", "bbox_to_anchor": (1.0, 1.0)}  # of the axes, a legend

_NAMED: Final = 8  # parts that a legend has room for; more have no label
_COLOURS: Final = ("#1b4f9c", "#e07b00", "#2e7d32", "#7a4100", "#6fa0e8", "#b00020")


class Part(NamedTuple):
    """What an item did in a mode."""

    item: int
    label: str
    style: Style
    rows: NDArray[np.intp]  # of the traces
    time: Array  # s, since the mode began


def parts(
    scenario: CrucibleChargingScenario,
    traces: Table,
    states: Sequence[str],
    *modes: str,
    first: str = "",
) -> list[Part]:
    """Return the rows in which items were in one of some modes.

    Args:
        scenario: Of the run.
        traces: Of the run.
        states: Names of the chart's states, by the index in ``traces``.
        *modes: With which the states' names begin.
        first: The state from which on rows count; "" for any.
    """
    begun = states.index(first) if first else -1
    mode = np.array([name.partition(".")[0] for name in states])[traces["state"].astype(int)]
    found: list[Part] = []
    for i, one in enumerate(scenario.plan):
        rows = np.flatnonzero(np.isin(mode, modes) & (traces["item"] == i))
        if begun >= 0:
            rows = rows[np.logical_or.accumulate(traces["state"][rows] == begun)]
        if len(rows):
            style: Style = {"color": colour_of(i), "linewidth": 1.2}
            label = f"{i + 1}: {one.kind}, {1e3 * one.mass:.0f} g" if len(found) < _NAMED else ""
            time = traces["time"][rows] - traces["time"][rows[0]]
            found.append(Part(i, label, style, rows, time))
    return found


def colour_of(item: int) -> str:
    """Return the colour of an item, by its index in the plan."""
    return _COLOURS[item % len(_COLOURS)]


def off_command(traces: Table) -> Array:
    """Return how far the nugget is from the command, m."""
    away: Array = np.linalg.norm(in_space(traces, "nugget") - in_space(traces, "desired"), axis=1)
    return away


def said(outcome: Outcome, metric: str, scale: float = 1.0) -> str:
    """Return a metric's value for a title."""
    found = outcome.metrics.get(metric)
    if found is None or found.value is None:
        return "-"
    return f"{scale * found.value + 0.0:.3g}"  # no -0
