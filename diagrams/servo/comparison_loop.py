"""A state machine or a PID with a camera corrects a step, on any linear plant with its flaws.

One plant and one camera, and the two controllers that are designed for them from one number.
"""

import warnings
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Final, Literal

from pydrake.common import RandomDistribution
from pydrake.systems.framework import Diagram, DiagramBuilder, LeafSystem
from pydrake.systems.primitives import (
    Adder,
    ConstantVectorSource,
    DiscreteTimeDelay,
    RandomSource,
)

from chamfer.models.plants.measured_step import identify, read_step, unit_doubts
from chamfer.models.plants.servo_plant import ServoPlantParams, TransferFunction, transfer_function
from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_positive,
    within,
)
from chamfer.systems.exact_discretisation import discretise
from chamfer.systems.ports import require_ports
from chamfer.systems.servo.backlash import Backlash
from chamfer.systems.servo.compensator import TrajectoryCompensator
from chamfer.systems.servo.compensator_law import COMPENSATES, AxisParams, CompensatorParams
from chamfer.systems.servo.desired_trajectory import Step
from chamfer.systems.servo.pid_law import PidGains, SampledPidParams
from chamfer.systems.servo.sampled_pid import SampledPid
from chamfer.systems.servo.servo_plant import make_linear_plant
from chamfer.systems.servo.settling import SettlingPlant, sample_plant
from chamfer.systems.servo.timed_design import SettlingTask, timed_axis, timed_gains
from chamfer.systems.vision.measured_error import (
    CameraErrorParams,
    MeasuredErrorParams,
    add_measured_error,
)

ControllerKind = Literal["fsm", "pid"]

STEPS: Final = 16  # of the plant, between two frames
_TOLERANCE: Final = 0.05  # of the step
_CAMERA_ERRORS: Final = 3.0  # least tolerance, in largest errors of the camera
_REACH: Final = 2.0  # limit of the compensation, in what holds the step
_SETTLING_TIMES: Final = 3.0  # of a run


@dataclass(frozen=True, kw_only=True)
class ServoCameraParams(CameraErrorParams):
    """The camera that measures the error."""

    period: float = 1 / 60  # s, between two frames, and of both controllers; assumed
    resolution: float = 2e-4  # m, assumed
    latency: float = 0.02  # s, assumed
    noise: float = 1e-4  # m, assumed
    lost: float = 0.0  # share of frames without a measurement

    def __post_init__(self) -> None:
        super().__post_init__()
        require_positive(self, "period")
        if not 0 <= self.lost < 1:
            raise ParameterError("lost", self.lost, "0 <= share < 1")

    @property
    def measurement(self) -> MeasuredErrorParams:
        """The block that makes a measured error of the true one."""
        return MeasuredErrorParams(
            period=self.period,
            resolution=self.resolution,
            latency=self.latency,
            noise=self.noise,
        )


@dataclass(frozen=True, kw_only=True)
class ComparedLoopScenario:
    """A step that a camera measures, for a state machine and a PID of like design."""

    desired: Step = field(default_factory=lambda: Step(amplitude=0.02))
    plant: ServoPlantParams = field(default_factory=ServoPlantParams)
    friction: float = 0.0
    # m of the command, by which it goes ahead before the plant follows, either way: dry friction
    # over stiffness, or half of a backlash
    camera: ServoCameraParams = field(default_factory=ServoCameraParams)
    settling_time: float = 1.5  # s, the one number that both controllers are designed from
    tolerance: float | None = None
    # m, within which the error counts as settled; None: 5 % of the step, or three times the
    # camera's largest error if that is more
    fsm: AxisParams | None = None  # the state machine's settings; None: designed
    pid: PidGains | None = None  # the PID's gains; None: designed
    duration: float | None = None  # s, of a run; None: three times the settling time

    def __post_init__(self) -> None:
        require_positive(self, "settling_time", "tolerance", "duration")
        require_not_negative(self, "friction")
        with within("desired"):
            require_positive(self.desired, "amplitude")
        if self.duration is not None and not self.duration > self.settling_time:
            allowed = f"more than the settling time, {self.settling_time:g} s"
            raise ParameterError("duration", self.duration, allowed)


@dataclass(frozen=True, kw_only=True)
class ResolvedComparedLoopScenario(ComparedLoopScenario):
    """The loop with plant identified, tolerance and both controllers."""

    tolerance: float = field()
    fsm: AxisParams = field()
    pid: PidGains = field()
    duration: float = field()


