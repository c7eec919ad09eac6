"""What the compensator does for many settings, simulated, beside what the theorem guarantees."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pydrake.systems.primitives import LinearSystem

from analysis.run.simulate import simulate
from diagrams.servo.parallel_axes import make_parallel_axes_diagram
from systems.servo.compensator import AxisParams
from systems.vision.measured_error import MeasuredErrorParams

SETTLES, REVERSES, CYCLES, UNFINISHED = 0, 1, 2, 3
TICKS = 320  # of a trial
BATCH = 100  # axes simulated at once; the plants' matrix grows with the square
_QUIET = 0.25  # of a trial, at its end, without an action: it has come to rest


def classify(
    axes: Sequence[AxisParams],
    plant: LinearSystem,
    measurement: MeasuredErrorParams,
    *,
    trials: int,
    seed: int,
) -> NDArray[np.int64]:
    """Simulate settings from rest at random large errors and say what each does.

    The initial errors are uniform between one and one and a half times the large error, so that
    both increments are used and the last small one falls anywhere in the dead zone.

    Args:
        axes: The settings, n of them.
        plant: Continuous, with a DC gain.
        measurement: The camera.
        trials: Initial errors per setting.
        seed: For the initial errors and the camera's noise.

    Returns:
        The worst of each setting's trials, shape (n,): SETTLES, REVERSES (and then settles),
        CYCLES, or UNFINISHED where a trial was too short to tell.
    """
    generator = np.random.default_rng(seed)
    errors = np.array([axis.large_error for axis in axes])[:, None] * generator.uniform(
        1.0, 1.5, (len(axes), trials)
    )
    period = measurement.period
    all_axes = [axis for axis in axes for _ in range(trials)]
    reversed_, acting = np.empty(errors.size, dtype=bool), np.empty(errors.size, dtype=bool)
    for first in range(0, errors.size, BATCH):
        part = slice(first, first + BATCH)
        increments = simulate(
            make_parallel_axes_diagram(
                all_axes[part], plant, errors.ravel()[part], measurement, step=period
            ),
            duration=TICKS * period,
            step=period,
            seed=seed,
        ).outputs["increment"]
        increments = increments.reshape(len(increments), -1)
        reversed_[part] = np.any(increments < 0, axis=0)
        acting[part] = np.any(increments[int((1 - _QUIET) * len(increments)) :] != 0, axis=0)
    verdict = np.where(
        reversed_, np.where(acting, CYCLES, REVERSES), np.where(acting, UNFINISHED, SETTLES)
    )
    worst: NDArray[np.int64] = verdict.reshape(errors.shape).max(axis=1).astype(np.int64)
    return worst


@dataclass(frozen=True, kw_only=True)
class Oscillation:
    """The steady oscillation of one axis; NaN where it came to rest."""

    frequency: NDArray[np.float64]  # rad/s, shape (n,)
    amplitude: NDArray[np.float64]  # half of peak to peak, shape (n,)


def oscillation(
    axes: Sequence[AxisParams],
    plant: LinearSystem,
    measurement: MeasuredErrorParams,
    *,
    seed: int = 0,
) -> Oscillation:
    """Simulate settings from rest at their large error and measure how they keep oscillating."""
    period = measurement.period
    errors = np.array([axis.large_error for axis in axes])
    run = simulate(
        make_parallel_axes_diagram(axes, plant, errors, measurement, step=period / 8),
        duration=4 * TICKS * period,
        step=period / 8,
        seed=seed,
    )
    late = run.time >= run.time[-1] / 2
    time = run.time[late]
    frequency, amplitude = np.full(len(axes), np.nan), np.full(len(axes), np.nan)
    for i in range(len(axes)):
        if not np.any(run.outputs["increment"][late, i]):
            continue
        error = errors[i] - run.outputs["actual_trajectory"][late, i]
        middle = error - (error.max() + error.min()) / 2
        rising = np.flatnonzero((middle[:-1] < 0) & (middle[1:] >= 0))
        if len(rising) > 1:
            lasted = time[rising[-1]] - time[rising[0]]
            frequency[i] = 2 * np.pi * (len(rising) - 1) / lasted
            amplitude[i] = float(np.ptp(error)) / 2
    return Oscillation(frequency=frequency, amplitude=amplitude)
