"""Many insertions by vision: how often the peg is seated, force, time; and other methods."""

from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import ClassVar, Final, Literal, get_args

import numpy as np
from matplotlib.figure import Figure
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import (
    mean_interval,
    metrics_of,
    over_trials,
    prefixed,
    rate,
    trial_seed,
)
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.cell.alignment_runs import (
    AlignmentTrialsScenario,
    courses,
    drawn,
    mean_over,
    require_starts,
    row_before,
)
from chamfer.analysis.drawing.figure_kit import (
    Curve,
    ReferenceLine,
    draw_cumulative,
    draw_lines,
    trial_curves,
)
from chamfer.analysis.drawing.figure_style import LIMIT, REGION, Style, dress, legend, new_figure
from chamfer.analysis.insertion.cell_runs import (
    INSERTION,
    CellInsertion,
    ending,
    insertion_metrics,
    run_cell_insertion,
)
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.insertion.cells import CELLS, Cells
from chamfer.diagrams.insertion.insertion import (
    InsertionScenario,
    ResolvedInsertionScenario,
    resolve_as,
    task_params,
)
from chamfer.models.peg.peg_and_hole import SEATED
from chamfer.models.validation import ParameterError

Way = Literal["wait", "frozen", "frozen_wait", "settling"]
TrialInAWay = tuple[int, str]  # of a trial, and of a way or none

AS_IT_IS: Final = ""  # the way of the scenario itself
_SETTLES: Final = 1.5  # s, after which what is frozen rests
_DRAWN: Final = 100.0  # 1/s, rows of a course that is kept


@dataclass(frozen=True, kw_only=True)
class InsertionTrialsScenario(InsertionScenario, AlignmentTrialsScenario):
    """Insertions with many starts and model errors, and variants with the same starts.

    Ways: ``wait`` decides after the compensation's time, as section 5 does; ``frozen`` stops the
    compensation when it decides, the paper's proposal, ``frozen_wait`` does both; ``settling``
    does both too but does not advance, to see what becomes of errors.
    """

    initial_error: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # the middle of the starts
    trials: int = 10  # as in section 5; use 200 for success rates
    beside: tuple[Way, ...] = ("wait", "frozen", "settling")
    # further variants with the same starts

    WHOLE: ClassVar[Mapping[str, Cells]] = {"cell": CELLS}

    def __post_init__(self) -> None:
        super().__post_init__()
        known = get_args(Way)
        if len(set(self.beside)) < len(self.beside) or not set(self.beside) <= set(known):
            raise ParameterError("beside", self.beside, f"some of {', '.join(known)}, or none")


@dataclass(frozen=True, kw_only=True)
class ResolvedInsertionTrialsScenario(ResolvedInsertionScenario, InsertionTrialsScenario):
    """The scenario with no field left open."""


INSERTION_REPEATABILITY: Final = InsertionTrialsScenario()


def resolve_insertion_trials(scenario: InsertionTrialsScenario) -> ResolvedInsertionTrialsScenario:
    """Resolve the insertions, once it is sure that every trial has something to see."""
    resolved = resolve_as(ResolvedInsertionTrialsScenario, scenario)
    require_starts(resolved, resolved.spread)
    return resolved


def in_a_way(
    scenario: ResolvedInsertionTrialsScenario, way: str
) -> ResolvedInsertionTrialsScenario:
    """Return the scenario with the changes of a variant."""
    decide, insert = scenario.decide, scenario.insert
    if way in ("wait", "frozen_wait", "settling"):
        decide = replace(decide, kind="wait")
    if way in ("frozen", "frozen_wait", "settling"):
        insert = replace(insert, compensation="frozen", freeze_depth=None)
    if way == "settling":
        insert = replace(insert, pause=_SETTLES)
    return replace(scenario, decide=decide, insert=insert)


def insert_one(scenario: ResolvedInsertionTrialsScenario, seed: int, task: TrialInAWay) -> Row:
    """Run one of a seed's trials in one way; it depends on its arguments alone.

    The row has what ``INSERTION`` names, how it ended, and its course; of settling the errors as
    it froze and at last.
    """
    trial, way = task
    one = in_a_way(drawn(scenario, scenario.spread, seed, trial), way)
    settles = way == "settling"
    done = run_cell_insertion(one, trial_seed(seed, trial), until_advance=settles)
    row: Row = {
        **insertion_metrics(done, one),
        "ending": ending(done, one),
        "state": done.state,
        "cpu_speed": float(done.traces["time"][-1]) / done.cpu_seconds,
    }
    if settles:
        return {**row, **_settled(done)}
    every = max(1, round(1 / (_DRAWN * one.step)))
    return {
        **row,
        "times": done.traces["time"][::every],
        "depths": done.traces["depth"][::every],
        "lateral_errors": done.traces["lateral_error"][::every],
        "rotational_errors": done.traces["rotational_error"][::every],
    }


