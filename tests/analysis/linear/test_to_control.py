from pathlib import Path
from typing import Any

import control
import numpy as np
import pytest
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.analysis import Simulator
from pydrake.systems.framework import BasicVector, Context, Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import (
    ConstantVectorSource,
    DiscreteTimeDelay,
    LinearSystem,
    MatrixGain,
    Saturation,
    ZeroOrderHold,
)

from chamfer.analysis.linear.from_control import from_control
from chamfer.analysis.linear.to_control import to_control
from chamfer.diagrams.servo.servo_loops import make_pid_loop
from chamfer.diagrams.servo.servo_scenario import StepScenario
from chamfer.models.arms import puma_250
from chamfer.models.plants.servo_plant import SpringMassDamperParams
from chamfer.models.validation import ParameterError
from chamfer.systems.servo.pid_law import PidGains, SampledPidParams
from chamfer.systems.servo.sampled_pid import SampledPid
from chamfer.systems.servo.servo_plant import make_spring_mass_damper
from chamfer.systems.vision.measured_error import MeasuredError, MeasuredErrorParams

M, B, K = 2.14708, 53.896, 700.0  # the paper's plant
T = 1 / 80  # s
GAINS = 0.3, 4.0  # of the error, and 1/s of its integral
FREQUENCIES = (1.0, 20.0, 170.0)  # rad/s


def sampled_loop(latency: float = 0.02, *, first: float = 0.0) -> Diagram:
    """Return a PI in Python with a late camera around a continuous plant."""
    builder = DiagramBuilder()
    gains = PidGains(proportional=GAINS[0], integral=GAINS[1])
    pid = builder.AddNamedSystem("pid", SampledPid(SampledPidParams(axes=(gains,))))
    plant = builder.AddNamedSystem(
        "plant", make_spring_mass_damper(SpringMassDamperParams(), "position")
    )
    plant.configure_default_state([first, 0.0])
    camera = builder.AddNamedSystem("camera", MeasuredError(MeasuredErrorParams(latency=latency)))
    goal = builder.AddNamedSystem("goal", ConstantVectorSource([0.0]))
    builder.Connect(goal.get_output_port(), camera.GetInputPort("desired_trajectory"))
    builder.Connect(plant.get_output_port(), camera.GetInputPort("actual_trajectory"))
    builder.Connect(camera.GetOutputPort("error"), pid.GetInputPort("error"))
    builder.Connect(pid.get_output_port(), plant.get_input_port())
    builder.ExportOutput(plant.get_output_port(), "position")
    return builder.Build()


def test_the_loop_of_eq_2_is_exact_and_its_states_are_named() -> None:
    loop = to_control(make_pid_loop(StepScenario(), "velocity"), input="controller PID::u0")
    assert loop.dt == 0
    for frequency in FREQUENCIES:
        s = 1j * frequency
        law = 341 + 21903 / s - 0.00853 * 39971 / (1 + 39971 / s)
        assert loop(s) == pytest.approx(law * s / (M * s**2 + B * s + K), rel=1e-9)
    plant = "plant::impedance control A(s)"
    assert loop.state_labels == [
        *(f"controller PID::x{i}" for i in range(2)),
        *(f"{plant}::x{i}" for i in range(2)),
    ]
    assert (loop.input_labels, loop.output_labels) == (
        ["controller PID::u0"],
        ["computer vision::error"],
    )


def test_a_whole_system_keeps_what_nothing_moves() -> None:
    diagram = make_pid_loop(StepScenario(), "velocity")
    whole = to_control(diagram, input="controller PID", whole=True)
    assert "desired trajectory::x0" in whole.state_labels
    closed = to_control(diagram)
    assert (closed.ninputs, closed.nstates) == (0, 5)
    assert closed.output_labels == ["desired_trajectory", "controller", "actual_trajectory"]


@pytest.mark.parametrize("name", ["pid::error", "plant::u0", "camera::actual_trajectory"])
def test_a_sampled_loop_is_the_same_wherever_it_is_opened(name: str) -> None:
    loop = to_control(sampled_loop(), input=name, period=T, at=0.5)
    held = control.c2d(control.tf([K], [M, B, K]), T)
    assert loop.dt == T
    for frequency in FREQUENCIES:
        z = np.exp(1j * frequency * T)
        expected = (GAINS[0] + GAINS[1] * T / (1 - 1 / z)) * z**-2 * held(z)  # two samples late
        assert loop(z) == pytest.approx(expected, rel=1e-6, abs=1e-7)
    assert loop.input_labels == [name]


