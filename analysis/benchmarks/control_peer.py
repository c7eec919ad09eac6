"""python-control: linear blocks for the PID loop, a discrete nonlinear one for the FSM loop."""

from typing import Any

import control as ct
import numpy as np

from chamfer.analysis.benchmarks.case import Case, Samples
from chamfer.analysis.benchmarks.engine import Engine, LoopName


def engines(case: Case, loop: LoopName) -> list[Engine]:
    """Return the engine; both of its loops are exact at the samples."""
    return [_pid_engine(case) if loop == "pid" else _fsm_engine(case)]


def _pid_engine(case: Case) -> Engine:
    m = case.mass_damping_stiffness[0]
    p, i, d, n = case.gains

    def build() -> Any:
        plant = ct.ss(
            case.dynamics,
            [[0.0], [1.0 / m]],
            [[0.0, 1.0]],
            0.0,
            inputs="force",
            outputs="actual",
            name="plant",
        )
        controller = ct.ss(
            np.diag([0.0, -n]),
            [[1.0], [n]],
            [[i, -d * n]],
            p + d * n,
            inputs="error",
            outputs="force",
            name="controller",
        )
        vision = ct.summing_junction(["desired", "-actual"], "error", name="vision")
        return ct.interconnect([plant, controller, vision], inputs="desired", outputs="actual")

    def run(model: Any) -> Samples:
        response = ct.forced_response(model, case.pid_time, case.amplitude)
        return np.asarray(response.outputs, dtype=np.float64)

    return Engine(
        name="python-control",
        build=build,
        run=run,
        accuracy=1e-10,
        note="interconnect, forced_response (exact)",
    )


def _fsm_engine(case: Case) -> Engine:
    m, _, k = case.mass_damping_stiffness
    desired = np.full_like(case.fsm_time, case.amplitude)

    def law(_time: float, state: Samples, error: Samples, _params: object) -> list[float]:
        return [case.compensate(float(state[0]), float(error[0]))]

    def build() -> Any:
        continuous = ct.ss(case.dynamics, [[0.0], [k / m]], [[1.0, 0.0]], 0.0)
        sampled = ct.sample_system(continuous, case.period, "zoh")
        plant = ct.ss(sampled, inputs="command", outputs="actual", name="plant")
        controller = ct.nlsys(
            law,
            law,
            inputs="error",
            outputs="command",
            states=1,
            dt=case.period,
            name="controller",
        )
        vision = ct.summing_junction(
            ["desired", "-actual"], "error", name="vision", dt=case.period
        )
        return ct.interconnect(
            [plant, controller, vision], inputs="desired", outputs="actual", dt=case.period
        )

    def run(model: Any) -> Samples:
        response = ct.input_output_response(model, case.fsm_time, desired)
        return np.asarray(response.outputs, dtype=np.float64)

    return Engine(
        name="python-control",
        build=build,
        run=run,
        accuracy=1e-10,
        note="all discrete at the tick, plant by zero-order hold (exact)",
    )
