"""The servo loops as machine code: for maps and sweeps, of ten thousand trials and more.

What the diagrams of :mod:`chamfer.diagrams.servo.servo_loops` do with exact steps, to 1e-12, at
the same times and with the same seed; a trial of a map takes a thousandth of the time. The
diagrams are the reference, and what a single run is made with. The compensator's guards and
actions and what the camera makes of an error are the blocks' own functions, compiled; plant and
trajectory are discretised as the diagrams' are. Written a second time is the wiring of Figs. 6 and
7, and in which order things happen at a tick.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydrake.common import RandomDistribution
from pydrake.systems.analysis import DiscreteTimeApproximation
from scipy.linalg import block_diag

from chamfer.diagrams.servo.servo_scenario import ServoScenario, fsm_axis, has_feedforward
from chamfer.models.plants.servo_plant import Form
from chamfer.models.validation import ParameterError
from chamfer.systems.compiled import compiled
from chamfer.systems.exact_discretisation import count_samples
from chamfer.systems.sensing.drawn_noise import drawn_noise
from chamfer.systems.servo.compensator_law import (
    AxisParams,
    class_increment,
    error_class,
    is_measured,
    limited_sum,
)
from chamfer.systems.servo.desired_trajectory import make_desired_trajectory
from chamfer.systems.servo.servo_plant import make_spring_mass_damper
from chamfer.systems.vision.measured_error import seen

Array = NDArray[np.float64]

_seen = compiled(seen)
_class_increment = compiled(class_increment)
_error_class = compiled(error_class)
_is_measured = compiled(is_measured)
_limited_sum = compiled(limited_sum)


@compiled
def compensate(
    compensation: float,
    error: float,
    dead_zone: float,
    large_error: float,
    increment: float,
    divider: float,
    limit: float,
) -> tuple[float, float]:
    """Run one tick of Figs. 3 and 4 with the parameters of an axis.

    An error that is NaN, as nothing was measured, holds the total ``compensation``. Returned are
    the new one, and the increment that the tick asked for before the limit.
    """
    if not _is_measured(error):
        return compensation, 0.0
    asked = _class_increment(_error_class(error, dead_zone, large_error), increment, divider)
    return _limited_sum(compensation, asked, limit), asked


class FsmTrials(NamedTuple):
    """The results of n trials of the FSM loop: the diagram's outputs at m times, and t ticks."""

    time: Array  # s, shape (m,)
    desired_trajectory: Array  # m, shape (n, m)
    controller: Array  # the compensation, m or N, shape (n, m)
    actual_trajectory: Array  # m, shape (n, m)
    increment: Array  # what each tick asked for, before the limit, shape (n, t)


