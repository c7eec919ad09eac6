"""Runs of the hybrid position/force loop."""

from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import over_trials, trial_seed
from chamfer.analysis.campaign.trial_rows import Row, table_of, with_table
from chamfer.analysis.contact.contact_metrics import QUANTITIES, contact_metrics, stability_metrics
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Outcome, Progress
from chamfer.diagrams.contact.compiled_hybrid_loop import run_compiled
from chamfer.diagrams.contact.hybrid_loop import make_hybrid_diagram
from chamfer.diagrams.contact.hybrid_loop_stability import stability
from chamfer.diagrams.contact.hybrid_scenario import HybridScenario, HybridTrials
from chamfer.models.surfaces.damage import impact_speed_limit
from chamfer.systems.contact.arm_motion import CONTACT_SIGNALS
from chamfer.systems.force.contact_detection_law import make_contact_chart
from chamfer.systems.statechart.chart import Chart

Traces = dict[str, NDArray[np.float64]]


def run_contact(scenario: HybridScenario, seed: int) -> Traces:
    """Simulate a resolved scenario and return its traces.

    Columns: ``time`` s; ``force`` and ``measured_force`` N, the push; ``position_error`` m, the
    true one along the motion; the endpoint's coordinates and the desired ones;
    :data:`CONTACT_SIGNALS`; ``mode``; joint positions, velocities and torques.
    """
    arm, period = scenario.ARM, scenario.controller.period
    outputs, n = run_compiled(scenario, seed), arm.num_joints
    if outputs is None:
        diagram = make_hybrid_diagram(scenario)
        run = simulate(diagram, duration=scenario.duration, step=period, seed=seed)
        outputs = run.outputs
    q, v = outputs["encoders"][:, :n], outputs["encoders"][:, n:]
    endpoint = np.array([arm.endpoint(one) for one in q])
    # The controller's outputs are of the tick before, its errors belong to those encoders.
    error = np.roll(outputs["position_error"], -1, axis=0)
    error[-1] = error[-2]
    shown = outputs["measured_encoders"][:, :n]
    if not np.array_equal(shown, q):
        error += np.array([arm.endpoint(one) for one in shown]) - endpoint
    direction, along = scenario.direction, scenario.along
    push = -(outputs["contact_force"] @ np.pad(direction, (0, 3))[:3])
    measured = np.roll(outputs["force_error"], -1, axis=0)
    measured[-1] = measured[-2]
    traces: Traces = {
        "time": period * np.arange(len(q), dtype=np.float64),
        "force": push,
        "measured_force": scenario.task.force - measured @ direction,
        "position_error": error @ along,
        "position": endpoint @ along,
        "height": -(endpoint - scenario.touching) @ direction,
        "mode": outputs["mode"],
    }
    for i, name in enumerate(arm.coordinates):
        traces[name] = endpoint[:, i]
        traces[f"desired_{name}"] = endpoint[:, i] + error[:, i]
    for i, name in enumerate(CONTACT_SIGNALS):
        traces[name] = outputs["contact"][:, i]
    for i, name in enumerate(arm.joint_names):
        traces[f"{name}.position"] = q[:, i]
        traces[f"{name}.velocity"] = v[:, i]
        traces[f"{name}.torque"] = outputs["torque"][:, i]
    return traces


def measure(scenario: HybridScenario, traces: Traces) -> dict[str, float | None]:
    """Measure a run of a scenario."""
    task = scenario.task
    return contact_metrics(
        traces,
        force=task.force,
        after=scenario.measure_after,
        period=task.period,
        kick=task.kick_time,
        impact_limit=impact_speed_limit(task.nugget_mass),
    )


def run_trials(scenario: HybridTrials, seed: int, progress: Progress) -> Outcome:
    """Run a scenario with each of its seeds; the traces are of the first."""
    finished = run_each(partial(_run_trial, scenario, seed), range(scenario.trials), progress)
    first = finished.tasks[0]
    return Outcome(
        metrics=over_trials(finished.rows, QUANTITIES) | stability_metrics(stability(scenario)),
        traces=table_of(finished.rows[0]) or run_contact(scenario, trial_seed(seed, first)),
        simulated_seconds=len(finished) * scenario.duration,
    )


def _run_trial(scenario: HybridTrials, seed: int, trial: int) -> Row:
    traces = run_contact(scenario, trial_seed(seed, trial))
    measured = measure(scenario, traces)
    return measured if trial else with_table(measured, traces)


def contact_charts(scenario: HybridScenario) -> tuple[Chart[Any, Any], ...]:
    """Return the loop's state chart, contact detection."""
    return (make_contact_chart(scenario.detection, scenario.direction),)