def _settled(done: CellInsertion) -> Row:
    """Return the errors where the compensation froze, and at the end."""
    traces, frozen = done.traces, done.began()
    values: dict[str, float | None] = {}
    for name in ("lateral_error", "rotational_error"):
        error = traces[name]
        values |= {f"frozen.{name}": None, f"settled.{name}": None}
        if frozen is not None:
            values[f"frozen.{name}"] = float(error[row_before(traces["time"], frozen)])
            values[f"settled.{name}"] = float(error[-1])
    return values


_HARD: Final = 5.0  # N, a contact force to stay below
_QUANTILE: Final = 95  # %
_SETTLING: Final = "settling"


def run(scenario: ResolvedInsertionTrialsScenario, seed: int, progress: Progress) -> Outcome:
    """Insert the peg many times, in every way."""
    ways = (AS_IT_IS, *scenario.beside)
    tasks = [(trial, way) for trial in range(scenario.trials) for way in ways]
    finished = run_each(partial(insert_one, scenario, seed), tasks, progress)
    found: dict[str, Trials[TrialInAWay]] = finished.split(ways, lambda task: task[1])
    metrics: dict[str, Metric] = {}
    for way, trials in found.items():
        if way == _SETTLING:
            metrics |= _settled_statistics(trials)
        else:
            of = _statistics(trials)
            metrics |= of if way == AS_IT_IS else prefixed(way, of)
    if "wait" in found:
        metrics |= _saved(found[AS_IT_IS], found["wait"])
    drawn = {way: trials for way, trials in found.items() if way != _SETTLING}
    rows = [
        (float(way), float(trial), row)
        for way, trials in enumerate(drawn.values())
        for (trial, _), row in zip(trials.tasks, trials.rows, strict=True)
    ]
    return Outcome(
        metrics=metrics,
        traces={
            "trial": column([trial for _, trial, _ in rows]),
            "way": column([way for way, _, _ in rows]),
            **{
                name: column([np.nan if row[name] is None else row[name] for *_, row in rows])
                for name in INSERTION
            },
        },
        simulated_seconds=sum(float(row["times"][-1]) for *_, row in rows),
        tables={
            "courses": courses(
                [row for *_, row in rows],
                ("times", "depths", "lateral_errors", "rotational_errors"),
                way=[way for way, *_ in rows],
                trial=[trial for _, trial, _ in rows],
            )
        },
    )


def _statistics(trials: Trials[TrialInAWay]) -> dict[str, Metric]:
    n = len(trials)
    seated = trials.column("seated")
    first, said = trials.column("seated.first"), trials.column("said_seated")
    ends = Counter(row["ending"] for row in trials.rows if not row["seated"])
    why = "".join(f"; {count}: {ending}" for ending, count in ends.most_common(3))
    wrong = float(np.sum((said > 0) & (seated == 0)))
    force = trials.column("force.contact")
    soft = int(np.sum(force < _HARD))
    metrics = {
        **rate("success_rate", int(seated.sum()), n, f"seated, of {n} trials{why}"),
        **rate("first_attempt", int(first.sum()), n, "seated with the first attempt"),
        **metrics_of({"said_wrongly": (wrong, "", f"of {n} trials: a false done")}),
        **rate("force.soft", soft, n, f"contact force below {_HARD:g} N, medians of 10 ms"),
    }
    for name in ("force.axial", "force.lateral", "force.contact", "force.raw_peak", "force.peak"):
        values = trials.column(name)
        high = np.percentile(values, _QUANTILE)
        found = {"median": np.median(values), f"p{_QUANTILE}": high, "max": values.max()}
        rows = {of: (float(one), "N", "of the trials") for of, one in found.items()}
        metrics |= prefixed(name, metrics_of(rows))
    for name in (
        *("depth", "time_to_seated", "cycle_time", "decision.time"),
        *("touch.lateral_error", "touch.rotational_error", "attempts"),
    ):
        unit = INSERTION[name].unit
        metrics[f"{name}.mean"] = mean_over(trials, name, unit, "in no trial")
    limits = ["force.share", "saturated", "joints.margin"]
    if any(row["compliance.deflection"] is not None for row in trials.rows):
        limits.append("compliance.deflection")
    return metrics | over_trials(trials.rows, {name: INSERTION[name] for name in limits})


