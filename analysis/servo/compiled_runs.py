"""Runs of the servo loops for the points of a sweep, compiled."""

from collections.abc import Sequence
from functools import partial

from chamfer.analysis.servo.servo_runs import ServoRun, add_pid_loops
from chamfer.diagrams.servo.compiled_loop import fuse_pid_loop, run_fsm_trials
from chamfer.diagrams.servo.servo_loops import LOOPS
from chamfer.diagrams.servo.servo_scenario import ServoScenario


def run_compiled_loops(scenario: ServoScenario, loops: Sequence[str], *, seed: int) -> ServoRun:
    """Do what ``run_loops`` does, without Drake's simulator."""
    machines = {}
    for name in loops:
        loop = LOOPS[name]
        if loop.controller == "FSM":
            form = loop.form or scenario.plant.form
            run = run_fsm_trials(scenario, form, feedforward=loop.feedforward, seed=seed)
            machines["time"] = run.time
            machines["desired_trajectory"] = run.desired_trajectory[0]
            machines[f"{name}.controller"] = run.controller[0]
            machines[f"{name}.actual_trajectory"] = run.actual_trajectory[0]
    return add_pid_loops(scenario, loops, machines, partial(fuse_pid_loop, scenario))
