import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.published.fsm_visual_servoing import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Metric, Outcome, load, quiet, select
from chamfer.analysis.servo.servo_response import run_loops
from chamfer.diagrams.servo.servo_loops import LOOPS
from chamfer.diagrams.servo.servo_scenario import (
    CameraParams,
    FsmParams,
    PlantParams,
    ServoScenario,
    SinusoidScenario,
    StepScenario,
    resolve,
)
from chamfer.models.validation import ParameterError
from chamfer.systems.servo.desired_trajectory import Sinusoid, Step
from chamfer.systems.servo.pid import PidParams

SINUSOID_RESPONSE = load(select(CATALOGUE.entries, ["sinusoid-response"])[0])
STEP_RESPONSE = load(select(CATALOGUE.entries, ["step-response"])[0])


@pytest.fixture(scope="module")
def step() -> Outcome:
    return STEP_RESPONSE.run(resolve(StepScenario()), 0, quiet)


@pytest.fixture(scope="module")
def sinusoid() -> Outcome:
    return SINUSOID_RESPONSE.run(resolve(SinusoidScenario()), 0, quiet)


def failed(name: str, metrics: Mapping[str, Metric]) -> set[str]:
    values = [value for value in PUBLISHED if value.experiment == name]
    return {c.published.metric for c in check(values, metrics) if not c.ok}


def test_fig_8_is_reproduced(step: Outcome) -> None:
    value = {name: metric.value for name, metric in step.metrics.items()}
    assert value["pid.steady_state_error"] == pytest.approx(700 / (700 + 21903), rel=1e-6)
    assert value["fsm.slope_ratio"] == pytest.approx(5, abs=0.5)
    assert value["fsm_feedforward.overshoot"] == pytest.approx(14, abs=0.5)


def test_only_the_claims_for_the_force_to_velocity_plant_fail(step: Outcome) -> None:
    assert failed("step-response", step.metrics) == {
        "fsm_velocity.error_max",
        "fsm_velocity.overshoot",
    }


def test_eq_2_on_the_position_level_plants(step: Outcome) -> None:
    assert step.metrics["pid_position.overshoot"].value == pytest.approx(66, abs=1)
    assert step.metrics["pid_command.growth_rate"].value == pytest.approx(20.15, abs=0.01)
    undefined = step.metrics["pid_command.overshoot"]
    assert undefined.value is None
    assert undefined.note.startswith("unstable, grows at 20.15 1/s")


def test_pid_gains_that_are_unstable_are_a_result_not_an_error() -> None:
    scenario = resolve(StepScenario(pid=PidParams(integral=-21903.0)))
    outcome = STEP_RESPONSE.run(scenario, 0, quiet)
    assert outcome.metrics["pid.overshoot"].value is None
    # Without the derivative: m s^2 + (b + P) s + k + I = 0.
    growth = max(np.roots([2.14708, 53.896 + 341, 700 - 21903]).real)
    assert outcome.metrics["pid.growth_rate"].value == pytest.approx(growth, rel=1e-2)
    STEP_RESPONSE.plot(scenario, outcome)


def test_a_fast_pid_loop_is_measured_finely_enough() -> None:
    outcome = STEP_RESPONSE.run(resolve(StepScenario(pid=PidParams(integral=1e7))), 0, quiet)
    # (s + a)(s^2 + 2 d w s + w^2), where a is far away: exp(-pi d / sqrt(1 - d^2)).
    w = math.sqrt((700 + 1e7) / 2.14708)
    d = 184.2 / 2 / w
    assert outcome.metrics["pid.overshoot"].value == pytest.approx(
        100 * math.exp(-math.pi * d / math.sqrt(1 - d**2)), abs=0.8
    )
    assert outcome.metrics["pid.rise_time"].value == pytest.approx(1.01 / w, rel=0.2)


@pytest.mark.parametrize(
    ("integral", "message"),
    [
        (1e12, r"the largest coefficient of pid_command is .*, allowed: at most 1\.5"),
        (1e300, r"the largest coefficient of pid is .*, allowed: at most .* overflow"),
        (1e10, r"the fastest mode of pid is .*, allowed: at most"),
    ],
)
def test_a_pid_loop_that_is_too_fast_or_overflows_is_refused(
    integral: float, message: str
) -> None:
    scenario = resolve(StepScenario(pid=PidParams(integral=integral)))
    with pytest.raises(ParameterError, match=message):
        STEP_RESPONSE.run(scenario, 0, quiet)


