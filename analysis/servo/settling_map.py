"""What the compensator does for many settings, simulated, beside what the theorem guarantees."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from chamfer.diagrams.servo.compiled_loop import run_fsm_trials
from chamfer.diagrams.servo.servo_scenario import StepScenario
from chamfer.systems.servo.compensator import AxisParams

SETTLES, REVERSES, CYCLES, UNFINISHED = 0, 1, 2, 3
TICKS = 320  # of a trial
_QUIET = 0.25  # of a trial, at its end, without an action: it has come to rest


def classify(
    axes: Sequence[AxisParams], scenario: StepScenario, *, trials: int, seed: int
) -> NDArray[np.int64]:
    """Simulate settings from rest at random large errors and say what each does.

    The initial errors are uniform between one and one and a half times the large error, so that
    both increments are used and the last small one falls anywhere in the dead zone.

    Args:
        axes: The settings, n of them.
        scenario: Its plant, in the position form, and its camera.
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
    period = scenario.fsm.period
    increments = run_fsm_trials(
        replace(scenario, duration=TICKS * period, step=period),
        "position",
        axes=[axis for axis in axes for _ in range(trials)],
        amplitudes=errors.ravel(),
        feedforward=False,
        seed=seed,
    ).increment
    reversed_ = np.any(increments < 0, axis=1)
    acting = np.any(increments[:, int((1 - _QUIET) * TICKS) :] != 0, axis=1)
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
    axes: Sequence[AxisParams], scenario: StepScenario, *, seed: int = 0
) -> Oscillation:
    """Simulate settings from rest at their large error and measure how they keep oscillating.

    Plant, in the position form, and camera are the scenario's.
    """
    period = scenario.fsm.period
    errors = np.array([axis.large_error for axis in axes])
    run = run_fsm_trials(
        replace(scenario, duration=4 * TICKS * period, step=period / 8),
        "position",
        axes=axes,
        amplitudes=errors,
        feedforward=False,
        seed=seed,
    )
    late = run.time >= run.time[-1] / 2
    time = run.time[late]
    acting = np.any(run.increment[:, 2 * TICKS :], axis=1)
    frequency, amplitude = np.full(len(axes), np.nan), np.full(len(axes), np.nan)
    for i in np.flatnonzero(acting):
        error = errors[i] - run.actual_trajectory[i, late]
        middle = error - (error.max() + error.min()) / 2
        rising = np.flatnonzero((middle[:-1] < 0) & (middle[1:] >= 0))
        if len(rising) > 1:
            lasted = time[rising[-1]] - time[rising[0]]
            frequency[i] = 2 * np.pi * (len(rising) - 1) / lasted
            amplitude[i] = float(np.ptp(error)) / 2
    return Oscillation(frequency=frequency, amplitude=amplitude)
