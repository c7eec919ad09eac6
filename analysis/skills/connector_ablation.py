"""What each primitive is worth: the same insertions by skills that lack one of them."""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import prefixed, trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.analysis.skills.ablation import CHANGES
from chamfer.analysis.skills.connector_ablation_figures import plot_ablation
from chamfer.analysis.skills.connector_trials import (
    BncConnectorSuccessScenario,
    DConnectorSuccessScenario,
    measured,
    success_metrics,
)
from chamfer.analysis.skills.randomised_scenario import drawn_world
from chamfer.analysis.skills.skill_run import run_skill

Task = tuple[str, int]  # a skill's name, and the number of a trial

WITHOUT_SIGHT: Final = "without_sight"
SHOWN: Final = ("success_rate", "false_done", "duration", "force.peak_share", "torque.peak")


@dataclass(frozen=True, kw_only=True)
class DConnectorAblationScenario(DConnectorSuccessScenario):
    """A D connector, inserted by skills without one of their primitives each."""

    trials: int = 20  # insertions by each of the skills, all in the same worlds


@dataclass(frozen=True, kw_only=True)
class BncConnectorAblationScenario(BncConnectorSuccessScenario):
    """A BNC connector, likewise."""

    trials: int = 20  # insertions by each of the skills, all in the same worlds


AblationScenario = DConnectorAblationScenario | BncConnectorAblationScenario


def skills(scenario: AblationScenario) -> tuple[str, ...]:
    """Return the names of the skills that differ: the whole one, and what it can lack."""
    own = scenario.make_skill()
    blind = replace(scenario, sight=None).make_skill()
    changed = [name for name, change in CHANGES.items() if name == "whole" or change(own) != own]
    return (*changed, WITHOUT_SIGHT) if own != blind else tuple(changed)


def attempt(scenario: AblationScenario, seed: int, task: Task) -> Row:
    """Run one of a seed's trials by one of the skills."""
    name, trial = task
    seeing = scenario if name != WITHOUT_SIGHT else replace(scenario, sight=None)
    one = drawn_world(seeing, seeing.spread, seed, trial)
    change = CHANGES["whole" if name == WITHOUT_SIGHT else name]
    done = run_skill(change(one.make_skill()), one, seed=trial_seed(seed, trial))
    return measured(done, one)


def run(scenario: AblationScenario, seed: int, progress: Progress) -> Outcome:
    """Insert the connector by every skill, in the same worlds."""
    names = skills(scenario)
    tasks = [(name, trial) for name in names for trial in range(scenario.trials)]
    attempts = run_each(partial(attempt, scenario, seed), tasks, progress)
    found = attempts.split(names, lambda task: task[0])
    metrics: dict[str, Metric] = {}
    for name, of in found.items():
        whole = success_metrics(_numbered(of))
        ends = [f"success_rate{end}" for end in (".low", ".high")]
        metrics |= prefixed(name, {key: whole[key] for key in (*SHOWN, *ends)})
    return Outcome(
        metrics=metrics,
        traces={
            "skill": np.array([name for name, _ in attempts.tasks], dtype=np.str_),
            "trial": column([trial for _, trial in attempts.tasks]),
            **{
                name: attempts.column(name)
                for name in ("success", "false_done", "duration", "force.peak_share", "obstacle")
            },
            "reason": np.array([row["reason"] for row in attempts.rows], dtype=np.str_),
        },
        simulated_seconds=float(attempts.column("duration").sum()),
    )


def _numbered(attempts: Trials[Task]) -> Trials[int]:
    return Trials(tasks=tuple(trial for _, trial in attempts.tasks), rows=attempts.rows)


def figures(scenario: AblationScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"ablation": plot_ablation(outcome, skills(scenario))}
