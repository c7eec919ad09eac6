from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest
from numpy.typing import NDArray
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, LeafSystem

from chamfer.analysis.linear.simulate import simulate
from chamfer.diagrams.servo.comparison_loop import (
    ComparedLoopScenario,
    ResolvedComparedLoopScenario,
    make_compared_diagram,
    what_is_open,
)
from chamfer.diagrams.servo.servo_loops import (
    make_fsm_loop,
    make_pid_loop,
    make_servo_diagram,
)
from chamfer.diagrams.servo.servo_scenario import (
    STEP,
    CameraParams,
    FsmParams,
    PlantParams,
    ServoScenario,
    SinusoidScenario,
    StepScenario,
    fsm_axis,
    resolve,
)
from chamfer.models.plants.servo_plant import Form
from chamfer.models.validation import ParameterError
from chamfer.systems.servo.desired_trajectory import Sinusoid, Step
from chamfer.systems.servo.pid import PidParams


def transfer(plant: PlantParams, form: str) -> control.TransferFunction:
    m, b, k = plant.mass, plant.damping, plant.stiffness
    numerator = {"velocity": [1, 0], "position": [k], "compliance": [1]}[form]
    return control.tf(numerator, [m, b, k])


def pid_transfer(pid: PidParams) -> control.TransferFunction:
    s = control.tf("s")
    n = pid.filter
    return pid.proportional + pid.integral / s + pid.derivative * n / (1 + n / s)


@pytest.mark.parametrize("form", ["velocity", "compliance"])
def test_the_pid_loop_steps_as_python_control_says(form: Form) -> None:
    scenario = StepScenario(desired=Step(amplitude=0.4))
    run = simulate(make_pid_loop(scenario, form, step=1e-3), duration=0.5, step=1e-3)
    loop = control.feedback(pid_transfer(scenario.pid) * transfer(scenario.plant, form), 1)
    _, expected = control.step_response(control.minreal(loop, verbose=False), run.time)
    np.testing.assert_allclose(run.outputs["actual_trajectory"], 0.4 * expected, atol=2e-7)


def test_the_pid_loop_follows_a_sinusoid_exactly_at_any_step() -> None:
    scenario = SinusoidScenario(desired=Sinusoid(amplitude=-2.0, frequency=7.0))
    coarse, fine = (
        simulate(make_pid_loop(scenario, "velocity", step=step), duration=2.0, step=step)
        for step in (0.05, 0.001)
    )
    np.testing.assert_allclose(
        coarse.outputs["actual_trajectory"], fine.outputs["actual_trajectory"][::50], atol=1e-9
    )
    loop = pid_transfer(scenario.pid) * transfer(scenario.plant, "velocity")
    ratio = control.minreal(control.feedback(loop, 1), verbose=False)(7.0j)
    late = fine.time > 1.0
    expected = -2 * (ratio * np.exp(7.0j * fine.time[late])).imag
    np.testing.assert_allclose(fine.outputs["actual_trajectory"][late], expected, atol=1e-6)


def by_python_control(
    scenario: ServoScenario, form: Form, desired: NDArray[np.float64]
) -> NDArray[np.float64]:
    """The sampled FSM loop: python-control's exact plant, the law written out again."""
    axis = fsm_axis(scenario, form)
    period, resolution = scenario.fsm.period, scenario.camera.resolution
    sampled = control.c2d(control.ss(transfer(scenario.plant, form)), period)
    state = np.zeros((2, 1))
    errors = [0.0] * scenario.measurement.delay_samples
    valid = [False] * len(errors)
    total, output = 0.0, []
    for goal in desired.tolist():
        actual = float((sampled.C @ state)[0, 0])
        output.append(actual)
        seen = resolution * np.floor((goal - actual) / resolution + 0.5)
        errors.append(seen)
        valid.append(True)
        error, counts = errors.pop(0), valid.pop(0)
        step = 0.0
        if counts and abs(error) >= axis.large_error:
            step = axis.increment
        elif counts and abs(error) >= axis.dead_zone:
            step = axis.increment / axis.divider
        total = max(-axis.limit, min(axis.limit, total + np.sign(error) * step))
        command = total + (goal if scenario.fsm.feedforward and form == "position" else 0.0)
        state = sampled.A @ state + sampled.B * command
    return np.array(output)


@pytest.mark.parametrize(
    ("form", "feedforward"),
    [("position", False), ("position", True), ("velocity", False), ("compliance", False)],
)
@pytest.mark.parametrize("latency", [0.0, 0.02])
@pytest.mark.parametrize("substeps", [1, 8])
def test_the_fsm_loop_steps_as_a_loop_written_with_python_control(
    form: Form, feedforward: bool, latency: float, substeps: int
) -> None:
    scenario = SinusoidScenario(
        plant=PlantParams(form=form),
        camera=CameraParams(latency=latency),
        fsm=FsmParams(limit=0.9 if form == "position" else None, feedforward=feedforward),
    )
    period = scenario.fsm.period
    run = simulate(
        make_fsm_loop(scenario, form, step=period / substeps), duration=5.0, step=period
    )
    expected = by_python_control(scenario, form, np.sin(run.time))
    np.testing.assert_allclose(run.outputs["actual_trajectory"], expected, atol=1e-9)