def test_what_is_seen_at_the_tick_is_what_was_before_it() -> None:
    # From the camera's input to the PI's output: of this tick's error nothing is there yet.
    law = to_control(
        sampled_loop(latency=0.0), input="pid::error", output="pid::compensation", period=T, at=0.5
    )
    z = np.exp(0.7j)
    assert law(z) == pytest.approx((GAINS[0] + GAINS[1] * T / (1 - 1 / z)) / z, rel=1e-6)


def test_several_rates_make_the_period_of_both() -> None:
    builder = DiagramBuilder()
    fast = builder.AddNamedSystem("fast", DiscreteTimeDelay(0.01, 1, 1))
    slow = builder.AddNamedSystem("slow", ZeroOrderHold(0.02, 1))
    builder.Connect(fast.get_output_port(), slow.get_input_port())
    builder.ExportInput(fast.get_input_port(), "in")
    builder.ExportOutput(slow.get_output_port(), "out")
    diagram = builder.Build()
    with pytest.raises(ParameterError, match=r"^period is None, allowed: the diagram's, s: .*$"):
        to_control(diagram)
    with pytest.raises(ParameterError, match=r"^period is 0\.01, allowed: one of the whole"):
        to_control(diagram, period=0.01)
    found = to_control(diagram, period=0.02)
    z = np.exp(0.3j)
    assert found(z) == pytest.approx(z**-2, abs=1e-9)  # into the delay, a period on into the hold


class Pendulum(LeafSystem):
    """A Python block in continuous time."""

    def __init__(self) -> None:
        super().__init__()
        torque = self.DeclareVectorInputPort("torque", 1)
        state = self.DeclareContinuousState(2)
        self.DeclareStateOutputPort("state", state)
        self._torque = torque

    def DoCalcTimeDerivatives(  # noqa: N802
        self, context: Context, derivatives: Any
    ) -> None:
        angle, speed = context.get_continuous_state_vector().CopyToVector()
        torque = self._torque.Eval(context)[0]
        derivatives.SetFromVector([speed, torque - 9.81 * np.sin(angle)])


def test_a_python_block_is_differenced_where_it_is() -> None:
    block = Pendulum()
    context = block.CreateDefaultContext()
    context.SetContinuousState([0.6, 0.0])
    found = to_control(block, at=context)
    assert pytest.approx(np.array([[0, 1], [-9.81 * np.cos(0.6), 0]]), abs=1e-8) == found.A
    assert pytest.approx(np.array([[0.0], [1.0]]), abs=1e-9) == found.B
    assert found.output_labels == ["state[0]", "state[1]"]
    assert context.get_continuous_state_vector().CopyToVector()[0] == 0.6


def test_a_nonlinear_block_is_differentiated_at_its_input() -> None:
    block = Saturation([-1.0], [1.0])
    context = block.CreateDefaultContext()
    block.get_input_port().FixValue(context, [0.5])
    assert pytest.approx(1.0) == to_control(block, at=context).D
    block.get_input_port().FixValue(context, [1.5])
    assert pytest.approx(0.0) == to_control(block, at=context).D


@pytest.mark.parametrize("step", [0.0, 1e-3])
def test_an_arm_is_driven_through_its_mass_matrix(step: float) -> None:
    builder = DiagramBuilder()
    arm, _ = AddMultibodyPlantSceneGraph(builder, step)
    arm.set_name("arm")
    Parser(arm).AddModels(str(Path(puma_250.__file__).with_suffix(".urdf")))
    arm.Finalize()
    diagram = builder.Build()
    context = diagram.CreateDefaultContext()
    own = arm.GetMyMutableContextFromRoot(context)
    arm.SetPositions(own, [1.0, 0, 0, 0, 0, 0, 0, 0.3, -0.2, 0.5])
    found = to_control(
        diagram,
        input="arm::actuation",
        output="arm::state",
        at=context,
        period=step or None,
        whole=True,
    )
    rates = np.linalg.solve(arm.CalcMassMatrix(own), arm.MakeActuationMatrix())
    assert found.B[10:] == pytest.approx((step or 1.0) * rates, rel=1e-6, abs=1e-9)
    assert found.state_labels[0] == "arm::puma_250_base_qw"


class Halves(LeafSystem):
    """Passes its input on in the second half of each period only."""

    def __init__(self) -> None:
        super().__init__()
        given = self.DeclareVectorInputPort("in", 1)

        def calc(context: Context, output: BasicVector) -> None:
            late = context.get_time() / T % 1.0 > 0.5
            output[0] = given.Eval(context)[0] * late

        self.DeclareVectorOutputPort("out", 1, calc)


