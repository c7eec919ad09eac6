"""Fig. 3-15: the wrist's angular integrator fights the force integrator."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure
from pydrake.systems.framework import Diagram

from chamfer.analysis.campaign.trial_metrics import prefixed
from chamfer.analysis.contact.contact_figures import note_stability
from chamfer.analysis.contact.contact_runs import run_trials
from chamfer.analysis.drawing.figure_kit import metric_value
from chamfer.analysis.drawing.figure_style import (
    DESIRED,
    FORCE,
    POSITION,
    dress,
    legend,
    new_figure,
)
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress
from chamfer.diagrams.contact.contact_scenarios import AdeptScenario
from chamfer.diagrams.contact.hybrid_loop import make_hybrid_diagram

_WRIST = 3  # joint index


def run_contention(scenario: AdeptScenario, seed: int, progress: Progress) -> Outcome:
    """Run the scenario unchanged, and with the wrist's integrator off while in contact."""
    on = run_trials(scenario, seed, lambda done, doing="": progress(done / 2, doing))
    off = run_trials(_held(scenario), seed, lambda done, doing="": progress(0.5 + done / 2, doing))
    ratio = _ratio(on.metrics["force.deviation"], off.metrics["force.deviation"])
    metrics = {**on.metrics, **prefixed("wrist_integrator_off", off.metrics)}
    metrics["force.deviation_ratio"] = ratio
    metrics["wrist_integrator_off.wrist_error"] = _wrist_error(scenario, off)
    metrics["wrist_error"] = _wrist_error(scenario, on)
    return Outcome(
        metrics=metrics,
        traces=on.traces,
        simulated_seconds=on.simulated_seconds + off.simulated_seconds,
        tables={"wrist_integrator_off": off.traces},
    )


def _held(scenario: AdeptScenario) -> AdeptScenario:
    return replace(scenario, controller=replace(scenario.controller, held_integrators=(_WRIST,)))


def make_loops(scenario: AdeptScenario) -> tuple[Diagram, ...]:
    """Return the resolved loops of the comparison."""
    return make_hybrid_diagram(scenario), make_hybrid_diagram(_held(scenario))


def _ratio(over: Metric, under: Metric) -> Metric:
    if over.value is None or not under.value:
        return Metric(value=None, unit="", note="no contact")
    return Metric(value=over.value / under.value, unit="", note="integrator on over off")


def _wrist_error(scenario: AdeptScenario, outcome: Outcome) -> Metric:
    """Return the wrist's largest angular error while deviations count."""
    traces = outcome.traces
    after = traces["time"] >= scenario.measure_after
    if not np.any(after):
        return Metric(value=None, unit="rad", note="the run ends before measure_after")
    error = abs(traces["desired_phi"] - traces["phi"])[after]
    return Metric(value=float(error.max()), unit="rad", note="of the first seed")


def figures(scenario: AdeptScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Draw force and wrist error of both runs."""
    on, off = (
        metric_value(outcome.metrics, f"{of}force.deviation")
        for of in ("", "wrist_integrator_off.")
    )
    figure = new_figure(
        height=6.0,
        caption=f"With the wrist's integrator on the force deviates by {on:.2g} N, "
        f"with it off in contact by {off:.2g} N.",
    )
    force, angle = figure.subplots(2, 1, sharex=True)
    for table, label, style in (
        (outcome.traces, "integrator on", POSITION),
        (outcome.tables["wrist_integrator_off"], "integrator off in contact", FORCE),
    ):
        force.plot(table["time"], table["force"], label=label, **style)
        error = np.degrees(table["desired_phi"] - table["phi"])
        angle.plot(table["time"], error, label=label, **style)
    force.axhline(scenario.task.force, label="desired", **DESIRED)
    angle.axhline(0.0, **DESIRED)
    force.set_ylim(bottom=0)
    angle.set_xlim(0, scenario.duration)
    title = f"(a) Force deviation {on:.2g} N with the wrist's integrator, {off:.2g} N without"
    dress(force, title=title, x="", y="force / N")
    dress(angle, title="(b) Wrist angle", x="time / s", y="desired minus actual / deg")
    legend(force, ncols=3)
    note_stability(figure, outcome)
    return {"wrist-contention": figure}
