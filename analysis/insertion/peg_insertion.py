"""Whitney's case: one peg on a spring support is fed into its hole (Fig. 1)."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.geometry import Meshcat

from chamfer.analysis.cell.wedging_diagram import draw_reach, draw_sides
from chamfer.analysis.drawing.figure_kit import metric_value, shade
from chamfer.analysis.drawing.figure_style import (
    FORCE,
    LIMIT,
    REGION,
    Style,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.insertion.insertion_runs import Insertion, insert, measure, median, path
from chamfer.analysis.report.replay import record, set_stage
from chamfer.analysis.scenario.experiment import Outcome, Progress, Table, column
from chamfer.diagrams.insertion.peg_insertion import (
    JOINTS,
    PegInsertionScenario,
    make_peg_insertion_view,
)
from chamfer.models.peg_theory.wedging import sliding_bounds, wedging_bounds
from chamfer.systems.contact.peg_hole_contact_monitor import FEATURES, ContactState


def run(scenario: PegInsertionScenario, seed: int, progress: Progress) -> Outcome:
    """Feed the peg in; nothing is random."""
    finished = insert(scenario, progress)
    return Outcome(
        metrics=measure(scenario, finished),
        traces=_traces(scenario, finished),
        simulated_seconds=float(finished.time[-1]),
        tables={"predicted": path(scenario)},
    )


def _traces(scenario: PegInsertionScenario, run: Insertion) -> Table:
    columns = {
        "time": run.time,
        "depth": run.depth,
        "push": run.push,
        "force_x": run.axial,
        **{f"force_{axis}": run.lateral[:, k] for k, axis in enumerate("yz")},
        "force_x_median": median(run.axial, scenario.step),
        "force_y_median": median(run.lateral[:, 0], scenario.step),
        "state": run.state,
        **{f"normal_{name}": run.normal[:, k] for k, name in enumerate(FEATURES)},
        **{name: run.joints[:, k] for k, name in enumerate(JOINTS)},
        "tip": run.joints[:, 1] - scenario.support.centre_distance * np.sin(run.tilt),
        "tilt": run.tilt,
        "loss": run.loss,
    }
    return {name: column(values) for name, values in columns.items()}


Array = NDArray[np.float64]

STATES: Final[dict[ContactState, tuple[str, str]]] = {
    ContactState.CHAMFER: ("chamfer", "#f2d7a0"),
    ContactState.ONE_POINT: ("one point", "#cfe3cf"),
    ContactState.TWO_POINT: ("two points", "#c9d8f0"),
    ContactState.SEATED: ("seated", "#e6e6e6"),
    ContactState.FACE: ("on the face", "#f0c9c9"),
}
_EXACT: Final[Style] = {"color": "#b00020", "linestyle": "--", "linewidth": 1.4}
_SIMPLE: Final[Style] = {"color": "#777777", "linestyle": ":", "linewidth": 1.4}
_PATH: Final[Style] = {"color": "#e07b00", "linestyle": "-", "linewidth": 1.4}
_START: Final[Style] = {"color": "#e07b00", "marker": "o", "linestyle": "none", "markersize": 6}
_MM: Final = 1e3
_MRAD: Final = 1e3
_TALL: Final = 1.6  # times the largest simulated force, beyond which predictions are cut


def figures(scenario: PegInsertionScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw axial and lateral force, and tip and tilt in the wedging diagram."""
    traces, predicted = outcome.traces, outcome.tables["predicted"]
    forces, titles = {}, {}
    for k, kind in enumerate(("axial", "lateral")):
        found, said = (
            metric_value(outcome.metrics, f"{of}force.{kind}") for of in ("", "predicted.")
        )
        forces[kind] = f"{kind} force up to {found:.2g} N, {said:.2g} N by exact statics"
        titles[kind] = f"({'ab'[k]}) {forces[kind].capitalize().replace(' n', ' N')}"
    ends = "seated" if outcome.metrics["seated"].value else "not seated"
    figure = new_figure(
        height=10.0,
        caption=f"The peg ends {ends}: {forces['axial']}. Colours in the background are the "
        "contact states; (c) is its way into the wedge-free region.",
    )
    above, below, path = figure.subplots(3, 1, height_ratios=(1.0, 1.0, 1.5))
    below.sharex(above)
    fed = traces["time"] <= scenario.released
    l_of = (traces["depth"][fed] - scenario.parts.chamfer_height) * _MM
    force = traces["force_x_median"][fed]
    for axes, measured, of, title in (
        (above, force, predicted["axial"], titles["axial"]),
        (below, traces["force_y_median"][fed], predicted["lateral"], titles["lateral"]),
    ):
        for one, (label, colour) in STATES.items():
            look: Style = {"color": colour, "alpha": 0.6, "linewidth": 0, "zorder": 0.5}
            shade(axes, l_of, traces["state"][fed] == one, label, look)
        axes.plot(l_of, measured, label="simulated, median of 10 ms", **FORCE)
        axes.plot(predicted["depth"] * _MM, of, label="exact statics", **_EXACT)
        dress(axes, title=title, x="depth l in the bore / mm", y="force / N")
    above.plot(predicted["depth"] * _MM, predicted["simple"], label="Whitney", **_SIMPLE)
    tallest = max(_TALL * float(force.max()), 0.1)
    if scenario.force_cap < tallest:
        above.axhline(scenario.force_cap, label="cap of the push", **LIMIT)
    above.set_ylim(0.0, tallest)
    above.set_xlabel("")
    legend(below, handles=above.get_legend_handles_labels()[0], ncols=4)
    _diagram(path, scenario, outcome, fed)
    return {"peg-insertion": figure}


