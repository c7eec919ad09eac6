from typing import Any

import numpy as np
import pytest

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.scenario.experiment import Experiment, load, select
from chamfer.analysis.servo.compiled_runs import run_compiled_loops
from chamfer.analysis.servo.servo_runs import run_loops
from chamfer.diagrams.servo.servo_loops import LOOPS
from chamfer.diagrams.servo.servo_scenario import (
    CameraParams,
    ServoScenario,
    SinusoidScenario,
    StepScenario,
    resolve,
)

SINUSOID_RESPONSE = load(select(CATALOGUE.entries, ["sinusoid-response"])[0])
STEP_RESPONSE = load(select(CATALOGUE.entries, ["step-response"])[0])


def quiet(fraction: float, doing: str = "") -> None:
    assert 0 <= fraction <= 1


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


@pytest.mark.parametrize(
    ("experiment", "scenario"),
    [
        (STEP_RESPONSE, StepScenario(camera=CameraParams(noise=0.002))),
        (SINUSOID_RESPONSE, SinusoidScenario(camera=CameraParams(noise=0.002, latency=0.02))),
    ],
    ids=lambda one: getattr(one, "name", ""),
)
def test_a_point_of_a_sweep_measures_what_the_run_does(
    experiment: Experiment[Any], scenario: ServoScenario
) -> None:
    assert experiment.run_swept is not None
    resolved = experiment.resolve(scenario)
    run = experiment.run(resolved, 5, quiet)
    swept = experiment.run_swept(resolved, 5, quiet)
    assert list(swept.metrics) == list(run.metrics)
    for name, metric in run.metrics.items():
        expected = metric.value if metric.value is None else pytest.approx(metric.value, abs=1e-9)
        assert (name, swept.metrics[name].value) == (name, expected)
