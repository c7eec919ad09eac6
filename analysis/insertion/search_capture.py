"""How often a spiral finds its hole: theory, exact geometry, and searches of the cell's arm."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from matplotlib.figure import Figure
from pydrake.systems.framework import Context

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import rate
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.drawing.figure_style import Style, dress, legend, new_figure
from chamfer.analysis.insertion.insertion_map import errors_in
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.diagrams.cell.work_cell import ARMS
from chamfer.diagrams.insertion.insertion import (
    InsertionScenario,
    ResolvedInsertionScenario,
    make_insertion_diagram,
    resolve,
)
from chamfer.models.peg_theory.search_capture import SpiralCoverage, draw_errors
from chamfer.models.validation import ParameterError, require_whole
from chamfer.systems.strategies.insertion_controller import TASK

_ENDED: Final = ("release", "back_off", "check", "seated")
_MOST: Final = 100_000
_CELL: Final = (
    "cell=ur5e-fixture",
    "search.kind=spiral",
    "search.radius=0.002",
    "gap=0.002",
    "begin=0.1",
    "decide.kind=at_once",
    "insert.attempts=1",
    "duration=15",
)


@dataclass(frozen=True, kw_only=True)
class SearchCaptureScenario:
    """A cell that searches by a spiral, and how far its hole is off."""

    cell: InsertionScenario = field(
        default_factory=lambda: make_scenario(InsertionScenario(), settings=_CELL)
    )
    errors: tuple[float, ...] = (0.0025, 0.0035, 0.0045)
    # m: radius of a disc over which the error is uniform
    trials: int = 5  # of each error, simulated
    draws: int = 2000  # likewise, by geometry

    def __post_init__(self) -> None:
        require_whole(self, "trials", "draws")
        if not 0 < max(self.trials, self.draws) <= _MOST:
            raise ParameterError("draws", self.draws, f"1 to {_MOST}")
        if not self.errors or not all(0 < one < math.inf for one in self.errors):
            raise ParameterError("errors", self.errors, "numbers > 0, at least one")
        if self.cell.search.kind != "spiral":
            raise ParameterError("cell.search.kind", self.cell.search.kind, "spiral")

    def coverage(self, cell: ResolvedInsertionScenario) -> SpiralCoverage:
        """Return the spiral of the cell."""
        pitch, radius = cell.search.pitch, cell.search.radius
        assert pitch is not None
        assert radius is not None
        return SpiralCoverage(pitch=pitch, radius=radius, capture=cell.parts.chamfer_limit)


SEARCH_CAPTURE: Final = SearchCaptureScenario()


def resolve_capture(scenario: SearchCaptureScenario) -> SearchCaptureScenario:
    """Return the scenario, whose cell is found to be one that can be run."""
    resolve(scenario.cell)
    return scenario


def search(scenario: InsertionScenario) -> Row:
    """Search once, until the peg is in its hole, or has not found it."""
    cell = resolve(scenario)
    diagram = make_insertion_diagram(cell)
    task, depth = diagram.GetSubsystemByName(TASK), diagram.GetOutputPort("contact.depth")
    deep = cell.search.drop or 0.0

    def ended(root: Context) -> bool:
        state = task.snapshot(task.GetMyContextFromRoot(root)).state
        inside = depth.Eval(diagram.GetMyContextFromRoot(root))[0] >= deep
        return bool(inside or state in _ENDED or state == "gave_up")

    run = simulate(diagram, duration=cell.duration, step=cell.step, ended=ended)
    # Beside the part it is as deep, and nothing is found.
    planes = errors_in(*(run.outputs[f"{arm}.true_pose"][-1] for arm in ARMS)).values()
    off = math.hypot(*(plane.lateral for plane in planes))
    found = run.outputs["contact.depth"][-1] >= deep and off < cell.parts.hole_radius
    return {"found": float(found), "simulated_seconds": float(run.time[-1])}


def run(scenario: SearchCaptureScenario, seed: int, progress: Progress) -> Outcome:
    """Search for holes that are off by drawn errors."""
    starts, spiral = [], scenario.coverage(resolve(scenario.cell))
    for k, size in enumerate(scenario.errors):
        drawn = draw_errors(size, scenario.trials, np.random.default_rng([seed, k]))
        starts += [replace(scenario.cell, initial_error=(0, y, z, 0, 0, 0)) for y, z in drawn]
    searches = run_each(search, starts, progress)
    metrics: dict[str, Metric] = {}
    rows = []
    for k, size in enumerate(scenario.errors):
        mine = slice(k * scenario.trials, (k + 1) * scenario.trials)
        found = int(searches.column("found")[mine].sum())
        name, theory = f"error_{1e3 * size:g}mm", 100 * spiral.probability(size)
        generator = np.random.default_rng([seed, k, 1])
        holes = draw_errors(size, scenario.draws, generator)
        geometry = 100 * float(spiral.finds(holes, generator).mean())
        note = f"{found} of {scenario.trials} searches"
        simulated = rate(f"{name}.found", found, scenario.trials, note)
        metrics |= simulated | {
            f"{name}.predicted": Metric(value=theory, unit="%", note="by theory"),
            f"{name}.geometry": Metric(value=geometry, unit="%", note="by the spiral's track"),
        }
        rows.append((size, theory, geometry, *(one.value for one in simulated.values())))
    names = ("error", "predicted", "geometry", "found", "low", "high")
    return Outcome(
        metrics=metrics,
        traces=dict(zip(names, map(column, zip(*rows, strict=True)), strict=True)),
        simulated_seconds=float(searches.column("simulated_seconds").sum()),
    )


_MM: Final = 1e3


def figures(scenario: SearchCaptureScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw how often holes are found, over the error."""
    spiral, found = scenario.coverage(resolve(scenario.cell)), outcome.traces["found"]
    rates = dict.fromkeys(f"{one:.0f}" for one in (found.min(), found.max()))
    says = f"A spiral of {_MM * spiral.radius:.3g} mm finds {' to '.join(rates)} % of the holes"
    figure = new_figure(
        6.5,
        5.2,
        caption=f"{says}, over the largest hole error: by theory, by the geometry of the track "
        f"and in {scenario.trials} simulated searches at each error.",
    )
    axes = figure.subplots()
    traces, sizes = (
        outcome.traces,
        np.linspace(0.8 * min(scenario.errors), 1.1 * max(scenario.errors), 61),
    )
    said = [100 * spiral.probability(one) for one in sizes]
    axes.plot(_MM * sizes, said, color="#1b4f9c", label="theory, of many turns")
    blank: Style = {
        "linestyle": "none",
        "marker": "s",
        "markerfacecolor": "none",
        "color": "#1b4f9c",
    }
    axes.plot(_MM * traces["error"], traces["geometry"], label="geometry of the track", **blank)
    ends = [traces["found"] - traces["low"], traces["high"] - traces["found"]]
    points: Style = {"fmt": "o", "color": "#b00020", "capsize": 4}
    label = f"simulated, {scenario.trials} each, 95 % interval"
    axes.errorbar(_MM * traces["error"], traces["found"], yerr=ends, label=label, **points)
    x = "largest hole error (uniform over a disc) / mm"
    dress(axes, title=says, x=x, y="found / %")
    axes.set_ylim(0.0, 105.0)
    axes.set_yticks(np.linspace(0.0, 100.0, 6))
    legend(axes, ncols=2)
    return {"search-capture": figure}
