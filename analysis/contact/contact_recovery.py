"""Section 2.1.4: lost contact with and without the mode that searches it slowly."""

from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullLocator
from pydrake.systems.framework import Diagram

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import over_trials
from chamfer.analysis.campaign.trial_rows import Row, table_of, with_table
from chamfer.analysis.contact.contact_figures import note_stability
from chamfer.analysis.contact.contact_metrics import QUANTITIES, stability_metrics
from chamfer.analysis.contact.contact_runs import Traces, measure, run_contact
from chamfer.analysis.drawing.figure_kit import metric_value
from chamfer.analysis.drawing.figure_style import (
    DESIRED,
    FORCE,
    LIMIT,
    POSITION,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress, column
from chamfer.diagrams.contact.contact_scenarios import PlanarLoop
from chamfer.diagrams.contact.hybrid_loop import make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_loop_stability import stability
from chamfer.models.surfaces.damage import SAFE_SPEED

_GAINS = (1.0, 2.0, 3.0, 4.0, 5.0)  # 1/s, force integrals compared
_BOUNCES = 6  # impacts in which they should grow
_BOUNCING = 12.0  # s, longest run without the loss mode


class RecoveryRun(NamedTuple):
    """One of the compared runs."""

    name: str
    scenario: PlanarLoop


def _tasks(scenario: PlanarLoop) -> list[RecoveryRun]:
    return [
        RecoveryRun("with_loss_mode", scenario),
        RecoveryRun("without_loss_mode", _without(scenario)),
        *(RecoveryRun(f"bounces_at_{gain:g}", _first_contact(scenario, gain)) for gain in _GAINS),
    ]


def make_loops(scenario: PlanarLoop) -> list[Diagram]:
    """Return the resolved loops of the comparison."""
    return [make_hybrid_diagram(task.scenario) for task in _tasks(scenario)]


def run_recovery(scenario: PlanarLoop, seed: int, progress: Progress) -> Outcome:
    """Run the blow with and without the loss mode, and the bounces over the force integral."""
    tasks = _tasks(scenario)
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


def _run_task(seed: int, task: RecoveryRun) -> Row:
    return with_table({}, run_contact(task.scenario, seed))


def bounces(traces: Traces) -> list[float]:
    """Return the speeds of the first impacts, m/s."""
    impacts = traces["impact_speed"]
    return [float(speed) for speed in impacts[impacts > 0][:_BOUNCES]]


def _without(scenario: PlanarLoop) -> PlanarLoop:
    return replace(scenario, controller=replace(scenario.controller, loss_mode=False))


def _first_contact(scenario: PlanarLoop, gain: float) -> PlanarLoop:
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


def _after_blow(scenario: PlanarLoop, traces: Traces, name: str, unit: str) -> Metric:
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


_WITHOUT = {"color": "#b00020", "linestyle": "--", "linewidth": 1.2}


def figures(scenario: PlanarLoop, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw force and distance after the blow, with and without the loss mode, and the bounces."""
    hit, without = (
        metric_value(outcome.metrics, name)
        for name in ("recontact.force", "without_loss_mode.force")
    )
    says = f"{hit:.2g} N at most with the loss mode, {without:.2g} N without"
    figure = new_figure(
        height=9.5,
        caption=f"After a blow the force is {says}. Below: speed of each bounce without it.",
    )
    panels = figure.subplot_mosaic([["force"], ["distance"], ["bounces"]])
    panels["distance"].sharex(panels["force"])
    blow = scenario.task.kick_time or 0.0
    for table, label, style in (
        (outcome.tables["without_loss_mode"], "force integral goes on", _WITHOUT),
        (outcome.traces, "loss mode", FORCE),
    ):
        shown = (table["time"] > blow - 0.1) & (table["time"] < blow + 2.0)
        time = table["time"][shown] - blow
        panels["force"].plot(time, table["force"][shown], label=label, **style)
        panels["distance"].plot(time, 1e3 * table["gap"][shown], label=label, **style)
    panels["force"].axhline(scenario.task.force, label="desired", **DESIRED)
    panels["distance"].axhline(0.0, **DESIRED)
    dress(panels["force"], title=f"(a) Force after a blow: {says}", x="", y="force / N")
    dress(
        panels["distance"],
        title="(b) Distance from the surface",
        x="time after the blow / s",
        y="distance / mm",
    )
    legend(panels["distance"], ncols=2)
    axes, table = panels["bounces"], outcome.tables["bounces"]
    gains = np.unique(table["force_integral"])
    for i, gain in enumerate(gains):
        of = table["force_integral"] == gain
        shade = 0.25 + 0.75 * i / max(1, len(gains) - 1)
        look = {"marker": "o", "ms": 4, "color": POSITION["color"], "alpha": shade}
        label = f"{gain:g} 1/s"
        axes.semilogy(table["bounce"][of] + 1, table["speed"][of], label=label, **look)
    axes.axhline(SAFE_SPEED, label=f"safe for glass, {SAFE_SPEED:g} m/s", **LIMIT)
    dress(
        axes,
        title="(c) Speed of bounces without the loss mode, by gain of the force integral",
        x="impact",
        y="impact speed / (m/s)",
    )
    axes.yaxis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axes.yaxis.set_minor_locator(NullLocator())
    axes.yaxis.set_major_formatter("{x:g}")
    legend(axes, ncols=6)
    note_stability(figure, outcome)
    return {"contact-recovery": figure}
