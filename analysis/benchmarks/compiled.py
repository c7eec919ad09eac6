"""Chamfer's compiled loops: what a trial of a map or a sweep takes."""

from dataclasses import replace

import numpy as np
from pydrake.systems.primitives import LinearSystem

from chamfer.analysis.benchmarks.case import Case, Samples
from chamfer.analysis.benchmarks.engine import Engine, LoopName
from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.servo.compiled_loop import fuse_pid_loop, run_fsm_trials
from chamfer.diagrams.servo.servo_scenario import fsm_axis

NAME = "Chamfer, compiled"
_TRIALS = 1000


def engines(case: Case, loop: LoopName) -> list[Engine]:
    """Return the engine: FSM loops by the thousand, PID loops one by one."""
    return [_pid_engine(case) if loop == "pid" else _fsm_engine(case)]


def _pid_engine(case: Case) -> Engine:
    step = float(case.pid_time[1])

    def run(loop: LinearSystem) -> Samples:
        output: Samples = simulate(loop, duration=case.duration, step=step).outputs["y0"][:, -1]
        return output

    return Engine(
        name=NAME,
        build=lambda: fuse_pid_loop(case.scenario, "velocity"),
        run=run,
        accuracy=1e-10,
        note="fused by hand, solved by matrix powers",
    )


def _fsm_engine(case: Case) -> Engine:
    scenario = replace(case.scenario, step=case.period)
    axis = fsm_axis(scenario, "position")
    # The first trial is the case, the others have other increments.
    axes = [
        replace(axis, increment=share * axis.increment)
        for share in np.geomspace(1.0, 10.0, _TRIALS).tolist()
    ]

    def run(_model: None) -> Samples:
        first: Samples = run_fsm_trials(scenario, "position", axes=axes).actual_trajectory[0]
        return first

    return Engine(
        name=NAME,
        build=lambda: None,
        run=run,
        accuracy=1e-10,
        note=f"a map of {_TRIALS} trials, times of one",
        trials=_TRIALS,
    )
