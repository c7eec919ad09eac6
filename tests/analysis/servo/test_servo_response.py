import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.linalg import expm

from chamfer.analysis.catalogue import CATALOGUE
from chamfer.analysis.linear.simulate import simulate
from chamfer.analysis.published.fsm_visual_servoing import PUBLISHED
from chamfer.analysis.report.checks import check
from chamfer.analysis.scenario.experiment import Metric, Outcome, load, quiet, select
from chamfer.analysis.servo.servo_response import frame_growth, run_loops
from chamfer.diagrams.servo.servo_loops import LOOPS, camera_pid, make_servo_diagram
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
from chamfer.systems.servo.pid_law import SampledPidParams
from chamfer.systems.servo.sampled_pid import SampledPid

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


def eq_2_by_frames(rule: float | None, late: int) -> NDArray[np.float64]:
    """A frame, as a matrix, of eq. (2) without its derivative behind the camera, written out.

    The state is position, velocity, the integral's force, the step, and the ``late`` last errors.
    The rule is the share of a frame's error in the sum that answers it, and the force is held;
    None: the law is continuous and the error is held.
    """
    m, b, k, p, i, period = 2.14708, 53.896, 700.0, 341.0, 21903.0, 1 / 80
    gain, rate = (p, i) if rule is None else (p + rule * i * period, 0.0)
    rates = [[0, 1, 0, 0], [-k / m, -b / m, 1 / m, gain / m], [0, 0, 0, rate], [0, 0, 0, 0]]
    held = expm(period * np.array(rates))[:3]  # of position, velocity, force, error
    if rule is not None:
        held[2, 3] = i * period
    errors = np.vstack([[0, -1, 0, 1, *np.zeros(late)], np.eye(4 + late)[4:]])  # newest first
    keeps = np.eye(4 + late)[3:4]  # the step
    moved = held @ np.vstack([np.eye(4 + late)[:3], errors[-1:]])
    return np.vstack([moved, keeps, errors[:-1]])


@pytest.mark.parametrize(
    ("rule", "growth", "a_frame_late"),
    [(None, 1.025, 1.620), (1.0, 1.871, 1.778), (0.5, 0.970, 1.610), (0.0, 0.631, 1.479)],
)
def test_eq_2_diverges_behind_the_camera_but_for_some_rules_of_its_sum(
    rule: float | None, growth: float, a_frame_late: float
) -> None:
    """The numbers of docs/fsm-or-pid.md."""
    for late, expected in enumerate((growth, a_frame_late)):
        poles = np.abs(np.linalg.eigvals(eq_2_by_frames(rule, late)))
        # The step, and the integral that the plant's zero hides, stay as they are.
        moving = poles[np.abs(poles - 1) > 1e-6]
        assert moving.max() == pytest.approx(expected, abs=1e-3)


@pytest.mark.parametrize(("later", "rate"), [(0, 80.5), (1, 190.5)])
def test_eq_2_needs_so_many_frames_a_second(later: int, rate: float) -> None:
    slow, fast = (
        resolve(StepScenario(fsm=FsmParams(period=1 / one), duration=1.0))
        for one in (rate - 0.5, rate + 0.5)
    )
    assert frame_growth(slow, "pid_camera", later=later) > 0
    assert frame_growth(fast, "pid_camera", later=later) == 0


@pytest.mark.parametrize("late", [0, 1])
@pytest.mark.parametrize("substeps", [1, 8])
def test_the_diagram_of_eq_2_behind_the_camera_is_its_matrix(late: int, substeps: int) -> None:
    camera = CameraParams(resolution=0.0, latency=late / 80)
    scenario = resolve(StepScenario(pid=PidParams(derivative=0.0), camera=camera))
    frame = eq_2_by_frames(None, late)
    diagram = make_servo_diagram(scenario, loops=["pid_camera"], step=1 / 80 / substeps)
    found = simulate(diagram, duration=0.25, step=1 / 80).outputs["pid_camera.actual_trajectory"]
    state, expected = np.eye(4 + late)[3], []
    for _ in found:
        expected.append(state[1])
        state = frame @ state
    np.testing.assert_allclose(found, expected, atol=1e-9 * np.abs(expected).max())
    growth = run_loops(scenario, ("fsm", "pid_camera"), seed=0).growth["pid_camera"]
    assert growth == pytest.approx(80 * np.log(np.abs(np.linalg.eigvals(frame)).max()))


def test_behind_a_fast_camera_eq_2_is_that_of_fig_8(step: Outcome) -> None:
    scenario = resolve(StepScenario(fsm=FsmParams(period=5e-4), duration=0.5))
    outcome = STEP_RESPONSE.run(scenario, 0, quiet)
    for name in ("rise_time", "steady_state_error"):
        expected = step.metrics[f"pid.{name}"].value
        assert outcome.metrics[f"pid_camera.{name}"].value == pytest.approx(expected, rel=0.1)
    for fast, verdict in ((outcome, "eq. (2) is stable"), (step, "eq. (2) diverges")):
        drawn = STEP_RESPONSE.plot(scenario, fast)["step-response"].axes[4]
        assert " ".join(drawn.get_title("left").split()).endswith(verdict)


def test_the_pid_for_the_camera_bears_the_delay_that_it_is_said_to(step: Outcome) -> None:
    scenario = resolve(StepScenario())
    gains = camera_pid(scenario, "pid_designed")[0]
    margin = step.metrics["pid_designed.delay_margin"].value or 0.0
    calmer = []
    for latency in (margin, margin + 1 / 80):
        late = replace(scenario, camera=CameraParams(resolution=0.0, latency=latency))
        law = SampledPid(SampledPidParams(axes=(gains,)))
        diagram = make_servo_diagram(late, loops=["fsm"], step=1 / 80, controller=law)
        off = np.abs(
            1 - simulate(diagram, duration=12, step=1 / 80).outputs["fsm.actual_trajectory"]
        )
        calmer.append(off[-240:].max() < off[240:480].max())
    assert calmer == [True, False]


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
