"""pathsim: block diagrams with an integrator in every block."""

from typing import Any, NamedTuple

import numpy as np
from pathsim import Connection, Simulation
from pathsim.blocks import PID, Adder, Constant, Scope, StateSpace, Wrapper
from pathsim.solvers import GEAR52A, RKDP54

from chamfer.analysis.benchmarks.case import Case, Samples
from chamfer.analysis.benchmarks.engine import Engine, LoopName


class _Model(NamedTuple):
    simulation: Any
    scope: Any


def engines(case: Case, loop: LoopName) -> list[Engine]:
    """Return the engine."""
    return [_pid_engine(case) if loop == "pid" else _fsm_engine(case)]


def _make_model(
    case: Case, controller: Any, plant: Any, *, solver: Any, step: float, rtol: float
) -> _Model:
    desired = Constant(case.amplitude)
    vision = Adder("+-")
    scope = Scope(sampling_period=step)
    simulation = Simulation(
        [desired, vision, controller, plant, scope],
        [
            Connection(desired, vision[0]),
            Connection(plant, vision[1], scope),
            Connection(vision, controller),
            Connection(controller, plant),
        ],
        Solver=solver,
        dt=step,
        dt_max=step,
        tolerance_lte_rel=rtol,
        tolerance_lte_abs=1e-3 * rtol,
        log=False,
    )
    return _Model(simulation, scope)


def _run(model: _Model, case: Case) -> Samples:
    model.simulation.run(case.duration)
    _, output = model.scope.read()
    return np.asarray(output, dtype=np.float64).ravel()


def _pid_engine(case: Case) -> Engine:
    m = case.mass_damping_stiffness[0]
    p, i, d, n = case.gains

    def build() -> _Model:
        plant = StateSpace(
            A=case.dynamics,
            B=np.array([[0.0], [1.0 / m]]),
            C=np.array([[0.0, 1.0]]),
            D=np.zeros((1, 1)),
        )
        controller = PID(Kp=p, Ki=i, Kd=d, f_max=n)
        step = float(case.pid_time[1])
        return _make_model(case, controller, plant, solver=GEAR52A, step=step, rtol=1e-5)

    return Engine(
        name="pathsim",
        build=build,
        run=lambda model: _run(model, case),
        accuracy=1e-6,
        note="GEAR52A, rtol 1e-05",
    )


def _fsm_engine(case: Case) -> Engine:
    m, _, k = case.mass_damping_stiffness

    def build() -> _Model:
        plant = StateSpace(
            A=case.dynamics,
            B=np.array([[0.0], [k / m]]),
            C=np.array([[1.0, 0.0]]),
            D=np.zeros((1, 1)),
        )
        compensation = 0.0

        def tick(error: float) -> float:
            nonlocal compensation
            compensation = case.compensate(compensation, float(error))
            return compensation

        controller = Wrapper(tick, T=case.period)
        return _make_model(case, controller, plant, solver=RKDP54, step=case.period, rtol=1e-6)

    return Engine(
        name="pathsim",
        build=build,
        run=lambda model: _run(model, case),
        accuracy=1e-6,
        note="RKDP54, rtol 1e-06",
    )
