"""Fig. 3-15: the wrist's angular integrator fights the force integrator."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from matplotlib.figure import Figure

from chamfer.analysis.campaign.trial_metrics import prefixed
from chamfer.analysis.contact.contact_runs import run_trials
from chamfer.analysis.contact.wrist_contention_figures import plot_contention
from chamfer.analysis.scenario.experiment import Metric, Outcome, Progress
from chamfer.diagrams.contact.adept_scenarios import WristContentionScenario

_WRIST = 3  # joint index


def run_contention(scenario: WristContentionScenario, seed: int, progress: Progress) -> Outcome:
    """Run the scenario as it is, and with the wrist's integrator off while in contact."""
    on = run_trials(scenario, seed, lambda done, doing="": progress(done / 2, doing))
    held = replace(scenario, controller=replace(scenario.controller, held_integrators=(_WRIST,)))
    off = run_trials(held, seed, lambda done, doing="": progress(0.5 + done / 2, doing))
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


def _ratio(over: Metric, under: Metric) -> Metric:
    if over.value is None or not under.value:
        return Metric(value=None, unit="", note="no contact")
    return Metric(value=over.value / under.value, unit="", note="integrator on over off")


def _wrist_error(scenario: WristContentionScenario, outcome: Outcome) -> Metric:
    """Return the wrist's largest angular error while deviations count."""
    traces = outcome.traces
    after = traces["time"] >= scenario.measure_after
    if not np.any(after):
        return Metric(value=None, unit="rad", note="the run ends before measure_after")
    error = abs(traces["desired_phi"] - traces["phi"])[after]
    return Metric(value=float(error.max()), unit="rad", note="of the first seed")


def figures(scenario: WristContentionScenario, outcome: Outcome) -> Mapping[str, Figure]:
    """Return the figures by file name."""
    return {"wrist-contention": plot_contention(scenario, outcome)}
