"""Fig. 11: the height of the peg's tip with and without compensation."""

from typing import Final

from matplotlib.figure import Figure

from chamfer.analysis.drawing.figure_style import (
    BAND,
    DESIRED,
    FSM,
    PUBLISHED,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.published.work_cell import DROOP
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.cell.alignment_scenario import VerticalTrackingScenario

_WITHOUT: Final[Style] = {"color": "#1b4f9c", "linestyle": "--", "linewidth": 1.8}
_ADDED: Final[Style] = {"color": "#7a4100", "linestyle": "-.", "linewidth": 1.3}
_RUNS: Final = (
    ("uncompensated", "without compensation", _WITHOUT),
    ("compensated", "with compensation by sight", FSM),
)


def plot_heights(scenario: VerticalTrackingScenario, outcome: Outcome) -> Figure:
    """Draw height, error and compensation over time."""
    traces, goal = outcome.traces, scenario.mouth[2]
    time, desired = traces["time"], traces["desired_height"]
    figure = new_figure(10.0, 7.5)
    height, error = figure.subplots(2, 1, sharex=True)
    height.plot(time, 1e3 * desired, label="desired", **DESIRED)
    for name, label, style in _RUNS:
        height.plot(time, 1e3 * traces[f"{name}_height"], label=label, **style)
    dress(height, title="(a) Height of the peg's tip", x="", y="height / mm")
    legend(height, loc="lower right")
    zone = 1e3 * scenario.compensator.lateral.closed.dead_zone * scenario.cameras.pixel_size
    error.axhspan(-zone, zone, label="dead zone", **BAND)
    error.axhline(1e3 * DROOP, label="published: 1.5 mm low", **PUBLISHED)
    for name, label, style in _RUNS:
        off = traces[f"{name}_height"] - desired
        error.plot(time, 1e3 * off, label=label, **style)
    error.plot(time, 1e3 * traces["compensation"], label="compensation added", **_ADDED)
    title = f"(b) Actual minus desired height, and compensation; goal {1e3 * goal:g} mm"
    dress(error, title=title, x="time / s", y="error / mm")
    legend(error, loc="upper center", bbox_to_anchor=(0.5, -0.14), ncols=5)
    error.set_xlim(0.0, float(time[-1]))
    return figure
