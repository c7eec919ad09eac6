"""Runs an experiment at many points of its scenario."""

import math
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any, Final, Literal, get_args

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import Task, Trials, parallel, run_here, running, try_each
from chamfer.analysis.campaign.trial_loop import Failure
from chamfer.analysis.campaign.trial_metrics import mean_interval
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.command.running import Job, prepare
from chamfer.analysis.report.check_text import LIMIT
from chamfer.analysis.report.checks import Published, check
from chamfer.analysis.report.results import defined_metrics
from chamfer.analysis.scenario.errors import ExperimentError, UserError, valid_name
from chamfer.analysis.scenario.experiment import (
    Catalogue,
    Entry,
    Outcome,
    Progress,
    load,
    quiet,
    select,
)
from chamfer.analysis.scenario.scenario_io import make_scenario
from chamfer.analysis.scenario.scenario_yaml import one_line
from chamfer.analysis.sweep.sweep_design import (
    Design,
    Spec,
    VariedField,
    design_points,
    varied_fields,
)

OK: Final = "ok"
INTERVAL: Final = ".ci95"  # ending of the column with half of a mean's 95 % interval
MOST_TRIALS: Final = 10_000
_LARGEST: Final = 2**63  # from here on integers are texts
_PROBES: Final = 8  # points that may run to learn what an experiment measures
_METRIC, _UNIT = "metric.", "unit."  # in front of names in a trial's row

Kind = Literal["ok", "refused", "failed"]
KINDS: Final[tuple[Kind, ...]] = get_args(Kind)


@dataclass(frozen=True, kw_only=True)
class SweepPlan:
    """Holds the fields, points and seeds of a sweep."""

    job: Job  # the experiment, with the scenario that fields are varied of
    varied: tuple[VariedField, ...]
    design: Design
    points: tuple[tuple[Any, ...], ...]  # the fields' values
    trials: int  # seeds of each point
    seed: int  # the first one
    metrics: tuple[str, ...] | None  # None: all


@dataclass(frozen=True, kw_only=True)
class PointTrial:
    """A point and a seed."""

    entry: Entry
    settings: tuple[str, ...]  # path=value, on top of the default scenario
    seed: int


class SweepTable(dict[str, NDArray[Any]]):
    """Columns by name, a row per point: the fields, the metrics, ``status`` and ``seed``.

    It is a dict, so that ``pandas.DataFrame(table)`` takes it. A metric is its mean over the
    point's trials, NaN where it is undefined in all of them; if there are several trials, the
    column with the ending ``.ci95`` is half of its 95 % interval by Student's t. ``broken`` is how
    many specifications are broken, in any of the trials, where the experiment has some. A status
    that is not ``ok`` says why the point, or how many of its trials, have no result.
    """

    def __init__(self, columns: Mapping[str, NDArray[Any]], units: Mapping[str, str]) -> None:
        super().__init__(columns)
        self.units = units  # of fields and metrics, "" for a pure number


@dataclass(frozen=True, kw_only=True)
class SweepResult:
    """Holds the measurements of a sweep."""

    plan: SweepPlan
    table: SweepTable  # a row per point
    trials: dict[str, NDArray[Any]]  # a row per point and seed
    metrics: dict[str, str]  # columns of metrics by the metrics' names
    counts: dict[Kind, int]  # of trials
    simulated_seconds: float
    reasons: dict[str, int]  # of points without a result
    broken: dict[str, int]  # specifications, and at how many points they are


def sweep(name: str, vary: Mapping[str, Spec], *, workers: int = 1, **options: Any) -> SweepTable:
    """Run an experiment at many points of its scenario and return a row for each.

    Args:
        name: Of the experiment.
        vary: The values of each field by its dotted path, or a
            :class:`~chamfer.analysis.sweep.sweep_design.Drawn` interval.
        workers: Processes; for more than one, a script's main module must allow to be imported.
        options: Those of :func:`make_plan`.

    Raises:
        UserError: If a name, field or metric doesn't exist, or an argument is not allowed.
    """
    plan = make_plan(name, vary, **options)
    with parallel(workers):
        return run_sweep(plan, quiet).table


