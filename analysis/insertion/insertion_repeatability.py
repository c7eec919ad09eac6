"""Many insertions by sight: how often the peg is seated, how hard, how soon; and other ways."""

from collections import Counter
from collections.abc import Mapping
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.campaign.campaign import Trials
from chamfer.analysis.campaign.trial_metrics import mean_interval, prefixed, rate
from chamfer.analysis.insertion.cell_runs import INSERTION
from chamfer.analysis.insertion.insertion_repeatability_figures import plot_insertions
from chamfer.analysis.insertion.insertion_trials import (
    AS_IT_IS,
    InsertionTrialsScenario,
    Task,
    insert_all,
)
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column

_HARD: Final = 5.0  # N, a contact force to stay below
_QUANTILE: Final = 95  # %
_SETTLING: Final = "settling"


def run(scenario: InsertionTrialsScenario, seed: int, progress: Progress) -> Outcome:
    """Insert the peg many times, in every way."""
    found = insert_all(scenario, seed, progress)
    metrics: dict[str, Metric] = {}
    for way, trials in found.items():
        if way == _SETTLING:
            metrics |= _settled(trials)
        else:
            of = _statistics(trials)
            metrics |= of if way == AS_IT_IS else prefixed(way, of)
    if "wait" in found:
        metrics |= _saved(found[AS_IT_IS], found["wait"])
    drawn = {way: trials for way, trials in found.items() if way != _SETTLING}
    ways = list(drawn)
    rows = [
        (float(ways.index(way)), float(task[0]), row)
        for way, trials in drawn.items()
        for task, row in zip(trials.tasks, trials.rows, strict=True)
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
            "courses": {
                "way": np.concatenate([np.full(len(row["times"]), way) for way, _, row in rows]),
                "trial": np.concatenate([np.full(len(row["times"]), k) for _, k, row in rows]),
                **{
                    name: np.concatenate([row[f"{name}s"] for *_, row in rows])
                    for name in ("time", "depth", "lateral_error", "rotational_error")
                },
            }
        },
    )


def _statistics(trials: Trials[Task]) -> dict[str, Metric]:
    n = len(trials)
    seated = trials.column("seated")
    first, said = trials.column("seated.first"), trials.column("seated.said")
    ends = Counter(row["ending"] for row in trials.rows if not row["seated"])
    why = "".join(f"; {count}: {ending}" for ending, count in ends.most_common(3))
    wrong = int(np.sum((said > 0) & (seated == 0)))
    force = trials.column("force.contact")
    soft = int(np.sum(force < _HARD))
    metrics = {
        **rate("success_rate", int(seated.sum()), n, f"seated, of {n} trials{why}"),
        **rate("first_attempt", int(first.sum()), n, "seated with the first attempt"),
        "said_wrongly": Metric(
            value=float(wrong), unit="", note=f"of {n} trials: said to be seated, and not"
        ),
        **rate("force.soft", soft, n, f"contact force below {_HARD:g} N, medians of 10 ms"),
    }
    for name, unit in (
        ("force.axial", "N"),
        ("force.lateral", "N"),
        ("force.contact", "N"),
        ("force.raw_peak", "N"),
    ):
        values = trials.column(name)
        metrics[f"{name}.median"] = _metric(float(np.median(values)), unit, "of the trials")
        quantile = float(np.percentile(values, _QUANTILE))
        metrics[f"{name}.p{_QUANTILE}"] = _metric(quantile, unit, "of the trials")
        metrics[f"{name}.max"] = _metric(float(values.max()), unit, "of the trials")
    for name in (
        "depth",
        "time_to_seated",
        "decision.time",
        "touch.lateral_error",
        "touch.rotational_error",
        "attempts",
    ):
        values = trials.column(name)
        values = values[np.isfinite(values)]
        unit = INSERTION[name].unit
        if not len(values):
            metrics[f"{name}.mean"] = Metric(value=None, unit=unit, note="in no trial")
            continue
        span = f"mean of {len(values)} trials, {values.min():.4g} to {values.max():.4g}"
        metrics[f"{name}.mean"] = _metric(float(values.mean()), unit, span)
    return metrics


def _metric(value: float, unit: str, note: str) -> Metric:
    return Metric(value=value, unit=unit, note=note)


def _saved(early: Trials[Task], late: Trials[Task]) -> dict[str, Metric]:
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
    known = bool(np.isfinite(half))
    return {
        "saved.time.mean": Metric(value=mean, unit="s", note=note),
        "saved.time.mean_low": Metric(
            value=mean - half if known else None, unit="s", note=interval
        ),
        "saved.time.mean_high": Metric(
            value=mean + half if known else None, unit="s", note=interval
        ),
    }


def _settled(trials: Trials[Task]) -> dict[str, Metric]:
    """Return the errors as the compensation froze after its time, and when they rest."""
    metrics = {}
    for name, unit in (("lateral_error", "m"), ("rotational_error", "rad")):
        for when, note in (
            ("frozen", "as the compensation froze, after its time"),
            ("settled", "1.5 s later, the command unchanged"),
        ):
            values = trials.column(f"{when}.{name}")
            values = values[np.isfinite(values)]
            for kind, value in (("mean", np.mean), ("max", np.max)):
                metrics[f"settling.{when}.{name}.{kind}"] = Metric(
                    value=float(value(values)) if len(values) else None, unit=unit, note=note
                )
    return metrics


def figures(scenario: InsertionTrialsScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"insertion-repeatability": plot_insertions(scenario, outcome)}
