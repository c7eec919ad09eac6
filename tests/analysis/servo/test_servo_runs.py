import numpy as np
import pytest

from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.servo.servo_runs import growth_rate, run_loops
from chamfer.diagrams.servo.compiled_loop import fuse_pid_loop
from chamfer.diagrams.servo.servo_loops import LOOPS, make_servo_diagram
from chamfer.diagrams.servo.servo_scenario import CameraParams, StepScenario, resolve


def test_eq_2_is_unstable_on_the_commanded_position_only() -> None:
    scenario = resolve(StepScenario())
    rates = {
        name: growth_rate(fuse_pid_loop(scenario, loop.form))
        for name, loop in LOOPS.items()
        if loop.controller == "PID" and loop.form
    }
    assert rates.pop("pid_command") == pytest.approx(20.153, abs=0.001)
    assert set(rates.values()) == {0.0}


def test_an_unstable_loop_is_cut_short_and_the_others_are_not() -> None:
    scenario = resolve(StepScenario(duration=1.0))
    run = run_loops(scenario, ("pid", "fsm", "pid_command"), seed=0)
    time, response = run.traces["time"], run.traces["pid_command.actual_trajectory"]
    known = np.isfinite(response)
    assert time[known][-1] == pytest.approx(6 / 20.153, abs=2e-3)
    assert np.abs(response[known]).max() < 1e4
    assert np.all(np.isfinite(run.traces["fsm.actual_trajectory"]))
    # What is cut is the end: the start grows at the loop's rate.
    half = time < 0.15
    ratio = np.abs(response[known & ~half]).max() / np.abs(response[half]).max()
    assert ratio == pytest.approx(np.exp(20.153 * (time[known][-1] - 0.15)), rel=0.2)


def test_loops_do_not_depend_on_their_company() -> None:
    scenario = resolve(StepScenario(camera=CameraParams(noise=0.002), duration=0.5))
    together = run_loops(scenario, ("pid", "fsm_velocity", "fsm"), seed=5).traces
    alone = run_loops(scenario, ("fsm",), seed=5).traces
    np.testing.assert_array_equal(
        together["fsm.actual_trajectory"], alone["fsm.actual_trajectory"]
    )


def test_loops_side_by_side_in_one_diagram_are_the_loops_alone() -> None:
    scenario = resolve(StepScenario(duration=0.5))
    assert scenario.step is not None
    alone = run_loops(scenario, ("pid", "fsm"), seed=0).traces
    diagram = make_servo_diagram(scenario, loops=("pid", "fsm"), step=scenario.step)
    together = simulate(diagram, duration=0.5, step=scenario.step)
    np.testing.assert_array_equal(together.time, alone["time"])
    for name in ("pid", "fsm"):
        np.testing.assert_allclose(
            together.outputs[f"{name}.actual_trajectory"],
            alone[f"{name}.actual_trajectory"],
            atol=1e-11,
        )
