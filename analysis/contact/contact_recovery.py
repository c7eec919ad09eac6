"""Section 2.1.4: lost contact with and without the mode that seeks it slowly."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import over_trials
from chamfer.analysis.campaign.trial_rows import Row, table_of, with_table
from chamfer.analysis.contact.contact_metrics import QUANTITIES
from chamfer.analysis.contact.contact_recovery_figures import plot_recovery
from chamfer.analysis.contact.contact_runs import Traces, measure, run_contact
from chamfer.analysis.contact.loop_metrics import stability_metrics
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.contact.hybrid_loop_stability import stability
from chamfer.diagrams.contact.planar_scenarios import RecoveryScenario

_GAINS = (1.0, 2.0, 3.0, 4.0, 5.0)  # 1/s, force integrals compared
_BOUNCES = 6  # impacts in which they should grow
_BOUNCING = 12.0  # s, longest run without the loss mode


class Task(NamedTuple):
    """One of the runs that are compared."""

    name: str
    scenario: RecoveryScenario


def run_recovery(scenario: RecoveryScenario, seed: int, progress: Progress) -> Outcome:
    """Run the blow with and without the loss mode, and the bounces over the force integral."""
    tasks = [
        Task("with_loss_mode", scenario),
        Task("without_loss_mode", _without(scenario)),
        *(Task(f"bounces_at_{gain:g}", _first_contact(scenario, gain)) for gain in _GAINS),
    ]
    finished = run_each(partial(_run_task, seed), tasks, progress)
    runs = finished.split([task.name for task in tasks], lambda task: task.name)
    with_mode, without, *first_contacts = (table_of(one.rows[0]) for one in runs.values())
    rows: dict[str, list[float]] = {"force_integral": [], "bounce": [], "speed": []}
    growth = []
    for gain, traces in zip(_GAINS, first_contacts, strict=True):
        speeds = bounces(traces)
        growth.append(_growth(speeds))
        for bounce, speed in enumerate(speeds):
            rows["force_integral"].append(gain)
            rows["bounce"].append(bounce)
            rows["speed"].append(speed)
    metrics = over_trials([measure(scenario, with_mode)], QUANTITIES)
    metrics |= stability_metrics(stability(scenario))
    metrics |= {
        "recontact.force": _after_blow(scenario, with_mode, "peak_force", "N"),
        "recontact.blow_speed": _after_blow(scenario, with_mode, "impact_speed", "m/s"),
        "without_loss_mode.force": _after_blow(scenario, without, "peak_force", "N"),
        "without_loss_mode.speed": _after_blow(scenario, without, "impact_speed", "m/s"),
        "growth_threshold": _threshold(growth),
    }
    for gain, grown in zip(_GAINS, growth, strict=True):
        metrics[f"without_loss_mode.growth_at_{gain:g}"] = Metric(
            value=grown, unit="", note="sixth impact's speed over the second's"
        )
    return Outcome(
        metrics=metrics,
        traces=with_mode,
        simulated_seconds=sum(task.scenario.duration for task in tasks),
        tables={
            "without_loss_mode": without,
            "bounces": {name: column(values) for name, values in rows.items()},
        },
    )


def _run_task(seed: int, task: Task) -> Row:
    return with_table({}, run_contact(task.scenario, seed))


def bounces(traces: Traces) -> list[float]:
    """Return the speeds of the first impacts, m/s."""
    impacts = traces["impact_speed"]
    return [float(speed) for speed in impacts[impacts > 0][:_BOUNCES]]


def _without(scenario: RecoveryScenario) -> RecoveryScenario:
    return replace(scenario, controller=replace(scenario.controller, loss_mode=False))


def _first_contact(scenario: RecoveryScenario, gain: float) -> RecoveryScenario:
    """Return the approach alone, without the loss mode."""
    return replace(
        scenario,
        task=replace(scenario.task, kick_time=None),
        controller=replace(scenario.controller, loss_mode=False, force_integral=gain),
        duration=min(_BOUNCING, scenario.duration),
    )


def _growth(speeds: list[float]) -> float:
    """Return the last impact's speed over the second one's; 0 if the bounces end before.

    The first is the approach's speed, not that of a rebound.
    """
    return speeds[-1] / speeds[1] if len(speeds) == _BOUNCES else 0.0


def _threshold(growth: list[float]) -> Metric:
    """Return the force integral at which bounces begin to grow, between those compared."""
    for i in range(1, len(growth)):
        if growth[i - 1] < 1 <= growth[i]:
            part = (1 - growth[i - 1]) / (growth[i] - growth[i - 1])
            value = _GAINS[i - 1] + part * (_GAINS[i] - _GAINS[i - 1])
            return Metric(value=value, unit="1/s", note="interpolated")
    return Metric(value=None, unit="1/s", note=f"not among {_GAINS}")


def _after_blow(scenario: RecoveryScenario, traces: Traces, name: str, unit: str) -> Metric:
    blow = scenario.task.kick_time
    if blow is None or blow >= scenario.duration:
        return Metric(value=None, unit=unit, note="no blow in the run")
    left = (traces["time"] > blow) & (traces["gap"] > 0)
    if not np.any(left):
        return Metric(value=None, unit=unit, note="the blow does not break the contact")
    after = traces["time"] > traces["time"][np.argmax(left)]
    if not np.any(after):
        return Metric(value=None, unit=unit, note="the run ends with the blow")
    return Metric(value=float(traces[name][after].max()), unit=unit)


def figures(scenario: RecoveryScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"contact-recovery": plot_recovery(scenario, outcome)}