def make_plan(
    name: str,
    vary: Mapping[str, Spec],
    *,
    metrics: Sequence[str] | None = None,
    trials: int = 1,
    seed: int = 0,
    design: Design | None = None,
    points: int | None = None,
    settings: Sequence[str] = (),
    scenario: Path | None = None,
    catalogue: Catalogue = CATALOGUE,
) -> SweepPlan:
    """Return what a sweep is to run.

    Args:
        name: Of the experiment.
        vary: As in :func:`sweep`.
        metrics: What to keep, all metrics unless given.
        trials: Seeds of each point: ``seed``, ``seed + 1``, ...
        seed: Of all randomness, draws of points as well.
        design: See :func:`~chamfer.analysis.sweep.sweep_design.design_points`.
        points: How many to draw.
        settings: Fields, ``path=value``, that are not as by default at all points.
        scenario: A file with such fields.
        catalogue: Where the experiments are.

    Raises:
        UserError: If the experiment or a field doesn't exist, or an argument is not allowed.
    """
    chosen = select(catalogue.entries, [name])
    (job,) = prepare(chosen, file=scenario, settings=settings, catalogue=catalogue)
    varied = varied_fields(job.experiment.default, vary)
    for setting in settings:
        path = setting.partition("=")[0].strip()
        for one in varied:
            if _within(path, one.path) or _within(one.path, path):
                raise UserError(f"{path} is set and {one.path} is varied")
    if not 1 <= trials <= MOST_TRIALS:
        raise UserError(f"trials is {trials}, allowed: an integer from 1 to {MOST_TRIALS}")
    used, found = design_points(varied, design=design, points=points, seed=seed)
    return SweepPlan(
        job=job,
        varied=varied,
        design=used,
        points=tuple(found),
        trials=trials,
        seed=seed,
        metrics=None if metrics is None else tuple(dict.fromkeys(metrics)),
    )


def _within(path: str, above: str) -> bool:
    return f"{path}.".startswith(f"{above}.")


def run_sweep(plan: SweepPlan, progress: Progress) -> SweepResult:
    """Run all points.

    Points that are refused or fail are rows with the reason, and the others go on.

    Raises:
        UserError: If a metric is asked for that the experiment doesn't measure.
    """
    experiment = plan.job.experiment
    run = partial(run_point, experiment.run_swept or experiment.run, plan.job.published)
    if plan.metrics is not None:
        _require_measured(plan, run)
    tasks = [
        PointTrial(entry=plan.job.entry, settings=_settings(plan, point), seed=plan.seed + i)
        for point in plan.points
        for i in range(plan.trials)
    ]
    found = try_each(run, tasks, progress)
    rows: dict[PointTrial, Row] = dict(zip(found.tasks, found.rows, strict=True))
    for task, failure in found.failed:
        kind: Kind = "refused" if failure.refused else "failed"
        rows[task] = {"kind": kind, "status": failure.reason, "simulated_seconds": 0.0}
    return _result(plan, [rows[task] for task in tasks])


def run_point(
    run: Callable[[Any, int, Progress], Outcome], published: Sequence[Published], task: PointTrial
) -> Row:
    """Return what an experiment's run measured at a point, and the specifications it broke."""
    experiment = load(task.entry)
    scenario = make_scenario(experiment.default, settings=task.settings)
    failed: list[Failure] = []

    def counting(
        function: Callable[[Task], Row], tasks: Sequence[Task], progress: Progress
    ) -> Trials[Task]:
        trials = run_here(function, tasks, progress)
        failed.extend(failure for _, failure in trials.failed)
        return trials

    with running(counting):
        outcome = run(experiment.resolve(scenario), task.seed, quiet)
    if failed:
        raise ExperimentError(f"{len(failed)} of its trials failed: {failed[0].reason}")
    metrics = defined_metrics(outcome.metrics)
    limits = check(published, metrics, default=False)
    return {
        "kind": "ok",
        "status": OK,
        "simulated_seconds": float(outcome.simulated_seconds),
        "broken": " ".join(one.published.metric for one in limits if not one.ok),
        **{f"{_METRIC}{name}": metric.value for name, metric in metrics.items()},
        **{f"{_UNIT}{name}": metric.unit for name, metric in metrics.items()},
    }


def _settings(plan: SweepPlan, point: Sequence[Any]) -> tuple[str, ...]:
    """Return a point's settings; those of the plan's scenario give way to the varied fields."""
    paths = [one.path for one in plan.varied]
    fixed = [
        setting
        for setting in plan.job.overrides
        if not any(_within(setting.partition("=")[0], path) for path in paths)
    ]
    values = zip(paths, map(one_line, point), strict=True)
    return (*fixed, *(f"{path}={value}" for path, value in values))