def test_a_negative_step_mirrors_a_positive_one(step: Outcome) -> None:
    down = STEP_RESPONSE.run(resolve(StepScenario(desired=Step(amplitude=-1.0))), 0, quiet)
    for name in ("pid.overshoot", "fsm.rise_time", "fsm.slope_ratio"):
        assert down.metrics[name].value == pytest.approx(step.metrics[name].value, rel=1e-9)
    error = down.metrics["fsm.steady_state_error"].value
    assert error == pytest.approx(-(step.metrics["fsm.steady_state_error"].value or math.nan))


@pytest.mark.parametrize(
    ("experiment", "scenario"),
    [
        (STEP_RESPONSE, StepScenario(desired=Step(amplitude=0.0))),
        (SINUSOID_RESPONSE, SinusoidScenario(desired=Sinusoid(amplitude=0.0))),
    ],
)
def test_nothing_to_follow_is_refused(experiment: object, scenario: object) -> None:
    with pytest.raises(ParameterError, match=r"desired\.amplitude is 0\.0"):
        experiment.run(resolve(scenario), 0, quiet)  # type: ignore[attr-defined,type-var]


def test_fig_9_is_reproduced_with_feedforward_only(sinusoid: Outcome) -> None:
    assert failed("sinusoid-response", sinusoid.metrics) == {
        "error_rms_ratio_compensation",
        "error_rms_ratio_velocity",
    }


def test_the_pid_follows_a_sinusoid_as_its_transfer_function_says(sinusoid: Outcome) -> None:
    s = 1j
    controller = 341 + 21903 / s - 0.00853 * 39971 / (1 + 39971 / s)
    loop = controller * s / (2.14708 * s**2 + 53.896 * s + 700)
    closed, sensitivity = loop / (1 + loop), 1 / (1 + loop)
    value = {name: metric.value for name, metric in sinusoid.metrics.items()}
    assert value["pid.amplitude_ratio"] == pytest.approx(abs(closed), rel=1e-4)
    assert value["pid.phase_lag"] == pytest.approx(-math.degrees(np.angle(closed)), abs=0.01)
    assert value["pid.error_rms"] == pytest.approx(abs(sensitivity) / math.sqrt(2), rel=1e-2)


def test_the_sweep_says_where_the_fsm_is_better(sinusoid: Outcome) -> None:
    sweep: Mapping[str, NDArray[np.float64]] = sinusoid.tables["frequencies"]
    limit = sinusoid.metrics["fsm.better_below"].value
    assert limit is not None
    better = sweep["fsm"] < sweep["pid"]
    np.testing.assert_array_equal(better, sweep["frequency"] < limit)


def test_a_shorter_sinusoid_than_can_be_measured_is_refused() -> None:
    scenario = replace(SinusoidScenario(), duration=6.0)
    with pytest.raises(ParameterError, match=r"duration is .*, allowed: more than 7\.85398 s"):
        SINUSOID_RESPONSE.run(resolve(scenario), 0, quiet)


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


@pytest.mark.parametrize(
    "scenario",
    [
        SinusoidScenario(camera=CameraParams(noise=0.002, latency=0.02), duration=0.7),
        StepScenario(
            plant=PlantParams(form="compliance"),
            fsm=FsmParams(period=0.01, limit=300.0, divider=3.0),  # N, which is reached
            camera=CameraParams(noise=0.001, resolution=0.0),
            duration=1.2,
        ),
    ],
)
def test_a_compiled_run_is_the_run(scenario: ServoScenario) -> None:
    resolved = resolve(scenario)
    run, compiled = (
        run_loops(resolved, list(LOOPS), seed=5, compiled=compiled) for compiled in (False, True)
    )
    assert compiled.growth == run.growth
    assert list(compiled.traces) == list(run.traces)
    for name, trace in run.traces.items():
        np.testing.assert_allclose(
            compiled.traces[name], trace, rtol=0, atol=1e-12 * max(1.0, np.nanmax(np.abs(trace)))
        )
