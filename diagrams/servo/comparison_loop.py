"""A state machine or a PID that undoes a step by sight, on any linear plant with its flaws."""

from typing import Literal

from pydrake.common import RandomDistribution
from pydrake.systems.framework import Diagram, DiagramBuilder, OutputPort
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    DiscreteTimeDelay,
    RandomSource,
)

from chamfer.diagrams.servo.comparison_scenario import (
    ComparedLoopScenario,
    linear_plant,
    resolve_compared,
)
from chamfer.models.plants.servo_plant import transfer_function
from chamfer.models.validation import known
from chamfer.systems.exact_discretisation import discretise
from chamfer.systems.servo.backlash import Backlash
from chamfer.systems.servo.compensator import CompensatorParams, TrajectoryCompensator
from chamfer.systems.servo.sampled_pid import SampledPid, SampledPidParams
from chamfer.systems.vision.measured_error import add_measured_error

Controller = Literal["fsm", "pid"]

STEPS = 16  # of the plant, between two frames


def make_compared_diagram(scenario: ComparedLoopScenario, controller: Controller) -> Diagram:
    """Build one of the two loops; it exports ``position`` and ``command``, m.

    The plant takes exact steps of a sixteenth of the camera's period, to which its dead time is
    rounded. Noise and lost frames are the same for both controllers with one seed.

    Args:
        scenario: What it leaves open is designed.
        controller: Which of the two.
    """
    scenario = resolve_compared(scenario)
    period = scenario.camera.period
    step = period / STEPS
    model = transfer_function(scenario.plant)
    builder = DiagramBuilder()
    desired = builder.AddNamedSystem(
        "desired position", ConstantVectorSource([scenario.desired.amplitude])
    )
    vision = add_measured_error(builder, scenario.camera.measurement)
    if scenario.camera.lost:
        builder.Connect(
            _add_frames(builder, scenario.camera.lost, period), vision.GetInputPort("visible")
        )
    if controller == "fsm":
        axis = known("fsm", scenario.fsm)
        law = TrajectoryCompensator(CompensatorParams(axes=(axis,), period=period))
    else:
        gains = known("pid", scenario.pid)
        law = SampledPid(SampledPidParams(axes=(gains,), period=period))
    law = builder.AddNamedSystem(f"controller {controller.upper()}", law)
    plant = builder.AddNamedSystem("plant", discretise(linear_plant(model), step))
    follows = law.GetOutputPort("compensation")
    if scenario.friction:
        play = builder.AddNamedSystem("dry friction", Backlash(scenario.friction, period=step))
        builder.Connect(follows, play.get_input_port())
        follows = play.get_output_port()
    if late := round(model.dead_time / step):
        waits = builder.AddNamedSystem("dead time", DiscreteTimeDelay(step, late, 1))
        builder.Connect(follows, waits.get_input_port())
        follows = waits.get_output_port()
    builder.Connect(follows, plant.get_input_port(0))
    builder.Connect(desired.get_output_port(), vision.GetInputPort("desired_trajectory"))
    builder.Connect(plant.get_output_port(0), vision.GetInputPort("actual_trajectory"))
    builder.Connect(vision.GetOutputPort("error"), law.GetInputPort("error"))
    builder.ExportOutput(plant.get_output_port(0), "position")
    builder.ExportOutput(law.GetOutputPort("compensation"), "command")
    loop = builder.Build()
    loop.set_name(f"{controller.upper()} loop")
    return loop


def _add_frames(builder: DiagramBuilder, lost: float, period: float) -> OutputPort:
    """Add what says whether a frame shows the part: 0.5 and more if it does."""
    drawn = builder.AddNamedSystem(
        "lost frames", RandomSource(RandomDistribution.kUniform, 1, period)
    )
    least = builder.AddNamedSystem("share", ConstantVectorSource([0.5 - lost]))
    seen = builder.AddNamedSystem("frames", Adder(2, 1))
    builder.Connect(drawn.get_output_port(), seen.get_input_port(0))
    builder.Connect(least.get_output_port(), seen.get_input_port(1))
    return seen.get_output_port()
