"""Many insertions from random initial errors, and how many of them succeed."""

import math
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import ClassVar, Final, Literal, NamedTuple

import numpy as np

from analysis.run.campaign import run_each
from analysis.run.experiment import Metric, Progress, Table, column
from analysis.run.trial_metrics import Trial, rate, trial_seed
from analysis.skills.connector_runs import (
    AXES,
    INSERTION,
    failure,
    insertion_metrics,
    run_insertion,
)
from diagrams.skills.connector_insertion import BncConnectorScenario, DConnectorScenario
from diagrams.skills.connector_sight import SightSettings
from models.validation import ParameterError, require_not_negative

_LIFETIME: Final = 50  # trials of a process, each of which leaves 3 MB behind
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


class Attempt(NamedTuple):
    """One of many trials."""

    initial_error: tuple[float, ...]  # rad above m, as it was drawn
    measured: Trial  # of INSERTION; None where an error ended the run
    reason: str  # why it failed; empty if it did not


def drawn(scenario: SuccessScenario, seed: int, trial: int) -> SuccessScenario:
    """Return the scenario with the initial error of one of a seed's trials."""
    spread = scenario.spread
    ranges = [spread.rotational] * 3 + [spread.lateral] * 2 + [0.0]
    error = np.random.default_rng([seed, trial]).uniform(-1.0, 1.0, 6) * ranges
    return replace(scenario, initial_error=tuple((error + scenario.initial_error).tolist()))


def attempt(scenario: SuccessScenario, seed: int, trial: int) -> Attempt:
    """Run one of a seed's trials; it depends on its arguments alone.

    An error ends the trial and not the campaign: it counts as failed.
    """
    one = drawn(scenario, seed, trial)
    try:
        done = run_insertion(one, trial_seed(seed, trial))
    except (Exception, SystemExit) as error:  # the latter is a failed assertion of Drake's
        lines = str(error).splitlines() or [""]
        nothing: dict[str, float | None] = dict.fromkeys(INSERTION)
        reason = f"{type(error).__name__}: {lines[0]}"
        return Attempt(one.initial_error, nothing | {"success": 0.0}, reason)
    return Attempt(one.initial_error, insertion_metrics(done, one), failure(done, one))


def attempt_all(scenario: SuccessScenario, seed: int, progress: Progress) -> list[Attempt]:
    """Run as many trials as the scenario asks for, on all cores that are allowed."""
    trials = range(scenario.trials)
    return run_each(partial(attempt, scenario, seed), trials, progress, lifetime=_LIFETIME)


def success_metrics(attempts: Sequence[Attempt]) -> dict[str, Metric]:
    """Return how many trials succeed, with the exact 95 % interval, and what they take."""
    n = len(attempts)
    good = sum(not one.reason for one in attempts)
    reasons = Counter(one.reason for one in attempts if one.reason)
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


def _pooled(attempts: Sequence[Attempt], name: str, pooled: Literal["largest", "mean"]) -> Metric:
    found = [one.measured[name] for one in attempts]
    known = [value for value in found if value is not None]
    unit = INSERTION[name].unit
    if not known:
        return Metric(value=None, unit=unit, note="no trial came to its end")
    note = f"{pooled} of {len(known)} trials, {min(known):.4g} to {max(known):.4g}"
    value = max(known) if pooled == "largest" else math.fsum(known) / len(known)
    return Metric(value=value, unit=unit, note=note)


def attempt_rows(attempts: Sequence[Attempt]) -> Table:
    """Return a row for each trial: its errors, rad and m, and what it measured; NaN: nothing."""
    rows = {"trial": column(np.arange(len(attempts)))}
    errors = np.array([one.initial_error for one in attempts])
    rows |= {f"initial_{axis}": column(errors[:, i]) for i, axis in enumerate(AXES)}
    for name in MEASURED:
        values = [one.measured[name] for one in attempts]
        rows[name] = column([math.nan if value is None else value for value in values])
    return rows | {"reason": np.array([one.reason for one in attempts], dtype=np.str_)}