def run_fsm_trials(
    scenario: ServoScenario,
    form: Form,
    *,
    duration: float,
    step: float,
    axes: Sequence[AxisParams] | None = None,
    amplitudes: Array | None = None,
    feedforward: bool | None = None,
    seed: int = 0,
) -> FsmTrials:
    """Run Fig. 7 for many settings of the compensator and heights of the desired trajectory.

    Args:
        scenario: Plant, camera, period and trajectory, which are the same for all.
        form: Of the plant.
        duration: s, of a trial.
        step: s, of the outputs; the FSM's period is a multiple of it.
        axes: A setting per trial, n of them; None: the scenario's, once.
        amplitudes: Of the desired trajectory, m, shape (n,); None: the scenario's for all.
        feedforward: As of :func:`chamfer.diagrams.servo.servo_loops.make_fsm_loop`.
        seed: Of the camera's noise, which one source of Drake's draws for all trials: a single
            trial sees what the diagram of one loop sees with that seed.

    Raises:
        ParameterError: If the FSM's period is not a multiple of the step, or the output is not
            finite.
        ValueError: If there are not as many amplitudes as axes.
    """
    axes = [fsm_axis(scenario, form)] if axes is None else axes
    heights = np.broadcast_to(
        scenario.desired.amplitude if amplitudes is None else amplitudes, len(axes)
    )
    if feedforward is None:
        feedforward = has_feedforward(scenario)
    period = scenario.fsm.period
    substeps = round(period / step)
    if substeps < 1 or abs(substeps * step - period) > 1e-9 * period:
        raise ParameterError("step", step, f"the FSM's period, {period:g} s, over a whole number")
    rows = count_samples(duration, step)
    camera = scenario.measurement
    ticks = -(-(rows - 1) // substeps)
    # Trajectory, of 1 m, and plant beside each other, with exact steps.
    unit = make_desired_trajectory(replace(scenario.desired, amplitude=1.0))
    samples, shape = np.empty((0, 0)), (ticks + 1, len(axes))
    if camera.noise:
        before = make_desired_trajectory(scenario.desired)
        (samples,) = drawn_noise((RandomDistribution.kUniform, shape), after=before, seed=seed)
    start = unit.CreateDefaultContext().get_continuous_state_vector().CopyToVector()
    trajectory = DiscreteTimeApproximation(unit, step)
    plant = DiscreteTimeApproximation(make_spring_mass_damper(scenario.plant, form), step)
    trials = FsmTrials(
        step * np.arange(rows, dtype=np.float64),
        *_run(
            np.array(
                [(a.dead_zone, a.large_error, a.increment, a.divider, a.limit) for a in axes],
                dtype=np.float64,
            ),
            np.outer(heights, np.concatenate([start, np.zeros(len(plant.A()))])),
            block_diag(trajectory.A(), plant.A()),
            np.concatenate([np.zeros_like(start), plant.B()[:, 0]]),
            block_diag(trajectory.C(), plant.C()),
            samples,
            float(camera.noise),
            float(camera.resolution),
            camera.delay_samples,
            feedforward and form == "position",
            rows,
            substeps,
        ),
    )
    actual = trials.actual_trajectory
    if not np.isfinite(actual).all():
        unbounded = float(actual[~np.isfinite(actual)][0])
        allowed = "finite numbers, these parameters make it overflow"
        raise ParameterError("actual_trajectory", unbounded, allowed)
    return trials


@compiled
def _run(
    axes: Array,
    starts: Array,
    matrix: Array,
    column: Array,
    output: Array,
    samples: Array,
    noise: float,
    resolution: float,
    delay: int,
    feedforward: bool,
    rows: int,
    substeps: int,
) -> tuple[Array, Array, Array, Array]:
    """Run every trial; see :func:`run_fsm_trials`.

    The order at a tick is that of the diagram: a row shows what was before it; the compensator
    acts; the camera exposes what it will show later, with the sample that the noise source, which
    steps when the compensator acts, has moved on to; plant and trajectory step.
    """
    trials, size = starts.shape
    ticks = -(-(rows - 1) // substeps)
    desired, actual = np.empty((trials, rows)), np.empty((trials, rows))
    controller, increment = np.empty((trials, rows)), np.empty((trials, ticks))
    on_the_way, following = np.empty(delay), np.empty(size)
    for i in range(trials):
        state, total, command = starts[i], 0.0, 0.0
        on_the_way[:] = np.nan
        for row in range(rows):
            goal, position = _dot(output[0], state), _dot(output[1], state)
            desired[i, row], controller[i, row], actual[i, row] = goal, total, position
            if row == rows - 1:
                break
            tick = row // substeps
            if row == tick * substeps:
                sample = samples[tick + min(delay, 1), i] if noise else 0.0
                error = _seen(goal - position, sample, noise, resolution)
                if delay:
                    place = tick % delay
                    error, on_the_way[place] = on_the_way[place], error
                dead_zone, large_error, step, divider, limit = axes[i]
                total, increment[i, tick] = compensate(
                    total, error, dead_zone, large_error, step, divider, limit
                )
                command = total + goal if feedforward else total
            for j in range(size):
                following[j] = _dot(matrix[j], state) + column[j] * command
            state[:] = following
    return desired, controller, actual, increment


@compiled
def _dot(row: Array, column: Array) -> float:
    total = 0.0
    for i in range(len(row)):
        total += row[i] * column[i]
    return total
