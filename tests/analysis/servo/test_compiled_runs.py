import numpy as np

from analysis.servo.compiled_runs import run_compiled_loops
from analysis.servo.servo_runs import run_loops
from diagrams.servo.servo_loops import LOOPS
from diagrams.servo.servo_scenario import (
    CameraParams,
    SinusoidScenario,
    StepScenario,
    resolve,
)


def test_a_compiled_run_is_the_run() -> None:
    scenario = resolve(SinusoidScenario(duration=0.7))
    run, compiled = (
        run_loops(scenario, list(LOOPS), seed=0),
        run_compiled_loops(scenario, list(LOOPS), seed=0),
    )
    assert compiled.growth == run.growth
    assert list(compiled.traces) == list(run.traces)
    for name, trace in run.traces.items():
        np.testing.assert_allclose(
            compiled.traces[name], trace, rtol=0, atol=1e-12 * max(1.0, np.nanmax(np.abs(trace)))
        )


def test_a_loop_sees_the_noise_that_it_sees_alone() -> None:
    scenario = resolve(StepScenario(camera=CameraParams(noise=0.002), duration=1.0))
    compiled = run_compiled_loops(scenario, ("fsm", "fsm_velocity"), seed=5).traces
    for name in ("fsm", "fsm_velocity"):
        alone = run_loops(scenario, (name,), seed=5).traces
        np.testing.assert_allclose(
            compiled[f"{name}.actual_trajectory"], alone[f"{name}.actual_trajectory"], atol=1e-12
        )
