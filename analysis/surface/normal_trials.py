"""Several observers on the same data: slides that are simulated once, with many seeds of noise."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from time import perf_counter
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
from chamfer.systems.estimation.surface_observer import make_filter
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
    run = simulate(
        make_estimation_diagram(quiet),
        duration=scenario.duration,
        step=scenario.observer.period,
    )
    d = scenario.dimension
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
    """A filter, and the normals it is told to expect, shape (n, d), if any."""

    filter: NormalFilter
    predicted: Array | None
    first: int = 0  # the sample that it begins with


def observer_of(scenario: EstimationScenario, given: ObserverSettings) -> ResolvedObserverSettings:
    """Return an observer with what it is told in a scenario."""
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


@dataclass(frozen=True, kw_only=True)
class SensorFault:
    """What happens to a sensor's force and rate before an observer gets them."""

    late: int = 0  # samples that force and rate come late
    rate: ForceRateParams | None = None  # None: the sensor gives the rate; else it is differenced


def sensed(
    on: Slide, sensor: ForceRateSensorParams, random: np.random.Generator, fault: SensorFault
) -> tuple[Array, Array]:
    """Return force, N, and its rate, N/s, shape (n, d), as a sensor shows them."""
    u, u_dot = sensor.force_noise / math.sqrt(3), sensor.force_rate_noise / math.sqrt(3)
    rows = np.maximum(np.arange(len(on.time)) - fault.late, 0)
    force = on.force[rows] + u * random.standard_normal(on.force.shape)
    rate = on.force_rate[rows] + u_dot * random.standard_normal(on.force.shape)
    if sensor.bias is not None:
        force = force + np.array(sensor.bias)
    if fault.rate is not None:
        period = float(on.time[1] - on.time[0])
        share, filtered = fault.rate.share(period), np.zeros(force.shape[1])
        for measured, row in zip(force, rate, strict=True):
            step = share * (measured - filtered)
            filtered, row[:] = filtered + step, step / period
    return force, rate


def run_trial(
    on: Slide,
    contenders: Sequence[Contender],
    measured: Mapping[str, str],
    *,
    up: Array,
    sensor: ForceRateSensorParams,
    random: np.random.Generator,
    window: tuple[float, float],
    fault: SensorFault = SensorFault(),
) -> Row:
    """Give each contender the same noisy slide and return its errors in a window of time.

    Args:
        on: The slide.
        contenders: The observers.
        measured: By column of the row, shape (observers,), which error of
            :func:`chamfer.analysis.surface.normal_metrics.errors` it has.
        up: First estimate of the normal, shape (d,).
        sensor: What adds noise and bias.
        random: Where the noise comes from.
        window: s, from and up to.
        fault: What else is wrong with the sensor.
    """
    force, rate = sensed(on, sensor, random, fault)
    found = [_errors(on, one, force, rate, up, window) for one in contenders]
    return {
        name: np.array([one[of] for one in found], dtype=np.float64)
        for name, of in measured.items()
    }


def table_of_observers(finished: Trials[Any], count: int, **of_trial: Sequence[int]) -> Table:
    """Return a row a trial and observer: what is of the trial, the observer, what was measured."""
    return {
        **{name: column(np.repeat(values, count)) for name, values in of_trial.items()},
        "observer": column(np.tile(np.arange(count), len(finished))),
        **{
            name: column(np.concatenate([row[name] for row in finished.rows]))
            for name in finished.rows[0]
        },
    }


def _errors(
    on: Slide,
    observer: Contender,
    force: Array,
    rate: Array,
    up: Array,
    window: tuple[float, float],
) -> Mapping[str, float | None]:
    d = len(up)
    memory = observer.filter.start(up)
    normals = np.tile(up, (len(force), 1))
    covariances = np.tile(np.eye(d), (len(force), 1, 1))
    bands = np.full(len(force), math.inf)
    for k in range(observer.first, len(force)):
        predicted = observer.predicted[k] if observer.predicted is not None else None
        sample = Sample(force[k], rate[k], on.nominal[k, :d], on.nominal[k, d:], predicted)
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
    d = len(up)
    rows = range(len(on.time) // 2, len(on.time))
    samples = [
        Sample(
            on.force[k],
            on.force_rate[k],
            on.nominal[k, :d],
            on.nominal[k, d:],
            observer.predicted[k] if observer.predicted is not None else None,
        )
        for k in rows
    ]
    best = math.inf
    for _ in range(max(1, updates // len(samples))):
        memory = observer.filter.start(up)
        begin = perf_counter()
        for sample in samples:
            memory = observer.filter.update(memory, sample).memory
        best = min(best, (perf_counter() - begin) / len(samples))
    return best
