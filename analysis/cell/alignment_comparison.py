"""The state machine against a PID law in the same cell, from the same starts."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from itertools import product
from typing import Final, NamedTuple

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray
from pydrake.systems.framework import Diagram

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import mean_interval, metrics_of, prefixed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.cell.alignment_runs import (
    ALIGNMENT,
    COURSE,
    STOPPED,
    AlignmentTrialsScenario,
    ResolvedAlignmentTrialsScenario,
    align,
    courses,
    detected_metric,
    resolve_trials,
    settled_trials,
    settling_metrics,
    statistics,
    stopped_metrics,
)
from chamfer.analysis.drawing.figure_style import LOOPS, PUBLISHED, dress, legend, new_figure
from chamfer.analysis.published.fsm_work_cell import MEAN_ERROR
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.cell.alignment import make_alignment_diagram
from chamfer.diagrams.cell.alignment_scenario import (
    ControllerChoice,
    ControllerKind,
    Kind,
    OpenAxis,
    OpenGains,
    SixAxisPid,
    SixAxisSettings,
)
from chamfer.diagrams.cell.controller_design import arm_responses, design_compensator, design_pid
from chamfer.models.validation import ParameterError

CONTROLLERS: Final[tuple[ControllerKind, ...]] = ("fsm", "pid")
_ERRORS: Final = ("lateral_error", "rotational_error")
_MEASURED: Final = (*_ERRORS, "lateral_overshoot", "rotational_overshoot")
_TUNING_TRIALS: Final = 1_000_000  # from here on: none of the comparison is among them


@dataclass(frozen=True, kw_only=True)
class AlignmentComparisonScenario(AlignmentTrialsScenario):
    """Both controllers from the same starts, with the same model errors.

    How both are tuned: each has one number for the lateral and one for the rotational axes from
    which the rest follows, by the settling theorem from the small increment and by SIMC from the
    time constant. With ``tuning_trials`` > 0 every candidate runs from that many starts, none of
    which the comparison uses, and the one with the least mean of ``lateral_error`` +
    ``rotational_error``, relative to the published means, is taken. What the
    cell's controllers are designed for was found so, with 8 trials, and rounded.
    """

    trials: int = 10
    tuning_trials: int = 0  # trials of every candidate; 0: the scenario's own parameters
    small_lateral: tuple[float, ...] = (2e-5, 3e-5)  # m, candidates for the state machine
    small_rotational: tuple[float, ...] = (4e-4, 6e-4, 8e-4, 1e-3)
    # rad, candidates for the state machine
    closed_loop: tuple[float, ...] = (0.05, 0.1, 0.15, 0.2, 0.3)  # s, candidates for the PID

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.tuning_trials <= 1000:
            raise ParameterError("tuning_trials", self.tuning_trials, "0 to 1000")
        for name in ("small_lateral", "small_rotational", "closed_loop"):
            candidates = getattr(self, name)
            if not candidates or not all(0 < one < np.inf for one in candidates):
                raise ParameterError(name, candidates, "one or more finite numbers > 0")


@dataclass(frozen=True, kw_only=True)
class ResolvedAlignmentComparisonScenario(
    ResolvedAlignmentTrialsScenario, AlignmentComparisonScenario
):
    """The scenario with no field left open."""


COMPARISON: Final = AlignmentComparisonScenario()
_Resolved = ResolvedAlignmentComparisonScenario


def resolve(scenario: AlignmentComparisonScenario) -> _Resolved:
    """Refuse fields that the comparison sets itself, and scenarios without a comparison."""
    if scenario.controller != ControllerChoice():
        raise ParameterError("controller.kind", scenario.controller.kind, "fsm; both are run")
    if scenario.compensated == "none":
        raise ParameterError("compensated", "none", "peg, hole, both")
    return resolve_trials(_Resolved, scenario)


def _candidates(scenario: _Resolved) -> dict[ControllerKind, list[_Resolved]]:
    responses, untuned = arm_responses(scenario), _without_numbers(scenario)
    of = _with_both(scenario)
    fsm = scenario.compensator
    increments: list[dict[Kind, float]] = [
        {"lateral": fsm.lateral.divider * one, "rotational": fsm.rotational.divider * other}
        for one, other in product(scenario.small_lateral, scenario.small_rotational)
    ]
    elements = [design_compensator(untuned, responses, one) for one in increments]
    laws = [design_pid(untuned, responses, time) for time in scenario.closed_loop]
    return {
        "fsm": [replace(of["fsm"], compensator=one) for one in elements],
        "pid": [replace(of["pid"], pid=one) for one in laws],
    }


def _with_both(scenario: _Resolved) -> dict[ControllerKind, _Resolved]:
    return {
        kind: replace(scenario, controller=ControllerChoice(kind=kind)) for kind in CONTROLLERS
    }


def make_loops(scenario: _Resolved) -> list[Diagram]:
    """Return the loops of both controllers."""
    return [make_alignment_diagram(one) for one in _with_both(scenario).values()]


def _without_numbers(scenario: _Resolved) -> _Resolved:
    """Return the scenario with what tuning is to find open again."""
    fsm, pid = vars(scenario.compensator).items(), vars(scenario.pid).items()
    elements = {kind: OpenAxis(divider=of.divider, limit=of.limit) for kind, of in fsm}
    laws = {kind: OpenGains(derivative=of.derivative, limit=of.limit) for kind, of in pid}
    return replace(scenario, compensator=SixAxisSettings(**elements), pid=SixAxisPid(**laws))


class ControllerTrial(NamedTuple):
    """A trial with a controller."""

    scenario: _Resolved
    trial: int


def _align(seed: int, task: ControllerTrial) -> Row:
    return align(task.scenario, seed, task.trial)


def _is_of(scenario: _Resolved, task: ControllerTrial) -> bool:
    return task.scenario == scenario


def score(finished: Trials[ControllerTrial]) -> float:
    """Return the mean error of trials, both kinds relative to the published means, summed."""
    if not len(finished):
        return math.inf
    lateral, rotational = map(finished.column, _ERRORS)
    return float(np.mean(lateral / MEAN_ERROR[0] + rotational / MEAN_ERROR[1]))


def run(scenario: _Resolved, seed: int, progress: Progress) -> Outcome:
    """Tune both if the scenario wants it, and compare them."""
    tables: dict[str, dict[str, NDArray[np.float64]]] = {}
    chosen = _with_both(scenario)
    simulated = 0
    if scenario.tuning_trials:
        tuned, tables["tuning"] = _tune(scenario, seed, progress)
        chosen |= tuned
        simulated += len(tables["tuning"]["score"]) * scenario.tuning_trials
    tasks = [
        ControllerTrial(chosen[name], k) for name in CONTROLLERS for k in range(scenario.trials)
    ]
    finished = run_each(partial(_align, seed), tasks, progress)
    simulated += len(finished)
    found = finished.split(CONTROLLERS, lambda task: task.scenario.controller.kind)
    metrics: dict[str, Metric] = {}
    for name, of in found.items():
        for measured in _MEASURED:
            metrics |= prefixed(name, statistics(of, measured, ALIGNMENT[measured].unit))
        count = int(np.isfinite(of.column("settling_time")).sum())
        note = f"mean of the {count} of {len(of)} trials that settle in time"
        metrics |= prefixed(name, settled_trials(of, note))
        metrics[f"{name}.detected"] = detected_metric(of.column("detected"))
        stopped = {one: of.column(one) for one in STOPPED}
        metrics |= prefixed(name, {**stopped_metrics(stopped), **settling_metrics(chosen[name])})
        metrics |= prefixed(name, _parameters(chosen[name]))
    for measured in _ERRORS:
        metrics |= _difference(found, measured, ALIGNMENT[measured].unit)
    kinds = [float(CONTROLLERS.index(task.scenario.controller.kind)) for task in finished.tasks]
    numbers = [float(one) for one in _numbers(finished)]
    tables["errors"] = courses(finished.rows, COURSE, controller=kinds, trial=numbers)
    traces = {"trial": column(np.arange(scenario.trials))}
    for name, of in found.items():
        for measured in (*_MEASURED, "settling_time"):
            values = np.full(scenario.trials, np.nan)
            values[_numbers(of)] = of.column(measured)
            traces[f"{name}.{measured}"] = values
    return Outcome(
        metrics=metrics,
        traces=traces,
        simulated_seconds=simulated * scenario.duration,
        tables=tables,
    )


def _numbers(finished: Trials[ControllerTrial]) -> list[int]:
    return [task.trial for task in finished.tasks]


def _tune(
    scenario: _Resolved, seed: int, progress: Progress
) -> tuple[dict[ControllerKind, _Resolved], dict[str, NDArray[np.float64]]]:
    """Return the best candidate of each controller, and every candidate's score."""
    candidates, trials = _candidates(scenario), scenario.tuning_trials
    listed = [one for name in CONTROLLERS for one in candidates[name]]
    tasks = [ControllerTrial(one, _TUNING_TRIALS + k) for one in listed for k in range(trials)]
    finished = run_each(partial(_align, seed), tasks, progress)
    scores = [score(finished.select(partial(_is_of, one))) for one in listed]
    best = {
        name: min(candidates[name], key=lambda one: scores[listed.index(one)])
        for name in CONTROLLERS
    }
    # What tells candidates apart: small increments, or integral gains.
    knobs = [
        [axis.small_increment for axis in one.compensator.axes]
        if one.controller.kind == "fsm"
        else [law.integral for law in one.pid.axes]
        for one in listed
    ]
    table = {
        "controller": column([float(CONTROLLERS.index(one.controller.kind)) for one in listed]),
        "lateral": column([axes[0] for axes in knobs]),
        "rotational": column([axes[3] for axes in knobs]),
        "score": column(scores),
    }
    return best, table


