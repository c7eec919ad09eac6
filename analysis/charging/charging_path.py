"""The path that a charging cycle took through its chart, a row for each mode."""

from typing import Final

from matplotlib.figure import Figure

from chamfer.analysis.drawing.chart_path import plot_chart_path
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.systems.charging.charging_chart import DONE, HALTED, STOPPED, ChargingChart
from chamfer.systems.statechart.chart import ANY

_SELDOM: Final = (HALTED, "back_off")  # drawn only where the run came to it
# What stands in a row: states by the mode with which their names begin.
_ROWS: Final = (
    {"home"},
    {"acquire"},
    {"scan", "slew"},
    {"wall"},
    {"crown"},
    {"bulk"},
    {"release", "retreat", "return", DONE},
    {ANY, *_SELDOM, STOPPED},
)
_MOST: Final = 2  # numbers at a line; a transition is taken with each item


def plot_path(chart: ChargingChart, outcome: Outcome) -> Figure:
    """Draw the chart and what a run took of it.

    Args:
        chart: Which ran.
        outcome: Its table ``transitions`` has the columns ``time``, s, ``source``, ``target`` and
            ``label``; its metrics ``cycle.laid`` and ``cycle.time``.
    """
    names = [*chart.state_names, ANY]
    mode = {name: name.partition(".")[0] for name in names}
    path = outcome.tables["transitions"]
    laid, time = outcome.metrics["cycle.laid"], outcome.metrics["cycle.time"].value
    why = f", then stopped: {laid.note}" if laid.note else ""
    return plot_chart_path(
        chart,
        {**path, "outcome": path["label"]},
        result=f"{laid.value:g} items laid in {time:.1f} s{why}",
        rows=[[name for name in names if mode[name] in row] for row in _ROWS],
        seldom=[name for name in names if mode[name] in _SELDOM],
        most=_MOST,
    )
