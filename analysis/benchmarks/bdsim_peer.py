"""bdsim: block diagrams on SciPy's integrators."""

import io
from contextlib import redirect_stdout
from typing import Any, NamedTuple

import bdsim
import numpy as np

from chamfer.analysis.benchmarks.case import Case, Samples
from chamfer.analysis.benchmarks.engine import Engine, LoopName

_RTOL, _ATOL = 1e-6, 1e-9


class _Model(NamedTuple):
    runtime: Any
    diagram: Any
    plant: Any


def engines(case: Case, loop: LoopName) -> list[Engine]:
    """Return the engine."""
    return [_pid_engine(case) if loop == "pid" else _fsm_engine(case)]


def _make_runtime() -> Any:
    # It says on standard output which toolboxes it did not find.
    with redirect_stdout(io.StringIO()):
        return bdsim.BDSim(sysargs=False, banner=False, graphics=False, progress=False, quiet=True)


def _run(model: _Model, case: Case, solver: str, step: float | None) -> tuple[Samples, Samples]:
    with redirect_stdout(io.StringIO()):
        result = model.runtime.run(
            model.diagram,
            case.duration,
            dt=step,
            solver=solver,
            solver_args={"rtol": _RTOL, "atol": _ATOL},
            watch=[model.plant],
        )
    return np.asarray(result.t, dtype=np.float64), np.asarray(result.y, dtype=np.float64).ravel()


def _pid_engine(case: Case) -> Engine:
    m = case.mass_damping_stiffness[0]
    p, i, d, n = case.gains

    def build() -> _Model:
        runtime = _make_runtime()
        diagram = runtime.blockdiagram()
        desired = diagram.CONSTANT(case.amplitude)
        vision = diagram.SUM("+-")
        proportional = diagram.GAIN(p)
        integral = diagram.INTEGRATOR(gain=i)
        unfiltered = diagram.SUM("+-")
        bandwidth = diagram.GAIN(n)
        filtered = diagram.INTEGRATOR()
        derivative = diagram.GAIN(d * n)
        force = diagram.SUM("+++")
        plant = diagram.LTI_SS(
            A=case.dynamics,
            B=np.array([[0.0], [1.0 / m]]),
            C=np.array([[0.0, 1.0]]),
            x0=np.zeros(2),
        )
        diagram.connect(desired, vision[0])
        diagram.connect(plant, vision[1])
        diagram.connect(vision, proportional, integral, unfiltered[0])
        diagram.connect(filtered, unfiltered[1])
        diagram.connect(unfiltered, bandwidth, derivative)
        diagram.connect(bandwidth, filtered)
        diagram.connect(proportional, force[0])
        diagram.connect(integral, force[1])
        diagram.connect(derivative, force[2])
        diagram.connect(force, plant)
        diagram.compile()
        return _Model(runtime, diagram, plant)

    def run(model: _Model) -> Samples:
        return _run(model, case, "LSODA", float(case.pid_time[1]))[1]

    return Engine(
        name="bdsim",
        build=build,
        run=run,
        accuracy=1e-6,
        note=f"LSODA, faster than Radau and BDF, rtol {_RTOL:g}",
    )


def _fsm_engine(case: Case) -> Engine:
    m, _, k = case.mass_damping_stiffness

    def build() -> _Model:
        runtime = _make_runtime()
        diagram = runtime.blockdiagram()
        clock = diagram.clock(case.period, "s")
        desired = diagram.CONSTANT(case.amplitude)
        vision = diagram.SUM("+-")
        law = diagram.FUNCTION(case.compensate, nin=2)
        # Its clocks skip the tick at t = 0: the hold starts with what that tick would have given.
        hold = diagram.ZOH(clock, x0=[case.compensate(0.0, case.amplitude)])
        plant = diagram.LTI_SS(
            A=case.dynamics,
            B=np.array([[0.0], [k / m]]),
            C=np.array([[1.0, 0.0]]),
            x0=np.zeros(2),
        )
        diagram.connect(desired, vision[0])
        diagram.connect(plant, vision[1])
        diagram.connect(hold, law[0])
        diagram.connect(vision, law[1])
        diagram.connect(law, hold)
        diagram.connect(hold, plant)
        diagram.compile()
        return _Model(runtime, diagram, plant)

    def run(model: _Model) -> Samples:
        time, output = _run(model, case, "RK45", None)
        return output[np.searchsorted(time, case.fsm_time - 1e-9)]

    return Engine(
        name="bdsim",
        build=build,
        run=run,
        accuracy=1e-6,
        note=f"RK45, rtol {_RTOL:g}, tick at t = 0 put into the initial state",
    )