def _diagram(
    axes: Axes, scenario: PegInsertionScenario, outcome: Outcome, fed: NDArray[np.bool_]
) -> None:
    """Draw the path of tip and tilt into the region that is free of wedging."""
    parts, support, traces = scenario.parts, scenario.support, outcome.traces
    edge = 1.15 * max(parts.chamfer_limit, abs(scenario.lateral))
    x = np.linspace(-edge, edge, 201)
    reached = np.abs(x) <= parts.chamfer_limit
    wedge, slide = wedging_bounds(parts, support, x), sliding_bounds(parts, support, x)
    lower, upper = np.maximum(wedge[0], slide[0]), np.minimum(wedge[1], slide[1])
    free = "neither wedges nor jams"
    axes.fill_between(x * _MM, lower * _MRAD, upper * _MRAD, where=reached, label=free, **REGION)
    simple = wedging_bounds(parts, support, x, "simple")
    draw_sides(axes, x, wedge, "may wedge beyond", FORCE)
    draw_sides(axes, x, slide, "no push slides", _EXACT)
    draw_sides(axes, x, simple, "Whitney's sides", _SIMPLE)
    draw_reach(axes, parts)
    axes.plot(traces["tip"][fed] * _MM, traces["tilt"][fed] * _MRAD, label="tip and tilt", **_PATH)
    axes.plot(scenario.lateral * _MM, scenario.tilt * _MRAD, label="start", **_START)
    tallest = 1.1 * max(float(upper.max()), abs(scenario.tilt), parts.rotation_limit) * _MRAD
    axes.set_ylim(-tallest, tallest)
    title, off = "(c) Path in the wedging diagram", "lateral error of the tip / mm"
    dress(axes, title=title, x=off, y="tilt / mrad")
    legend(axes, ncols=3)


_EYE: Final = np.array([0.0, -0.12, 0.07])  # m; assumed
_TARGET: Final = np.array([-0.01, 0.0, 0.0])  # m; assumed
_FLOOR: Final = np.array([0.0, 0.0, -0.05])  # m; assumed


def replay_peg_insertion(
    scenario: PegInsertionScenario, outcome: Outcome, meshcat: Meshcat
) -> None:
    """Show a run as an animation; its traces have the time and the joints' positions."""
    diagram, plant = make_peg_insertion_view(scenario, meshcat)
    set_stage(meshcat, floor=_FLOOR, eye=_EYE, target=_TARGET)
    traces = outcome.traces
    positions = np.column_stack([traces[name] for name in JOINTS])
    record(meshcat, diagram, plant, np.asarray(traces["time"]), positions)
