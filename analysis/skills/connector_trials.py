"""Many insertions, each in a world of its own, and how many of them succeed."""

import math
from collections import Counter
from dataclasses import dataclass, field
from functools import partial
from typing import Final, Literal

import numpy as np

from chamfer.analysis.campaign.campaign import Trials, run_each
from chamfer.analysis.campaign.trial_metrics import rate, trial_seed
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.scenario.experiment import Metric, Progress, Table, column
from chamfer.analysis.skills.connector_runs import (
    INSERTION,
    failure,
    insertion_metrics,
    run_insertion,
)
from chamfer.analysis.skills.connector_truth import Verdict, verdict
from chamfer.analysis.skills.randomised_scenario import WorldSpread, drawn_world
from chamfer.analysis.skills.skill_run import AXES, SkillResult
from chamfer.diagrams.contact.sensing import Sensing
from chamfer.diagrams.skills.connector_insertion import (
    BncConnectorScenario,
    DConnectorScenario,
    PegScenario,
    Rj45ConnectorScenario,
)
from chamfer.diagrams.skills.connector_sight import SightSettings
from chamfer.diagrams.skills.vision_servo import Belief
from chamfer.models.validation import ParameterError
from chamfer.systems.sensing.wrench_sensor import WrenchSensorParams
from chamfer.systems.strategies.peg_in_hole import Search

_MOST: Final = 10_000  # trials
# Of a trial's world: errors, rad and m; the true connector's friction and mating force, N, 1 if
# it has the tightest fit, and depth of an obstacle, m; stiffness of the true wrist along z, N/m.
DRAWN: Final = (
    *(f"initial_{axis}" for axis in AXES),
    "friction",
    "mating_force",
    "tight",
    "wrist_stiffness",
    "obstacle",
)
# What does not depend on the machine.
MEASURED: Final = tuple(name for name in INSERTION if name != "real_time_factor")


def _known_cameras() -> SightSettings:
    """Return cameras that are believed to be as they are, but for what a trial draws."""
    return SightSettings(xz=Belief(), yz=Belief())


@dataclass(frozen=True, kw_only=True)
class _Campaign:
    """What all campaigns have in place of what one insertion has."""

    initial_error: tuple[float, ...] = (0.0,) * 6  # the middle of the errors
    sight: SightSettings | None = field(default_factory=_known_cameras)  # None: the plug is held
    sensing: Sensing = "realistic"
    sensor: WrenchSensorParams = field(default_factory=WrenchSensorParams)
    spread: WorldSpread = field(default_factory=WorldSpread)
    trials: int = 50  # insertions, each in a world of its own
    step: float = 0.002  # s, of the plant; peak forces differ by less than 1 % from those at 1 ms
    duration: float = 240.0  # s, after which a run ends at the latest, all its retries made

    def __post_init__(self) -> None:
        if not 1 <= self.trials <= _MOST:
            raise ParameterError("trials", self.trials, f"1 to {_MOST}")
        super().__post_init__()  # type: ignore[misc]  # of the insertion that comes next


@dataclass(frozen=True, kw_only=True)
class DConnectorSuccessScenario(_Campaign, DConnectorScenario):
    """Many insertions of a D connector, from its grasp by sight on, each in a world of its own."""


@dataclass(frozen=True, kw_only=True)
class BncConnectorSuccessScenario(_Campaign, BncConnectorScenario):
    """Many insertions of a BNC connector, likewise."""

    initial_error: tuple[float, ...] = (0.0, 0.0, 0.6, 0.0, 0.0, 0.0)
    # The middle of the errors; the slots are that far from the studs.


@dataclass(frozen=True, kw_only=True)
class PegSuccessScenario(_Campaign, PegScenario):
    """Many insertions of a round peg, likewise, and the same worlds with other searches."""

    compared: tuple[Search, ...] = ("spiral", "tilt")  # searches beside that of the skill


@dataclass(frozen=True, kw_only=True)
class Rj45ConnectorSuccessScenario(_Campaign, Rj45ConnectorScenario):
    """Many insertions of an RJ45 plug, likewise."""


SuccessScenario = (
    DConnectorSuccessScenario
    | BncConnectorSuccessScenario
    | PegSuccessScenario
    | Rj45ConnectorSuccessScenario
)


