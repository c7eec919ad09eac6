"""The dependence of an insertion on the solver: steps, stiffness, facets, approximation."""

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, NamedTuple

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import metrics_of, prefixed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.drawing.figure_style import PUBLISHED, Style, dress, legend_below, new_figure
from chamfer.analysis.insertion.insertion_runs import (
    insert,
    insert_by_cenic,
    is_seated,
    median,
    onset_of,
    predict,
)
from chamfer.analysis.insertion.oblique_impact import (
    draw_impacts,
    impact_metrics,
    strike_all,
)
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.insertion.peg_insertion import (
    PegInsertionScenario,
    resolve_peg_insertion,
)
from chamfer.models.validation import ParameterError, require_finite, require_positive
from chamfer.systems.contact.contact_approximation import Convex

Array = NDArray[np.float64]

STARTS: Final = ("sliding", "stuck")
# What is varied: a tuple of the scenario, and what each of its values makes of the insertion.
_CHANGES: Final[dict[str, Callable[[PegInsertionScenario, Any], PegInsertionScenario]]] = {
    "steps": lambda base, value: replace(base, step=value),
    "stiffnesses": lambda base, value: replace(
        base, contact=replace(base.contact, stiffness=value)
    ),
    "facets": lambda base, value: replace(base, contact=replace(base.contact, facets=value)),
    "stictions": lambda base, value: replace(base, stiction=value),
    "approximations": lambda base, value: replace(base, approximation=value),
    "accuracies": lambda base, value: base,
}
PARAMETERS: Final = tuple(_CHANGES)
MEASURED: Final = ("depth", "force", "raw_peak", "onset", "balance", "seated")
_UNITS: Final = ("m", "N", "N", "m", "%", "")


@dataclass(frozen=True, kw_only=True)
class ConvergenceScenario:
    """An insertion, a start that no push slides, and the variations, one at a time."""

    insertion: PegInsertionScenario = field(
        default_factory=lambda: PegInsertionScenario(
            lateral=0.0, tilt=0.045, depth=0.02, gap=0.001, speed=0.04
        )
    )
    stuck_tilt: float = 0.08
    # rad, of a start beyond the last tilt at which a push slides the peg; assumed
    steps: tuple[float, ...] = (2e-3, 1e-3, 5e-4, 2.5e-4)  # s, of the plant, the finest last
    stiffnesses: tuple[float, ...] = (1e5, 1e6, 1e7, 1e8)  # N/m, of a contact at a point
    facets: tuple[int, ...] = (32, 64, 128)  # of the bore
    stictions: tuple[float, ...] = (1e-3, 1e-4, 1e-5)  # m/s, at which a contact sticks
    approximations: tuple[Convex, ...] = ("lagged", "similar", "sap")  # of contact, Drake's
    accuracies: tuple[float, ...] = (1e-2, 1e-5)  # of CENIC, with steps up to the insertion's
    impact_speed: float = 0.04
    # m/s, across a plate, ten times that along it, of the peg's mass: that of the feed

    def __post_init__(self) -> None:
        require_finite(self, "stuck_tilt")
        require_positive(self, "impact_speed")
        for name in ("steps", "stiffnesses", "stictions", "accuracies"):
            values = getattr(self, name)
            if not all(0 < value < math.inf for value in values):
                raise ParameterError(name, values, "finite numbers > 0, or none")


class Variation(NamedTuple):
    """An insertion to run."""

    parameter: str  # of PARAMETERS
    value: float  # of an approximation its place in the scenario's tuple
    start: str
    scenario: PegInsertionScenario
    accuracy: float | None = None  # of CENIC; None: the scenario's own steps


CONVERGENCE: Final = ConvergenceScenario()


def resolve(scenario: ConvergenceScenario) -> ConvergenceScenario:
    """Resolve the insertion."""
    return replace(scenario, insertion=resolve_peg_insertion(scenario.insertion))