def _require_measured(plan: SweepPlan, run: Callable[[PointTrial], Row]) -> None:
    """Run points until all metrics that are asked for have been seen.

    Names of metrics depend on choices, such as that of a controller, and not on numbers: one
    point of each choice is enough.
    """
    known: dict[str, None] = {}
    seen = set()
    probes = 0
    for point in plan.points:
        choice = tuple(one_line(value) for value in point if not _is_number(value))
        if choice in seen or probes == _PROBES:
            continue
        probes += 1
        probe = PointTrial(entry=plan.job.entry, settings=_settings(plan, point), seed=plan.seed)
        for row in try_each(run, [probe], quiet).rows:
            seen.add(choice)
            known |= dict.fromkeys(_names(row))
        wrong = [name for name in plan.metrics or () if name not in known]
        if not wrong:
            return
    if known:
        valid_name("metric", wrong[0], known)


def _names(row: Row) -> list[str]:
    return [name.removeprefix(_METRIC) for name in row if name.startswith(_METRIC)]


def _result(plan: SweepPlan, rows: Sequence[Row]) -> SweepResult:
    """Return the result of rows, those of a point one after the other."""
    paths = [one.path for one in plan.varied]
    names = dict.fromkeys(name for row in rows for name in _names(row))
    if plan.metrics is not None:
        names = dict.fromkeys(plan.metrics)
    # A metric may be named as a field, such as an increment that is derived unless it is given.
    columns = {name: f"measured.{name}" if name in paths else name for name in names}
    groups = [rows[k : k + plan.trials] for k in range(0, len(rows), plan.trials)]
    status = [_status(group) for group in groups]
    table = dict(zip(paths, map(as_column, zip(*plan.points, strict=True)), strict=True))
    trials = {path: np.repeat(column, plan.trials) for path, column in table.items()}
    units = {one.path: one.unit for one in plan.varied}
    for name, column in columns.items():
        found = [row.get(f"{_METRIC}{name}") for row in rows]
        values = np.array([math.nan if one is None else one for one in found], dtype=np.float64)
        for row in rows:
            units[column] = row.get(f"{_UNIT}{name}", units.get(column, ""))
        trials[column] = table[column] = values
        if plan.trials > 1:
            means = [_mean(own) for own in values.reshape(-1, plan.trials)]
            table[column], table[f"{column}{INTERVAL}"] = np.array(means).T
    broken = [set().union(*(row.get("broken", "").split() for row in group)) for group in groups]
    if any(one.kind == LIMIT for one in plan.job.published):
        known = [any(row["kind"] == "ok" for row in group) for group in groups]
        table["broken"] = np.where(known, list(map(len, broken)), np.nan)
    table["status"] = np.array(status, dtype=object)
    table["seed"] = np.full(len(groups), plan.seed)
    trials["status"] = np.array([row["status"] for row in rows], dtype=object)
    trials["seed"] = plan.seed + np.arange(len(rows)) % plan.trials
    return SweepResult(
        plan=plan,
        table=SweepTable(table, units),
        trials=trials,
        metrics=columns,
        counts={kind: sum(row["kind"] == kind for row in rows) for kind in KINDS},
        simulated_seconds=math.fsum(row["simulated_seconds"] for row in rows),
        reasons=dict(Counter(text for text in status if text != OK)),
        broken=dict(Counter(name for names in broken for name in sorted(names))),
    )


def as_column(values: Sequence[Any]) -> NDArray[Any]:
    """Return a field's values as numbers, or else as texts as ``--set`` takes them."""
    if all(map(_is_number, values)):
        whole = all(isinstance(value, int) for value in values)
        return np.array(values, dtype=np.int64 if whole else np.float64)
    texts = [value if isinstance(value, str) else one_line(value) for value in values]
    return np.array(texts, dtype=object)


def _is_number(value: Any) -> bool:
    if isinstance(value, int):
        return not isinstance(value, bool) and abs(value) < _LARGEST
    return isinstance(value, float)


def _mean(values: NDArray[np.float64]) -> tuple[float, float]:
    known = values[~np.isnan(values)]
    return mean_interval(known) if len(known) else (math.nan, math.nan)


def _status(group: Sequence[Row]) -> str:
    without = [str(row["status"]) for row in group if row["kind"] != "ok"]
    if not without or len(without) == len(group):
        return without[0] if without else OK
    return f"{len(without)} of {len(group)} trials: {without[0]}"
