"""The exact solutions: matrix exponentials over one output step, in NumPy and SciPy alone."""

import numpy as np
from scipy.linalg import expm

from chamfer.analysis.benchmarks.case import Case, Samples


def exact_pid(case: Case) -> Samples:
    """Return the PID loop's output, m, at ``case.pid_time``.

    The state is position, velocity, integral of the error and filtered error; the step is a
    fifth state that stays constant.
    """
    m, b, k = case.mass_damping_stiffness
    p, i, d, n = case.gains
    loop = np.array(
        [
            [0.0, 1.0, 0.0, 0.0, 0.0],
            [-k / m, -(b + p + d * n) / m, i / m, -d * n / m, (p + d * n) / m],
            [0.0, -1.0, 0.0, 0.0, 1.0],
            [0.0, -n, 0.0, -n, n],
            [0.0, 0.0, 0.0, 0.0, 0.0],
        ]
    )
    step = expm(loop * (case.pid_time[1] - case.pid_time[0]))
    state = np.array([0.0, 0.0, 0.0, 0.0, case.amplitude])
    output = np.empty_like(case.pid_time)
    for row in range(len(output)):
        output[row] = state[1]
        state = step @ state
    return output


def exact_fsm(case: Case) -> Samples:
    """Return the FSM loop's output, m, at ``case.fsm_time``."""
    m, _, k = case.mass_damping_stiffness
    held = np.zeros((3, 3))
    held[:2, :2] = case.dynamics
    held[1, 2] = k / m
    step = expm(held * case.period)
    state = np.zeros(3)
    output = np.empty_like(case.fsm_time)
    for row in range(len(output)):
        output[row] = state[0]
        state[2] = case.compensate(float(state[2]), case.amplitude - float(state[0]))
        state = step @ state
    return output