def sampled_response(plant: TransferFunction, camera: ServoCameraParams) -> SettlingPlant:
    """Return a plant with all dead times, sampled at the camera's period.

    Raises:
        ParameterError: If the plant is not stable, or does not follow its command at rest.
    """
    return sample_plant(
        make_linear_plant(plant.state_space()),
        camera.period,
        delay_samples=camera.measurement.delay_samples,
        dead_time=plant.dead_time,
        owner="camera.",
    )


def what_is_open(scenario: ComparedLoopScenario) -> dict[str, Any]:
    """Return the plant identified, tolerance, duration and both controllers of a scenario.

    Raises:
        ParameterError: If a controller can't settle in time, naming the least time that it needs.
    """
    plant = scenario.plant
    if plant.measured is not None and plant.identified is None:
        with within("plant"):
            step = read_step(Path(plant.measured))
            identified = identify(step)
        plant = replace(plant, identified=identified)
        for doubt in unit_doubts(step, identified):
            warnings.warn(f"plant.measured is {plant.measured!r}: {doubt}", stacklevel=2)
    with within("camera"):
        bound = scenario.camera.measurement.bound
    height, tolerance = scenario.desired.amplitude, scenario.tolerance
    if tolerance is None:
        tolerance = max(_TOLERANCE * height, _CAMERA_ERRORS * bound)
    duration = scenario.duration or _SETTLING_TIMES * scenario.settling_time
    found = {"plant": plant, "tolerance": tolerance, "duration": duration}
    if scenario.fsm is not None and scenario.pid is not None:
        return found
    task = SettlingTask(
        error=height,
        tolerance=tolerance,
        settling_time=scenario.settling_time,
        measurement_error=bound,
        period=scenario.camera.period,
    )
    response = sampled_response(transfer_function(plant), scenario.camera)
    limit = _REACH * height / response.gain
    fsm = scenario.fsm or timed_axis(task, response, limit=limit)
    return found | {"fsm": fsm, "pid": scenario.pid or timed_gains(task, response, limit=limit)}


def make_compared_diagram(
    scenario: ResolvedComparedLoopScenario,
    kind: ControllerKind,
    *,
    controller: LeafSystem | None = None,
) -> Diagram:
    """Build one of the two loops, with the outputs ``position`` and ``command``, m.

    The plant takes exact steps of a sixteenth of the camera's period, to which its dead time is
    rounded. Noise and lost frames are the same for both controllers with one seed.

    Args:
        scenario: With both controllers.
        kind: The controller to use.
        controller: Your own controller instead. Its ports are vectors of size 1: the input
            ``error``, m, desired minus measured position, NaN while nothing is seen; the output
            ``compensation``, m, the command.

    Raises:
        ParameterError: If the controller has other ports.
    """
    period = scenario.camera.period
    step = period / STEPS
    model = transfer_function(scenario.plant)
    builder = DiagramBuilder()
    desired = builder.AddNamedSystem(
        "desired position", ConstantVectorSource([scenario.desired.amplitude])
    )
    vision = add_measured_error(builder, scenario.camera.measurement)
    if lost := scenario.camera.lost:
        # A frame shows the part where the sum is 0.5 and more.
        source = RandomSource(RandomDistribution.kUniform, 1, period)
        drawn = builder.AddNamedSystem("lost frames", source)
        least = builder.AddNamedSystem("share", ConstantVectorSource([0.5 - lost]))
        seen = builder.AddNamedSystem("frames", Adder(2, 1))
        builder.Connect(drawn.get_output_port(), seen.get_input_port(0))
        builder.Connect(least.get_output_port(), seen.get_input_port(1))
        builder.Connect(seen.get_output_port(), vision.GetInputPort("visible"))
    law: LeafSystem
    if controller is not None:
        require_ports("controller", controller, inputs={"error": 1}, outputs={"compensation": 1})
        law = controller
    elif kind == "fsm":
        law = TrajectoryCompensator(CompensatorParams(axes=(scenario.fsm,), period=period))
        law.law.in_units(error="m", **dict.fromkeys(COMPENSATES, "m"))
    else:
        law = SampledPid(SampledPidParams(axes=(scenario.pid,), period=period))
        law.law.in_units(error="m", compensation="m")
    law = builder.AddNamedSystem(f"controller {kind.upper()}", law)
    plant = builder.AddNamedSystem(
        "plant", discretise(make_linear_plant(model.state_space()), step)
    )
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
    loop.set_name(f"{kind.upper()} loop")
    return loop
