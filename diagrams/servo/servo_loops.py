"""The servo loops of Figs. 5 to 7: PID and state machine on one axis, side by side.

Source: Ruybal, Lumia and Wood, section 3. Each loop is a diagram of its own with the blocks of
Figs. 6 and 7: desired trajectory, computer vision, controller and plant; the plant is the inner
loop of Fig. 5, impedance control A(s) with the environment B(s) fed back.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, Literal

from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem, System
from pydrake.systems.primitives import Adder, Gain

from chamfer.diagrams.servo.servo_scenario import (
    ServoScenario,
    camera_gains,
    fsm_axis,
    has_feedforward,
)
from chamfer.models.plants.servo_plant import Form
from chamfer.models.validation import ParameterError
from chamfer.systems.exact_discretisation import discretise
from chamfer.systems.ports import require_ports
from chamfer.systems.servo.compensator import TrajectoryCompensator
from chamfer.systems.servo.compensator_law import COMPENSATES, CompensatorParams
from chamfer.systems.servo.desired_trajectory import make_desired_trajectory
from chamfer.systems.servo.pid import make_pid
from chamfer.systems.servo.pid_law import PidGains, SampledPidParams
from chamfer.systems.servo.sampled_pid import SampledPid
from chamfer.systems.servo.servo_plant import make_plant
from chamfer.systems.vision.measured_error import add_measured_error


@dataclass(frozen=True)
class ServoLoop:
    """Which controller drives which form of the plant."""

    controller: Literal["PID", "FSM", "PID by camera", "PID for the camera"]
    form: Form | None  # None: the scenario's
    title: str
    feedforward: bool | None = None  # None: the scenario's


LOOPS: Final = {
    "pid": ServoLoop("PID", "velocity", "PID loop"),
    "fsm": ServoLoop("FSM", None, "FSM loop"),
    "fsm_feedforward": ServoLoop("FSM", None, "FSM loop with feedforward", True),
    "fsm_compensation": ServoLoop("FSM", None, "FSM loop, compensation only", False),
    "fsm_velocity": ServoLoop("FSM", "velocity", "FSM loop, force to velocity"),
    "pid_position": ServoLoop("PID", "compliance", "PID loop, force to position"),
    "pid_command": ServoLoop("PID", "position", "PID loop, commanded position to position"),
    "pid_camera": ServoLoop("PID by camera", "velocity", "PID loop behind the camera"),
    "pid_designed": ServoLoop("PID for the camera", "position", "PID loop for the camera"),
}


def make_servo_diagram(
    scenario: ServoScenario,
    *,
    loops: Sequence[str] | None = None,
    signals: Sequence[str] = ("actual_trajectory",),
    step: float | None = None,
    controller: LeafSystem | None = None,
) -> Diagram:
    """Build loops of :data:`LOOPS` side by side.

    Args:
        scenario: The trajectory and the parameters.
        loops: The loops to build. None: ``pid`` and ``fsm``, or ``fsm`` alone with a controller.
        signals: The outputs of each to export, as ``<loop>.<signal>``:
            ``desired_trajectory``, ``controller`` (force N or compensation m),
            ``actual_trajectory``.
        step: s. None keeps every linear part continuous, one block per block of the paper's
            figures. Otherwise the linear parts, a whole PID loop or the FSM's plant and
            trajectory, take exact steps of that size. The FSM's period has to be a multiple of
            it, best by a power of two.
        controller: Your own controller instead of the law of the one loop. Its ports are vectors
            of size 1. The input ``error``, m, is desired minus actual trajectory. In an FSM loop
            it is the camera's measurement, NaN while it has seen nothing. The output
            ``compensation`` is in N or, with a plant in position form, m. With feedforward it
            also needs the input ``desired_trajectory``, m, and the output ``command``, m.

    Raises:
        ParameterError: If the controller has other ports, or there is not one loop for it. The
            loop behind the camera is ``fsm``.
    """
    if loops is None:
        loops = ("pid", "fsm") if controller is None else ("fsm",)
    if controller is not None and (len(loops) != 1 or "camera" in LOOPS[loops[0]].controller):
        raise ParameterError("loops", tuple(loops), "one of a PID or FSM, whose place it takes")
    builder = DiagramBuilder()
    for name in loops:
        loop = LOOPS[name]
        form = loop.form or scenario.plant.form
        if loop.controller == "PID":
            diagram = make_pid_loop(scenario, form, step=step, controller=controller)
        elif loop.controller != "FSM":
            gains, plant = camera_pid(scenario, name)
            law = SampledPid(SampledPidParams(axes=(gains,), period=scenario.fsm.period))
            law.law.in_units(error="m", compensation=_unit(form))
            diagram = _wire("FSM", scenario, form, law, step=step, plant=plant)
        else:
            ahead = loop.feedforward
            diagram = make_fsm_loop(
                scenario, form, feedforward=ahead, step=step, controller=controller
            )
        diagram.set_name(loop.title)
        builder.AddSystem(diagram)
        for signal in signals:
            builder.ExportOutput(diagram.GetOutputPort(signal), f"{name}.{signal}")
    servo = builder.Build()
    servo.set_name("PID and FSM trajectory compensation")
    return servo


def _unit(form: Form) -> str:
    """Return what a plant is commanded in."""
    return "m" if form == "position" else "N"


def make_pid_loop(
    scenario: ServoScenario,
    form: Form,
    *,
    step: float | None = None,
    controller: LeafSystem | None = None,
) -> Diagram:
    """Build Fig. 6: the PID of eq. (2), which sees the continuous error, and a plant.

    With your own controller only trajectory and plant take exact steps.
    """
    if controller is None and step is not None:
        return discretise(_wire("PID", scenario, form, None), step)
    return _wire("PID", scenario, form, controller, step=step)


def camera_pid(scenario: ServoScenario, name: str) -> tuple[PidGains, Diagram]:
    """Return the sampled law of a PID loop behind the camera, and the plant that it drives.

    Eq. (2) stays continuous: the law only holds a frame's error until the next one, and the plant
    has eq. (2) before it.
    """
    plant = make_plant(scenario.plant, LOOPS[name].form or scenario.plant.form)
    if LOOPS[name].controller == "PID for the camera":
        return camera_gains(scenario), plant
    builder = DiagramBuilder()
    builder.AddNamedSystem("plant", plant)
    pid = builder.AddNamedSystem("controller PID", make_pid(scenario.pid))
    builder.Connect(pid.get_output_port(), plant.get_input_port(0))
    builder.ExportInput(pid.get_input_port(), "error")
    builder.ExportOutput(plant.get_output_port(0), "actual_trajectory")
    return PidGains(proportional=1.0, integral=0.0), builder.Build()


def make_fsm_loop(
    scenario: ServoScenario,
    form: Form,
    *,
    feedforward: bool | None = None,
    step: float | None = None,
    controller: LeafSystem | None = None,
) -> Diagram:
    """Build Fig. 7: the state machine, which sees the camera's error, and a plant.

    With feedforward (None: the scenario's choice) the compensation is added to the desired
    trajectory, as on the robot. Only a plant that takes a commanded position can have it.
    """
    if feedforward is None:
        feedforward = has_feedforward(scenario)
    feedforward = feedforward and form == "position"
    return _wire("FSM", scenario, form, controller, step=step, feedforward=feedforward)


def _wire(
    kind: Literal["PID", "FSM"],
    scenario: ServoScenario,
    form: Form,
    own: LeafSystem | None,
    *,
    step: float | None = None,
    feedforward: bool = False,
    plant: Diagram | None = None,
) -> Diagram:
    """Close the loop through its own law, or the one of its kind."""

    def linear(system: System) -> System:
        return system if step is None else discretise(system, step)

    if own is not None:
        require_ports(
            "controller",
            own,
            inputs={"error": 1} | ({"desired_trajectory": 1} if feedforward else {}),
            outputs={"compensation": 1} | ({"command": 1} if feedforward else {}),
        )
    builder = DiagramBuilder()
    desired = builder.AddNamedSystem(
        "desired trajectory", linear(make_desired_trajectory(scenario.desired))
    )
    vision: System
    law: System
    if kind == "PID":
        vision = builder.AddNamedSystem("computer vision", _make_continuous_error())
        law = own or make_pid(scenario.pid)
    else:
        vision = add_measured_error(builder, scenario.measurement)
        axis = fsm_axis(scenario, form)
        fsm = TrajectoryCompensator(CompensatorParams(axes=(axis,), period=scenario.fsm.period))
        fsm.law.in_units(error="m", **dict.fromkeys(COMPENSATES, _unit(form)))
        law = own or fsm
    builder.AddNamedSystem("controller" if own else f"controller {kind}", law)
    plant = builder.AddNamedSystem("plant", linear(plant or make_plant(scenario.plant, form)))
    if kind == "PID" and own is None:
        error, compensation = law.get_input_port(0), law.get_output_port(0)
    else:
        error, compensation = law.GetInputPort("error"), law.GetOutputPort("compensation")
    command = compensation
    if feedforward:
        builder.Connect(desired.get_output_port(0), law.GetInputPort("desired_trajectory"))
        command = law.GetOutputPort("command")
    builder.Connect(desired.get_output_port(0), vision.GetInputPort("desired_trajectory"))
    builder.Connect(plant.get_output_port(0), vision.GetInputPort("actual_trajectory"))
    builder.Connect(vision.GetOutputPort("error"), error)
    builder.Connect(command, plant.get_input_port(0))
    builder.ExportOutput(desired.get_output_port(0), "desired_trajectory")
    builder.ExportOutput(compensation, "controller")
    builder.ExportOutput(plant.get_output_port(0), "actual_trajectory")
    loop = builder.Build()
    loop.set_name(f"{kind} loop")
    return loop


def _make_continuous_error() -> Diagram:
    builder = DiagramBuilder()
    minus = builder.AddNamedSystem("minus", Gain(-1.0, 1))
    error = builder.AddNamedSystem("error", Adder(2, 1))
    builder.Connect(minus.get_output_port(), error.get_input_port(1))
    builder.ExportInput(error.get_input_port(0), "desired_trajectory")
    builder.ExportInput(minus.get_input_port(), "actual_trajectory")
    builder.ExportOutput(error.get_output_port(), "error")
    return builder.Build()