def test_continuous_and_exact_diagrams_agree() -> None:
    scenario = resolve(StepScenario())
    exact = simulate(
        make_servo_diagram(scenario, loops=["fsm"], step=scenario.fsm.period / 4),
        duration=1.0,
        step=scenario.fsm.period,
    )
    simulator = Simulator(make_servo_diagram(scenario, loops=["fsm"]))
    simulator.get_mutable_integrator().set_target_accuracy(1e-9)
    simulator.AdvanceTo(1.0)
    port = simulator.get_system().GetOutputPort("fsm.actual_trajectory")
    assert port.Eval(simulator.get_context())[0] == pytest.approx(
        exact.outputs["fsm.actual_trajectory"][-1], abs=1e-6
    )


def test_feedforward_needs_a_plant_that_takes_a_position() -> None:
    plant = PlantParams(form="velocity")
    with pytest.raises(
        ParameterError, match=r"fsm\.feedforward is True, allowed: false with plant\.form="
    ):
        StepScenario(plant=plant, fsm=FsmParams(feedforward=True))
    assert resolve(SinusoidScenario(plant=plant)).fsm.feedforward is False
    scenario = StepScenario(fsm=FsmParams(feedforward=True))
    fed, plain = (
        simulate(make_fsm_loop(s, "velocity", step=1 / 80), duration=0.5, step=1 / 80)
        for s in (scenario, StepScenario())
    )
    np.testing.assert_array_equal(
        fed.outputs["actual_trajectory"], plain.outputs["actual_trajectory"]
    )


@pytest.mark.parametrize("feedforward", [False, True])
def test_only_the_camera_leads_from_the_plant_to_the_compensator(
    feedforward: bool, wires: Any
) -> None:
    loop = make_fsm_loop(StepScenario(), "position", feedforward=feedforward)
    fed = {("desired trajectory", "controller FSM")} if feedforward else set()
    assert {wire[::2] for wire in wires(loop)} == fed | {
        *(("computer vision", "controller FSM"), ("controller FSM", "plant")),
        *((start, "computer vision") for start in ("desired trajectory", "plant")),
    }


class Proportional(LeafSystem):
    """A user's own controller: a gain, and nothing while nothing is measured."""

    def __init__(self, gain: float, output: str = "compensation") -> None:
        super().__init__()
        error = self.DeclareVectorInputPort("error", 1)

        def calc(context: Context, vector: BasicVector) -> None:
            vector[0] = gain * np.nan_to_num(error.Eval(context)[0])

        self.DeclareVectorOutputPort(output, 1, calc)


def test_a_users_own_controller_takes_the_laws_place() -> None:
    """A P controller leaves 1/(1 + K) of a step on a plant that follows its command."""
    scenario = resolve(replace(STEP, camera=CameraParams(resolution=0.0)))
    step = scenario.fsm.period / 8
    for loop in ("fsm", "pid_command"):
        diagram = make_servo_diagram(
            scenario, loops=[loop], step=step, controller=Proportional(0.5)
        )
        run = simulate(diagram, duration=2.5, step=step)
        assert run.outputs[f"{loop}.actual_trajectory"][-1] == pytest.approx(1 / 3, abs=1e-6)


def test_a_controller_with_other_ports_is_refused_in_a_line() -> None:
    with pytest.raises(ParameterError, match=r"port compensation of size 1; .* are: force \(1\)$"):
        make_servo_diagram(resolve(STEP), controller=Proportional(0.5, "force"))
    with pytest.raises(ParameterError, match=r"loops is .*, allowed: one"):
        make_servo_diagram(resolve(STEP), loops=("pid", "fsm"), controller=Proportional(0.5))
    fed = replace(STEP, fsm=FsmParams(feedforward=True))
    with pytest.raises(ParameterError, match="input port desired_trajectory of size 1"):
        make_servo_diagram(resolve(fed), controller=Proportional(0.5))


def test_a_users_own_controller_is_compared_too() -> None:
    scenario = ResolvedComparedLoopScenario(**what_is_open(ComparedLoopScenario()))
    loop = make_compared_diagram(scenario, "fsm", controller=Proportional(0.5))
    run = simulate(loop, duration=3.0, step=scenario.camera.period / 8)
    assert run.outputs["position"][-1] == pytest.approx(0.02 / 3, abs=2e-4)
    with pytest.raises(ParameterError, match=r"port compensation of size 1"):
        make_compared_diagram(scenario, "pid", controller=Proportional(0.5, "command"))
