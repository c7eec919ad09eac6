"""Chamfer: the project's own loops, exact, by the path that every experiment takes."""

from pydrake.systems.framework import System

from chamfer.analysis.benchmarks.case import Case, Samples
from chamfer.analysis.benchmarks.engine import Engine, LoopName
from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.servo.servo_loops import make_pid_loop, make_servo_diagram
from chamfer.systems.exact_discretisation import fuse


def engines(case: Case, loop: LoopName) -> list[Engine]:
    """Return the engine; it steps at the output's times, where it is exact."""
    step = case.period if loop == "fsm" else float(case.pid_time[1])

    def build() -> System:
        if loop == "fsm":
            return make_servo_diagram(case.scenario, loops=[loop], step=step)
        return fuse(make_pid_loop(case.scenario, "velocity"))

    def run(system: System) -> Samples:
        outputs = simulate(system, duration=case.duration, step=step).outputs
        if loop == "fsm":
            return outputs["fsm.actual_trajectory"]
        return outputs["y0"][:, -1]

    note = "stepped by Drake" if loop == "fsm" else "fused by Drake, solved by matrix powers"
    return [
        Engine(
            name="Chamfer",
            build=build,
            run=run,
            accuracy=1e-10,
            note=f"exact steps of {1e3 * step:g} ms, {note}",
        )
    ]