def variations(scenario: ConvergenceScenario) -> list[Variation]:
    """Return every insertion, the starts one after the other."""
    found = []
    for start in STARTS:
        base = scenario.insertion
        if start == "stuck":
            base = replace(base, tilt=math.copysign(scenario.stuck_tilt, base.tilt))
        for parameter, change in _CHANGES.items():
            for k, value in enumerate(getattr(scenario, parameter)):
                number = float(k) if parameter == "approximations" else value
                accuracy = value if parameter == "accuracies" else None
                found.append(Variation(parameter, number, start, change(base, value), accuracy))
    return found


def measure_variation(variation: Variation) -> Row:
    """Run one insertion and return the values of :data:`MEASURED`."""
    scenario = variation.scenario
    if variation.accuracy is None:
        run = insert(scenario, withdraw=False)
        axial = median(run.axial, scenario.step)
    else:
        run = insert_by_cenic(scenario, variation.accuracy)
        axial = run.axial
    steps = np.diff(run.time)
    work, lost = (float(one[1:] @ steps) for one in (run.power, run.loss))
    # CENIC holds the feed's input over a step, so that what the drives report is not their work.
    balance = 100 * lost / work if work > 0 and variation.accuracy is None else math.nan
    return {
        "depth": float(run.depth.max()),
        "force": float(axial.max()),
        "raw_peak": float(run.axial.max()),
        "onset": onset_of(scenario.parts, run.depth, run.two_point),
        "balance": balance,
        "seated": float(is_seated(scenario, run)),
    }


def run(scenario: ConvergenceScenario, seed: int, progress: Progress) -> Outcome:
    """Run every variation; nothing is random."""
    # The same insertion is among the values of several parameters.
    different = {(one.scenario, one.accuracy): one for one in variations(scenario)}
    results = run_each(measure_variation, list(different.values()), progress)
    results.split(STARTS, lambda variation: variation.start)  # none may be without
    by_run = {
        (one.scenario, one.accuracy): row
        for one, row in zip(results.tasks, results.rows, strict=True)
    }
    tasks = [one for one in variations(scenario) if (one.scenario, one.accuracy) in by_run]
    rows = [by_run[one.scenario, one.accuracy] for one in tasks]
    columns = {name: column([row[name] for row in rows]) for name in MEASURED}
    metrics: dict[str, Metric] = {}
    for start in STARTS:
        said = predict(next(one.scenario for one in tasks if one.start == start))
        names = [f"predicted.{one}" for one in ("seated", "force.axial", "two_point.onset")]
        metrics |= prefixed(start, {name: said[name] for name in names})
        for parameter in PARAMETERS:
            of = [
                k
                for k, one in enumerate(tasks)
                if (one.start, one.parameter) == (start, parameter)
            ]
            if of:
                named = [label(scenario, parameter, tasks[k].value) for k in of]
                found = _spread(parameter, named, {name: columns[name][of] for name in MEASURED})
                metrics |= prefixed(f"{start}.{parameter}", found)
    chosen = [
        k
        for k, one in enumerate(tasks)
        if one.start == "sliding"
        and one.parameter in ("steps", "facets", "stictions")
        and one.scenario.approximation == "lagged"
    ]
    worst = float(np.abs(columns["balance"][chosen] - 100).max()) if chosen else math.nan
    note = "of the work, not found in the contacts: over steps, facets and stictions"
    note = note if chosen else "none of steps, facets and stictions is varied"
    metrics |= metrics_of({"energy.worst": (worst, "%", note)})
    struck = strike_all(scenario.insertion, scenario.impact_speed)
    metrics |= prefixed("impact", impact_metrics(struck))
    return Outcome(
        metrics=metrics,
        tables={"impact": struck},
        traces={
            "parameter": column([float(PARAMETERS.index(one.parameter)) for one in tasks]),
            "value": column([one.value for one in tasks]),
            "start": column([float(STARTS.index(one.start)) for one in tasks]),
            **columns,
        },
        simulated_seconds=sum(one.scenario.released for one in results.tasks),
    )


