"""Many insertions from random initial errors, and how many of them succeed."""

import math
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, Final, Literal

import numpy as np

from analysis.run.campaign import Trials, run_each
from analysis.run.experiment import Metric, Progress, Table, column
from analysis.run.trial_metrics import rate, trial_seed
from analysis.run.trial_rows import Row
from analysis.skills.connector_runs import INSERTION, failure, insertion_metrics, run_insertion
from analysis.skills.skill_run import AXES
from diagrams.skills.connector_insertion import BncConnectorScenario, DConnectorScenario
from diagrams.skills.connector_sight import SightSettings
from models.validation import ParameterError, require_not_negative

_MOST: Final = 10_000  # trials
# What does not depend on the machine.
MEASURED: Final = tuple(name for name in INSERTION if name != "real_time_factor")


@dataclass(frozen=True, kw_only=True)
class InitialSpread:
    """By how much trials differ: each is uniform within plus and minus its range; assumed."""

    lateral: float = 0.002  # m, of the plug along x and y
    rotational: float = math.radians(3)  # rad, of the plug in the gripper about x, y and z

    RENAMED: ClassVar[Mapping[str, str]] = {"angular": "rotational"}

    def __post_init__(self) -> None:
        require_not_negative(self, "lateral", "rotational")


@dataclass(frozen=True, kw_only=True)
class DConnectorSuccessScenario(DConnectorScenario):
    """Many insertions of a D connector, from above the socket on."""

    sight: SightSettings | None = None
    initial_error: tuple[float, ...] = (0.0,) * 6  # the middle of the errors
    spread: InitialSpread = field(default_factory=InitialSpread)
    trials: int = 50  # insertions, each from an error of its own
    step: float = 0.002  # s, of the plant; peak forces differ by less than 1 % from those at 1 ms

    RENAMED: ClassVar[Mapping[str, str]] = {"runs": "trials"}

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_trials(self.trials)


@dataclass(frozen=True, kw_only=True)
class BncConnectorSuccessScenario(BncConnectorScenario):
    """Many insertions of a BNC connector, from above the socket on."""

    sight: SightSettings | None = None
    initial_error: tuple[float, ...] = (0.0, 0.0, 0.6, 0.0, 0.0, 0.0)
    # The middle of the errors; the slots are that far from the studs.
    spread: InitialSpread = field(default_factory=InitialSpread)
    trials: int = 50  # insertions, each from an error of its own
    step: float = 0.002  # s, of the plant; peak forces differ by less than 1 % from those at 1 ms

    RENAMED: ClassVar[Mapping[str, str]] = {"runs": "trials"}

    def __post_init__(self) -> None:
        super().__post_init__()
        _require_trials(self.trials)


SuccessScenario = DConnectorSuccessScenario | BncConnectorSuccessScenario


def _require_trials(trials: int) -> None:
    if not 1 <= trials <= _MOST:
        raise ParameterError("trials", trials, f"1 to {_MOST}")


def drawn(scenario: SuccessScenario, seed: int, trial: int) -> SuccessScenario:
    """Return the scenario with the initial error of one of a seed's trials."""
    spread = scenario.spread
    ranges = [spread.rotational] * 3 + [spread.lateral] * 2 + [0.0]
    error = np.random.default_rng([seed, trial]).uniform(-1.0, 1.0, 6) * ranges
    return replace(scenario, initial_error=tuple((error + scenario.initial_error).tolist()))


def attempt(scenario: SuccessScenario, seed: int, trial: int) -> Row:
    """Run one of a seed's trials; it depends on its arguments alone, but for how fast it runs.

    Returns:
        The error ``initial_<axis>`` as it was drawn, rad or m; what
        :data:`analysis.skills.connector_runs.INSERTION` has; ``reason`` why the plug is not in,
        empty if it is.
    """
    one = drawn(scenario, seed, trial)
    done = run_insertion(one, trial_seed(seed, trial))
    return {
        **{f"initial_{axis}": error for axis, error in zip(AXES, one.initial_error, strict=True)},
        **insertion_metrics(done, one),
        "reason": failure(done, one),
    }


def attempt_all(scenario: SuccessScenario, seed: int, progress: Progress) -> Trials[int]:
    """Run as many trials as the scenario asks for; a task is a trial's number."""
    return run_each(partial(attempt, scenario, seed), range(scenario.trials), progress)


def success_metrics(attempts: Trials[int]) -> dict[str, Metric]:
    """Return how many trials succeed, with the exact 95 % interval, and what they take."""
    n = len(attempts)
    reasons = Counter(row["reason"] for row in attempts.rows if row["reason"])
    good = n - reasons.total()
    note = f"{good} of {n}"
    if reasons:
        listed = ", ".join(f"{reason} ({count})" for reason, count in sorted(reasons.items()))
        note += f"; failed: {listed}"
    metrics = rate("success_rate", good, n, note)
    for name in ("force.peak", "force.peak_share", "torque.peak"):
        metrics[name] = _pooled(attempts, name, "largest")
    metrics["force.peak_mean"] = _pooled(attempts, "force.peak", "mean")
    for name in ("duration", "retries", "real_time_factor"):
        metrics[name] = _pooled(attempts, name, "mean")
    return metrics


def _pooled(attempts: Trials[int], name: str, pooled: Literal["largest", "mean"]) -> Metric:
    values = attempts.column(name).tolist()
    note = f"{pooled} of {len(values)} trials, {min(values):.4g} to {max(values):.4g}"
    value = max(values) if pooled == "largest" else math.fsum(values) / len(values)
    return Metric(value=value, unit=INSERTION[name].unit, note=note)


def attempt_rows(attempts: Trials[int]) -> Table:
    """Return a row for each trial: its error, rad and m, what it measured, and the reason."""
    names = (*(f"initial_{axis}" for axis in AXES), *MEASURED)
    return {
        "trial": column(attempts.tasks),
        **{name: attempts.column(name) for name in names},
        "reason": np.array([row["reason"] for row in attempts.rows], dtype=np.str_),
    }
