"""The servo loops of Figs. 5 to 7: PID and state machine on one axis, side by side.

Source: Ruybal, Lumia and Wood, section 3. Each loop is a diagram of its own with the blocks of
Figs. 6 and 7: desired trajectory, computer vision, controller and plant; the plant is the inner
loop of Fig. 5, impedance control A(s) with the environment B(s) fed back.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

import numpy as np
from pydrake.systems.framework import Diagram, DiagramBuilder, System
from pydrake.systems.primitives import Adder, Gain, LinearSystem, MatrixGain

from chamfer.diagrams.servo.servo_scenario import ServoScenario, fsm_axis, has_feedforward
from chamfer.models.plants.spring_mass_damper import Form, SpringMassDamperParams
from chamfer.systems.exact_discretisation import discretise
from chamfer.systems.servo.compensator import CompensatorParams, TrajectoryCompensator
from chamfer.systems.servo.desired_trajectory import make_desired_trajectory
from chamfer.systems.servo.pid import make_pid
from chamfer.systems.vision.measured_error import add_measured_error


@dataclass(frozen=True)
class Loop:
    """Which controller drives which form of the plant."""

    controller: Literal["PID", "FSM"]
    form: Form | None  # None: the scenario's
    title: str
    feedforward: bool | None = None  # None: the scenario's


LOOPS: Final = {
    "pid": Loop("PID", "velocity", "PID loop"),
    "fsm": Loop("FSM", None, "FSM loop"),
    "fsm_feedforward": Loop("FSM", None, "FSM loop with feedforward", True),
    "fsm_compensation": Loop("FSM", None, "FSM loop, compensation only", False),
    "fsm_velocity": Loop("FSM", "velocity", "FSM loop, force to velocity"),
    "pid_position": Loop("PID", "compliance", "PID loop, force to position"),
    "pid_command": Loop("PID", "position", "PID loop, commanded position to position"),
}


def make_servo_diagram(
    scenario: ServoScenario,
    *,
    loops: Sequence[str] = ("pid", "fsm"),
    signals: Sequence[str] = ("actual_trajectory",),
    step: float | None = None,
) -> Diagram:
    """Build loops of :data:`LOOPS` side by side.

    Args:
        scenario: What they follow and with which parameters.
        loops: Which loops.
        signals: Which outputs of each are exported, as ``<loop>.<signal>``:
            ``desired_trajectory``, ``controller`` (force N or compensation m),
            ``actual_trajectory``.
        step: s. None leaves everything that is linear continuous, one block per block of the
            paper's figures. Otherwise the linear parts, a whole PID loop or the FSM's plant and
            trajectory, take exact steps of that size; the FSM's period has to be a multiple of
            it, best by a power of two.
    """
    builder = DiagramBuilder()
    for name in loops:
        loop = LOOPS[name]
        form = loop.form or scenario.plant.form
        if loop.controller == "PID":
            diagram = make_pid_loop(scenario, form, step=step)
        else:
            diagram = make_fsm_loop(scenario, form, feedforward=loop.feedforward, step=step)
        diagram.set_name(loop.title)
        builder.AddSystem(diagram)
        for signal in signals:
            builder.ExportOutput(diagram.GetOutputPort(signal), f"{name}.{signal}")
    servo = builder.Build()
    servo.set_name("PID and FSM trajectory compensation")
    return servo


def make_pid_loop(scenario: ServoScenario, form: Form, *, step: float | None = None) -> Diagram:
    """Build Fig. 6: the PID of eq. (2), which sees the continuous error, and a plant."""
    builder = DiagramBuilder()
    desired = builder.AddNamedSystem(
        "desired trajectory", make_desired_trajectory(scenario.desired)
    )
    vision = builder.AddNamedSystem("computer vision", _make_continuous_error())
    controller = builder.AddNamedSystem("controller PID", make_pid(scenario.pid))
    plant = builder.AddNamedSystem("plant", make_plant(scenario.plant, form))
    builder.Connect(desired.get_output_port(), vision.GetInputPort("desired_trajectory"))
    builder.Connect(plant.get_output_port(), vision.GetInputPort("actual_trajectory"))
    builder.Connect(vision.get_output_port(), controller.get_input_port())
    builder.Connect(controller.get_output_port(), plant.get_input_port())
    builder.ExportOutput(desired.get_output_port(), "desired_trajectory")
    builder.ExportOutput(controller.get_output_port(), "controller")
    builder.ExportOutput(plant.get_output_port(), "actual_trajectory")
    loop = builder.Build()
    loop.set_name("PID loop")
    return loop if step is None else discretise(loop, step)


def make_fsm_loop(
    scenario: ServoScenario,
    form: Form,
    *,
    feedforward: bool | None = None,
    step: float | None = None,
) -> Diagram:
    """Build Fig. 7: the state machine, which sees the camera's error, and a plant.

    With feedforward (None: as the scenario says) the compensation is added to the desired
    trajectory, as on the robot; only a plant that takes a commanded position can have it.
    """
    if feedforward is None:
        feedforward = has_feedforward(scenario)

    def linear(system: System) -> System:
        return system if step is None else discretise(system, step)

    builder = DiagramBuilder()
    desired = builder.AddNamedSystem(
        "desired trajectory", linear(make_desired_trajectory(scenario.desired))
    )
    vision = add_measured_error(builder, scenario.measurement)
    controller = builder.AddNamedSystem(
        "controller FSM",
        TrajectoryCompensator(
            CompensatorParams(axes=(fsm_axis(scenario, form),), period=scenario.fsm.period)
        ),
    )
    plant = builder.AddNamedSystem("plant", linear(make_plant(scenario.plant, form)))
    command = controller.GetOutputPort("compensation")
    if feedforward and form == "position":
        builder.Connect(desired.get_output_port(0), controller.GetInputPort("desired_trajectory"))
        command = controller.GetOutputPort("command")
    builder.Connect(desired.get_output_port(0), vision.GetInputPort("desired_trajectory"))
    builder.Connect(plant.get_output_port(0), vision.GetInputPort("actual_trajectory"))
    builder.Connect(vision.GetOutputPort("error"), controller.GetInputPort("error"))
    builder.Connect(command, plant.get_input_port(0))
    builder.ExportOutput(desired.get_output_port(0), "desired_trajectory")
    builder.ExportOutput(controller.GetOutputPort("compensation"), "controller")
    builder.ExportOutput(plant.get_output_port(0), "actual_trajectory")
    loop = builder.Build()
    loop.set_name("FSM loop")
    return loop


def make_plant(params: SpringMassDamperParams, form: Form) -> Diagram:
    """Build the inner loop of Fig. 5: A(s) moves the mass, B(s) is what the environment answers.

    It has the same transfer function as :func:`chamfer.systems.servo.spring_mass_damper.\
make_spring_mass_damper`: A(s) is the free mass, force N to (position m, velocity m/s); B(s) the
    reaction of spring and damper. In the position form the stiffness K_p of eq. (1) turns the
    commanded position into a force.
    """
    m, b, k = params.mass, params.damping, params.stiffness
    builder = DiagramBuilder()
    balance = builder.AddNamedSystem("force balance", Adder(2, 1))
    motion = builder.AddNamedSystem(
        "impedance control A(s)",
        LinearSystem(
            A=np.array([[0.0, 1.0], [0.0, 0.0]]),
            B=np.array([[0.0], [1.0 / m]]),
            C=np.eye(2),
            D=np.zeros((2, 1)),
        ),
    )
    environment = builder.AddNamedSystem("environment B(s)", MatrixGain(D=np.array([[-k, -b]])))
    row = [0.0, 1.0] if form == "velocity" else [1.0, 0.0]
    actual = builder.AddNamedSystem("actual trajectory", MatrixGain(D=np.array([row])))
    if form == "position":
        stiffness = builder.AddNamedSystem("stiffness K_p", Gain(k, 1))
        builder.Connect(stiffness.get_output_port(), balance.get_input_port(0))
        builder.ExportInput(stiffness.get_input_port(), "commanded_trajectory")
    else:
        builder.ExportInput(balance.get_input_port(0), "force")
    builder.Connect(environment.get_output_port(), balance.get_input_port(1))
    builder.Connect(balance.get_output_port(), motion.get_input_port())
    builder.Connect(motion.get_output_port(), environment.get_input_port())
    builder.Connect(motion.get_output_port(), actual.get_input_port())
    builder.ExportOutput(actual.get_output_port(), "actual_trajectory")
    plant = builder.Build()
    plant.set_name("plant")
    return plant


def _make_continuous_error() -> Diagram:
    builder = DiagramBuilder()
    minus = builder.AddNamedSystem("minus", Gain(-1.0, 1))
    error = builder.AddNamedSystem("error", Adder(2, 1))
    builder.Connect(minus.get_output_port(), error.get_input_port(1))
    builder.ExportInput(error.get_input_port(0), "desired_trajectory")
    builder.ExportInput(minus.get_input_port(), "actual_trajectory")
    builder.ExportOutput(error.get_output_port(), "error")
    return builder.Build()
