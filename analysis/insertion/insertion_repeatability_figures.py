"""Many insertions: depths over time, how soon and how hard, and the touches."""

from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.drawing.figure_style import LIMIT, Style, dress, legend, new_figure
from chamfer.analysis.insertion.insertion_trials import AS_IT_IS, InsertionTrialsScenario
from chamfer.analysis.scenario.experiment import Outcome
from chamfer.diagrams.insertion.insertion import task_params
from chamfer.systems.contact.peg_hole_contact_monitor import SEATED

Array = NDArray[np.float64]

_COLOURS: Final = {AS_IT_IS: "#e07b00", "wait": "#1b4f9c", "frozen": "#b00020"}
_OTHER: Final = "#777777"
_MARKERS: Final = {AS_IT_IS: "o", "wait": "s", "frozen": "D"}
_REGION: Final[Style] = {"color": "#dfe7f2", "linewidth": 0}
_SAFE: Final = 5.0  # N
_MM: Final = 1e3


def plot_insertions(scenario: InsertionTrialsScenario, outcome: Outcome) -> Figure:
    """Draw every trial in every way."""
    figure = new_figure(12.0, 8.4)
    courses, times, forces, touches = figure.subplots(2, 2).ravel()
    ways = [way for way in (AS_IT_IS, *scenario.beside) if way != "settling"]
    table, traces = outcome.tables["courses"], outcome.traces
    params = task_params(scenario)
    for k, way in enumerate(ways):
        colour, named = _COLOURS.get(way, _OTHER), _name(scenario, way)
        for trial in np.unique(table["trial"][table["way"] == k]):
            of = (table["way"] == k) & (table["trial"] == trial)
            first = trial == table["trial"][table["way"] == k][0]
            courses.plot(
                table["time"][of] - scenario.begin,
                _MM * table["depth"][of],
                color=colour,
                linewidth=0.8,
                alpha=0.7,
                label=named if first else None,
            )
        rows = traces["way"] == k
        _distribution(times, traces["time_to_seated"][rows], colour, named)
        _distribution(forces, traces["force.contact"][rows], colour, named)
        seated = rows & (traces["seated"] > 0)
        for of, filled in ((seated, True), (rows & ~seated, False)):
            touches.plot(
                _MM * traces["touch.lateral_error"][of],
                _MM * traces["touch.rotational_error"][of],
                marker=_MARKERS.get(way, "d"),
                linestyle="none",
                color=colour,
                markerfacecolor=colour if filled else "none",
                markersize=6,
                label=named if filled else (f"{named}: not seated" if of.any() else None),
            )
    courses.axhline(_MM * SEATED * params.target, label="counts as seated", **LIMIT)
    since = "time since the first frame / s"
    dress(courses, title="(a) Depth of the tip", x=since, y="depth / mm")
    forces.axvline(_SAFE, label=f"{_SAFE:g} N", **LIMIT)
    for axes, title, x in (
        (times, "(b) How soon: share seated", since),
        (forces, "(c) How hard: share of trials below", "largest contact force, 10 ms / N"),
    ):
        dress(axes, title=title, x=x, y="share of the trials / %")
        axes.set_ylim(0.0, 103.0)
    region = params.region
    lateral = np.linspace(0.0, region.lateral_limit, 100)
    tilt = np.array([region.tilt_at(one) for one in lateral])
    touches.fill_between(_MM * lateral, 0.0, _MM * tilt, label="free of wedging", **_REGION)
    dress(
        touches,
        title="(d) Errors where the last attempt touches",
        x="lateral error / mm",
        y="rotational error / mrad",
    )
    touches.set_xlim(0.0, None)
    touches.set_ylim(0.0, None)
    for axes in (courses, times, forces, touches):
        legend(axes, loc="best")
    return figure


def _name(scenario: InsertionTrialsScenario, way: str) -> str:
    if way != AS_IT_IS:
        return way.replace("_", ", ")
    return f"{scenario.decide.kind.replace('_', ' ')}, {scenario.insert.compensation}"


def _distribution(axes: Axes, values: Array, colour: str, name: str) -> None:
    """Draw the share of all values, NaN included, that is below."""
    known = np.sort(values[np.isfinite(values)])
    share = 100 * np.arange(1, len(known) + 1) / max(len(values), 1)
    axes.step(known, share, where="post", color=colour, linewidth=1.6, label=name)