def _parameters(scenario: _Resolved) -> dict[str, Metric]:
    fsm, pid = scenario.compensator, scenario.pid
    if scenario.controller.kind == "pid":
        return metrics_of(
            {
                "lateral.proportional": (pid.lateral.proportional, "m/pixel"),
                "lateral.integral": (pid.lateral.integral, "m/(pixel s)"),
                "rotational.proportional": (pid.rotational.proportional, ""),
                "rotational.integral": (pid.rotational.integral, "1/s"),
            }
        )
    return metrics_of(
        {
            "lateral.small_increment": (fsm.lateral.closed.small_increment, "m"),
            "lateral.dead_zone": (fsm.lateral.dead_zone, "pixels"),
            "rotational.small_increment": (fsm.rotational.closed.small_increment, "rad"),
            "rotational.dead_zone": (fsm.rotational.dead_zone, "rad"),
        }
    )


def _difference(
    found: Mapping[ControllerKind, Trials[ControllerTrial]], name: str, unit: str
) -> dict[str, Metric]:
    """Return the mean of the trials' differences, FSM minus PID, with its 95 % interval."""
    both = set(_numbers(found["fsm"])) & set(_numbers(found["pid"]))
    fsm, pid = (of.select(lambda task: task.trial in both).column(name) for of in found.values())
    difference = fsm - pid
    n = len(difference)
    mean, half = mean_interval(difference)
    note = "FSM minus PID, same starts; by Student's t" if n > 1 else "one trial has no interval"
    ends = {"mean": mean, "mean_low": mean - half, "mean_high": mean + half}
    return metrics_of({f"difference.{name}.{of}": (end, unit, note) for of, end in ends.items()})