def test_a_loop_is_not_opened_where_its_signal_changes_within_the_period() -> None:
    builder = DiagramBuilder()
    lag = LinearSystem(A=[[-5.0]], B=[[5.0]], C=[[1.0]], D=[[0.0]])
    plant = builder.AddNamedSystem("plant", lag)
    hold = builder.AddNamedSystem("hold", ZeroOrderHold(T, 1))
    halves = builder.AddNamedSystem("halves", Halves())
    builder.Connect(plant.get_output_port(), hold.get_input_port())
    builder.Connect(hold.get_output_port(), halves.get_input_port())
    builder.Connect(halves.get_output_port(), plant.get_input_port())
    with pytest.raises(ParameterError, match=r"^input is 'plant::u0', allowed: .* held"):
        to_control(builder.Build(), input="plant", period=T)


@pytest.mark.parametrize(
    ("settings", "message"),
    [
        ({"period": T}, r"^at is None, allowed: where all states are finite, pid::x2 is not$"),
        ({"input": "pid::eror", "period": T}, r"^input is 'pid::eror', allowed: one of .*pid::er"),
        ({"output": "there", "period": T}, r"^output is 'there', allowed: one of .*position"),
        ({"period": 0.0}, r"^period is 0\.0, allowed: a finite number > 0, s$"),
        ({"period": 0.011, "at": 0.5}, r"^period is 0\.011, allowed: one of the whole diagram"),
        ({"period": T, "at": -1.0}, r"^at is -1\.0, allowed: a context, or a finite time"),
    ],
)
def test_mistakes_are_told_in_one_line(settings: dict[str, Any], message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        to_control(sampled_loop(), **settings)


def test_a_continuous_system_has_no_period() -> None:
    with pytest.raises(ParameterError, match=r"^period is 0\.1, allowed: None"):
        to_control(make_spring_mass_damper(SpringMassDamperParams(), "position"), period=0.1)


def test_a_mode_that_is_too_fast_is_refused() -> None:
    builder = DiagramBuilder()
    fast = LinearSystem(A=[[-1e8]], B=[[1e8]], C=[[1.0]], D=[[0.0]])
    plant = builder.AddNamedSystem("plant", fast)
    hold = builder.AddNamedSystem("hold", ZeroOrderHold(T, 1))
    builder.Connect(plant.get_output_port(), hold.get_input_port())
    builder.ExportInput(plant.get_input_port(), "in")
    with pytest.raises(ParameterError, match=r"^fastest continuous mode is 1"):
        to_control(builder.Build(), period=T)


@pytest.mark.parametrize("dt", [0, 0.05])
def test_there_and_back_nothing_changes(dt: float) -> None:
    there = control.ss([[-0.5, 1], [0, -0.25]], [[0, 1], [2, 0]], [[1, 1]], [[0, 0.5]], dt)
    there.name = "plant"
    block = from_control(there)
    assert block.get_name() == "plant"
    back = to_control(block)
    for name in ("A", "B", "C", "D"):
        assert np.array_equal(getattr(back, name), getattr(there, name))
    assert (back.dt, back.name) == (dt, "plant")


def test_a_transfer_function_answers_as_python_control_says() -> None:
    lag = control.tf([2.0], [0.5, 1.0])
    block = from_control(lag)
    assert isinstance(block, LinearSystem)
    assert block.time_period() == 0.0
    context = block.CreateDefaultContext()
    block.get_input_port().FixValue(context, [1.0])
    Simulator(block, context).AdvanceTo(0.7)
    expected = control.step_response(lag, [0.0, 0.7]).outputs[-1]
    assert block.get_output_port().Eval(context)[0] == pytest.approx(expected, rel=1e-3)


def test_a_gain_needs_no_states() -> None:
    block = from_control(control.tf([3.0], [1.0]))
    assert isinstance(block, MatrixGain)
    assert np.array_equal(block.D(), [[3.0]])


@pytest.mark.parametrize(
    ("system", "message"),
    [
        (control.tf([1, 0, 0], [1, 1]), r"^zeros is 2, allowed: at most as many as poles, 1$"),
        (control.tf([1], [1, 1], True), r"^dt is True, allowed: a period"),
        (control.ss([[np.nan]], [[1]], [[1]], 0), r"^system is .*, allowed: finite real numbers"),
        (control.frd([1, 2], [1, 2]), r"^system is 'FrequencyResponseData', allowed: a StateSp"),
        (
            control.tf([[[1], [1]]], [[[1, 1], [1, 2]]]),
            r"^transfer function is .*, allowed: one input and one output",
        ),
        (1.0, r"^system is 'float', allowed"),
    ],
)
def test_what_is_no_block_is_refused_in_one_line(system: Any, message: str) -> None:
    with pytest.raises(ParameterError, match=message):
        from_control(system)
