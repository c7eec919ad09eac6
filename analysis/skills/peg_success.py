"""How often a round peg is inserted, and how three searches do in the same worlds."""

import math
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import prefixed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.scenario.experiment import Outcome, Progress, Table
from chamfer.analysis.skills.connector_success import told
from chamfer.analysis.skills.connector_success_figures import plot_success
from chamfer.analysis.skills.connector_trials import (
    PegSuccessScenario,
    attempt,
    attempt_rows,
    success_metrics,
)
from chamfer.analysis.skills.peg_success_figures import plot_searches
from chamfer.systems.strategies.peg_in_hole import Search

_Task = tuple[Search, int]  # of a search, the number of a world
# What the searches are compared by, beside their rates of success.
_COMPARED: Final = ("duration", "force.peak_mean", "retries")


def _attempt(scenario: PegSuccessScenario, seed: int, task: _Task) -> Row:
    """Run one of a seed's trials with a search."""
    search, trial = task
    skill = replace(scenario.skill, search=search)
    return attempt(replace(scenario, skill=skill), seed, trial)


def run(scenario: PegSuccessScenario, seed: int, progress: Progress) -> Outcome:
    """Grasp and insert the peg many times with each search; what is asked is the skill's own."""
    searches = dict.fromkeys((scenario.skill.search, *scenario.compared))
    tasks = [(search, trial) for search in searches for trial in range(scenario.trials)]
    attempts = run_each(partial(_attempt, scenario, seed), tasks, progress)
    by_search = {
        search: Trials(tasks=tuple(trial for _, trial in its.tasks), rows=its.rows)
        for search, its in attempts.split(searches, lambda task: task[0]).items()
    }
    found = {search: success_metrics(its) for search, its in by_search.items()}
    metrics = told(found[scenario.skill.search])
    for search, its in found.items():
        compared = {
            name: metric
            for name, metric in its.items()
            if name.startswith("success_rate") or name in _COMPARED
        }
        metrics |= prefixed(search, compared)
    return Outcome(
        metrics=metrics,
        traces=_rows(by_search),
        simulated_seconds=math.fsum(attempts.column("duration")),
    )


def _rows(by_search: Mapping[Search, Trials[int]]) -> Table:
    """Return the rows of all searches, one search after the other."""
    tables = []
    for search, its in by_search.items():
        named = np.array([search] * len(its), dtype=np.str_)
        tables.append({**attempt_rows(its), "search": named})
    return {name: np.concatenate([table[name] for table in tables]) for name in tables[0]}


def figures(scenario: PegSuccessScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    rows = outcome.traces
    own = rows["search"] == scenario.skill.search
    of_own = replace(outcome, traces={name: values[own] for name, values in rows.items()})
    figures = {"success": plot_success(of_own, middle=scenario.initial_error)}
    if not own.all():
        figures["searches"] = plot_searches(rows)
    return figures