_KINDS: Final = (("lateral", "mm", MEAN_ERROR[0]), ("rotational", "mrad", MEAN_ERROR[1]))


def figures(scenario: _Resolved, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw every trial and the median over time, and the errors at the end, trial by trial."""
    figure = new_figure(
        height=7.6,
        caption=f"Errors of {scenario.trials} trials with the FSM and with the PID from the same "
        f"starts: over time (thick: median), and {scenario.compensation_time:g} s after "
        "compensation begins (grey lines join equal starts).",
    )
    panels = figure.subplots(2, 2, width_ratios=(1.5, 1.0))
    for row, (name, unit, published) in enumerate(_KINDS):
        over_time, ends = panels[row]
        _over_time(over_time, scenario, outcome, name)
        over_time.axhline(1e3 * published, label="published mean, FSM", **PUBLISHED)
        over_time.set_ylim(1e3 * published / 1000, None)
        medians = (
            f"{LOOPS[one][0]} {1e3 * np.median(outcome.traces[f'{one}.{name}_error']):.2g} {unit}"
            for one in CONTROLLERS
        )
        title = f"({'ac'[row]}) Median {name} error at the end: {', '.join(medians)}"
        since = "time since compensation begins / s"
        dress(over_time, title=title, x=since, y=f"error / {unit}")
        legend(over_time, ncols=3)
        _ends(ends, outcome, name)
        ends.axhline(1e3 * published, label="published mean, FSM", **PUBLISHED)
        title = f"({'bd'[row]}) Errors after {scenario.compensation_time:g} s"
        dress(ends, title=title, x="", y=f"error / {unit}")
    return {"alignment-fsm-vs-pid": figure}


def _over_time(axes: Axes, scenario: _Resolved, outcome: Outcome, name: str) -> None:
    table = outcome.tables["errors"]
    for i, controller in enumerate(CONTROLLERS):
        label, style = LOOPS[controller]
        of = table["controller"] == i
        shape = (len(np.unique(table["trial"][of])), -1)
        time = table["time"][of].reshape(shape)[0] - scenario.begin
        errors = 1e3 * np.maximum(table[f"{name}_error"][of], 1e-7).reshape(shape)
        axes.semilogy(time, errors.T, color=style["color"], linewidth=0.5, alpha=0.45)
        axes.semilogy(time, np.median(errors, axis=0), label=label, **style | {"linewidth": 2.4})
    axes.set_xlim(-0.25, scenario.compensation_time)


def _ends(axes: Axes, outcome: Outcome, name: str) -> None:
    pairs = 1e3 * np.array(
        [outcome.traces[f"{controller}.{name}_error"] for controller in CONTROLLERS]
    )
    axes.semilogy(range(len(CONTROLLERS)), pairs, color="#999999", linewidth=0.7)
    for i, controller in enumerate(CONTROLLERS):
        color = LOOPS[controller][1]["color"]
        axes.semilogy(np.full(pairs.shape[1], i), pairs[i], "o", color=color, markersize=4)
    axes.set_xticks(range(len(CONTROLLERS)), [LOOPS[one][0] for one in CONTROLLERS])
    axes.set_xlim(-0.5, len(CONTROLLERS) - 0.5)
