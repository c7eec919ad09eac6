"""One plant and one camera, and the two controllers that are designed for them."""

from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TypeVar

from pydrake.systems.primitives import LinearSystem

from chamfer.models.plants.measured_step import identify, read_step
from chamfer.models.plants.servo_plant import ServoPlantParams, TransferFunction, transfer_function
from chamfer.models.validation import (
    ParameterError,
    require_not_negative,
    require_positive,
    within,
)
from chamfer.systems.servo.compensator import AxisParams
from chamfer.systems.servo.desired_trajectory import Step
from chamfer.systems.servo.sampled_pid import PidGains
from chamfer.systems.servo.settling import SettlingPlant, sample_plant
from chamfer.systems.servo.timed_design import SettlingTask, timed_axis, timed_gains
from chamfer.systems.vision.measured_error import CameraErrorParams, MeasuredErrorParams

_TOLERANCE = 0.05  # of the step
_CAMERA_ERRORS = 3.0  # least tolerance, in largest errors of the camera
_REACH = 2.0  # limit of the compensation, in what holds the step
_SETTLING_TIMES = 3.0  # of a run


@dataclass(frozen=True, kw_only=True)
class ServoCameraParams(CameraErrorParams):
    """The camera that measures the error."""

    period: float = 1 / 60  # s, between two frames, and of both controllers; assumed
    resolution: float = 2e-4  # m, assumed
    latency: float = 0.02  # s, assumed
    noise: float = 1e-4  # m, assumed
    lost: float = 0.0  # share of frames in which nothing is found

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
    """A step that is undone by sight; a state machine and a PID are designed for it alike."""

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
        require_positive(self, "settling_time")
        require_not_negative(self, "friction")
        with within("desired"):
            require_positive(self.desired, "amplitude")
        for name in ("tolerance", "duration"):
            if getattr(self, name) is not None:
                require_positive(self, name)
        if self.duration is not None and not self.duration > self.settling_time:
            allowed = f"more than the settling time, {self.settling_time:g} s"
            raise ParameterError("duration", self.duration, allowed)


ScenarioT = TypeVar("ScenarioT", bound=ComparedLoopScenario)


def linear_plant(plant: TransferFunction) -> LinearSystem:
    """Return a plant without its dead time as a continuous block, commanded to actual position."""
    block = LinearSystem(*plant.state_space())
    block.set_name("plant")
    return block


def sampled_response(plant: TransferFunction, camera: ServoCameraParams) -> SettlingPlant:
    """Return a plant behind all dead times, as controllers with the camera's period meet it.

    Raises:
        ParameterError: If the plant is not stable, or does not follow its command at rest.
    """
    try:
        return sample_plant(
            linear_plant(plant),
            camera.period,
            delay_samples=camera.measurement.delay_samples,
            dead_time=plant.dead_time,
        )
    except ParameterError as error:
        name = "camera.period" if error.name == "period" else f"the plant's {error.name}"
        raise ParameterError(name, error.value, error.allowed) from error


def resolve_compared(scenario: ScenarioT) -> ScenarioT:
    """Return the scenario with plant identified, tolerance and both controllers.

    Raises:
        ParameterError: If a controller can't settle in time, naming the least time that it needs.
    """
    plant = scenario.plant
    if plant.measured is not None and plant.identified is None:
        with within("plant"):
            plant = replace(plant, identified=identify(read_step(Path(plant.measured))))
    with within("camera"):
        bound = scenario.camera.measurement.bound
    height, tolerance = scenario.desired.amplitude, scenario.tolerance
    if tolerance is None:
        tolerance = max(_TOLERANCE * height, _CAMERA_ERRORS * bound)
    fsm, pid = scenario.fsm, scenario.pid
    if fsm is None or pid is None:
        task = SettlingTask(
            error=height,
            tolerance=tolerance,
            settling_time=scenario.settling_time,
            measurement_error=bound,
            period=scenario.camera.period,
        )
        response = sampled_response(transfer_function(plant), scenario.camera)
        limit = _REACH * height / response.gain
        fsm = fsm or timed_axis(task, response, limit=limit)
        pid = pid or timed_gains(task, response, limit=limit)
    return replace(
        scenario,
        plant=plant,
        tolerance=tolerance,
        fsm=fsm,
        pid=pid,
        duration=scenario.duration or _SETTLING_TIMES * scenario.settling_time,
    )