def attempt(scenario: SuccessScenario, seed: int, trial: int) -> Row:
    """Run one of a seed's trials; it depends on its arguments alone, but for how fast it runs.

    Returns:
        What was drawn, see :data:`DRAWN`; what
        :data:`chamfer.analysis.skills.connector_runs.INSERTION` has, and
        :class:`chamfer.analysis.skills.connector_truth.Verdict`; ``reason`` why the plug is not
        in, empty if it is.
    """
    one = drawn_world(scenario, scenario.spread, seed, trial)
    done = run_insertion(one, trial_seed(seed, trial))
    return measured(done, one)


def measured(done: SkillResult, one: SuccessScenario) -> Row:
    """Return the row of a run in a drawn world, see :func:`attempt`."""
    return {
        **_draws(one),
        **insertion_metrics(done, one),
        **{name: float(value) for name, value in verdict(done, one)._asdict().items()},
        "reason": failure(done, one),
    }


def _draws(one: SuccessScenario) -> dict[str, float | None]:
    """Return what was drawn of a trial's world."""
    return {
        **{f"initial_{axis}": error for axis, error in zip(AXES, one.initial_error, strict=True)},
        "friction": one.connector.material.friction,
        "mating_force": one.connector.mating_force,
        "tight": float(one.connector.tolerance == "worst"),
        "wrist_stiffness": one.wrist.stiffness[-1],
        "obstacle": one.obstacle,
    }


def attempt_all(scenario: SuccessScenario, seed: int, progress: Progress) -> Trials[int]:
    """Run as many trials as the scenario asks for; a task is a trial's number."""
    return run_each(partial(attempt, scenario, seed), range(scenario.trials), progress)


def success_metrics(attempts: Trials[int]) -> dict[str, Metric]:
    """Return how many trials succeed, with the exact 95 % interval, and what they take.

    Successes are those of the trials whose sockets are free. What the skill says is compared with
    the truth in all of them.
    """
    n = len(attempts)
    free = np.isnan(attempts.column("obstacle"))
    reasons = [row["reason"] for row in attempts.rows]
    bad = Counter(why for why, way in zip(reasons, free, strict=True) if why and way)
    count = int(free.sum())
    good = count - bad.total()
    note = f"{good} of {count}" + (f", {n - count} more with an obstacle" if count < n else "")
    if bad:
        listed = ", ".join(f"{reason} ({times})" for reason, times in sorted(bad.items()))
        note += f"; failed: {listed}"
    metrics = _rate("success_rate", good, count, note)
    failed = sum(map(bool, reasons))
    for name, of, what in (
        ("false_done", n, "runs"),
        ("false_hindered", int(attempts.column("hindered").sum()), "times that it was told"),
        ("false_reason", failed, "runs that failed"),
    ):
        wrong = int(attempts.column(name).sum())
        metrics |= _rate(name, wrong, of, f"{wrong} of {of} {what}")
    for name in ("force.peak", "force.peak_share", "torque.peak"):
        metrics[name] = _pooled(attempts, name, "largest")
    for name in ("force.peak", "force.peak_share"):
        metrics[f"{name}_mean"] = _pooled(attempts, name, "mean")
    shares = attempts.column("force.peak_share")[free]
    metrics["force.free_share"] = Metric(
        value=float(shares.max()) if count else None,
        unit=INSERTION["force.peak_share"].unit,
        note=f"force.peak_share of the {count} trials with a free socket, the largest",
    )
    for name in ("duration", "retries", "real_time_factor"):
        metrics[name] = _pooled(attempts, name, "mean")
    return metrics


def _rate(name: str, good: int, count: int, note: str) -> dict[str, Metric]:
    """Return a share as ``trial_metrics.rate`` does; none of none."""
    if count:
        return rate(name, good, count, note)
    ends = (name, f"{name}.low", f"{name}.high")
    return {end: Metric(value=None, unit="%", note=note) for end in ends}


def _pooled(attempts: Trials[int], name: str, pooled: Literal["largest", "mean"]) -> Metric:
    values = attempts.column(name).tolist()
    note = f"{pooled} of {len(values)} trials, {min(values):.4g} to {max(values):.4g}"
    value = max(values) if pooled == "largest" else math.fsum(values) / len(values)
    return Metric(value=value, unit=INSERTION[name].unit, note=note)


def attempt_rows(attempts: Trials[int]) -> Table:
    """Return a row for each trial: its world, what it measured, the truth, and the reason."""
    names = (*DRAWN, *MEASURED, *Verdict._fields)
    return {
        "trial": column(attempts.tasks),
        **{name: attempts.column(name) for name in names},
        "reason": np.array([row["reason"] for row in attempts.rows], dtype=np.str_),
    }
