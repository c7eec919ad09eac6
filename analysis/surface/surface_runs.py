"""Runs of a gripper on an unknown surface: led along it, or controlled."""

import math
from functools import partial

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import run_each
from chamfer.analysis.campaign.trial_metrics import over_trials, trial_seed
from chamfer.analysis.campaign.trial_rows import Row, table_of, with_table
from chamfer.analysis.contact.contact_metrics import stability_metrics
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Outcome, Progress
from chamfer.analysis.surface.normal_metrics import (
    BAND,
    ESTIMATION,
    TRACKING,
    angle_between,
    estimation_metrics,
    normalised_square,
    tracking_metrics,
)
from chamfer.diagrams.surface.surface_estimation import EstimationScenario, make_estimation_diagram
from chamfer.diagrams.surface.surface_scenario import SurfaceScenario
from chamfer.diagrams.surface.surface_tracking import make_tracking_diagram
from chamfer.diagrams.surface.tracking_scenario import TrackingScenario
from chamfer.diagrams.surface.tracking_stability import tracking_stability
from chamfer.systems.estimation.instantaneous_normal import instantaneous_normal

Array = NDArray[np.float64]
Traces = dict[str, Array]


def run_estimation(scenario: EstimationScenario, seed: int) -> Traces:
    """Lead the gripper of a resolved scenario along the surface and return its traces.

    A row is a sample of the observer; the estimate is the one made with it. Columns: those of
    :func:`_observed`, and ``instantaneous`` deg, the single sample's normal (in the plane).
    """
    period = scenario.observer.period
    run = simulate(
        make_estimation_diagram(scenario),
        duration=_length(scenario.duration, period),
        step=period,
        seed=seed,
    )
    return _observed(scenario, run.time, run.outputs)


def run_tracking(scenario: TrackingScenario, seed: int) -> Traces:
    """Let the controller of a resolved scenario follow the surface and return its traces.

    A row is a period of the controller. Columns: those of :func:`_observed`, and ``effort_x`` and
    so on, N.
    """
    period = scenario.controller.period
    run = simulate(
        make_tracking_diagram(scenario),
        duration=_length(scenario.duration, period),
        step=period,
        seed=seed,
    )
    traces = _observed(scenario, run.time, run.outputs)
    for i, axis in enumerate("xyz"[: scenario.dimension]):
        traces[f"effort_{axis}"] = run.outputs["effort"][1:, i]
    return traces


def _length(duration: float, period: float) -> float:
    """Return how long to simulate, s, so that the last sample's estimate shows, a row later."""
    samples = math.floor(duration / period + 1e-9)
    return (samples + 1.5) * period  # rounding must not decide about the last row


def _observed(scenario: SurfaceScenario, time: Array, outputs: dict[str, Array]) -> Traces:
    """Return what all runs have in common.

    ``time`` s; ``force`` N, the normal component of the true force; ``error`` deg, the estimated
    normal's; ``band`` deg, three standard deviations; ``nees``, the normalised error squared;
    ``change`` deg, of the estimate since the start; ``angle``, ``true_angle`` and
    ``instantaneous`` deg, of the normals above the x axis (in the plane); ``status``; ``speed``
    m/s and ``point_x`` m and so on, of the contact point; ``nominal_x`` m and so on; ``normal_x``
    and ``true_normal_x`` and so on; ``measured_force_x`` N and so on, of the gripper on the
    surface; ``travel`` m, of the contact point along x.
    """
    d = scenario.dimension
    # What the observer makes of a sample shows up in the next row.
    normal, deviation = outputs["normal"][1:], outputs["deviation"][1:]
    covariance = outputs["covariance"][1:].reshape(-1, d, d)
    contact, force = outputs["contact"][:-1], outputs["contact_force"][:-1]
    point, velocity, truth = contact[:, :d], contact[:, d : 2 * d], contact[:, 2 * d : 3 * d]
    first = np.broadcast_to(scenario.up, normal.shape)
    traces = {
        "time": time[:-1],
        "force": np.sum(force * truth, axis=1),
        "error": angle_between(normal, truth),
        "band": BAND * np.degrees(deviation),
        "nees": normalised_square(normal, truth, covariance),
        "change": angle_between(normal, first),
        "status": outputs["status"][1:],
        "speed": np.linalg.norm(velocity, axis=1),
        "travel": point[:, 0],
    }
    if d == 2:
        traces["angle"] = np.degrees(np.arctan2(normal[:, 1], normal[:, 0]))
        traces["true_angle"] = traces["angle"] - traces["error"]
        traces["instantaneous"] = _instantaneous(scenario, outputs)[:-1]
    for i, axis in enumerate("xyz"[:d]):
        traces[f"point_{axis}"] = point[:, i]
        traces[f"nominal_{axis}"] = outputs["nominal_motion"][:-1, i]
        traces[f"normal_{axis}"] = normal[:, i]
        traces[f"true_normal_{axis}"] = truth[:, i]
        traces[f"measured_force_{axis}"] = outputs["measured_force"][:-1, i]
    return traces


def _instantaneous(scenario: SurfaceScenario, outputs: dict[str, Array]) -> Array:
    """Return the angle that each sample alone shows, deg; NaN where it shows none."""
    sensing = scenario.observer.sensing
    none = np.zeros(scenario.dimension)
    angles = []
    names = ("measured_force", "measured_force_rate", "nominal_motion")
    logs = (np.ascontiguousarray(outputs[name]) for name in names)
    for force, rate, motion in zip(*logs, strict=True):
        v = motion[scenario.dimension :] - sensing.compliance @ rate
        found, u = instantaneous_normal(-force, v, 1.0, sensing.velocity_noise, none)
        angles.append(np.degrees(np.arctan2(found[1], found[0])) if np.isfinite(u) else np.nan)
    return np.array(angles)


def run_estimation_trials(scenario: EstimationScenario, seed: int, progress: Progress) -> Outcome:
    """Run a scenario with as many seeds as it asks for; the traces are of the first."""
    finished = run_each(partial(_estimate, scenario, seed), range(scenario.trials), progress)
    first = finished.tasks[0]
    return Outcome(
        metrics=over_trials(finished.rows, ESTIMATION),
        traces=table_of(finished.rows[0]) or run_estimation(scenario, trial_seed(seed, first)),
        simulated_seconds=len(finished) * scenario.duration,
    )


def run_tracking_trials(scenario: TrackingScenario, seed: int, progress: Progress) -> Outcome:
    """Run a scenario with as many seeds as it asks for; the traces are of the first."""
    finished = run_each(partial(_track, scenario, seed), range(scenario.trials), progress)
    first = finished.tasks[0]
    return Outcome(
        metrics=over_trials(finished.rows, TRACKING)
        | stability_metrics(tracking_stability(scenario)),
        traces=table_of(finished.rows[0]) or run_tracking(scenario, trial_seed(seed, first)),
        simulated_seconds=len(finished) * scenario.duration,
    )


def _estimate(scenario: EstimationScenario, seed: int, trial: int) -> Row:
    traces = run_estimation(scenario, trial_seed(seed, trial))
    lead = scenario.lead  # the metrics' windows are of its motion along x
    moving = traces | {"time": traces["time"] - lead.begins}
    measured = estimation_metrics(moving, halt=lead.halt)
    return measured if trial else with_table(measured, traces)


def _track(scenario: TrackingScenario, seed: int, trial: int) -> Row:
    traces = run_tracking(scenario, trial_seed(seed, trial))
    every = round(scenario.observer.period / scenario.controller.period)
    measured = tracking_metrics(traces, force=scenario.task.force, every=every)
    return measured if trial else with_table(measured, traces)
