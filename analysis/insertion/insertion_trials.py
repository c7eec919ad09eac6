"""Many insertions in the cell with drawn starts and model errors, each in several ways."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Final, Literal, get_args

import numpy as np

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.cell.alignment_runs import row_before
from chamfer.analysis.cell.alignment_trials import AlignmentTrialsScenario, drawn, resolve_trials
from chamfer.analysis.insertion.cell_runs import (
    CellInsertion,
    ending,
    insertion_metrics,
    run_cell_insertion,
)
from chamfer.analysis.scenario.experiment import Progress
from chamfer.diagrams.insertion.insertion_scenario import InsertionScenario, resolve
from chamfer.models.validation import ParameterError

Way = Literal["wait", "frozen", "frozen_wait", "settling"]
Task = tuple[int, str]  # of a trial, and of a way or none

AS_IT_IS: Final = ""  # the way of the scenario itself
_SETTLES: Final = 1.5  # s, after which what is frozen rests
_DRAWN: Final = 100.0  # 1/s, rows of a course that is kept


@dataclass(frozen=True, kw_only=True)
class InsertionTrialsScenario(InsertionScenario, AlignmentTrialsScenario):
    """Insertions with many starts and many model errors, and the same starts in other ways.

    Ways: ``wait`` decides after the compensation's time, as section 5 does; ``frozen`` stops the
    compensation when it decides, the paper's proposal, ``frozen_wait`` does both; ``settling``
    does both too but does not advance, to see what becomes of errors.
    """

    initial_error: tuple[float, ...] = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0)  # the middle of the starts
    trials: int = 10  # as section 5's runs; 200 for the issue of its rates
    beside: tuple[Way, ...] = ("wait", "frozen", "settling")  # of the same starts

    def __post_init__(self) -> None:
        super().__post_init__()
        known = get_args(Way)
        if len(set(self.beside)) < len(self.beside) or not set(self.beside) <= set(known):
            raise ParameterError("beside", self.beside, f"some of {', '.join(known)}, or none")


def resolve_insertion_trials(scenario: InsertionTrialsScenario) -> InsertionTrialsScenario:
    """Resolve the insertions, once it is sure that every trial has something to see."""
    return resolve(resolve_trials(scenario))


def in_a_way(scenario: InsertionTrialsScenario, way: str) -> InsertionTrialsScenario:
    """Return the scenario with what a way does differently."""
    changes: dict[str, Callable[[InsertionTrialsScenario], InsertionTrialsScenario]] = {
        AS_IT_IS: lambda one: one,
        "wait": _waits,
        "frozen": _freezes,
        "frozen_wait": lambda one: _waits(_freezes(one)),
        "settling": lambda one: _pauses(_waits(_freezes(one))),
    }
    return changes[way](scenario)


def _waits(scenario: InsertionTrialsScenario) -> InsertionTrialsScenario:
    return replace(scenario, decide=replace(scenario.decide, kind="wait"))


def _freezes(scenario: InsertionTrialsScenario) -> InsertionTrialsScenario:
    insert = replace(scenario.insert, compensation="frozen", freeze_depth=None)
    return replace(scenario, insert=insert)


def _pauses(scenario: InsertionTrialsScenario) -> InsertionTrialsScenario:
    return replace(scenario, insert=replace(scenario.insert, pause=_SETTLES))


def insert_all(
    scenario: InsertionTrialsScenario, seed: int, progress: Progress
) -> dict[str, Trials[Task]]:
    """Run every trial in every way, and return the trials by way."""
    ways = (AS_IT_IS, *scenario.beside)
    tasks = [(trial, way) for trial in range(scenario.trials) for way in ways]
    finished = run_each(partial(insert_one, scenario, seed), tasks, progress)
    return finished.split(ways, _way_of)


def _way_of(task: Task) -> str:
    return task[1]


def insert_one(scenario: InsertionTrialsScenario, seed: int, task: Task) -> Row:
    """Run one of a seed's trials in one way; it depends on its arguments alone.

    Returns:
        What :data:`chamfer.analysis.insertion.cell_runs.INSERTION` has, how it ended as ``ending``
        and ``state``, and for the figure ``times`` s, ``depths`` m and ``forces`` N; of settling
        the errors as it froze and at last.
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
    traces, frozen = done.traces, done.entered("insert")
    values: dict[str, float | None] = {}
    for name in ("lateral_error", "rotational_error"):
        error = traces[name]
        before = np.nan if frozen is None else error[row_before(traces["time"], frozen)]
        values[f"frozen.{name}"] = None if frozen is None else float(before)
        values[f"settled.{name}"] = None if frozen is None else float(error[-1])
    return values