def _spread(
    parameter: str, named: Sequence[str], columns: Mapping[str, Array]
) -> dict[str, Metric]:
    """Return what every value's run measured, and how far the largest and least are apart."""
    metrics: dict[str, tuple[float | None, str, str]] = {}
    for name, unit in zip(MEASURED, _UNITS, strict=True):
        for value, found in zip(named, columns[name].tolist(), strict=True):
            known = math.isfinite(found)
            note = _note(name, parameter, known)
            metrics[f"{value}.{name}"] = (found if known else None, unit, note)
    force = columns["force"]
    spread = 100 * float(np.ptp(force) / force[-1]) if force[-1] > 0 else None
    metrics["force.spread"] = (spread, "%", "between the largest and the least, of the last")
    return metrics_of(metrics)


def _note(name: str, parameter: str, defined: bool) -> str:
    if name == "onset":
        return "l" if defined else "two points never touch"
    if parameter == "accuracies" and name in ("force", "raw_peak"):
        return "CENIC's, recomputed from the pose"
    if name == "balance" and not defined:
        return "the drives report no work"
    return {"force": "largest median of 10 ms", "balance": "dissipated, of the work"}.get(name, "")


def label(scenario: ConvergenceScenario, parameter: str, value: float) -> str:
    """Return a value as metrics name it."""
    if parameter == "approximations":
        return scenario.approximations[int(value)]
    return f"{value:g}".replace(".", "_").replace("+", "")


_TITLES: Final = {
    "steps": "step / s",
    "stiffnesses": "stiffness / (N/m)",
    "facets": "facets",
    "stictions": "stiction / (m/s)",
    "approximations": "approximation",
    "accuracies": "CENIC's accuracy",
}
_STARTS: Final[tuple[tuple[str, Style], ...]] = (
    ("sliding", {"color": "#1b4f9c", "marker": "o", "linestyle": "-"}),
    ("stuck", {"color": "#e07b00", "marker": "s", "linestyle": "--"}),
)
_ACROSS: Final = 3  # panels
_LETTERS: Final = 20  # of the names of a parameter's values, beyond which they are turned
_RAW: Final[Style] = {"marker": "x", "linestyle": "none"}
_MM: Final = 1e3


def figures(scenario: ConvergenceScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw forces above depths, one column a parameter."""
    figure = new_figure(
        height=10.0,
        caption="Axial force and depth of an insertion over each parameter of the contact model "
        "and the integrator: where a curve is flat the result has converged.",
    )
    grid = figure.subplots(2 * math.ceil(len(PARAMETERS) / _ACROSS), _ACROSS)
    panels = np.array([grid[0::2].ravel(), grid[1::2].ravel()])
    for one in panels[:, len(PARAMETERS) :].flat:
        one.remove()
    traces = outcome.traces
    statics = outcome.metrics["sliding.predicted.force.axial"].value
    for k, parameter in enumerate(PARAMETERS):
        values = getattr(scenario, parameter)
        names = [one if isinstance(one, str) else f"{one:g}" for one in values]
        for i, (start, style) in enumerate(_STARTS):
            of = (traces["parameter"] == k) & (traces["start"] == i)
            x = np.arange(np.count_nonzero(of))
            label = f"{start} start"
            panels[0, k].plot(x, traces["force"][of], label=label, **style)
            raw = {**_RAW, "color": style["color"]}
            panels[0, k].plot(x, traces["raw_peak"][of], label=f"{label}, raw peak", **raw)
            panels[1, k].plot(x, traces["depth"][of] * _MM, label=label, **style)
        if statics is not None:
            panels[0, k].axhline(statics, label="exact statics, sliding start", **PUBLISHED)
        for axes, y in zip(panels[:, k], ("axial force / N", "depth / mm"), strict=True):
            dress(axes, title="", x=_TITLES[parameter], y="" if k % _ACROSS else y)
            turned = {"rotation": 30, "ha": "right"} if len("".join(names)) > _LETTERS else {}
            axes.set_xticks(range(len(names)), names, fontsize=8, **turned)
        panels[0, k].set_yscale("log")
        for axes, first in zip(panels[:, k], panels[:, 0], strict=True):
            if k:
                axes.sharey(first)
    legend_below(figure, panels[0, 0])
    impacts = draw_impacts(outcome.tables["impact"])
    return {"contact-convergence": figure, "impact": impacts}
