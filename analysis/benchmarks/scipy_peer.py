"""SciPy: the loops as functions, without any block diagram."""

import numpy as np
from scipy.integrate import odeint, solve_ivp

from chamfer.analysis.benchmarks.case import Case, Samples
from chamfer.analysis.benchmarks.engine import Engine, LoopName

_RTOL, _ATOL = 1e-6, 1e-8


def engines(case: Case, loop: LoopName) -> list[Engine]:
    """Return LSODA by both of its interfaces, or the FSM's plant integrated tick by tick."""
    return _pid_engines(case) if loop == "pid" else [_fsm_engine(case)]


def _pid_engines(case: Case) -> list[Engine]:
    m, b, k = case.mass_damping_stiffness
    p, i, d, n = case.gains
    desired, start = case.amplitude, [0.0, 0.0, 0.0, 0.0]

    def derivative(_time: float, state: Samples) -> list[float]:
        position, velocity, integral, filtered = state.tolist()
        error = desired - velocity
        force = p * error + i * integral + d * n * (error - filtered)
        acceleration = (force - b * velocity - k * position) / m
        return [velocity, acceleration, error, n * (error - filtered)]

    def run_odeint(_model: None) -> Samples:
        states = odeint(derivative, start, case.pid_time, tfirst=True, rtol=_RTOL, atol=_ATOL)
        return np.asarray(states[:, 1], dtype=np.float64)

    def run_solve_ivp(_model: None) -> Samples:
        solution = solve_ivp(
            derivative,
            (0.0, float(case.pid_time[-1])),
            start,
            method="LSODA",
            t_eval=case.pid_time,
            rtol=_RTOL,
            atol=_ATOL,
        )
        return np.asarray(solution.y[1], dtype=np.float64)

    return [
        Engine(
            name=f"SciPy LSODA, {interface}",
            build=lambda: None,
            run=run,
            accuracy=1e-6,
            note=f"hand-written equations, rtol {_RTOL:g}",
        )
        for interface, run in (("odeint", run_odeint), ("solve_ivp", run_solve_ivp))
    ]


def _fsm_engine(case: Case) -> Engine:
    m, b, k = case.mass_damping_stiffness

    def run(_model: None) -> Samples:
        state, compensation = np.zeros(2), 0.0
        output = np.zeros_like(case.fsm_time)

        def derivative(_time: float, state: Samples) -> list[float]:
            position, velocity = state.tolist()
            return [velocity, (k * (compensation - position) - b * velocity) / m]

        for row in range(1, len(output)):
            compensation = case.compensate(compensation, case.amplitude - float(state[0]))
            solution = solve_ivp(derivative, (0.0, case.period), state, rtol=_RTOL, atol=_ATOL)
            state = solution.y[:, -1]
            output[row] = state[0]
        return output

    return Engine(
        name="SciPy RK45 per tick",
        build=lambda: None,
        run=run,
        accuracy=1e-6,
        note=f"solve_ivp, hand-written equations, rtol {_RTOL:g}",
    )