def _saved(early: Trials[TrialInAWay], late: Trials[TrialInAWay]) -> dict[str, Metric]:
    """Return what deciding early saves, over pairs of one start that were both seated."""
    waited = {
        task[0]: row["time_to_seated"] for task, row in zip(late.tasks, late.rows, strict=True)
    }
    pairs = [
        waited[task[0]] - row["time_to_seated"]
        for task, row in zip(early.tasks, early.rows, strict=True)
        if row["time_to_seated"] is not None and waited.get(task[0]) is not None
    ]
    if not pairs:
        return {"saved.time.mean": Metric(value=None, unit="s", note="no pair is seated")}
    values = np.array(pairs)
    mean, half = mean_interval(values)
    note = f"{len(pairs)} pairs of one start, {values.min():.3g} to {values.max():.3g} s"
    interval = "95 % interval of the mean by Student's t"
    low, high = (mean - half, mean + half) if np.isfinite(half) else (None, None)
    saved = {"mean": (mean, "s", note), "mean_low": (low, "s", interval)}
    return prefixed("saved.time", metrics_of(saved | {"mean_high": (high, "s", interval)}))


def _settled_statistics(trials: Trials[TrialInAWay]) -> dict[str, Metric]:
    """Return the errors as the compensation froze after its time, and when they rest."""
    metrics: dict[str, tuple[float | None, str, str]] = {}
    for name, unit in (("lateral_error", "m"), ("rotational_error", "rad")):
        for when, note in (
            ("frozen", "as the compensation froze, after its time"),
            ("settled", "1.5 s later, the command unchanged"),
        ):
            values = trials.column(f"{when}.{name}")
            values = values[np.isfinite(values)]
            for kind, value in (("mean", np.mean), ("max", np.max)):
                found = float(value(values)) if len(values) else None
                metrics[f"settling.{when}.{name}.{kind}"] = (found, unit, note)
    return metrics_of(metrics)


Array = NDArray[np.float64]

_COLOURS: Final = {AS_IT_IS: "#e07b00", "wait": "#1b4f9c", "frozen": "#b00020"}
_OTHER: Final = "#777777"
_MARKERS: Final = {AS_IT_IS: "o", "wait": "s", "frozen": "D"}
_MM: Final = 1e3


def figures(scenario: ResolvedInsertionTrialsScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw every trial in every way."""
    figure = new_figure(
        height=9.0,
        caption="Insertion trials with each variant of the skill: depth over time, how soon they "
        "seat, the contact force, and the errors at touch beside the wedge-free region.",
    )
    courses, times, forces, touches = figure.subplots(2, 2).ravel()
    ways = [way for way in (AS_IT_IS, *scenario.beside) if way != "settling"]
    table, traces = outcome.tables["courses"], outcome.traces
    params = task_params(scenario)
    depths: list[Curve] = []
    for k, way in enumerate(ways):
        colour, named = _COLOURS.get(way, _OTHER), _name(scenario, way)
        of = table["way"] == k
        course = table["time"][of] - scenario.begin, _MM * table["depth"][of], table["trial"][of]
        thin: Style = {"color": colour, "linewidth": 0.8, "alpha": 0.7}
        depths += trial_curves(*course, thin, named)
        rows = traces["way"] == k
        line: Style = {"color": colour, "linewidth": 1.6}
        draw_cumulative(times, traces["time_to_seated"][rows], line, named)
        draw_cumulative(forces, traces["force.contact"][rows], line, named)
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
    since, title = "time since the first frame / s", "(a) Depth of the tip"
    counts = [ReferenceLine(_MM * SEATED * params.target, "seated from here", LIMIT)]
    draw_lines(courses, (), depths, title=title, y="depth / mm", over=since, levels=counts)
    forces.axvline(_HARD, label=f"{_HARD:g} N", **LIMIT)
    for axes, title, x in (
        (times, "(b) Share of trials seated", since),
        (forces, "(c) Share of trials below a force", "largest contact force, 10 ms / N"),
    ):
        dress(axes, title=title, x=x, y="share of the trials / %")
        axes.set_ylim(0.0, 103.0)
    region = params.region
    lateral = np.linspace(0.0, region.lateral_limit, 100)
    tilt = np.array([region.tilt_at(one) for one in lateral])
    touches.fill_between(_MM * lateral, 0.0, _MM * tilt, label="free of wedging", **REGION)
    title, y = "(d) Errors at touch, last attempt", "rotational error / mrad"
    dress(touches, title=title, x="lateral error / mm", y=y)
    touches.set_xlim(0.0, None)
    touches.set_ylim(0.0, None)
    for axes in (courses, times, forces, touches):
        legend(axes)
    return {"insertion-repeatability": figure}


def _name(scenario: ResolvedInsertionTrialsScenario, way: str) -> str:
    if way != AS_IT_IS:
        return way.replace("_", ", ")
    return f"{scenario.decide.kind.replace('_', ' ')}, {scenario.insert.compensation}"
