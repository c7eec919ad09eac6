"""Runs of an arm that finds an unknown wall."""

from functools import partial

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import over_trials, trial_seed
from chamfer.analysis.campaign.trial_rows import Row, table_of, with_table
from chamfer.analysis.contact.contact_metrics import stability_metrics
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Outcome, Progress
from chamfer.analysis.surface.normal_metrics import BAND, angle_between
from chamfer.analysis.surface.unknown_wall_metrics import QUANTITIES, wall_metrics
from chamfer.diagrams.contact.hybrid_loop_stability import stability
from chamfer.diagrams.surface.unknown_wall_loop import make_unknown_wall_diagram
from chamfer.diagrams.surface.unknown_wall_scenario import UnknownWallScenario
from chamfer.models.surfaces.damage import impact_speed_limit
from chamfer.models.surfaces.surface import curvature, normal
from chamfer.systems.contact.arm_motion import CONTACT_SIGNALS

Array = NDArray[np.float64]
Traces = dict[str, Array]


def run_wall(scenario: UnknownWallScenario, seed: int) -> Traces:
    """Simulate a resolved scenario and return its traces, a row for each period.

    Columns: ``time`` s; ``force`` N, the normal component of the true force; ``error`` deg, of the
    estimated normal at the tip; ``band`` deg, three standard deviations; ``mode`` of contact
    detection; ``status`` of the observer; ``travel`` m, of the tip since the first contact;
    ``curvature`` 1/m, of the wall at the tip, the largest of any direction;
    ``across`` m, out of the wall as it is believed; ``along`` m; ``point_x`` m and so on, the tip;
    ``normal_x`` and ``true_normal_x`` and so on; ``measured_force_x`` N and so on, of the arm on
    the wall; :data:`CONTACT_SIGNALS`; joint positions, velocities and torques.
    """
    arm, d, n = scenario.ARM, scenario.dimension, scenario.ARM.num_joints
    diagram = make_unknown_wall_diagram(scenario)
    period = scenario.controller.period
    run = simulate(diagram, duration=scenario.duration, step=period, seed=seed)
    outputs, wall = run.outputs, scenario.make_surface()
    point = outputs["tip"][:, :3]
    truth = np.array([normal(wall, p) for p in point])
    estimate = np.zeros_like(truth)
    estimate[:, :d] = outputs["normal"]
    touched = outputs["mode"] > 0
    moved = np.linalg.norm(np.diff(point, axis=0, prepend=point[:1]), axis=1)
    origin = point[int(np.argmax(touched))]
    traces: Traces = {
        "time": run.time,
        "force": np.sum(outputs["contact_force"] * truth, axis=1),
        "error": np.abs(angle_between(estimate, truth)),
        "band": BAND * np.degrees(outputs["deviation"]),
        "mode": outputs["mode"],
        "status": outputs["status"],
        "travel": np.cumsum(np.where(touched, moved, 0.0)),
        "along": (point - origin) @ scenario.spatial_along,
        "curvature": np.array([curvature(wall, p) for p in point]),
        "across": (point - origin) @ scenario.spatial_up,
    }
    for i, axis in enumerate("xyz"):
        traces[f"point_{axis}"] = point[:, i]
        traces[f"normal_{axis}"] = estimate[:, i]
        traces[f"true_normal_{axis}"] = truth[:, i]
    for i, axis in enumerate("xyz"[:d]):
        traces[f"measured_force_{axis}"] = outputs["measured_force"][:, i]
    for i, name in enumerate(CONTACT_SIGNALS):
        traces[name] = outputs["contact"][:, i]
    for i, name in enumerate(arm.joint_names):
        traces[f"{name}.position"] = outputs["encoders"][:, i]
        traces[f"{name}.velocity"] = outputs["encoders"][:, n + i]
        traces[f"{name}.torque"] = outputs["torque"][:, i]
    return traces


def run_wall_trials(scenario: UnknownWallScenario, seed: int, progress: Progress) -> Outcome:
    """Run with as many seeds as the scenario asks for; the traces are of the first."""
    finished = run_each(partial(_run_trial, scenario, seed), range(scenario.trials), progress)
    first = finished.tasks[0]
    metrics = over_trials(finished.rows, QUANTITIES) | stability_metrics(stability(scenario))
    return Outcome(
        metrics=metrics,
        traces=table_of(finished.rows[0]) or run_wall(scenario, trial_seed(seed, first)),
        simulated_seconds=len(finished) * scenario.duration,
    )


def _run_trial(scenario: UnknownWallScenario, seed: int, trial: int) -> Row:
    traces = run_wall(scenario, trial_seed(seed, trial))
    task = scenario.task
    measured = wall_metrics(
        traces,
        force=task.force,
        after=scenario.measure_after,
        kick=task.kick_time,
        impact_limit=impact_speed_limit(task.nugget_mass),
    )
    return measured if trial else with_table(measured, traces)
