"""Several observers on the same data: slides simulated once, with many seeds of noise."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from time import process_time
from typing import Any

import numpy as np
from numpy.typing import NDArray

from chamfer.analysis.campaign.campaign import Trials
from chamfer.analysis.campaign.trial_rows import Row
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.scenario.experiment import Table, column
from chamfer.analysis.surface.normal_metrics import (
    DEVIATIONS,
    angle_between,
    errors,
    normalised_square,
)
from chamfer.diagrams.surface.surface_estimation import (
    EstimationScenario,
    ResolvedEstimationScenario,
    make_estimation_diagram,
    resolve_estimation,
)
from chamfer.diagrams.surface.surface_scenario import ObserverSettings, ResolvedObserverSettings
from chamfer.models.surfaces.surface import normal
from chamfer.systems.estimation.normal_filter import NormalFilter, Sample, tangential_deviation
from chamfer.systems.estimation.surface_observer_law import make_filter
from chamfer.systems.sensing.force_rate import ForceRateParams, ForceRateSensorParams

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True)
class Slide:
    """A noise-free slide, a row a sample; d dimensions, world frame."""

    time: Array  # (n,), s
    force: Array  # (n, d), N, of the surface on the gripper
    force_rate: Array  # (n, d), N/s
    nominal: Array  # (n, 2d), m and m/s
    normal: Array  # (n, d), the true one


def slide(scenario: ResolvedEstimationScenario) -> Slide:
    """Simulate the contact without noise."""
    silent = ForceRateSensorParams(force_noise=0.0, force_rate_noise=0.0)
    quiet = replace(scenario, sensor=silent, force_delay=0.0, force_rate=None)
    diagram, d = make_estimation_diagram(quiet), scenario.dimension
    run = simulate(diagram, duration=scenario.duration, step=scenario.observer.period)
    # Logs have a column a time; compiled code wants each sample in one piece.
    force, rate, nominal, contact = (
        np.ascontiguousarray(run.outputs[name])
        for name in ("measured_force", "measured_force_rate", "nominal_motion", "contact")
    )
    return Slide(
        time=run.time,
        force=-force,
        force_rate=-rate,
        nominal=nominal,
        normal=contact[:, 2 * d : 3 * d],
    )


@dataclass(frozen=True, kw_only=True)
class Contender:
    """A filter, and its predicted normals, shape (n, d), if any."""

    filter: NormalFilter
    predicted: Array | None
    first: int = 0  # the sample that it begins with


def observer_of(scenario: EstimationScenario, given: ObserverSettings) -> ResolvedObserverSettings:
    """Return an observer with its settings in a scenario."""
    return resolve_estimation(replace(scenario, observer=given)).observer


def contender(scenario: EstimationScenario, given: ObserverSettings, on: Slide) -> Contender:
    """Return the filter that a scenario's observer runs, for a slide."""
    predicted = None
    if given.prediction is not None:
        seen = given.prediction.make()
        predicted = np.array([normal(seen, p[: scenario.dimension]) for p in on.nominal])
    observer = observer_of(scenario, given)
    # Hovering and pressing are of use to those that know of it.
    calibrated = observer.model_error.tare or observer.model_error.press
    first = 0 if calibrated else round(scenario.lead.begins / observer.period)
    return Contender(filter=make_filter(observer), predicted=predicted, first=first)


def sensed(
    on: Slide,
    sensor: ForceRateSensorParams,
    random: np.random.Generator,
    *,
    late: int = 0,
    differenced: ForceRateParams | None = None,
) -> tuple[Array, Array]:
    """Return force, N, and its rate, N/s, shape (n, d), at a sensor's output.

    Both are ``late``, samples; the rate is ``differenced``, or measured if that is None.
    """
    u, u_dot = sensor.force_noise / math.sqrt(3), sensor.force_rate_noise / math.sqrt(3)
    rows = np.maximum(np.arange(len(on.time)) - late, 0)
    force = on.force[rows] + u * random.standard_normal(on.force.shape)
    rate = on.force_rate[rows] + u_dot * random.standard_normal(on.force.shape)
    if sensor.bias is not None:
        force = force + np.array(sensor.bias)
    if differenced is not None:
        period = float(on.time[1] - on.time[0])
        share, filtered = differenced.share(period), np.zeros(force.shape[1])
        for measured, row in zip(force, rate, strict=True):
            step = share * (measured - filtered)
            filtered, row[:] = filtered + step, step / period
    return force, rate


def run_trial(
    on: Slide,
    contenders: Sequence[Contender],
    measured: Mapping[str, str],
    shown: tuple[Array, Array],
    *,
    up: Array,
    window: tuple[float, float],
) -> Row:
    """Give each contender the same slide and return its errors in a window of time.

    Args:
        on: The slide.
        contenders: The observers.
        measured: By column of the row, shape (observers,), which error of
            :func:`chamfer.analysis.surface.normal_metrics.errors` it has.
        shown: Force and rate as :func:`sensed` returns them.
        up: First estimate of the normal, shape (d,).
        window: s, from and up to.
    """
    found = [_errors(on, one, shown, up, window) for one in contenders]
    return {
        name: np.array([one[of] for one in found], dtype=np.float64)
        for name, of in measured.items()
    }


def table_of_observers(finished: Trials[Any], count: int, **of_trial: Sequence[int]) -> Table:
    """Return a row for each trial and observer: the trial, the observer, the measurements."""
    return {
        **{name: column(np.repeat(values, count)) for name, values in of_trial.items()},
        "observer": column(np.tile(np.arange(count), len(finished))),
        **{
            name: column(np.concatenate([row[name] for row in finished.rows]))
            for name in finished.rows[0]
        },
    }


def samples_of(
    on: Slide, observer: Contender, shown: tuple[Array, Array], first: int
) -> list[Sample]:
    """Return an observer's inputs from a sample on."""
    d = on.force.shape[1]
    known = [None] * len(on.time) if observer.predicted is None else list(observer.predicted)
    rows = zip(*shown, on.nominal[:, :d], on.nominal[:, d:], known, strict=True)
    return [Sample(*row) for row in rows][first:]


def _errors(
    on: Slide,
    observer: Contender,
    shown: tuple[Array, Array],
    up: Array,
    window: tuple[float, float],
) -> Mapping[str, float | None]:
    count, d = on.force.shape
    memory = observer.filter.start(up)
    normals, covariances = np.tile(up, (count, 1)), np.tile(np.eye(d), (count, 1, 1))
    bands = np.full(count, math.inf)
    for k, sample in enumerate(samples_of(on, observer, shown, observer.first), observer.first):
        found = observer.filter.update(memory, sample)
        memory, normals[k], covariances[k] = found.memory, found.normal, found.covariance
        bands[k] = tangential_deviation(found.normal, found.covariance)
    traces = {
        "time": on.time,
        "error": angle_between(normals, on.normal),
        "band": DEVIATIONS * np.degrees(bands),
        "nees": normalised_square(normals, on.normal, covariances),
    }
    return errors(traces, window, largest=window)


def cost(observer: Contender, on: Slide, *, up: Array, updates: int) -> float:
    """Return the time that an update takes, s, the least of a few rounds."""
    samples = samples_of(on, observer, (on.force, on.force_rate), len(on.time) // 2)
    best = math.inf
    for _ in range(max(1, updates // len(samples))):
        memory = observer.filter.start(up)
        begin = process_time()
        for sample in samples:
            memory = observer.filter.update(memory, sample).memory
        best = min(best, (process_time() - begin) / len(samples))
    return best
